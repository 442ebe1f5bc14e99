"""Blending of AOVs on the device; their history is part of `GpuHistory`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from supersampler.backends.gpu.history import BlendedAovs, GpuHistory
from supersampler.backends.gpu.memory import DISPLAY, Memory, PixelBuffer, kept_buffer, write_to
from supersampler.backends.gpu.passes import Pass, Resource
from supersampler.errors import DeviceError
from supersampler.frame import Frame
from supersampler.methods.aovs.gpu import aov_pass, aov_shader

if TYPE_CHECKING:
    import wgpu


class AovPasses:
    """The pass that follows a step of any method where AOVs are requested; compiled on first use."""

    def __init__(self, device: "wgpu.GPUDevice") -> None:
        self._device = device
        self._passes: dict[tuple[int, bool], Pass] = {}  # by channels, and whether there is a history
        self._given: dict[str, Memory] = {}

    def upload(self, frame: Frame, next_history: GpuHistory) -> BlendedAovs:
        """Upload a frame's AOVs and its depth, which not every step reads; return memory for blended AOVs.

        Raises:
            DeviceError: they do not fit into a binding of the device.
        """
        channels, display = channels_of(frame), next_history.display
        pixel = PixelBuffer(4 * channels, DISPLAY)
        limit = self._device.limits["max-storage-buffer-binding-size"]
        if pixel.total_bytes(frame.size, display) > limit:
            most = limit // (4 * display[0] * display[1])
            raise DeviceError(
                f"{channels} channels of AOVs at {display} need a binding of "
                f"{pixel.total_bytes(frame.size, display)} bytes; the device's limit is {limit}: request at "
                f"most {most} channels, or choose executor='auto'"
            )
        for name, values in (("frame_aovs", frame.aovs), ("frame_depth", frame.depth)):
            image = np.asarray(values, np.float32)
            memory, known = PixelBuffer(image.nbytes), self._given.get(name)
            self._given[name] = kept_buffer(self._device, known, memory)
            write_to(self._device, self._given[name], image)
        known = None if next_history.aovs is None else next_history.aovs.memory
        return BlendedAovs(channels, kept_buffer(self._device, known, pixel, frame.size, display))

    def encode(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        frame: Frame,
        history: GpuHistory,
        blended: BlendedAovs,
        resources: Mapping[str, Resource],
    ) -> None:
        """Encode the pass after those of the step, whose weights are in `aux`.

        `blended` comes from `upload` of the same frame; `resources` are the step's, by name.
        """
        key = blended.channels, history.aovs is not None
        spec = aov_pass(blended.channels, has_history=history.aovs is not None)
        if key not in self._passes:
            self._passes[key] = Pass(self._device, aov_shader(spec), spec.tile, spec.names)
        given = {name: memory.resource for name, memory in self._given.items()}
        bound = {**resources, **given, "next_aovs": blended.memory.resource}
        if history.aovs is not None:
            bound["history_aovs"] = history.aovs.memory.resource
        compute = encoder.begin_compute_pass()
        self._passes[key].encode(compute, bound, spec.extent.size(frame.size, history.display))
        compute.end()


def channels_of(frame: Frame) -> int:
    """Return the number of AOV channels of a frame that has some."""
    assert frame.aovs is not None  # noqa: S101 - `check_aovs` has refused the frame
    channels: int = frame.aovs.shape[2]
    return channels
