"""The network of the classifier in bytes, for the host executor: `network.npz` of a model folder.

Values are q * scale + zero. Products of bytes are summed as they are, and a scale and a bias for each output
channel lead from the sum to the next layer's bytes:

    sum of w x  =  sigma * sum of w' q + ...,  w' = round(w s / sigma),  sigma = max |w s| / 127

with the input's scale s of each channel within the weights, so that inputs of several sources need no common
one. What a depthwise convolution gives has a sign and is stored around 128.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import nn

from supersampler_model.methods.classifier_inputs import SEEN
from supersampler_model.networks.classifier import CLASSES, ClassifierNetwork

Floats = NDArray[np.float64]
BYTE, SIGNED, MIDDLE = 255.0, 127.0, 128.0
EPSILON = 1e-5  # of batch normalisation
SPARE = 8  # bytes of a record between packed pixels and decoder: what is at half size


@dataclass(frozen=True)
class Scales:
    """How the bytes of some channels are values: (byte - zero) * scale, an entry a channel."""

    scale: Floats
    zero: Floats

    @classmethod
    def of(cls, channels: int, scale: float, zero: float = 0.0) -> "Scales":
        """All channels alike."""
        return cls(np.full(channels, scale), np.full(channels, zero))

    def beside(self, other: "Scales") -> "Scales":
        """Channels of both, one after the other."""
        return Scales(np.concatenate([self.scale, other.scale]), np.concatenate([self.zero, other.zero]))


@dataclass(frozen=True)
class Layer:
    """Whole weights (out, in) or (out, 3, 3), and what leads from sums to bytes or values, (out,)."""

    weights: NDArray[np.int8]
    scale: NDArray[np.float32]
    bias: NDArray[np.float32]

    def ordered(self, order: NDArray[np.int64]) -> "Layer":
        """The same with its outputs in another order."""
        return Layer(self.weights[order], self.scale[order], self.bias[order])

    def and_then(self, other: "Layer") -> "Layer":
        """Outputs of both, of the same inputs."""
        return Layer(
            np.concatenate([self.weights, other.weights]),
            np.concatenate([self.scale, other.scale]),
            np.concatenate([self.bias, other.bias]),
        )


def pixelwise(weights: Floats, bias: Floats, given: Scales, made: Scales) -> Layer:
    """Quantise a 1x1 convolution, weights (out, in)."""
    scaled = weights * given.scale
    sigma = np.maximum(np.abs(scaled).max(axis=1), 1e-12) / SIGNED
    whole = np.round(scaled / sigma[:, None])
    offset = bias - sigma * (whole @ given.zero)
    return Layer(
        whole.astype(np.int8),
        (sigma / made.scale).astype(np.float32),
        (offset / made.scale + made.zero).astype(np.float32),
    )


def depthwise(weights: Floats, given: float, made: float) -> Layer:
    """Quantise a 3x3 convolution of each channel, (channels, 3, 3), to bytes around MIDDLE."""
    sigma = np.maximum(np.abs(weights).max(axis=(1, 2)), 1e-12) / SIGNED
    whole = np.round(weights / sigma[:, None, None]).astype(np.int8)
    bias = np.full(len(weights), MIDDLE, np.float32)
    return Layer(whole, (sigma * given / made).astype(np.float32), bias)


def folded(layer: nn.Module) -> tuple[Floats, Floats]:
    """Weights (out, in) and bias of a `Pointwise` with its batch normalisation within."""
    values = {
        name: value.detach().cpu().numpy().astype(np.float64) for name, value in layer.state_dict().items()
    }
    scale = values["1.weight"] / np.sqrt(values["1.running_var"] + EPSILON)
    bias = values["1.bias"] - values["1.running_mean"] * scale
    return values["0.weight"][:, :, 0, 0] * scale[:, None], bias


def unpacking(channels: int, factor: int) -> NDArray[np.int64]:
    """Order of channels in which each of factor x factor sub-pixels has its own side by side."""
    kept = channels // (factor * factor)
    return np.arange(channels).reshape(kept, factor * factor).T.ravel()


def packed_scales() -> Scales:
    """How bytes of packed pixels are values: all in [0, 1] but the difference of depth, in [-1, 1]."""
    scale, zero = np.full(len(SEEN), 1.0 / BYTE), np.zeros(len(SEEN))
    at = SEEN.index("difference")
    scale[at], zero[at] = 2.0 / BYTE, 0.5 * BYTE
    return Scales(scale.repeat(4), zero.repeat(4))


def quantised(network: ClassifierNetwork, ranges: Mapping[str, float]) -> dict[str, Layer]:
    """Quantise all layers.

    Args:
        network: trained.
        ranges: the largest value that counts of what each layer gives, by its name in the network.
    """
    layers: dict[str, Layer] = {}
    packed = packed_scales()
    given, handed = packed.beside(Scales.of(SPARE, 1.0 / BYTE)), []
    blocks = [list(block.children()) for block in network.encoder.blocks]
    for level, (first, spatial, last_one) in enumerate(blocks):
        name, kernel = f"encoder.blocks.{level}", _weights(spatial)[:, 0]
        channels = len(kernel)
        inner, signed = ranges[f"{name}.0"] / BYTE, ranges[f"{name}.1"] / SIGNED
        made = ranges[f"{name}.2"] / BYTE
        layers[f"{level}.first"] = pixelwise(*folded(first), given, Scales.of(channels, inner))
        layers[f"{level}.spatial"] = depthwise(kernel, inner, signed)
        last = pixelwise(*folded(last_one), Scales.of(channels, signed, MIDDLE), Scales.of(channels, made))
        kept = channels if level + 1 == len(blocks) else channels // 2
        order = np.concatenate([unpacking(kept, 2**level), np.arange(kept, channels)])
        layers[f"{level}.last"] = last.ordered(order)
        handed.append(Scales.of(kept // 4**level, made))
        given = Scales.of(channels // 2, made)
    given = handed[0]
    for more in handed[1:]:
        given = given.beside(more)
    for i, layer in enumerate(network.decoder):
        weights, bias = folded(layer)
        made_here = Scales.of(len(bias), ranges[f"decoder.{i}"] / BYTE)
        layers[f"decoder.{i}"] = pixelwise(weights, bias, given, made_here)
        given = made_here
    layers["hidden"], seen = _hidden(network, packed, given, ranges)
    order = unpacking(network.mixing.out_channels, 2)
    weights, bias = _weights(network.mixing)[:, :, 0, 0], _weights(network.mixing, "bias")
    layers["mixing"] = pixelwise(weights, bias, seen, Scales.of(len(bias), 1.0)).ordered(order)
    return layers


def _hidden(
    network: ClassifierNetwork, packed: Scales, features: Scales, ranges: Mapping[str, float]
) -> tuple[Layer, Scales]:
    """The compositor's first layer with the classes beside it: both see the same record."""
    weights, bias = folded(network.hidden)
    pixels, spare = len(packed.scale), np.zeros((len(bias), SPARE))
    wide = np.concatenate([weights[:, :pixels], spare, weights[:, pixels:]], axis=1)
    given = packed.beside(Scales.of(SPARE, 0.0)).beside(features)
    made = Scales.of(len(bias), ranges["hidden"] / BYTE)
    classes = np.zeros((CLASSES, len(given.scale)))
    classes[:, pixels + SPARE :] = _weights(network.classes)[:, :, 0, 0]
    logits = Scales.of(CLASSES, ranges["classes"] / SIGNED, MIDDLE)
    said = pixelwise(classes, _weights(network.classes, "bias"), given, logits)
    return pixelwise(wide, bias, given, made).and_then(said), made


def _weights(layer: nn.Module, name: str = "weight") -> Floats:
    values: Floats = layer.get_parameter(name).detach().cpu().numpy().astype(np.float64)
    return values
