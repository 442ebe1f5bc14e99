"""Images of the GPU backend against those of the CPU backend, on the device whose times are measured."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from supersampler import Frame, Model, Upscaler
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler_bench.compatibility import compatible
from supersampler_bench.timing.device_gpu import frame_textures
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
    frames = [replace(frame, exposure=None, reset=not i) for i, frame in enumerate(_frames())]
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


def _frames() -> list[Frame]:
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
