"""Textures and buffers of the device, the rules of their sizes, and copies between them and arrays."""

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.gpu.device import check_texture_size
from supersampler.frame import Size
from supersampler.methods.at_rest import BLOCK, PHASES_PER_SAMPLE, SPARE_PHASES, block_count, phase_count
from supersampler.methods.spec import large_size

if TYPE_CHECKING:
    import wgpu

ROW = 256
"""Bytes to which each row is padded when a texture is copied to a buffer."""
TEXELS = {
    "rgba32float": 16, "rgba32uint": 16, "rgba16float": 8, "rg32float": 8, "rg32uint": 8, "r32uint": 4,
    "r32float": 4,
}  # fmt: skip
"""Bytes of a pixel, by format."""
# WebGPU's usage flags
_MAP_READ = 1
_COPY_SRC, _COPY_DST, _UNIFORM, _STORAGE = 4, 8, 64, 128
_TEXTURE_COPY_SRC, _TEXTURE_COPY_DST, _SAMPLED, _STORED = 1, 2, 4, 8


class Memory(NamedTuple):
    """A buffer or a texture.

    Attributes:
        resource: the buffer, or a view of the texture, for a bind group.
        texture: the texture; None for a buffer.
    """

    resource: Any
    texture: Any = None


def encode_write(
    device: "wgpu.GPUDevice",
    encoder: "wgpu.GPUCommandEncoder",
    buffer: "wgpu.GPUBuffer",
    values: NDArray[Any],
) -> None:
    """Encode a write to a buffer. A write by the queue would run before all steps of the encoder."""
    source = device.create_buffer_with_data(data=values, usage=_COPY_SRC)
    encoder.copy_buffer_to_buffer(source, 0, buffer, 0, values.nbytes)


def new_texture(device: "wgpu.GPUDevice", size: Size, texture_format: str) -> "wgpu.GPUTexture":
    """Allocate a texture that shaders sample and write, and that can be copied."""
    check_texture_size(device, size)
    usage = _TEXTURE_COPY_SRC | _TEXTURE_COPY_DST | _SAMPLED | _STORED
    return device.create_texture(size=(*size, 1), format=texture_format, usage=usage)


def write_to(device: "wgpu.GPUDevice", memory: Memory, values: NDArray[Any]) -> None:
    """Fill a buffer, or a texture from (h, w, channels)."""
    values = np.ascontiguousarray(values)
    if memory.texture is None:
        device.queue.write_buffer(memory.resource, 0, values)
        return
    height, width = values.shape[:2]
    layout = {"offset": 0, "bytes_per_row": TEXELS[memory.texture.format] * width, "rows_per_image": height}
    device.queue.write_texture({"texture": memory.texture}, values, layout, (width, height, 1))


