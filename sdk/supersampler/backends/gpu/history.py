"""History on the device: planes of pixels in textures and buffers, and values per frame."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.gpu import memory as gpu
from supersampler.backends.gpu.passes import BindGroups
from supersampler.frame import Float32, Size
from supersampler.io.display import MAX_HALF
from supersampler.methods import spec as shapes
from supersampler.methods.at_rest import BLOCK, TILE, block_of_pixels, phase_count
from supersampler.methods.spec import MethodSpec, sized

if TYPE_CHECKING:
    import wgpu

STATE = "state"
STATE_VALUES = 16
"""Values of the shader's `State`: signed exposure, flash, jitter, light, and values of one step."""
_STATE_TENSORS = {"exposure": slice(0, 1), "jitter": slice(2, 4), "light": slice(4, 8)}
SIGNATURES, PHASE_TABLE, TILES = "signatures", "phases", "tiles"
_MEAN, _BLOCKS = "static_mean", "static_blocks"
Packed = NDArray[Any]


class Codec(NamedTuple):
    """Conversion of a plane between its words and float32 (H, W, channels), at most four channels a word."""

    unpack: Callable[[Packed], Float32]
    pack: Callable[[Float32], Packed]


def _unpack_bytes(words: Packed) -> Float32:
    return np.ascontiguousarray(words).view(np.uint8).astype(np.float32) / np.float32(255.0)


