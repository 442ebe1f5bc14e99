"""Record and tables of `bench device --executor gpu`."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import supersampler
from supersampler.frame import Size
from supersampler.io.machine import installed_versions
from supersampler.methods.model_file import find_model, sha256
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.record import Record
from supersampler_bench.timing.child_process import commit
from supersampler_bench.timing.device_gpu import GpuPass, GpuStep
from supersampler_bench.timing.device_images import GpuImages
from supersampler_bench.timing.device_limits import DeviceLimits

if TYPE_CHECKING:
    import wgpu

BENCH = "device-gpu"
SLOW = 0.05
"""Passes with a smaller share of the time of every step are not in the table."""


@dataclass(frozen=True)
class GpuSubject:
    """Results of one run of `bench device`.

    Attributes:
        adapter: as wgpu describes it, with the driver.
        packages: versions of wgpu and of its native library.
        commit: of the package's sources; None where it is no checkout.
        models: SHA-256 of each model's files, by model and file.
    """

    adapter: dict[str, Any]
    packages: dict[str, str]
    commit: str | None
    models: dict[str, dict[str, str]]


def gpu_subject(device: "wgpu.GPUDevice", methods: Sequence[str]) -> GpuSubject:
    """Return what a measurement of these methods measures."""
    from wgpu.backends import wgpu_native

    native = ".".join(map(str, wgpu_native.lib_version_info))
    models = {
        Path(method).name: {
            path.name: sha256(path) for path in sorted(find_model(method).iterdir()) if path.is_file()
        }
        for method in methods
    }
    packages = {**installed_versions("wgpu"), "wgpu-native": native}
    return GpuSubject(dict(device.adapter.info), packages, commit(Path(supersampler.__file__).parent), models)


def gpu_record(
    subject: GpuSubject,
    limits: DeviceLimits,
    steps: Sequence[GpuStep],
    images: Sequence[GpuImages],
) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {
        "bench": BENCH,
        **asdict(subject),
        "limits": asdict(limits),
        "steps": [asdict(step) for step in steps],
        "images": [asdict(image) for image in images],
    }


def steps_of(record: Record) -> list[GpuStep]:
    """Return the steps in a record by `gpu_record`."""
    return [
        GpuStep(**{**row, "passes": tuple(GpuPass(**one) for one in row["passes"])})
        for row in record["steps"]
    ]


def step_table(record: Record) -> str:
    """Return the times of steps as Markdown, with their caption."""
    limits = DeviceLimits(**record["limits"])
    rows = [
        [
            _sizes(s.render, s.display),
            s.method,
            *(f"{time:.2f}" for time in (s.median, s.p95)),
            f"{s.moved / 1e9:.2f}",
            f"{s.multiply_adds / 1e9:.1f}",
            f"{(least := limits.least_ms(s.moved, s.multiply_adds)):.2f}",
            f"{s.median / least:.1f}x",
            f"{s.wall:.0f}",
            f"{s.first:.1f}",
        ]
        for s in steps_of(record)
    ]
    adapter = record["adapter"]
    caption = (
        f"{adapter['device']}, {adapter['backend_type']}, driver {adapter['description']}, wgpu "
        f"{record['packages']['wgpu']}. {record['steps'][0]['steps'] if rows else 0} steps by the device's "
        "timestamps, frame and image in textures, exposure measured, all pixels moving; methods of a size "
        "take turns. Least: time of moving the bytes that passes declare at the "
        f"{1e-9 * limits.moved:.0f} GB/s of a copy there, or of the network's multiply-adds at the "
        f"{1e-12 * limits.multiplied:.1f}·10^12 a second that `dot4I8Packed` reaches there, whichever is "
        "longer. Arrays: `step` from numpy to numpy. First: seconds until the first steps are done, "
        "with what has to be compiled for them."
    )
    headings = ["size", "method", "ms:", "p95:", "GB:", "10^9 multiply-adds:", "least ms:", "of least:"]
    return table([*headings, "arrays ms:", "first s:"], rows, caption)


def pass_table(record: Record) -> str:
    """Return the times of the passes of the largest steps as Markdown, with their caption."""
    limits, steps = DeviceLimits(**record["limits"]), steps_of(record)
    first = [(s.render, s.display) for s in steps[:1]]
    shown = [s for s in steps if (s.render, s.display) in first]
    rows = [
        [
            s.method,
            one.name,
            f"{one.median:.3f}",
            f"{one.p95:.3f}",
            f"{one.moved / 1e6:.0f}",
            f"{one.multiply_adds / 1e9:.1f}",
            f"{one.median / max(limits.least_ms(one.moved, one.multiply_adds), 1e-6):.1f}x",
        ]
        for s in shown
        for one in s.passes
        if one.median >= SLOW * s.median
    ]
    sums = "; ".join(f"{s.method} {sum(one.median for one in s.passes):.2f} of {s.median:.2f}" for s in shown)
    sizes = ", ".join(_sizes(*pair) for pair in first)
    caption = (
        f"Passes with at least {SLOW:.0%} of a step, {sizes}; each waits for the one before. "
        f"Sums of all passes, ms: {sums}."
    )
    headings = ["method", "pass", "ms:", "p95:", "MB:", "10^9 multiply-adds:", "of least:"]
    return table(headings, rows, caption)


def image_table(record: Record) -> str:
    """Return the differences of images as Markdown, with their caption."""
    images = [GpuImages(**row) for row in record["images"]]
    rows = [
        [i.method, i.memory, *(f"{off:.1e}" for off in (i.mean, i.p999)), f"{i.largest:.3f}"] for i in images
    ]
    caption = "Differences of images from those of the CPU backend, in [0, 1] after the display transform."
    if images:
        caption += (
            f" {images[0].frames} frames of the shipped shot, {_sizes(images[0].render, images[0].display)}."
        )
    return table(["method", "frame and image", "mean:", "99.9 %:", "largest:"], rows, caption)


def _sizes(render: Size, display: Size) -> str:
    return f"{size_text(render)} to {size_text(display)}"
