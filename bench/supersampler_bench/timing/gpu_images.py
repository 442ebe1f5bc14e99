"""Differences between images of the GPU and CPU backends, on the device whose times are measured."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from supersampler import Frame, Model, Upscaler
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler_bench.specs import compatible
from supersampler_bench.timing.latency import plaza_frames

if TYPE_CHECKING:
    import wgpu

RENDER, DISPLAY = (161, 91), (321, 181)
"""Odd sizes, so that workgroups and 2x2 pixels extend beyond the border."""
FRAMES = 8


@dataclass(frozen=True)
class GpuImages:
    """Differences from images of the CPU backend, in [0, 1] after the display transform."""

    method: str
    render: Size
    display: Size
    frames: int
    mean: float
    p999: float  # largest 99.9th percentile of a frame
    largest: float


def compare_images(
    device: "wgpu.GPUDevice", methods: Sequence[str], *, on_left_out: Callable[[str], None] = lambda _: None
) -> Iterator[GpuImages]:
    """Step both backends through the shipped shot, whose exposure both measure."""
    frames = plaza_frames(RENDER, count=FRAMES)
    frames = [replace(frame, exposure=None, reset=not i) for i, frame in enumerate(frames)]
    for method in compatible(methods, RENDER, DISPLAY, on_left_out):
        try:
            steps = [_stepper(method, executor="cpu"), _stepper(method, executor="gpu", device=device)]
        except ArgumentError as error:  # it has no shaders
            on_left_out(f"{method}: {error}")
            continue
        pairs = [[display_transform(step(frame)) for step in steps] for frame in frames]
        off = [np.abs(one - other) for one, other in pairs]
        p999 = max(float(np.quantile(one, 0.999)) for one in off)
        yield GpuImages(method, RENDER, DISPLAY, FRAMES, float(np.mean(off)), p999, float(np.max(off)))


def _stepper(method: str, **where: Any) -> Callable[[Frame], Float32]:
    model = Model.load(method, **where)
    return Upscaler(model, display_size=DISPLAY, skip=False, validate="off").step