def _pack_bytes(pixels: Float32) -> Packed:
    return (np.clip(pixels, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


BYTES = Codec(_unpack_bytes, _pack_bytes)
"""Values in [0, 1] in a byte each."""


class HistoryPlane(NamedTuple):
    """A plane of a history.

    Attributes:
        tensor: name of a history tensor with the plane's size.
        words: four-byte words per pixel.
        texture: format of the texture; None for a buffer.
        codec: conversion of the words; None for float32.
    """

    tensor: str
    words: int = 4
    texture: str | None = "rgba32float"
    codec: Codec | None = None

    def memory(self, extent: gpu.SizeRule) -> gpu.PixelMemory:
        """Return the memory of a plane of this size."""
        if self.texture:
            return gpu.PixelTexture(extent, self.texture)
        return gpu.PixelBuffer(4 * self.words, extent)


PIXEL_EXPONENT = 80
"""Smallest shared exponent of a pixel, biased as in a float32."""
_PART_BITS, _PARTS = 14, (1 << 14) - 1


def _unpack_pixels(words: Packed) -> Float32:
    first, second = words[..., 0], words[..., 1]
    exponent = (first >> 28 | second >> 10 & 0x30).astype(np.int32) + PIXEL_EXPONENT - 127
    parts = np.stack([first & _PARTS, first >> _PART_BITS & _PARTS, second & _PARTS], -1)
    colors = np.ldexp(parts.astype(np.float32), exponent[..., None] - _PART_BITS + 1)
    samples = (second >> 16).astype(np.uint16).view(np.float16).astype(np.float32)
    return np.concatenate([colors, samples[..., None]], -1, dtype=np.float32)


def _pack_pixels(pixels: Float32) -> Packed:
    colors = np.ascontiguousarray(np.clip(pixels[..., :3], 0.0, MAX_HALF), np.float32)
    most = colors.max(-1).view(np.uint32) >> 23
    exponent = np.clip(most, PIXEL_EXPONENT, PIXEL_EXPONENT + 63) - np.uint32(PIXEL_EXPONENT)
    shift = 127 + _PART_BITS - 1 - PIXEL_EXPONENT - exponent.astype(np.int32)
    parts = np.minimum(np.floor(np.ldexp(colors, shift[..., None]) + 0.5), _PARTS).astype(np.uint32)
    samples = np.clip(pixels[..., 3], 0.0, MAX_HALF).astype(np.float16).view(np.uint16).astype(np.uint32)
    first = parts[..., 0] | parts[..., 1] << _PART_BITS | exponent << 28
    return np.stack([first, parts[..., 2] | exponent >> 4 << _PART_BITS | samples << 16], -1)


PIXELS = HistoryPlane("color", 2, "rg32uint", Codec(_unpack_pixels, _pack_pixels))
"""Colour and number of samples in two words; see history_pixel.wgsl."""


@dataclass(frozen=True)
class HistoryLayout:
    """Mapping of a method's history tensors to planes.

    Attributes:
        spec: the method.
        planes: planes by name.
        channels: for each tensor, the plane and the plane's channel of each of its channels.
    """

    spec: MethodSpec
    planes: Mapping[str, HistoryPlane]
    channels: Mapping[str, tuple[tuple[str, int], ...]]

    def extent(self, plane: str, frame: Literal["previous", "render"]) -> gpu.SizeRule:
        """Return the size of a plane of the history that a step reads ("previous") or writes ("render")."""
        tensor = self.planes[plane].tensor
        if tensor == PHASE_TABLE:
            return gpu.PHASES
        if tensor == SIGNATURES:
            return gpu.SizeRule("previous_signatures" if frame == "previous" else "signatures")
        extents: dict[object, gpu.SizeRule] = {
            shapes.DISPLAY: gpu.DISPLAY,
            shapes.HALF: gpu.HALF,
            shapes.LARGE: gpu.LARGE,
            shapes.LARGE_HALF: gpu.LARGE_HALF,
            shapes.PREVIOUS: gpu.SizeRule(frame),
            shapes.BLOCKS: gpu.SizeRule(frame, BLOCK),
        }
        return extents[self.spec.history[tensor][2:]]

    def size(self, plane: str, display: Size, render: Size) -> Size:
        """Return the size of a plane after a frame of size `render`, (width, height)."""
        return self.extent(plane, "render").size(render, display)

    def memory(self, frame: Literal["previous", "render"]) -> dict[str, gpu.PixelMemory]:
        """Return the memory of all planes, of the state, and of the frozen tiles, by name; see `extent`."""
        planes = {name: plane.memory(self.extent(name, frame)) for name, plane in self.planes.items()}
        if SIGNATURES in planes:  # a method that converges
            planes[TILES] = gpu.PixelBuffer(8, self.extent("pixels", frame)._replace(divide=TILE))
        return {STATE: gpu.PixelBuffer(4 * STATE_VALUES), **planes}


def of_plane(plane: str, *channels: int) -> tuple[tuple[str, int], ...]:
    """Return the entry of `HistoryLayout.channels` for channels of one plane."""
    return tuple((plane, channel) for channel in channels)


def _image_of(tensor: str, values: NDArray[Any], channel: int) -> NDArray[Any]:
    """Return a channel of a history tensor as an image of its plane; see `HistoryLayout.extent`."""
    if tensor == PHASE_TABLE:
        return values[None, :, channel]
    if tensor == SIGNATURES:
        return values[:, channel].reshape(-1, values.shape[3])
    image: NDArray[Any] = values[0, channel]
    return image


class BlendedAovs(NamedTuple):
    """AOVs at display size: a buffer of float32, (H, W, channels)."""

    channels: int
    memory: gpu.Memory


@dataclass(eq=False)
class GpuHistory:
    """Buffers of a history, initially zeros, which mean no history.

    Attributes:
        device: device of the buffers.
        layout: layout of the tensors.
        display: (width, height) of the images.
        render: (width, height) of the previous frame.
        memory: memory of each plane, and of "state", the values per frame.
        aovs: blended AOVs; None if they were not requested.
        groups: bind groups of the steps that wrote it, by the history that they read. As they keep its memory
            alive, they are dropped with either.
        step: identity of the step that wrote it.
        previous: identity of the step before that one.
    """

    device: "wgpu.GPUDevice"
    layout: HistoryLayout
    display: Size
    render: Size
    memory: dict[str, gpu.Memory] = field(init=False)
    aovs: BlendedAovs | None = None
    groups: "WeakKeyDictionary[GpuHistory, BindGroups]" = field(default_factory=WeakKeyDictionary)
    step: object = field(default_factory=object)
    previous: object = None

    def __post_init__(self) -> None:
        memory = self.layout.memory("render").items()
        self.memory = {name: gpu.allocate(self.device, m, self.render, self.display) for name, m in memory}

    def follow(self, history: "GpuHistory") -> bool:
        """Record that a step reads `history` and writes this one.

        Returns:
            Whether this history was written two steps ago, just before `history`. What did not change in the
            previous step, nor in this one, is then up to date.
        """
        is_second = self.step is history.previous
        self.step, self.previous = object(), history.step
        return is_second

    def tensor(self, name: str) -> Float32:
        """Return a history tensor of the contract (`history.NAME` or NAME), NCHW."""
        name = name.removeprefix("history.")
        if name == "aovs" and self.aovs is not None:
            shape = *self.display[::-1], self.aovs.channels
            values = gpu.read_back(self.device, self.aovs.memory).view(np.float32)[: math.prod(shape)]
            return values.reshape(shape).transpose(2, 0, 1)[None]  # without padding
        if name in _STATE_TENSORS:
            values = gpu.read_back(self.device, self.memory[STATE])[_STATE_TENSORS[name]].view(np.float32)
            return values.copy().reshape(sized(self.layout.spec.history[name], {}))
        where = self.layout.channels[name]
        pixels = {plane: self._pixels(plane) for plane, _ in where}
        planes = np.stack([pixels[plane][..., channel] for plane, channel in where])
        phases = phase_count(self.display, self.render)
        if name == PHASE_TABLE:
            return np.ascontiguousarray(planes[:, 0, :phases].T)
        if name == SIGNATURES:
            split = planes.reshape(4, phases, -1, planes.shape[2])
            return np.ascontiguousarray(split.transpose(1, 0, 2, 3))
        if name == _MEAN:  # shaders do not update the mean of blocks that have none
            columns, rows = map(block_of_pixels, self.display, self.render)
            planes = planes * (self.tensor(_BLOCKS)[0, 0, rows[:, None], columns] != 0.0)
        return planes[None]

    def load(self, tensors: Mapping[str, NDArray[Any]]) -> None:
        """Fill the buffers from all history tensors of the contract, and from those of AOVs, if any."""
        tensors = {name.removeprefix("history."): tensor for name, tensor in tensors.items()}
        self.step, self.previous = object(), None
        state = np.zeros(STATE_VALUES, np.float32)
        for name, part in _STATE_TENSORS.items():
            if name in tensors:
                state[part] = tensors[name].reshape(-1)
        gpu.write_to(self.device, self.memory[STATE], state)
        if TILES in self.memory:
            tiles = self.memory[TILES]
            gpu.write_to(self.device, tiles, np.zeros(tiles.resource.size // 4, np.uint32))
        self.aovs = None
        if "aovs" in tensors:
            memory = gpu.allocate(self.device, gpu.PixelBuffer(tensors["aovs"].nbytes))
            gpu.write_to(self.device, memory, tensors["aovs"][0].transpose(1, 2, 0))
            self.aovs = BlendedAovs(tensors["aovs"].shape[1], memory)
        for name, plane in self.layout.planes.items():
            width, height = self.layout.size(name, self.display, self.render)
            channels = plane.words if plane.codec is None else 4 * plane.words
            pixels = np.zeros((height, width, channels), np.float32)
            for tensor, where in self.layout.channels.items():
                for i, (of, channel) in enumerate(where):
                    if of == name:
                        plane_of = _image_of(tensor, tensors[tensor], i)
                        pixels[: plane_of.shape[0], : plane_of.shape[1], channel] = plane_of
            packed = pixels if plane.codec is None else plane.codec.pack(pixels)
            gpu.write_to(self.device, self.memory[name], packed)

    def _pixels(self, name: str) -> Float32:
        plane = self.layout.planes[name]
        width, height = self.layout.size(name, self.display, self.render)
        count = height * width * plane.words  # without the padding
        words = gpu.read_back(self.device, self.memory[name])[:count]
        words = words.reshape(height, width, plane.words)
        return words.view(np.float32) if plane.codec is None else plane.codec.unpack(words)
