"""`GpuExtrapolation`: runs `guided-warp` on a device."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import ForkSafeLock
from supersampler.backends.gpu import memory as gpu
from supersampler.backends.gpu.device import default_device, raising
from supersampler.backends.gpu.frame import PARAMS, frame_memory, step_params, upload_frame
from supersampler.backends.gpu.passes import Pass
from supersampler.backends.gpu.shader import Shader
from supersampler.frame import Float32, Frame, Size

if TYPE_CHECKING:
    import wgpu

INPUTS = "depth", "motion", "gbuffer_base_color", "gbuffer_normal"
"""Images of the unshaded frame that the shaders read."""
_HEAD_BYTES = 32
"""Bytes of `WarpParams` before its offsets."""
_READ_TILE, _WARP_TILE = (16, 16), (8, 8)
"""Pixels of a workgroup."""


class WarpShaders(NamedTuple):
    """Shaders of the two passes.

    Attributes:
        read_shaded: packs the surfaces of the shaded frame.
        warp: computes colour and motion from them.
        offsets: (x, y) of the samples among which a pixel chooses; see `WarpParams`.
    """

    read_shaded: Shader
    warp: Shader
    offsets: tuple[tuple[int, int], ...]


class DeviceTensor(NamedTuple):
    """A history tensor of shape (1, c, h, w): a buffer of float32, (h, w, c)."""

    memory: gpu.Memory
    shape: tuple[int, ...]

    @property
    def size(self) -> Size:
        """(width, height) of the image."""
        return self.shape[3], self.shape[2]


class _Buffers(NamedTuple):
    """Buffers of a call for one size of frames and one of shaded frames."""

    sizes: tuple[Size, Size]
    memory: dict[str, gpu.Memory]
    image: gpu.Readback


class GpuExtrapolation:
    """Runs `guided-warp` as compute shaders; see `ExtrapolationExecutor`.

    Raises:
        DeviceError: there is no device, or it does not compile a shader.
    """

    name = "gpu"

    def __init__(self, shaders: WarpShaders, device: "wgpu.GPUDevice | None" = None) -> None:
        self._device = default_device() if device is None else device
        with raising(self._device, "compiling shaders"):
            self._read_shaded = Pass(self._device, shaders.read_shaded, _READ_TILE, {})
            self._warp = Pass(self._device, shaders.warp, _WARP_TILE, {})
        self._offsets = np.pad(np.array(shaders.offsets, np.float32), ((0, 0), (0, 2)))  # rows of four
        self._buffers: _Buffers | None = None
        self._lock = ForkSafeLock()  # of `_buffers`

    def upload(self, array: NDArray[Any]) -> DeviceTensor | NDArray[Any]:
        """See `ExtrapolationExecutor`. Jitters stay arrays: they become parameters."""
        if array.ndim == 2:
            return array
        with raising(self._device, "uploading a history"):
            tensor = self._new_tensor(array.shape)
            gpu.write_to(self._device, tensor.memory, np.asarray(array[0].transpose(1, 2, 0), np.float32))
            return tensor

    def download(self, tensor: DeviceTensor | NDArray[Any]) -> NDArray[Any]:
        """See `ExtrapolationExecutor`."""
        if not isinstance(tensor, DeviceTensor):
            return tensor.copy()
        _, channels, height, width = tensor.shape
        with raising(self._device, "reading a history"):
            values = gpu.read_back(self._device, tensor.memory).view(np.float32)[: math.prod(tensor.shape)]
        return np.ascontiguousarray(values.reshape(height, width, channels).transpose(2, 0, 1)[None])

    def extrapolate(self, frame: Frame, history: Mapping[str, Any]) -> tuple[Float32, Mapping[str, Any]]:
        """See `ExtrapolationExecutor`."""
        tensors = {name.removeprefix("history."): tensor for name, tensor in history.items()}
        width, height = frame.size
        shaded, image = tensors["color"].size, np.empty((height, width, 3), np.float32)
        with self._lock.lock, raising(self._device, f"extrapolating a frame of {frame.size}"):
            motion = self._new_tensor((1, 2, height, width))
            buffers = self._buffers_for(frame.size, shaded)
            upload_frame(self._device, buffers.memory, frame, INPUTS)
            resources = {name: memory.resource for name, memory in buffers.memory.items()}
            resources |= {
                f"history_{name}": tensor.memory.resource
                for name, tensor in tensors.items()
                if isinstance(tensor, DeviceTensor)
            }
            resources |= {"image": buffers.image.buffer, "next_motion": motion.memory.resource}
            encoder = self._device.create_command_encoder()
            params = step_params(frame, frame.size, tensors["motion"].size)
            gpu.encode_write(self._device, encoder, resources["params"], params)
            gpu.encode_write(self._device, encoder, resources["warp"], self._warp_params(shaded, tensors))
            encoder.clear_buffer(resources["shaded_surfaces"], 0, 4)
            compute = encoder.begin_compute_pass()
            self._read_shaded.encode(compute, resources, shaded, {})  # other buffers in each call
            self._warp.encode(compute, resources, frame.size, {})
            compute.end()
            buffers.image.encode(encoder)
            self._device.queue.submit([encoder.finish()])
            buffers.image.copy_to(image)
        jitter = np.array([frame.jitter], np.float32)
        return image, {**history, "history.motion": motion, "history.motion_jitter": jitter}

    def _new_tensor(self, shape: tuple[int, ...]) -> DeviceTensor:
        return DeviceTensor(gpu.allocate(self._device, gpu.PixelBuffer(4 * math.prod(shape))), shape)

    def _buffers_for(self, render: Size, shaded: Size) -> _Buffers:
        """Return buffers for these sizes: those of the previous call, if they fit."""
        if self._buffers is None or self._buffers.sizes != (render, shaded):
            memory = frame_memory(INPUTS) | {
                "params": gpu.PixelBuffer(4 * PARAMS),
                "warp": gpu.PixelBuffer(_HEAD_BYTES + self._offsets.nbytes),
                # a flag, and four words for each pixel
                "shaded_surfaces": gpu.PixelBuffer(16 + 16 * math.prod(shaded)),
            }
            held = {name: gpu.allocate(self._device, one, render, render) for name, one in memory.items()}
            self._buffers = _Buffers((render, shaded), held, gpu.Readback(self._device, (*render[::-1], 3)))
        return self._buffers

    def _warp_params(self, shaded: Size, tensors: Mapping[str, Any]) -> Float32:
        """Return the shader's `WarpParams`."""
        head = *shaded, *tensors["jitter"][0], *tensors["motion_jitter"][0], math.nan, 0.0
        return np.concatenate([np.array(head, np.float32), self._offsets.ravel()])
