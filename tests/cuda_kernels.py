"""Operators of our graphs that ONNX Runtime's CUDA provider runs, by docs/OperatorKernels.md of its source.

Read at commit 001d12d2623fd411ce0f83d05abb5e82304a3389: kernels for opset 17, and of their types those that
our graphs could have.
"""

_FLOATS = {"float", "float16"}
_NUMBERS = {*_FLOATS, "int32", "int64"}
_ANY = {*_NUMBERS, "bool"}

CUDA_KERNELS = {
    **dict.fromkeys(("Cast", "Concat", "Expand", "Gather", "Identity", "Reshape", "Slice", "Split"), _ANY),
    **dict.fromkeys(("Squeeze", "Transpose", "Unsqueeze"), _ANY),
    **dict.fromkeys(("Abs", "Add", "Div", "Max", "Min", "Mul", "Neg", "Pow", "Sub"), _NUMBERS),
    **dict.fromkeys(("ReduceMax", "ReduceSum"), _NUMBERS),
    **dict.fromkeys(("Greater", "GreaterOrEqual", "Less", "LessOrEqual"), _NUMBERS),
    **dict.fromkeys(
        ("Conv", "ConvTranspose", "DepthToSpace", "Exp", "Floor", "Log", "MatMul", "MaxPool"), _FLOATS
    ),
    **dict.fromkeys(("Reciprocal", "Relu", "Sigmoid", "Sqrt"), _FLOATS),
    "And": {"bool"},
    "Equal": _ANY,
    "Not": {"bool"},
    "Or": {"bool"},
    "Clip": {*_FLOATS, "int64"},
    "GridSample": {"float"},
    "Where": _ANY,  # bool is its condition
}
"""Types of data that a kernel takes."""

CPU_INPUTS = dict.fromkeys(
    ("Clip", "Expand", "ReduceSum", "Reshape", "Slice", "Split", "Squeeze", "Unsqueeze"), slice(1, None)
)
"""Inputs that kernels read in CPU memory."""
