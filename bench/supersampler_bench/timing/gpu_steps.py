"""Steps of the GPU backend: times of steps and passes, by timestamps, and differences of images."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from supersampler import ArgumentError, Frame, Model, Upscaler
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler_bench.specs import compatible
from supersampler_bench.timing.gpu_stopwatch import EachDispatch, Stopwatch
from supersampler_bench.timing.latency import plaza_frames, quantiles, take_turns
from supersampler_bench.timing.traffic import pass_costs
from supersampler_model.data.rendered import render_size

if TYPE_CHECKING:
    import wgpu

BURST = 10
"""Steps per command buffer, which keep the device busy."""
WALL_STEPS = 20
IMAGE_SIZES = (161, 91), (321, 181)
"""Odd sizes, so that workgroups and 2x2 pixels extend beyond the border."""
IMAGE_FRAMES = 8
_SAMPLED, _COPY_DST = 4, 2  # usages, as WebGPU numbers them
_CHANNELS = {"color": ("rgba16float", 4), "depth": ("r32float", 1), "motion": ("rg16float", 2)}
Textures = tuple[Frame, dict[str, Any]]


@dataclass(frozen=True)
class GpuPass:
    """A pass of a step."""

    name: str  # of the shader, with its level if a method has several
    median: float
    p95: float
    moved: int  # declared bytes, read and written
    multiply_adds: int  # of the network


@dataclass(frozen=True)
class GpuStep:
    """Times of a method at a size."""

    method: str
    render: Size
    display: Size
    precision: str  # of the network
    steps: int  # that were timed
    median: float  # this and the next two fields: on textures, by the device's clock
    p95: float
    p99: float
    wall: float  # this and the next field: of `Upscaler.step` on arrays, by the CPU's clock
    wall_p95: float
    first: float  # seconds to load the model, compile its shaders and run its first steps
    passes: tuple[GpuPass, ...]  # in order; each waits for the previous one

    @property
    def moved(self) -> int:
        """Bytes that all passes declare."""
        return sum(one.moved for one in self.passes)

    @property
    def multiply_adds(self) -> int:
        """Multiply-adds of the network in all passes."""
        return sum(one.multiply_adds for one in self.passes)


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


def measure_gpu(
    device: "wgpu.GPUDevice",
    methods: Sequence[str],
    displays: Sequence[Size],
    ratios: Sequence[float],
    *,
    steps: int = 100,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> Iterator[GpuStep]:
    """Time methods size by size; methods of one size alternate after every BURST steps.

    Frames have no exposure, so that all passes run. Ratios that a method lacks are left out.
    """
    for display, ratio in itertools.product(displays, ratios):
        frames = [replace(frame, exposure=None) for frame in plaza_frames(render_size(display, ratio))]
        placed = [(frame, frame_textures(device, frame)) for frame in frames]
        runners = []
        for method in compatible(methods, frames[0].size, display, on_left_out):
            try:
                runners.append(_GpuRunner(device, method, display, placed))
            except ArgumentError as error:  # it has no shaders
                on_left_out(f"{method}: {error}")
        take_turns([runner.step for runner in runners], -(-steps // BURST))
        for runner in runners:
            yield runner.timed()


def frame_textures(device: "wgpu.GPUDevice", frame: Frame) -> dict[str, "wgpu.GPUTexture"]:
    """Return textures of a frame's buffers, in the formats that `pass_costs` counts."""
    width, height = frame.size
    textures = {}
    for name, (texel, channels) in _CHANNELS.items():
        values = np.zeros((height, width, channels), np.float32 if texel == "r32float" else np.float16)
        image = np.atleast_3d(np.asarray(getattr(frame, name)))
        values[..., : image.shape[2]] = image
        texture = device.create_texture(size=(width, height, 1), format=texel, usage=_SAMPLED | _COPY_DST)
        layout = {"bytes_per_row": values.strides[0], "rows_per_image": height}
        device.queue.write_texture({"texture": texture}, values, layout, (width, height, 1))
        textures[name] = texture
    return textures


