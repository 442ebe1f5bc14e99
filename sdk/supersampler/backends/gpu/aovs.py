"""Blending of AOVs on the device; their history is part of `GpuHistory`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from supersampler.backends.gpu.frame import TEXTURE_CHANNELS, DeviceAovs
from supersampler.backends.gpu.history import BlendedAovs, GpuHistory
from supersampler.backends.gpu.memory import DISPLAY, Memory, PixelBuffer, kept_buffer, write_to
from supersampler.backends.gpu.passes import Pass, Resource
from supersampler.backends.gpu.program import TEXTURES
from supersampler.errors import DeviceError
from supersampler.frame import Frame, Size
from supersampler.methods.aovs.gpu import aov_pass, aov_shader

if TYPE_CHECKING:
    import wgpu


class AovPasses:
    """The passes that follow a step of any method where AOVs are requested; compiled on first use."""

    def __init__(self, device: "wgpu.GPUDevice") -> None:
        self._device = device
        self._passes: dict[tuple[Any, ...], Pass] = {}
        self._given: dict[str, Memory] = {}

    def upload(self, frame: Frame) -> tuple[DeviceAovs, Resource]:
        """Upload a frame's AOVs and its depth, which not every step reads; return both."""
        arrays = {name: np.asarray(getattr(frame, name), np.float32) for name in ("aovs", "depth")}
        for name, array in arrays.items():
            known = self._given.get(name)
            self._given[name] = kept_buffer(self._device, known, PixelBuffer(array.nbytes))
            write_to(self._device, self._given[name], array)
        aovs, depth = (self._given[name].resource for name in arrays)
        return DeviceAovs([aovs], arrays["aovs"].shape[2]), depth

    def room(self, channels: int, next_history: GpuHistory) -> BlendedAovs:
        """Return memory for the AOVs of a history, that of `next_history` if it fits.

        Raises:
            DeviceError: they do not fit into a binding of the device.
        """
        display = next_history.display
        pixel = PixelBuffer(4 * channels, DISPLAY)
        limit = self._device.limits["max-storage-buffer-binding-size"]
        if pixel.total_bytes(display, display) > limit:
            most = limit // (4 * display[0] * display[1])
            raise DeviceError(
                f"{channels} channels of AOVs at {display} need a binding of "
                f"{pixel.total_bytes(display, display)} bytes; the device's limit is {limit}: request at "
                f"most {most} channels, or choose executor='auto'"
            )
        known = None if next_history.aovs is None else next_history.aovs.memory
        return BlendedAovs(channels, kept_buffer(self._device, known, pixel, display, display))

    def encode(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        aovs: DeviceAovs,
        history: GpuHistory,
        next_history: GpuHistory,
        render: Size,
        variants: Mapping[str, str],
        resources: Mapping[str, Resource],
    ) -> None:
        """Encode the passes after those of the step, whose weights are in `aux`.

        `next_history` has room for the AOVs; `variants` and `resources` are the step's, by name.
        """
        assert next_history.aovs is not None  # noqa: S101 - see above
        blended = next_history.aovs.memory.resource
        bound = {**resources, "next_aovs": blended}
        if history.aovs is not None:
            bound["history_aovs"] = history.aovs.memory.resource
        bound |= {f"frame_aovs{i}": image for i, image in enumerate(aovs.images)}
        bound |= {f"aovs{i}": target for i, target in enumerate(aovs.targets)}
        in_textures = variants["frame"] == TEXTURES["frame"]
        parts = aovs.channels // TEXTURE_CHANNELS if in_textures else aovs.channels
        compute = encoder.begin_compute_pass()
        for number in range(len(aovs.images)):
            key = parts, number, history.aovs is not None, *variants.values()
            spec = aov_pass(parts, number, in_texture=in_textures, has_history=history.aovs is not None)
            if key not in self._passes:
                self._passes[key] = Pass(self._device, aov_shader(spec, variants), spec.tile, spec.names)
            size, groups = spec.extent.size(render, history.display), next_history.groups[history]
            self._passes[key].encode(compute, bound, size, groups)
        compute.end()
        if aovs.targets and not in_textures:
            encoder.copy_buffer_to_buffer(blended, 0, aovs.targets[0], 0, aovs.bytes(history.display))
