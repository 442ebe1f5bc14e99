"""The int8 network of the classifiers for the CPU backend: `network.npz` of a model folder.

A value is (byte - zero) * scale. Products of bytes are summed as integers; a scale and a bias per output
convert the sum to the next layer's bytes:

    sum of w x  =  sigma * sum of w' (byte - zero),  w' = round(w scale / sigma),  sigma = max |w scale| / 127

The scale of each input channel is folded into the weights, so inputs from several sources need no common
scale. Outputs of depthwise convolutions are signed and stored around 128. Each layer writes its output
channels, padded, in the order in which the next layer reads them, so no bytes are moved between layers.
"""

import io
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from supersampler import Frame, Shot
from supersampler.backends.onnx.session import frame_inputs
from supersampler.methods.classifier.network_file import BLOCK, KEPT, WORD, width_problem
from supersampler.methods.classifier.spec import CLASSES, DEFAULT_INPUTS
from supersampler.methods.spec import constants_of, flags_of
from supersampler_model import ops
from supersampler_model.methods.base import Method
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_inputs import Gathered
from supersampler_model.methods.classifier_network import ClassifierNetwork, unpack

Floats = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]
BYTE, SIGNED, MIDDLE = 255.0, 127.0, 128.0
EPSILON = 1e-5  # of batch normalisation
EIGHT = 8  # outputs per iteration of the last layer
HALF_SIZE_BYTES = 8  # bytes of the half-size inputs in a record
SCALES, FRAMES = (1.5, 2.5), 10  # ratios and frames of the calibration on the shipped shot
SHARE = 0.9999
"""Quantile at which a range ends: outliers would make the quantization of all other values coarser."""
MARGIN = 1.5
"""Factor that widens ranges, for scenes with larger values than the calibration shot."""


def cpu_network(method: Method) -> bytes | None:
    """Return the int8 network; None if kernels do not support the method's config."""
    if not isinstance(method, Classifier) or type(method.net) is not ClassifierNetwork:
        return None
    # kernels read these fields or are compiled for them; the others must have their defaults
    names = "network", *constants_of(method.spec), *flags_of(method.spec)
    constants = {name: getattr(method.config, name) for name in names}
    problem = width_problem(vars(method.config.network))
    if problem is not None or method.config != replace(type(method.config)(), **constants):
        return None
    stream = io.BytesIO()
    arrays: dict[str, Any] = quantized(method.net, calibrated(method))
    np.savez(stream, **arrays)
    return stream.getvalue()


@dataclass(frozen=True)
class ByteLayout:
    """Layout of channels as contiguous bytes; one entry per byte."""

    channel: NDArray[np.int64]  # index of the channel, or -1 for padding
    scale: Floats  # of the values
    zero: Floats  # byte of the value 0

    @classmethod
    def of(cls, channels: Sequence[int] | int, scale: float, zero: float = 0.0) -> "ByteLayout":
        """Return a layout with equal scales; `channels` may be a number of channels."""
        order = np.arange(channels) if isinstance(channels, int) else np.array(channels, np.int64)
        return cls(order, np.full(len(order), scale), np.full(len(order), zero))

    def beside(self, other: "ByteLayout") -> "ByteLayout":
        """Concatenate two layouts."""
        shifted = np.where(other.channel < 0, -1, other.channel + self.channel.max(initial=-1) + 1)
        return ByteLayout(
            np.concatenate([self.channel, shifted]),
            np.concatenate([self.scale, other.scale]),
            np.concatenate([self.zero, other.zero]),
        )

    def followed_by(self, room: int) -> "ByteLayout":
        """Append padding bytes."""
        return ByteLayout(
            np.pad(self.channel, (0, room), constant_values=-1),
            np.pad(self.scale, (0, room), constant_values=1.0),
            np.pad(self.zero, (0, room)),
        )

    def up_to(self, multiple: int) -> "ByteLayout":
        """Append padding bytes up to a multiple."""
        return self.followed_by(-len(self.channel) % multiple)