def read_back(device: "wgpu.GPUDevice", memory: Memory) -> NDArray[np.uint32]:
    """Return the words of a buffer, or of a texture row by row."""
    if memory.texture is None:
        return np.frombuffer(device.queue.read_buffer(memory.resource), np.uint32).copy()
    width, height = memory.texture.size[:2]
    texel = TEXELS[memory.texture.format]
    row = -(-texel * width // ROW) * ROW
    rows = device.create_buffer(size=row * height, usage=_COPY_SRC | _COPY_DST)
    encoder = device.create_command_encoder()
    target = {"buffer": rows, "bytes_per_row": row, "rows_per_image": height}
    encoder.copy_texture_to_buffer({"texture": memory.texture}, target, (width, height, 1))
    device.queue.submit([encoder.finish()])
    words = np.frombuffer(device.queue.read_buffer(rows), np.uint32).reshape(height, row // 4)
    return words[:, : texel // 4 * width].reshape(-1)


class Readback:
    """A storage buffer of float32 values that shaders write, and a second buffer that the CPU maps."""

    def __init__(self, device: "wgpu.GPUDevice", shape: tuple[int, ...]) -> None:
        self._device = device
        self.buffer = allocate(device, PixelBuffer(4 * math.prod(shape))).resource
        self._mapped = device.create_buffer(size=self.buffer.size, usage=_MAP_READ | _COPY_DST)

    def encode(self, encoder: "wgpu.GPUCommandEncoder") -> None:
        """Encode the copy to the second buffer."""
        if self._mapped.map_state != "unmapped":  # the previous copy was interrupted
            self._mapped = self._device.create_buffer(size=self._mapped.size, usage=self._mapped.usage)
        encoder.copy_buffer_to_buffer(self.buffer, 0, self._mapped, 0, self._mapped.size)

    def copy_to(self, array: NDArray[np.float32]) -> None:
        """Wait for the copy, and write it to a contiguous array."""
        self._mapped.map_sync(mode=_MAP_READ)
        try:
            values = np.frombuffer(self._mapped.read_mapped(copy=False), np.float32)
            np.copyto(array, values[: array.size].reshape(array.shape))
        finally:
            self._mapped.unmap()


Base = Literal["one", "render", "previous", "display", "large", "signatures", "previous_signatures"]
MAX_PHASES = PHASES_PER_SAMPLE * 9 * 9 + SPARE_PHASES
"""Phases of the largest ratio: rounded to whole pixels, 4 becomes up to 9 (`check_ratio`)."""


class SizeRule(NamedTuple):
    """A size in pixels: `of` / `divide`, rounded up, times `multiply`.

    Attributes:
        of: "render", "previous": the size of this frame and of the previous one; "display": of the image;
            "large": 1.4 times the display (`large_size`); "one": (1, 1); "signatures" and
            "previous_signatures": the blocks of this and the previous frame, with the jitter phases stacked
            vertically.
        divide: divisor of both axes.
        multiply: factors of the axes, (x, y).
    """

    of: Base
    divide: int = 1
    multiply: Size = (1, 1)

    def size(self, render: Size, display: Size) -> Size:
        """Return (width, height) at these sizes, after a previous frame of the same size."""
        if self.of == "large":
            width, height = large_size(display)
        elif self.of.endswith("signatures"):
            width, height = block_count(render)
            height *= phase_count(display, render)
        else:
            width, height = {"one": (1, 1), "display": display}.get(self.of, render)
        return -(-width // self.divide) * self.multiply[0], -(-height // self.divide) * self.multiply[1]

    @property
    def enlarged(self) -> "SizeRule":
        """This rule with the larger display in place of the display."""
        return self._replace(of="large") if self.of == "display" else self


ONE, RENDER, DISPLAY = SizeRule("one"), SizeRule("render"), SizeRule("display")
HALF, LARGE, LARGE_HALF = SizeRule("display", 2), SizeRule("large"), SizeRule("large", 2)
BLOCKS, PHASES = SizeRule("render", BLOCK), SizeRule("one", multiply=(MAX_PHASES, 1))


class PixelBuffer(NamedTuple):
    """A storage buffer of `bytes` for each pixel of an extent."""

    bytes: int
    extent: SizeRule = ONE

    def total_bytes(self, render: Size, display: Size) -> int:
        """Return the bytes of all pixels; see `SizeRule.size`."""
        return self.bytes * math.prod(self.extent.size(render, display))

    def buffer_bytes(self, render: Size, display: Size) -> int:
        """Return the size of the buffer: a multiple of four, and at least 16."""
        return max(-(-self.total_bytes(render, display) // 4) * 4, 16)


class PixelTexture(NamedTuple):
    """A texture of an extent, of a format in TEXELS."""

    extent: SizeRule
    format: str = "rgba32float"

    def total_bytes(self, render: Size, display: Size) -> int:
        """Return the bytes of all pixels; see `SizeRule.size`."""
        return TEXELS[self.format] * math.prod(self.extent.size(render, display))


PixelMemory = PixelBuffer | PixelTexture


def allocate(
    device: "wgpu.GPUDevice", memory: PixelMemory, render: Size = (1, 1), display: Size = (1, 1)
) -> Memory:
    """Allocate zeros for these sizes; see `SizeRule.size`."""
    if isinstance(memory, PixelBuffer):
        size = memory.buffer_bytes(render, display)
        return Memory(device.create_buffer(size=size, usage=_STORAGE | _UNIFORM | _COPY_SRC | _COPY_DST))
    texture = new_texture(device, memory.extent.size(render, display), memory.format)
    return Memory(texture.create_view(), texture)


def kept_buffer(
    device: "wgpu.GPUDevice",
    known: Memory | None,
    memory: PixelBuffer,
    render: Size = (1, 1),
    display: Size = (1, 1),
) -> Memory:
    """Return `known` if it has the size of `memory`, else a new buffer."""
    if known is not None and known.resource.size == memory.buffer_bytes(render, display):
        return known
    return allocate(device, memory, render, display)
