"""Record and tables of `bench device`."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from supersampler.io.machine import installed_versions
from supersampler_bench.record import BenchRecord, sizes_text, table
from supersampler_bench.timing.gpu_limits import GpuLimits, measure_limits
from supersampler_bench.timing.gpu_steps import GpuImages, GpuStep
from supersampler_bench.timing.other_runtimes import RuntimeStep

if TYPE_CHECKING:
    import wgpu

MIN_FRACTION = 0.05
"""Fraction of a step's time below which the table omits a pass."""


@dataclass(frozen=True)
class GpuRecord(BenchRecord):
    """Times of the GPU backend on a device."""

    adapter: dict[str, Any]  # wgpu's description, with the driver
    packages: dict[str, str]  # versions of wgpu and of its native library
    limits: GpuLimits
    images: list[GpuImages] = field(default_factory=list)
    steps: list[GpuStep] = field(default_factory=list)
    others: list[RuntimeStep] = field(default_factory=list)
    BENCH = "device-gpu"
    TABLES = ("", "passes", "images", "others")

    @classmethod
    def of(cls, device: "wgpu.GPUDevice") -> "GpuRecord":
        """Measure the limits of a device, and return its record without times."""
        from wgpu.backends import wgpu_native

        native = ".".join(map(str, wgpu_native.lib_version_info))
        packages = {**installed_versions("wgpu"), "wgpu-native": native}
        return cls(dict(device.adapter.info), packages, measure_limits(device))

    def table(self) -> str:
        """Return the table of steps."""
        limits = self.limits
        rows = [
            [
                sizes_text(s.render, s.display),
                s.method,
                *(f"{time:.2f}" for time in (s.median, s.p95)),
                f"{s.moved / 1e9:.2f}",
                f"{s.multiply_adds / 1e9:.1f}",
                f"{(floor := limits.floor_ms(s.moved, s.multiply_adds)):.2f}",
                f"{s.median / floor:.1f}",
                f"{s.wall:.0f}",
                f"{s.first:.1f}",
            ]
            for s in self.steps
        ]
        caption = (
            f"{self.adapter['device']}, {self.adapter['backend_type']}, driver "
            f"{self.adapter['description']}, wgpu {self.packages['wgpu']}. "
            f"{self.steps[0].steps if rows else 0} steps by the device's timestamps, with frame and image in "
            "textures, measured exposure, and all pixels moving; methods of one size alternate. Floor: the "
            f"time of the declared bytes at the {1e-9 * limits.moved:.0f} GB/s of a copy on this device, or "
            f"of the network's multiply-adds at the {1e-12 * limits.multiplied:.1f}·10^12 per second of "
            "`dot4I8Packed`, whichever is longer. Arrays: `step` from numpy to numpy. First: seconds until "
            "the first steps are done, with compilation."
        )
        headings = ["size", "method", "ms:", "p95:", "GB:", "10^9 multiply-adds:", "floor ms:", "of floor:"]
        return table([*headings, "arrays ms:", "first s:"], rows, caption)

    def passes_table(self) -> str:
        """Return the table of passes at the first size."""
        first = [(s.render, s.display) for s in self.steps[:1]]
        shown = [s for s in self.steps if (s.render, s.display) in first]
        rows = [
            [
                s.method,
                one.name,
                *(f"{one.median:.3f}", f"{one.p95:.3f}"),
                f"{one.moved / 1e6:.0f}",
                f"{one.multiply_adds / 1e9:.1f}",
                f"{one.median / max(self.limits.floor_ms(one.moved, one.multiply_adds), 1e-6):.1f}",
            ]
            for s in shown
            for one in s.passes
            if one.median >= MIN_FRACTION * s.median
        ]
        sums = "; ".join(
            f"{s.method} {sum(one.median for one in s.passes):.2f} of {s.median:.2f}" for s in shown
        )
        caption = (
            f"Passes of at least {MIN_FRACTION:.0%} of a step, "
            f"{', '.join(sizes_text(*pair) for pair in first)}; each waits for the previous one. "
            f"Sums of all passes, ms: {sums}."
        )
        headings = ["method", "pass", "ms:", "p95:", "MB:", "10^9 multiply-adds:", "of floor:"]
        return table(headings, rows, caption)

    def images_table(self) -> str:
        """Return the table of differences from the CPU backend's images."""
        rows = [[i.method, f"{i.mean:.1e}", f"{i.p999:.1e}", f"{i.largest:.1e}"] for i in self.images]
        shown = self.images[:1]
        caption = (
            "Differences from the images of the CPU backend, in [0, 1] after the display transform: "
            + "".join(f"{one.frames} frames, {sizes_text(one.render, one.display)}. " for one in shown)
            + "At 99.9 %: of the frame where it is largest."
        )
        return table(["method", "mean:", "at 99.9 %:", "largest:"], rows, caption)

    def others_table(self) -> str:
        """Return the table of other runtimes."""
        rows = [
            [
                *(sizes_text(s.render, s.display), s.method, s.runtime),
                *(f"{s.median:.2f}", f"{s.p95:.2f}", f"{s.first:.1f}"),
            ]
            for s in self.others
        ]
        versions = ", ".join(dict.fromkeys(f"{s.runtime.split(',')[0]} {s.version}" for s in self.others))
        caption = (
            f"Other runtimes on the same device ({versions or 'none'}), wall time of a step; torch with "
            "frame and image on the device, ONNX Runtime from arrays to arrays."
        )
        return table(["size", "method", "runtime", "ms:", "p95:", "first s:"], rows, caption)