class _GpuRunner:
    """One model, with its frames in textures. A turn is BURST timed steps, then BURST with timed passes."""

    def __init__(
        self, device: "wgpu.GPUDevice", method: str, display: Size, placed: Sequence[Textures]
    ) -> None:
        began = time.perf_counter()
        self._device, self._method, self._display = device, method, display
        self._model = Model.load(method, executor="gpu", device=device)
        self._upscaler = Upscaler(self._model, display_size=display, validate="off")
        self._placed, self._frames = placed, itertools.cycle(placed)
        self._image = self._model.gpu.new_image(display)
        self._number = len(self._model.gpu.program.passes)
        self._watch = Stopwatch(device, BURST * self._number)
        self._steps: list[NDArray[np.float64]] = []
        self._passes: list[NDArray[np.float64]] = []
        self.step()
        self._first = time.perf_counter() - began
        self._steps.clear()
        self._passes.clear()

    def step(self) -> None:
        """Time a turn."""
        encoder = self._device.create_command_encoder()
        for _ in range(BURST):
            self._watch.around(encoder, lambda: self._encode(encoder))
        self._steps.append(self._watch.submit(encoder))
        encoder = self._device.create_command_encoder()
        for _ in range(BURST):
            self._encode(EachDispatch(encoder, self._watch))
        self._passes.append(self._watch.submit(encoder).reshape(BURST, self._number))

    def _encode(self, encoder: Any) -> None:
        frame, textures = next(self._frames)
        self._upscaler.encode_into(
            encoder, textures, jitter=frame.jitter, exposure=frame.exposure, out=self._image
        )

    def timed(self) -> GpuStep:
        """Summarise the turns, and time steps on arrays."""
        model, render = self._model, self._placed[0][0].size
        costs = pass_costs(model.gpu.program, render, self._display)
        passes = tuple(
            GpuPass(cost.name, *quantiles(times)[:2], cost.moved, cost.multiply_adds)
            for cost, times in zip(costs, np.concatenate(self._passes).T.tolist(), strict=True)
        )
        setting = self._method, render, self._display, model.precision, BURST * len(self._steps)
        return GpuStep(
            *setting,
            *quantiles(np.concatenate(self._steps).tolist()),
            *quantiles(self._wall())[:2],
            self._first,
            passes,
        )

    def _wall(self) -> list[float]:
        upscaler = Upscaler(self._model, display_size=self._display, validate="off")
        image = np.empty((*self._display[::-1], 3), np.float32)
        times = []
        for frame, _ in itertools.islice(itertools.cycle(self._placed), WALL_STEPS + 2):
            began = time.perf_counter()
            upscaler.step(frame, out=image)
            times.append(1e3 * (time.perf_counter() - began))
        return times[2:]


def compare_images(
    device: "wgpu.GPUDevice", methods: Sequence[str], *, on_left_out: Callable[[str], None] = lambda _: None
) -> Iterator[GpuImages]:
    """Step both backends through the shipped shot, whose exposure both measure."""
    render, display = IMAGE_SIZES
    frames = plaza_frames(render, count=IMAGE_FRAMES)
    frames = [replace(frame, exposure=None, reset=not i) for i, frame in enumerate(frames)]
    for method in compatible(methods, render, display, on_left_out):
        try:
            on_gpu = _stepper(method, display, executor="gpu", device=device)
        except ArgumentError as error:  # it has no shaders
            on_left_out(f"{method}: {error}")
            continue
        steps = _stepper(method, display, executor="cpu"), on_gpu
        pairs = [[display_transform(step(frame)) for step in steps] for frame in frames]
        off = [np.abs(one - other) for one, other in pairs]
        p999 = max(float(np.quantile(one, 0.999)) for one in off)
        yield GpuImages(method, render, display, IMAGE_FRAMES, float(np.mean(off)), p999, float(np.max(off)))


def _stepper(method: str, display: Size, **where: Any) -> Callable[[Frame], Float32]:
    model = Model.load(method, **where)
    return Upscaler(model, display_size=display, skip=False, validate="off").step
