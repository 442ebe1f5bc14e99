"""`network.int8.onnx` of a model folder: the int8 network of the CPU backend as a QDQ graph.

It has the operators of `network.onnx`, and the weights, scales and biases of `network.npz`. As in `quantize`,
values between layers are 0 to 255, because scales are folded into the weights. So every QuantizeLinear has a
scale of 1, except the logits', and outputs of several layers can be concatenated. The outputs of depthwise
convolutions have the zero point MIDDLE.
"""

import io
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from supersampler.methods.classifier.network_file import KEPT
from supersampler_export.graph import check_portable
from supersampler_export.quantize import BYTE, MIDDLE, packed_bytes, unpacked

Arrays = Mapping[str, NDArray[Any]]
QUANTIZED_OPERATORS = frozenset({"QuantizeLinear", "DequantizeLinear"})
"""Operators of a QDQ graph in addition to PORTABLE_OPERATORS."""
ENDS = {"packed": "packed.bytes", "half_inputs": "half_inputs.bytes"}
"""Inputs of the graph, and the names of their quantized values."""


class Layer(NamedTuple):
    """A layer of `network.npz`, with channels in the graph's order: sum(weights * bytes) * scale + bias."""

    weights: NDArray[np.int8]  # in the shape of the graph's convolution
    scale: NDArray[np.float32]  # one per output channel
    bias: NDArray[np.float32]


def quantized_network(network: onnx.ModelProto, content: bytes) -> onnx.ModelProto:
    """Return the QDQ graph of `network.onnx`, which is not changed, with the content of `network.npz`.

    Raises:
        ExportError: the graph has an operator that is not portable.
    """
    with np.load(io.BytesIO(content)) as file:
        arrays = dict(file)
    made = _Graph(network)
    made.read_inputs()
    for node in network.graph.node:
        match node.op_type:
            case "Conv":
                made.add_convolution(node, arrays)
            case "Relu":  # bytes with a zero point of 0 are not negative
                made.read_instead(node.input[0], node.output[0])
            case "Gather" | "Split" | "MaxPool" | "DepthToSpace" | "Concat" | "Slice":
                made.add_quantized(node)
            case _:
                made.add(node)
    model = made.model()
    check_portable(model, QUANTIZED_OPERATORS)
    onnx.checker.check_model(model, full_check=True)
    return model


def layer_of(arrays: Arrays, name: str, shape: tuple[int, ...]) -> Layer:
    """Return a layer in the order of the graph: the inverse of `pixelwise` etc. of `quantize`.

    `name` is that of the graph's convolution, such as "encoder.blocks.0.1", "decoder.0.0" or "classes";
    `shape` is that of its weights, (out, in, height, width).
    """
    part, level = _part_of(name), int(name.split(".")[2]) if name.startswith("encoder") else 0
    weights, scale, bias = (arrays[f"{part}.{field}"] for field in ("weights", "scale", "bias"))
    outputs, inputs = shape[:2]
    rows, columns = np.arange(outputs), np.arange(inputs)
    if part.endswith("spatial"):
        return Layer(weights.transpose(0, 2, 3, 1).reshape(-1, 4, 3)[:, None, :3], scale, bias)
    if part == "blend":  # pixel by pixel in the file
        rows = rows.reshape(4, -1).T.ravel()
        flat = weights.reshape(len(weights), -1)
    else:
        flat = weights.transpose(0, 2, 1, 3).reshape(-1, 4 * weights.shape[1])
    if part.endswith("last"):
        kept = outputs if level + 1 == len(KEPT) else outputs // 2
        order = unpacked(kept, level) + list(range(kept, outputs))
        rows = np.array([order.index(channel) for channel in range(outputs)])
    if part == "decoder":
        columns = _decoder_columns(arrays)
    if name == "classes":  # these rows read the features only, after the packed pixels
        rows, columns = rows + arrays["logits.first"].item(), columns + len(packed_bytes().channel)
    return Layer(flat[rows][:, columns].reshape(shape), scale[rows], bias[rows])


def _part_of(name: str) -> str:
    path = name.split(".")
    if path[0] == "encoder":
        return f"{path[2]}.{('first', 'spatial', 'last')[int(path[3])]}"
    return "hidden" if path[0] == "classes" else path[0]


