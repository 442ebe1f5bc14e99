"""Step time of the GPU backend, by timestamp queries of the device."""

import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from supersampler import Frame, Model, Upscaler
from supersampler.backends.gpu.device import LIMITS, default_device, name_of
from supersampler.errors import ArgumentError, DeviceError
from supersampler.frame import Size
from supersampler_bench.compatibility import compatible
from supersampler_bench.timing.device import OnDevice
from supersampler_bench.timing.speed import WARM_UP, frames_of, quantiles, take_turns
from supersampler_model.data.shots import render_size

if TYPE_CHECKING:
    import wgpu

TIMESTAMPS = "timestamp-query"
_RESOLVE, _COPY_SRC = 512, 4  # usages, as WebGPU numbers them
_SAMPLED, _COPY_DST, _STORED = 4, 2, 8
_CHANNELS = {"color": ("rgba16float", 4), "depth": ("r32float", 1), "motion": ("rg16float", 2)}


def measure_gpu(
    methods: Sequence[str],
    displays: Sequence[Size],
    *,
    ratio: float = 2.0,
    steps: int = 100,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[OnDevice]:
    """Time methods; those of one size take turns, step by step. See `measure_device`.

    Raises:
        DeviceError: there is no device, or it has no timestamp queries.
    """
    device = _device_with_timestamps()
    results = []
    for display in displays:
        frames = frames_of(render_size(display, ratio))
        runners = []
        for method in compatible(methods, frames[0].size, display, on_left_out):
            try:
                runners.append(_Runner(Model.load(method, executor="gpu", device=device), display, frames))
            except ArgumentError as error:  # it has no shaders
                on_left_out(f"{method}: {error}")
        take_turns(runners, steps)
        results += [runner.timed() for runner in runners]
    return results


def _device_with_timestamps() -> "wgpu.GPUDevice":
    adapter = default_device().adapter
    if TIMESTAMPS not in adapter.features:
        raise DeviceError(f"adapter {name_of(adapter)} has no timestamp queries: steps cannot be timed on it")
    return adapter.request_device_sync(required_features=[TIMESTAMPS], required_limits=dict(LIMITS))


class _Runner:
    """One model, with its frames in textures. A step is the time between two queries around its passes."""

    def __init__(self, model: Model, display: Size, frames: Sequence[Frame]) -> None:
        self._model, self._display, self._device = model, display, model.gpu.device
        self._upscaler = Upscaler(model, display_size=display, validate="off")
        self._frames = itertools.cycle([(frame, self._textures(frame)) for frame in frames])
        self._image = model.gpu.new_image(display)
        self._queries = self._device.create_query_set(type="timestamp", count=2)
        self._times = self._device.create_buffer(size=16, usage=_RESOLVE | _COPY_SRC)
        self._milliseconds: list[float] = []
        for _ in range(WARM_UP):
            self.step()
        self._milliseconds.clear()

    def _textures(self, frame: Frame) -> dict[str, Any]:
        width, height = frame.size
        textures = {}
        for name, (texel, channels) in _CHANNELS.items():
            values = np.zeros((height, width, channels), np.float32 if texel == "r32float" else np.float16)
            image = np.atleast_3d(np.asarray(getattr(frame, name)))
            values[..., : image.shape[2]] = image
            texture = self._device.create_texture(
                size=(width, height, 1), format=texel, usage=_SAMPLED | _COPY_DST
            )
            layout = {"bytes_per_row": values.strides[0], "rows_per_image": height}
            self._device.queue.write_texture({"texture": texture}, values, layout, (width, height, 1))
            textures[name] = texture
        return textures

    def step(self) -> None:
        """Time one step."""
        frame, textures = next(self._frames)
        encoder = self._device.create_command_encoder()
        self._mark(encoder, "beginning_of_pass_write_index", 0)
        self._upscaler.encode_into(
            encoder, textures, jitter=frame.jitter, exposure=frame.exposure, out=self._image
        )
        self._mark(encoder, "end_of_pass_write_index", 1)
        encoder.resolve_query_set(self._queries, 0, 2, self._times, 0)
        self._device.queue.submit([encoder.finish()])
        begin, end = np.frombuffer(self._device.queue.read_buffer(self._times), np.uint64)
        self._milliseconds.append(1e-6 * float(end - begin))

    def _mark(self, encoder: "wgpu.GPUCommandEncoder", place: str, index: int) -> None:
        encoder.begin_compute_pass(timestamp_writes={"query_set": self._queries, place: index}).end()

    def timed(self) -> OnDevice:
        """Summarise."""
        model, (width, height) = self._model, self._display
        history = model.plan(next(self._frames)[0].size, self._display).history_bytes
        frame = sum(texture.size[0] * texture.size[1] * 4 for texture in next(self._frames)[1].values())
        setting = model.info.method, self._display, model.precision, name_of(self._device.adapter), False
        return OnDevice(*setting, *quantiles(self._milliseconds), frame + history + 8 * width * height)
