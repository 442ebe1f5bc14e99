"""The int8 network of `classifier` for shaders: the weights of each pass, and the offsets of its layers."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.methods.classifier.network_file import INPUT_PLANES, KEPT, read_network
from supersampler.methods.classifier.spec import Variant
from supersampler.methods.model_info import ModelInfo

Arrays = Mapping[str, NDArray[Any]]
Layer = tuple[NDArray[np.int8], NDArray[Any], NDArray[Any]]
"""Weights, scales and biases."""
CHUNK = 16
"""Bytes of a vec4u."""
CORNERS = 4
"""Display pixels of a packed pixel."""


class GpuLayers(NamedTuple):
    """The layers of a pass.

    Attributes:
        words: (n, 4) uint32, the buffer `network` (see int8.wgsl).
        constants: constants of the shader.
    """

    words: NDArray[np.uint32]
    constants: dict[str, float | int]


class _Writer:
    """Collects the layers of a pass; each method adds one and returns its offset in vec4u."""

    def __init__(self) -> None:
        self._parts: list[NDArray[np.uint32]] = []
        self._size = 0

    def layers(self, constants: dict[str, float | int]) -> GpuLayers:
        """Return the layers, with their size among the constants."""
        return GpuLayers(np.concatenate(self._parts), {**constants, "network_size": self._size})

    def _add(self, *parts: NDArray[Any]) -> int:
        first = self._size
        for part in parts:
            words = np.ascontiguousarray(part).reshape(-1).view(np.uint32).reshape(-1, 4)
            self._parts.append(words)
            self._size += len(words)
        return first

    def pointwise(self, weights: NDArray[np.int8], scale: NDArray[Any], bias: NDArray[Any]) -> int:
        """Add a 1x1 convolution; both axes of the weights (outputs, bytes) are padded to whole chunks."""
        outputs, given = (-(-extent // CHUNK) * CHUNK for extent in weights.shape)
        padded = np.zeros((outputs, given), np.int8)
        padded[: weights.shape[0], : weights.shape[1]] = weights
        quads = padded.reshape(outputs // 4, 4, given // 4, 4).transpose(0, 2, 1, 3)
        return self._add(quads, *self._values(outputs, scale, bias), 128 * padded.sum(1, np.int32))

    def depthwise(self, weights: NDArray[np.int8], scale: NDArray[Any], bias: NDArray[Any]) -> int:
        """Add a 3x3 convolution of each channel, weights (9, channels): see `depthwise` in int8.wgsl."""
        channels = weights.shape[1]
        quads = weights.reshape(9, channels // 4, 4).transpose(1, 2, 0)  # [quad][channel][pixel]
        last = np.eye(4, dtype=np.int8) * quads[..., 8:]
        groups = np.stack([quads[..., :4], quads[..., 4:8], last], 1)
        return self._add(groups, *self._values(channels, scale, bias), 128 * weights.sum(0, np.int32))

    @staticmethod
    def _values(outputs: int, *values: NDArray[Any]) -> list[NDArray[np.float32]]:
        return [np.pad(v[:outputs].astype(np.float32), (0, max(outputs - len(v), 0))) for v in values]


def read_gpu_network(info: ModelInfo, variant: Variant) -> list[GpuLayers]:
    """Read a model's network.npz for the GPU: the levels of the encoder, followed by the last layers.

    Raises:
        ModelError: see `read_network`.
    """
    arrays, widths = read_network(info, variant.outputs), info.config["network"]
    levels, given = [], CORNERS * INPUT_PLANES + CHUNK
    for level, (channels, kept) in enumerate(zip(widths["levels"], KEPT, strict=True)):
        deepest = level + 1 == len(KEPT)
        pooled = 0 if deepest else channels // 2
        levels.append(_level(arrays, level, (given, channels, kept * 4**level, pooled)))
        given = -(-pooled // CHUNK) * CHUNK
    quads, writer = -(-variant.blend_parameters // 4), _Writer()
    last = {
        "decoder": writer.pointwise(*_pointwise(arrays, "decoder", 2 * CHUNK)),
        "hidden_weights": writer.pointwise(*_hidden(arrays)),
        "blend": writer.pointwise(*_blend(arrays, variant.blend_parameters, quads)),
        "quads": quads,
        "logits": arrays["logits.first"].item(),
        "logits_scale": arrays["logits.scale"].item(),
    }
    return [*levels, writer.layers(last)]


def _level(arrays: Arrays, level: int, sizes: tuple[int, int, int, int]) -> GpuLayers:
    """Return a level; `sizes` are the bytes of its inputs, channels, kept and pooled outputs."""
    writer, (given, channels, kept, pooled) = _Writer(), sizes
    pooled_chunks = -(-pooled // CHUNK)
    first, scale, bias = _pointwise(arrays, f"{level}.first", channels)
    if level == 0:
        first = _by_corner(first)
    columns = arrays[f"{level}.spatial.weights"]  # (channels / 16, 3 columns, 16, 3 rows and padding)
    taps = columns[..., :3].transpose(3, 1, 0, 2).reshape(9, channels)
    spatial = (arrays[f"{level}.spatial.{part}"] for part in ("scale", "bias"))
    constants: dict[str, float | int] = {
        "level": level,
        "inputs": given // CHUNK,
        "channels": channels // CHUNK,
        "kept": kept // CHUNK,
        "pooled": pooled_chunks,
        "channel_quads": channels // 4,
        "output_quads": (kept + pooled_chunks * CHUNK) // 4,
        "first": writer.pointwise(first, scale, bias),
        "spatial": writer.depthwise(taps, *spatial),
        "last": writer.pointwise(*_pointwise(arrays, f"{level}.last", kept + pooled_chunks * CHUNK)),
    }
    return writer.layers(constants)


def _pointwise(arrays: Arrays, name: str, outputs: int) -> Layer:
    """Return weights (outputs, bytes), scales and biases from blocks of 32 outputs, without padding."""
    blocks = arrays[f"{name}.weights"]
    weights = blocks.transpose(0, 2, 1, 3).reshape(blocks.shape[0] * blocks.shape[2], -1)
    return weights[:outputs], arrays[f"{name}.scale"][:outputs], arrays[f"{name}.bias"][:outputs]


def _by_corner(weights: NDArray[np.int8]) -> NDArray[np.int8]:
    """Reorder the bytes of packed pixels from (input, corner) to (corner, input), the order in texels."""
    packed, rest = np.split(weights, [CORNERS * INPUT_PLANES], axis=1)
    packed = packed.reshape(-1, INPUT_PLANES, CORNERS).transpose(0, 2, 1).reshape(len(weights), -1)
    return np.concatenate([packed, rest], axis=1)


def _hidden(arrays: Arrays) -> Layer:
    weights, scale, bias = _pointwise(arrays, "hidden", CORNERS * CHUNK)
    room = CORNERS * CHUNK - len(weights)  # narrow networks have fewer outputs
    return np.pad(_by_corner(weights), ((0, room), (0, 0))), scale, bias


def _blend(arrays: Arrays, parameters: int, quads: int) -> Layer:
    """Pad the parameters of each display pixel to a multiple of four, and the bytes to the hidden layer's."""
    found = []
    for name in ("weights", "scale", "bias"):
        values = arrays[f"blend.{name}"].reshape(len(arrays["blend.scale"]), -1)[: CORNERS * parameters]
        corners = values.reshape(CORNERS, parameters, -1)
        padded = np.pad(corners, ((0, 0), (0, 4 * quads - parameters), (0, 0)))
        found.append(padded.reshape(CORNERS * 4 * quads, -1))
    weights = np.pad(found[0], ((0, 0), (0, CORNERS * CHUNK - found[0].shape[1])))
    return weights, found[1][:, 0], found[2][:, 0]
