"""Step time of the GPU backend and of each pass by timestamps."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame, Model, Upscaler
from supersampler.backends.gpu.device import LIMITS, default_device, name_of
from supersampler.backends.gpu.program import PassSpec
from supersampler.errors import ArgumentError, DeviceError
from supersampler.frame import Size
from supersampler_bench.specs import compatible
from supersampler_bench.timing.latency import plaza_frames, quantiles, take_turns
from supersampler_model.data.shots import render_size

if TYPE_CHECKING:
    import wgpu

TIMESTAMPS = "timestamp-query"
_RESOLVE, _COPY_SRC = 512, 4  # usages, as WebGPU numbers them


def device_with_timestamps() -> "wgpu.GPUDevice":
    """Open another device on the adapter of `default_device`.

    Raises:
        DeviceError: there is no device, or it has no timestamp queries.
    """
    adapter = default_device().adapter
    if TIMESTAMPS not in adapter.features:
        raise DeviceError(f"adapter {name_of(adapter)} has no timestamp queries: steps cannot be timed on it")
    return adapter.request_device_sync(required_features=[TIMESTAMPS], required_limits=dict(LIMITS))


class Stopwatch:
    """Pairs of timestamps in one command buffer.

    Args:
        device: see `device_with_timestamps`.
        max_pairs: largest number of pairs in one command buffer.
    """

    def __init__(self, device: "wgpu.GPUDevice", max_pairs: int) -> None:
        self._device, self._pairs = device, 0
        self._queries = device.create_query_set(type="timestamp", count=2 * max_pairs)
        self._times = device.create_buffer(size=16 * max_pairs, usage=_RESOLVE | _COPY_SRC)
        self._period = _nanoseconds(device)

    def around(self, encoder: "wgpu.GPUCommandEncoder", encode: Callable[[], object]) -> None:
        """Time what `encode` encodes, between two empty passes."""
        begin, end = 2 * self._pairs, 2 * self._pairs + 1
        self._pairs += 1
        self._mark(encoder, beginning_of_pass_write_index=begin)
        encode()
        self._mark(encoder, end_of_pass_write_index=end)

    def timed_pass(self, encoder: "wgpu.GPUCommandEncoder") -> "wgpu.GPUComputePassEncoder":
        """Begin a compute pass that is timed as a whole."""
        begin, end = 2 * self._pairs, 2 * self._pairs + 1
        self._pairs += 1
        return encoder.begin_compute_pass(
            timestamp_writes={
                "query_set": self._queries,
                "beginning_of_pass_write_index": begin,
                "end_of_pass_write_index": end,
            }
        )

    def submit(self, encoder: "wgpu.GPUCommandEncoder") -> NDArray[np.float64]:
        """Submit the commands; wait, and return the milliseconds of each pair in order."""
        pairs, self._pairs = self._pairs, 0
        encoder.resolve_query_set(self._queries, 0, 2 * pairs, self._times, 0)
        self._device.queue.submit([encoder.finish()])
        read = self._device.queue.read_buffer(self._times, 0, 16 * pairs)
        begin, end = np.frombuffer(read, np.uint64).reshape(-1, 2).T
        return 1e-6 * self._period * (end - begin).astype(np.float64)

    def _mark(self, encoder: "wgpu.GPUCommandEncoder", **write: int) -> None:
        encoder.begin_compute_pass(timestamp_writes={"query_set": self._queries, **write}).end()


def _nanoseconds(device: "wgpu.GPUDevice") -> float:
    """Return the unit of timestamps: wgpu's native library gives those of the driver."""
    from wgpu.backends.wgpu_native._ffi import lib

    return float(lib.wgpuQueueGetTimestampPeriod(device.queue._internal))


class EachDispatch:
    """A command encoder with a timed pass for each dispatch.

    Args:
        encoder: encoder of the commands.
        watch: gets a pair of timestamps for each dispatch.
    """

    def __init__(self, encoder: "wgpu.GPUCommandEncoder", watch: Stopwatch) -> None:
        self._encoder, self._watch = encoder, watch
        self._device = encoder._device  # as wgpu's encoders have it

    def __getattr__(self, name: str) -> Any:
        return getattr(self._encoder, name)

    def begin_compute_pass(self) -> "_Dispatches":
        """Begin a compute pass that becomes one per dispatch."""
        return _Dispatches(self._encoder, self._watch)