def _decoder_columns(arrays: Arrays) -> NDArray[np.int64]:
    """Return the indices of the bytes of each level that the decoder reads, without padding."""
    channels = [len(arrays[f"{level}.spatial.scale"]) for level in range(len(KEPT))]
    kept = [*(count // 2 for count in channels[:-1]), channels[-1]]
    firsts = np.cumsum((0, *KEPT))
    return np.concatenate([firsts[level] + np.arange(count // 4**level) for level, count in enumerate(kept)])


class _Graph:
    """Builder of a QDQ graph from a float graph."""

    def __init__(self, source: onnx.ModelProto) -> None:
        self._source = source
        self._weights = {t.name: t for t in source.graph.initializer}
        self._nodes: list[onnx.NodeProto] = []
        self._constants: dict[str, onnx.TensorProto] = {}
        self._names: dict[str, str] = {}  # new names of values that were renamed

    def model(self) -> onnx.ModelProto:
        """Return the graph, without constants that nothing reads."""
        model = onnx.ModelProto()
        model.CopyFrom(self._source)
        read = {name for node in self._nodes for name in node.input}
        read -= {name for node in self._nodes for name in node.output}
        known = {**self._weights, **self._constants}
        del model.graph.node[:], model.graph.initializer[:]
        model.graph.node.extend(self._nodes)
        model.graph.initializer.extend(tensor for name, tensor in known.items() if name in read)
        return model

    def read_inputs(self) -> None:
        """Quantize the inputs, which are in [0, 1] or [-1, 1]."""
        packed = packed_bytes()
        count = self._source.graph.input[1].type.tensor_type.shape.dim[1].dim_value
        scales = {"packed": packed.scale, "half_inputs": np.full(count, 1.0 / BYTE)}
        zeros = {"packed": packed.zero, "half_inputs": np.zeros(count)}
        for name, made in ENDS.items():
            factor = self._constant(f"{name}.factor", (1.0 / scales[name])[None, :, None, None])
            offset = self._constant(f"{name}.offset", zeros[name][None, :, None, None])
            self._add("Mul", [name, factor], f"{name}.scaled")
            self._add("Add", [f"{name}.scaled", offset], f"{name}.shifted")
            self._quantize(f"{name}.shifted", made)

    def add(self, node: onnx.NodeProto) -> None:
        """Add a node unchanged."""
        self._nodes.append(node)

    def read_instead(self, name: str, given: str) -> None:
        """Replace the value `given` by `name`."""
        self._names[given] = self._names.get(name, name)

    def add_quantized(self, node: onnx.NodeProto) -> None:
        """Add a node that moves bytes, and quantize its outputs again."""
        moved = onnx.NodeProto()
        moved.CopyFrom(node)
        is_shape = node.op_type == "Concat" and node.attribute[0].i == 0
        if not is_shape:
            moved.input[:] = [self._value(name) for name in node.input]
            moved.output[:] = [f"{name}.moved" for name in node.output]
        self._nodes.append(moved)
        for name in () if is_shape else node.output:
            self._quantize(f"{name}.moved", name)

    def add_convolution(self, node: onnx.NodeProto, arrays: Arrays) -> None:
        """Add a convolution of bytes; its output is quantized, except for the blend parameters."""
        name, (result,) = node.input[1].removesuffix(".weight"), node.output
        layer = layer_of(arrays, name, tuple(self._weights[node.input[1]].dims))
        if name == "blend":
            self._convolve(node, layer, result)
            return
        scale, bias = layer.scale.astype(np.float64), layer.bias.astype(np.float64)
        step = arrays["logits.scale"].item() if name == "classes" else 1.0
        zero = MIDDLE if name == "classes" or _part_of(name).endswith("spatial") else 0.0
        if _part_of(name).endswith("last"):  # compensate the zero point of its input
            bias += MIDDLE * scale * layer.weights.sum(axis=(1, 2, 3), dtype=np.int64)
        values = (scale * step, (bias - zero) * step)
        self._convolve(node, Layer(layer.weights, *(v.astype(np.float32) for v in values)), f"{result}.sum")
        self._quantize(f"{result}.sum", result, step, zero)

    def _convolve(self, node: onnx.NodeProto, layer: Layer, result: str) -> None:
        """Add a convolution. Its bias stays float, as in `network.npz`; providers may round it."""
        name = node.input[1]
        given = [
            self._constant(f"{name}.bytes", layer.weights),
            self._constant(f"{name}.scale", layer.scale),
            self._constant(f"{name}.zero", np.zeros(len(layer.scale), np.int8)),
        ]
        self._add("DequantizeLinear", given, name, axis=0)
        inputs = [self._value(node.input[0]), name]
        if layer.bias.any():
            inputs.append(self._constant(f"{name}.bias", layer.bias))
        made = helper.make_node("Conv", inputs, [result], name=node.name)
        made.attribute.extend(node.attribute)
        self._nodes.append(made)

    def _quantize(self, name: str, result: str, step: float = 1.0, zero: float = 0.0) -> None:
        """Quantize a value to bytes, and convert it back to floats."""
        scale = self._constant(f"step.{step:g}", np.array(step))
        point = self._constant(f"zero.{zero:g}", np.array(zero, np.uint8))
        self._add("QuantizeLinear", [name, scale, point], f"{result}.rounded")
        self._add("DequantizeLinear", [f"{result}.rounded", scale, point], result)

    def _value(self, name: str) -> str:
        return self._names.get(name, ENDS.get(name, name))

    def _add(self, operator: str, inputs: list[str], output: str, **attributes: Any) -> None:
        self._nodes.append(
            helper.make_node(operator, inputs, [output], name=f"{operator}.{output}", **attributes)
        )

    def _constant(self, name: str, array: NDArray[Any]) -> str:
        """Add a constant, with floats as float32, and return its name."""
        values = array.astype(np.float32) if array.dtype == np.float64 else array
        self._constants.setdefault(name, numpy_helper.from_array(values.copy(), name))
        return name
