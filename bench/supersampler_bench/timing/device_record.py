"""Record and tables of `bench device --executor gpu`, with images compared with those of the CPU backend."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from supersampler import Frame, Model, Upscaler
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler.io.machine import installed_versions
from supersampler.methods.model_file import find_model, sha256
from supersampler_bench.markdown import size_text, table
from supersampler_bench.record import BenchRecord
from supersampler_bench.specs import compatible
from supersampler_bench.timing.device_gpu import DeviceLimits, GpuStep, frame_textures, measure_limits
from supersampler_bench.timing.latency import frames_of

if TYPE_CHECKING:
    import wgpu

RENDER, DISPLAY = (161, 91), (321, 181)
"""Odd sizes, so that workgroups and 2x2 pixels reach over the border."""
FRAMES = 8


@dataclass(frozen=True)
class GpuImages:
    """Differences of images from those of the CPU backend, in [0, 1] after the display transform.

    Attributes:
        method: its name.
        memory: of frames and images: "arrays" or "textures", whose pixels are half floats.
        render: (width, height) of the frames.
        display: (width, height) of the images.
        frames: that were compared.
        mean: of all pixels.
        p999: 99.9th percentile of the frame where it is largest.
        largest: of all pixels.
    """

    method: str
    memory: str
    render: Size
    display: Size
    frames: int
    mean: float
    p999: float
    largest: float


def compare_images(
    device: "wgpu.GPUDevice", methods: Sequence[str], *, on_left_out: Callable[[str], None] = lambda _: None
) -> Iterator[GpuImages]:
    """Step the GPU and the CPU backend through the shipped shot.

    Args:
        device: of the GPU backend.
        methods: names of shipped models, or model folders.
        on_left_out: called with the reason why a method is left out.
    """
    frames = [replace(frame, exposure=None, reset=not i) for i, frame in enumerate(_half_frames())]
    for method in compatible(methods, RENDER, DISPLAY, on_left_out):
        try:
            model = Model.load(method, executor="gpu", device=device)
            expected = _stepper(Model.load(method, executor="cpu"))
        except ArgumentError as error:  # it has no shaders, or no kernels
            on_left_out(f"{method}: {error}")
            continue
        steppers = {"arrays": _stepper(model), "textures": _texture_stepper(model)}
        found: dict[str, list[Float32]] = {memory: [] for memory in steppers}
        for frame in frames:
            reference = display_transform(expected(frame))
            for memory, step in steppers.items():
                found[memory].append(np.abs(display_transform(step(frame)) - reference))
        for memory, off in found.items():
            p999 = max(float(np.quantile(one, 0.999)) for one in off)
            mean, largest = float(np.mean(off)), float(np.max(off))
            yield GpuImages(method, memory, RENDER, DISPLAY, len(off), mean, p999, largest)


def _half_frames() -> list[Frame]:
    """Frames of the shipped shot whose pixels are half floats, as in textures."""
    frames = frames_of(RENDER, count=FRAMES)
    return [replace(f, color=_halves(f.color), motion=_halves(f.motion)) for f in frames]


def _halves(image: Any) -> Float32:
    return np.asarray(image).astype(np.float16).astype(np.float32)


def _stepper(model: Model) -> Callable[[Frame], Float32]:
    return Upscaler(model, display_size=DISPLAY, skip=False, validate="off").step


def _texture_stepper(model: Model) -> Callable[[Frame], Float32]:
    upscaler = Upscaler(model, display_size=DISPLAY, validate="off")
    device, (width, height) = model.gpu.device, DISPLAY
    layout = {"bytes_per_row": 8 * width, "rows_per_image": height}

    def step(frame: Frame) -> Float32:
        given = frame_textures(device, frame)
        image = upscaler.step_textures(given, jitter=frame.jitter, exposure=frame.exposure, reset=frame.reset)
        read = device.queue.read_texture({"texture": image}, layout, (width, height, 1))
        pixels = np.frombuffer(read, np.float16).reshape(height, width, 4)
        return pixels[..., :3].astype(np.float32)

    return step


MIN_SHARE = 0.05
"""Passes with a smaller share of the time of every step are not in the table."""


@dataclass(frozen=True)
class GpuRecord(BenchRecord):
    """Times of the GPU backend on a device.

    Attributes:
        adapter: as wgpu describes it, with the driver.
        packages: versions of wgpu and of its native library.
        models: SHA-256 of each model's files, by model and file.
        limits: of the device.
        steps: times of methods.
        images: differences of their images from those of the CPU backend.
    """

    adapter: dict[str, Any]
    packages: dict[str, str]
    models: dict[str, dict[str, str]]
    limits: DeviceLimits
    steps: list[GpuStep] = field(default_factory=list)
    images: list[GpuImages] = field(default_factory=list)
    BENCH = "device-gpu"
    TABLES = ("", "passes", "images")

    @classmethod
    def of(cls, device: "wgpu.GPUDevice", methods: Sequence[str]) -> "GpuRecord":
        """Measure the limits of a device; return the record of methods without their times."""
        from wgpu.backends import wgpu_native

        native = ".".join(map(str, wgpu_native.lib_version_info))
        models = {
            Path(method).name: {
                path.name: sha256(path) for path in sorted(find_model(method).iterdir()) if path.is_file()
            }
            for method in methods
        }
        packages = {**installed_versions("wgpu"), "wgpu-native": native}
        return cls(dict(device.adapter.info), packages, models, measure_limits(device))

    def table(self) -> str:
        """Return the times of steps as Markdown, with their caption."""
        limits = self.limits
        rows = [
            [
                _sizes(s.render, s.display),
                s.method,
                *(f"{time:.2f}" for time in (s.median, s.p95)),
                f"{s.moved / 1e9:.2f}",
                f"{s.multiply_adds / 1e9:.1f}",
                f"{(floor := limits.min_ms(s.moved, s.multiply_adds)):.2f}",
                f"{s.median / floor:.1f}x",
                f"{s.wall:.0f}",
                f"{s.first:.1f}",
            ]
            for s in self.steps
        ]
        caption = (
            f"{self.adapter['device']}, {self.adapter['backend_type']}, driver "
            f"{self.adapter['description']}, wgpu {self.packages['wgpu']}. "
            f"{self.steps[0].steps if rows else 0} steps by the device's timestamps, frame and image in "
            "textures, exposure measured, all pixels moving; methods of a size take turns. Least: "
            "time of moving the bytes that passes declare at the "
            f"{1e-9 * limits.moved:.0f} GB/s of a copy there, or of the network's multiply-adds at the "
            f"{1e-12 * limits.multiplied:.1f}·10^12 a second that `dot4I8Packed` reaches there, whichever is "
            "longer. Arrays: `step` from numpy to numpy. First: seconds until the first steps are done, "
            "with what has to be compiled for them."
        )
        headings = ["size", "method", "ms:", "p95:", "GB:", "10^9 multiply-adds:", "least ms:", "of least:"]
        return table([*headings, "arrays ms:", "first s:"], rows, caption)

    def passes_table(self) -> str:
        """Return the times of the passes of the largest steps as Markdown, with their caption."""
        first = [(s.render, s.display) for s in self.steps[:1]]
        shown = [s for s in self.steps if (s.render, s.display) in first]
        rows = [
            [
                s.method,
                one.name,
                *(f"{one.median:.3f}", f"{one.p95:.3f}"),
                f"{one.moved / 1e6:.0f}",
                f"{one.multiply_adds / 1e9:.1f}",
                f"{one.median / max(self.limits.min_ms(one.moved, one.multiply_adds), 1e-6):.1f}x",
            ]
            for s in shown
            for one in s.passes
            if one.median >= MIN_SHARE * s.median
        ]
        sums = "; ".join(
            f"{s.method} {sum(one.median for one in s.passes):.2f} of {s.median:.2f}" for s in shown
        )
        caption = (
            f"Passes with at least {MIN_SHARE:.0%} of a step, {', '.join(_sizes(*pair) for pair in first)}; "
            f"each waits for the one before. Sums of all passes, ms: {sums}."
        )
        headings = ["method", "pass", "ms:", "p95:", "MB:", "10^9 multiply-adds:", "of least:"]
        return table(headings, rows, caption)

    def images_table(self) -> str:
        """Return the differences of images as Markdown, with their caption."""
        rows = [
            [i.method, i.memory, *(f"{off:.1e}" for off in (i.mean, i.p999)), f"{i.largest:.3f}"]
            for i in self.images
        ]
        caption = (
            "Differences of images from those of the CPU backend, in [0, 1] after the display transform."
        )
        for one in self.images[:1]:
            caption += f" {one.frames} frames of the shipped shot, {_sizes(one.render, one.display)}."
        return table(["method", "frame and image", "mean:", "99.9 %:", "largest:"], rows, caption)


def _sizes(render: Size, display: Size) -> str:
    return f"{size_text(render)} to {size_text(display)}"