class _Dispatches:
    """A compute pass that becomes one timed pass per dispatch."""

    def __init__(self, encoder: "wgpu.GPUCommandEncoder", watch: Stopwatch) -> None:
        self._encoder, self._watch = encoder, watch
        self._before: list[tuple[str, tuple[Any, ...]]] = []

    def set_pipeline(self, *given: Any) -> None:
        self._before.append(("set_pipeline", given))

    def set_bind_group(self, *given: Any) -> None:
        self._before.append(("set_bind_group", given))

    def dispatch_workgroups(self, *count: int) -> None:
        compute = self._watch.timed_pass(self._encoder)
        for name, given in self._before:
            getattr(compute, name)(*given)
        compute.dispatch_workgroups(*count)
        compute.end()
        self._before.clear()

    def end(self) -> None:
        """All passes have ended."""


BURST = 10
"""Steps in a command buffer, so that the device does not rest between them."""
WALL_STEPS = 20
_SAMPLED, _COPY_DST = 4, 2  # usages, as WebGPU numbers them
_CHANNELS = {"color": ("rgba16float", 4), "depth": ("r32float", 1), "motion": ("rg16float", 2)}
Textures = tuple[Frame, dict[str, Any]]


@dataclass(frozen=True)
class GpuPass:
    """A pass of a step.

    Attributes:
        name: name of its shader; with its level, where a method has it several times.
        median, p95: milliseconds.
    """

    name: str
    median: float
    p95: float


@dataclass(frozen=True)
class GpuStep:
    """Times of a method at a size, milliseconds.

    Attributes:
        method: its name.
        render: (width, height) of the frames.
        display: (width, height) of the images.
        precision: precision of the network.
        steps: steps that were timed.
        median, p95, p99: of a step on frame and image in textures, by the device's clock.
        wall, wall_p95: of `step`, from arrays to an array, by the program's clock.
        first: seconds of loading the model and of its first steps, with shaders that are not yet compiled.
        passes: passes in order; each waits for the one before.
    """

    method: str
    render: Size
    display: Size
    precision: str
    steps: int
    median: float
    p95: float
    p99: float
    wall: float
    wall_p95: float
    first: float
    passes: tuple[GpuPass, ...]


def measure_gpu(
    device: "wgpu.GPUDevice",
    methods: Sequence[str],
    displays: Sequence[Size],
    ratios: Sequence[float],
    *,
    steps: int = 100,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> Iterator[GpuStep]:
    """Time methods; those of one size alternate, BURST steps each. Results come size by size.

    The frames have no exposure, so that all passes run.

    Args:
        device: see `device_with_timestamps`.
        methods: names of shipped models, or model folders.
        displays: (width, height) of the images.
        ratios: display over render size; those that a method lacks are left out.
        steps: measured steps of each method.
        on_left_out: called with the reason why a method is left out.
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
        take_turns(runners, -(-steps // BURST))
        for runner in runners:
            yield runner.timed()


def frame_textures(device: "wgpu.GPUDevice", frame: Frame) -> dict[str, "wgpu.GPUTexture"]:
    """Return textures of a frame's images, in formats that engines use."""
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


def _name(spec: PassSpec) -> str:
    return f"{spec.shader} {spec.constants['level']}" if "level" in spec.constants else spec.shader


class _GpuRunner:
    """One model, with its frames in textures. A turn is BURST steps, and as many with timed passes."""

    def __init__(
        self, device: "wgpu.GPUDevice", method: str, display: Size, placed: Sequence[Textures]
    ) -> None:
        began = time.perf_counter()
        self._device, self._display = device, display
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
        """Summarise, after the last turn; time steps on arrays."""
        model, render = self._model, self._placed[0][0].size
        passes = tuple(
            GpuPass(_name(spec), *quantiles(times)[:2])
            for spec, times in zip(
                model.gpu.program.passes, np.concatenate(self._passes).T.tolist(), strict=True
            )
        )
        setting = model.info.method, render, self._display, model.precision, BURST * len(self._steps)
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