def pixelwise(weights: Floats, bias: Floats, given: ByteLayout, made: ByteLayout) -> Arrays:
    """Quantize a 1x1 convolution, weights (out, in), for `pointwise` of the CPU library."""
    given, made = given.up_to(WORD), made.up_to(BLOCK)
    scaled = np.where(given.channel >= 0, weights[:, given.channel] * given.scale, 0.0)
    sigma = np.maximum(np.abs(scaled).max(axis=1), 1e-12) / SIGNED
    whole = np.round(scaled / sigma[:, None])
    offset = bias - sigma * (whole @ given.zero)
    there, order = made.channel >= 0, made.channel
    blocks = np.where(there[:, None], whole[order], 0.0).astype(np.int8)
    return {
        "weights": blocks.reshape(-1, BLOCK, len(given.channel) // WORD, WORD).transpose(0, 2, 1, 3),
        "scale": np.where(there, sigma[order] / made.scale, 0.0).astype(np.float32),
        "bias": np.where(there, offset[order] / made.scale + made.zero, 0.0).astype(np.float32),
    }


def by_output(layer: Arrays, outputs: int) -> Arrays:
    """Reorder the last layer output by output: (outputs up to a multiple of eight, words, WORD)."""
    outputs = -(-outputs // EIGHT) * EIGHT
    blocks, words = layer["weights"].shape[:2]
    rows = layer["weights"].transpose(0, 2, 1, 3).reshape(blocks * BLOCK, words, WORD)
    return {"weights": rows[:outputs], "scale": layer["scale"][:outputs], "bias": layer["bias"][:outputs]}


def depthwise(weights: Floats, given: float, made: float) -> Arrays:
    """Quantize a depthwise 3x3 convolution, weights (channels, 3, 3), with outputs around MIDDLE."""
    sigma = np.maximum(np.abs(weights).max(axis=(1, 2)), 1e-12) / SIGNED
    whole = np.round(weights / sigma[:, None, None]).astype(np.int8)
    # a word has three vertical neighbours and padding
    columns = np.zeros((len(weights) // 16, 3, 16, WORD), np.int8)
    columns[..., :3] = whole.reshape(-1, 16, 3, 3).transpose(0, 3, 1, 2)
    return {
        "weights": columns,
        "scale": (sigma * given / made).astype(np.float32),
        "bias": np.full(len(weights), MIDDLE, np.float32),
    }


def fused(layer: nn.Module) -> tuple[Floats, Floats]:
    """Return weights (out, in) and bias of a `Pointwise` with its batch normalisation folded in."""
    state = layer.state_dict().items()
    values = {name: value.detach().cpu().numpy().astype(np.float64) for name, value in state}
    scale = values["1.weight"] / np.sqrt(values["1.running_var"] + EPSILON)
    bias = values["1.bias"] - values["1.running_mean"] * scale
    return values["0.weight"][:, :, 0, 0] * scale[:, None], bias


def packed_bytes() -> ByteLayout:
    """Return the layout of packed pixels: inputs in [0, 1], except the depth difference, in [-1, 1]."""
    scale, zero = np.full(len(DEFAULT_INPUTS), 1.0 / BYTE), np.zeros(len(DEFAULT_INPUTS))
    at = DEFAULT_INPUTS.index("depth_difference")
    scale[at], zero[at] = 2.0 / BYTE, 0.5 * BYTE
    return ByteLayout(np.arange(4 * len(DEFAULT_INPUTS)), scale.repeat(4), zero.repeat(4))


def unpacked(channels: int, level: int) -> list[int]:
    """Return the channels of a level in the decoder's order: sub-pixel by sub-pixel, KEPT bytes each."""
    parts = 4**level
    return [
        channel * parts + part if channel * parts < channels else -1
        for part in range(parts)
        for channel in range(KEPT[level])
    ]


def quantized(network: ClassifierNetwork, ranges: Mapping[str, float]) -> Arrays:
    """Quantize all layers of a trained network; `ranges` are those of `calibrated`.

    Returns "<layer>.weights", "<layer>.scale" and "<layer>.bias" of each layer; "logits.first", the index of
    the classes among the outputs of the hidden layer, and "logits.scale".
    """
    layers: dict[str, Arrays] = {}
    packed = packed_bytes()
    given = packed.beside(ByteLayout.of(HALF_SIZE_BYTES, 1.0 / BYTE))
    read = ByteLayout.of(0, 1.0)
    for level, block in enumerate(network.encoder.blocks):
        first, spatial, last = block.children()
        name, kernel = f"encoder.blocks.{level}", _weights(spatial)[:, 0]
        channels = len(kernel)
        inner, signed = ranges[f"{name}.0"] / BYTE, ranges[f"{name}.1"] / SIGNED
        made = ranges[f"{name}.2"] / BYTE
        layers[f"{level}.first"] = pixelwise(*fused(first), given, ByteLayout.of(channels, inner))
        layers[f"{level}.spatial"] = depthwise(kernel, inner, signed)
        kept = channels if level + 1 == len(KEPT) else channels // 2
        order = unpacked(kept, level) + list(range(kept, channels))
        middle = ByteLayout.of(channels, signed, MIDDLE)
        layers[f"{level}.last"] = pixelwise(*fused(last), middle, ByteLayout.of(order, made))
        here = ByteLayout.of(kept // 4**level, made)
        here = here.followed_by(KEPT[level] - len(here.channel))
        read = read.beside(here)
        given = ByteLayout.of(channels - kept, made)
    (decoder,) = network.decoder
    weights, bias = fused(decoder)
    features = ByteLayout.of(len(bias), ranges["decoder.0"] / BYTE)
    layers["decoder"] = pixelwise(weights, bias, read, features)
    record = packed.beside(features)
    weights, bias = fused(network.hidden)
    classes = np.zeros((CLASSES, weights.shape[1]))
    classes[:, len(packed.channel) :] = _weights(network.classes)[:, :, 0, 0]
    made_hidden = ByteLayout.of(len(bias), ranges["hidden"] / BYTE)
    layers["logits"] = {"first": np.array(len(bias)), "scale": np.array(ranges["classes"] / SIGNED)}
    layers["hidden"] = pixelwise(
        np.concatenate([weights, classes]),
        np.concatenate([bias, _weights(network.classes, "bias")]),
        record,
        made_hidden.beside(ByteLayout.of(CLASSES, ranges["classes"] / SIGNED, MIDDLE)),
    )
    outputs = network.blend.out_channels
    order = np.arange(outputs).reshape(-1, 4).T.ravel().tolist()  # pixel by pixel
    weights, bias = _weights(network.blend)[:, :, 0, 0], _weights(network.blend, "bias")
    layers["blend"] = by_output(pixelwise(weights, bias, made_hidden, ByteLayout.of(order, 1.0)), outputs)
    found = {f"{name}.{part}": array for name, layer in layers.items() for part, array in layer.items()}
    return {name: np.ascontiguousarray(array) for name, array in found.items()}


def _weights(layer: nn.Module, name: str = "weight") -> Floats:
    values: Floats = layer.get_parameter(name).detach().cpu().numpy().astype(np.float64)
    return values


def calibrated(method: Classifier) -> dict[str, float]:
    """Step the shipped shot at several ratios, and return the range of each layer's output, by name.

    Ranges are rounded to two digits, so that rounding errors do not change the int8 network.
    """
    ranges: dict[str, float] = {}
    layers = {name: layer for name, layer in method.net.named_modules() if _is_quantized(name)}
    hooks = [layer.register_forward_hook(_record_range(name, ranges)) for name, layer in layers.items()]

    def infer(gathered: Gathered) -> tuple[Tensor, Tensor]:
        logits, blend = method.net(*method.network_inputs(gathered))
        return logits, unpack(blend)

    vars(method)["infer"] = infer  # layer by layer on packed pixels, like the int8 network
    try:
        for scale in SCALES:
            _step_plaza(method, scale)
    finally:
        del vars(method)["infer"]
        for hook in hooks:
            hook.remove()
    return {name: float(f"{MARGIN * value:.1e}") for name, value in ranges.items()}


def _is_quantized(name: str) -> bool:
    """Return whether a layer's output is quantized: parts of blocks, decoder, compositor, classes."""
    path = name.split(".")
    return name in ("hidden", "classes") or (path[0], len(path)) in (("encoder", 4), ("decoder", 2))


def _record_range(name: str, ranges: dict[str, float]) -> Callable[[nn.Module, object, Tensor], None]:
    def note(_: nn.Module, __: object, given: Tensor) -> None:
        values = given.abs().flatten()
        rank = max(round((1.0 - SHARE) * len(values)), 1)
        ranges[name] = max(ranges.get(name, 0.0), float(torch.topk(values, rank).values[-1]))

    return note


def _step_plaza(method: Classifier, scale: float) -> None:
    shot = Shot.open("plaza")
    render = ops.Size(*shot.info.render_size)
    display = ops.Size(round(render.width * scale), round(render.height * scale))
    history = method.first_history(display, render)
    for item in itertools.islice(shot, FRAMES):
        frame = painted(item.frame, display) if "gbuffer_base_color" in method.inputs() else item.frame
        inputs = {
            name: torch.from_numpy(np.ascontiguousarray(value))
            for name, value in frame_inputs(frame, display, method.inputs()).items()
        }
        with torch.no_grad():
            history = method.step(*(inputs[name] for name in method.inputs()), *history).history


def painted(frame: Frame, display: tuple[int, int]) -> Frame:
    """Return a frame with made-up G-buffers, which the shipped shot lacks.

    The base colour is the toned colour, and all normals are equal. Display-size buffers are the nearest
    samples.
    """
    color = np.maximum(np.asarray(frame.color, np.float32), 0.0)
    base = color / (1.0 + color.max(axis=2, keepdims=True))
    normal = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), base.shape)
    width, height = frame.size
    rows = np.arange(display[1])[:, None] * height // display[1]
    columns = np.arange(display[0]) * width // display[0]
    found = {"base_color": base, "normal": normal, "depth": np.asarray(frame.depth, np.float32)}
    return replace(
        frame,
        gbuffer={"base_color": base, "normal": normal},
        gbuffer_display={name: image[rows, columns] for name, image in found.items()},
    )
