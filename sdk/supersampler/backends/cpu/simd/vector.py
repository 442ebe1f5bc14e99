"""Vectors of several lanes for kernels that numba compiles.

numba has scalars and arrays, and LLVM does not find the vectors of a warp by itself: reading a pixel's eight
channels at once makes one three times as fast. Here a vector is a value like a float: operators act on all
lanes, a float beside one is spread over them. LLVM splits what is wider than the machine's registers.

Kernels read and write through pointers (`load`, `store`); nothing is checked there. None of it is called from
Python: each function exists in compiled code alone.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import RequireLiteralValue
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from supersampler.backends.cpu.isa import add_products, pick

_FAST = ("contract", "nsz")  # a * b + c may be one operation; nothing else is reordered
_I32, _I1, _F32 = ir.IntType(32), ir.IntType(1), ir.FloatType()
_KINDS = {"f32": _F32, "i32": _I32, "mask": _I1}


class Vector(types.Type):  # numba has no types
    """`lanes` values of a kind: f32, i32, or mask, which comparisons give."""

    def __init__(self, kind: str, lanes: int) -> None:
        self.kind, self.lanes = kind, lanes
        super().__init__(f"{kind}x{lanes}")

    def of(self, kind: str) -> "Vector":
        """The same lanes of another kind."""
        return Vector(kind, self.lanes)

    @property
    def llvm(self) -> ir.VectorType:
        """The type in LLVM."""
        return ir.VectorType(_KINDS[self.kind], self.lanes)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, vector: Vector) -> None:
        super().__init__(manager, vector, vector.llvm)


def _spread(builder: ir.IRBuilder, scalar: ir.Value, vector: ir.VectorType) -> ir.Value:
    undefined = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(_I32, 0))
    lanes = ir.Constant(ir.VectorType(_I32, vector.count), [0] * vector.count)
    return builder.shuffle_vector(first, undefined, lanes)


# Operators


def _operator(symbol: Callable[..., Any], instructions: dict[str, str], *, compares: bool = False) -> None:
    """Define `symbol` on vectors: `instructions` names LLVM's for each kind."""

    @infer_global(symbol)
    class _Typing(AbstractTemplate):  # numba finds it by its decorator
        def generic(self, args: tuple[types.Type, ...], kws: dict[str, Any]) -> Any:
            vectors = [a for a in args if isinstance(a, Vector)]
            if kws or not vectors or any(v != vectors[0] for v in vectors):
                return None
            vector = vectors[0]
            if vector.kind not in instructions:
                return None
            scalar = types.float32 if vector.kind == "f32" else types.int32
            found = [a if isinstance(a, Vector) else scalar for a in args]
            return signature(vector.of("mask") if compares else vector, *found)

    def lower(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        vector = next(a for a in sig.args if isinstance(a, Vector))
        pairs = zip(args, sig.args, strict=True)
        values = [a if isinstance(t, Vector) else _spread(builder, a, vector.llvm) for a, t in pairs]
        instruction = instructions[vector.kind]
        if compares:
            ordered = builder.fcmp_ordered if vector.kind == "f32" else builder.icmp_signed
            return ordered(instruction, *values)
        make = getattr(builder, instruction)
        return make(*values, flags=_FAST) if vector.kind == "f32" else make(*values)

    for operands in ((Vector, Vector), (Vector, types.Number), (types.Number, Vector)):
        lower_builtin(symbol, *operands)(lower)


_operator(operator.add, {"f32": "fadd", "i32": "add"})
_operator(operator.sub, {"f32": "fsub", "i32": "sub"})
_operator(operator.mul, {"f32": "fmul", "i32": "mul"})
_operator(operator.truediv, {"f32": "fdiv"})
_operator(operator.and_, {"i32": "and_", "mask": "and_"})
_operator(operator.or_, {"i32": "or_", "mask": "or_"})
_operator(operator.lshift, {"i32": "shl"})
_operator(operator.rshift, {"i32": "ashr"})
_COMPARED = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq}
for _sign, _symbol in _COMPARED.items():
    _operator(_symbol, {"f32": _sign, "i32": _sign}, compares=True)


# Memory


def _place(builder: ir.IRBuilder, pointer: ir.Value, index: ir.Value, kind: ir.Type) -> ir.Value:
    return builder.bitcast(builder.gep(pointer, [index]), kind.as_pointer())


def _loader(lanes: int) -> Callable[..., Any]:
    def load(_: Any, pointer: Any, index: Any) -> Any:
        """Read `lanes` values from `index` on: int32 and bytes as i32, float32 and half floats as f32."""
        element = pointer.dtype
        vector = Vector("i32" if element in (types.int32, types.uint8) else "f32", lanes)

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            stored = {types.uint8: ir.IntType(8), types.uint16: ir.HalfType()}.get(element)
            kind = vector.llvm if stored is None else ir.VectorType(stored, lanes)
            value = builder.load(_place(builder, *args, kind))
            value.align = element.bitwidth // 8
            if element == types.uint8:
                return builder.zext(value, vector.llvm)
            return builder.fpext(value, vector.llvm) if element == types.uint16 else value

        return vector(pointer, types.intp), make

    return intrinsic(load)


load16, load8, load4 = _loader(16), _loader(8), _loader(4)


@intrinsic
def store(_: Any, pointer: Any, index: Any, vector: Any) -> Any:
    """Write all lanes from `index` on, as what the pointer points to; i32 must fit into bytes."""
    element = pointer.dtype

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        value = args[2]
        if element == types.uint8:
            value = builder.trunc(value, ir.VectorType(ir.IntType(8), vector.lanes))
        if element == types.uint16:
            value = builder.fptrunc(value, ir.VectorType(ir.HalfType(), vector.lanes))
        builder.store(value, _place(builder, args[0], args[1], value.type)).align = element.bitwidth // 8
        return context.get_dummy_value()

    return types.void(pointer, types.intp, vector), make


@intrinsic
def stream(_: Any, pointer: Any, index: Any, vector: Any) -> Any:
    """Like `store`, past the caches: for what is not read again soon, at multiples of the vector's bytes.

    Other threads see it once a lock was taken, as when a band of rows is reported done.
    """
    element = pointer.dtype

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        value = args[2]
        if element == types.uint16:
            value = builder.fptrunc(value, ir.VectorType(ir.HalfType(), vector.lanes))
        written = builder.store(value, _place(builder, args[0], args[1], value.type))
        written.align = vector.lanes * element.bitwidth // 8
        written.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(_I32, 1)]))
        return context.get_dummy_value()

    return types.void(pointer, types.intp, vector), make


@intrinsic
def prefetch(_: Any, pointer: Any, index: Any) -> Any:
    """Have the line at `index` come to the nearest cache; what is not there does no harm."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        place = builder.bitcast(builder.gep(args[0], [args[1]]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [place.type, _I32, _I32, _I32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [place, *(ir.Constant(_I32, n) for n in (0, 3, 1))])  # read, keep, data
        return context.get_dummy_value()

    return types.void(pointer, types.intp), make


@intrinsic
def gather(_: Any, pointer: Any, index: Any) -> Any:
    """Read one float32 or int32 for each lane, where the i32 lanes of `index` say; a load for each."""
    vector = index.of("i32" if pointer.dtype == types.int32 else "f32")

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        value = ir.Constant(vector.llvm, ir.Undefined)
        for lane in range(vector.lanes):
            at = ir.Constant(_I32, lane)
            place = builder.gep(args[0], [builder.sext(builder.extract_element(args[1], at), ir.IntType(64))])
            value = builder.insert_element(value, builder.load(place), at)
        return value

    return vector(pointer, index), make


# Functions of lanes


def _elementwise(name: str) -> Callable[..., Any]:
    def apply(_: Any, value: Any) -> Any:
        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            kind = ir.FunctionType(value.llvm, [value.llvm])
            name_of_all = f"llvm.{name}.v{value.lanes}f32"
            function = cgutils.get_or_insert_function(builder.module, kind, name_of_all)
            return builder.call(function, args)

        return value(value), make

    return intrinsic(apply)


square_root, floor, absolute = (_elementwise(name) for name in ("sqrt", "floor", "fabs"))


def _chooser(sign: str) -> Callable[..., Any]:
    def choose(_: Any, first: Any, second: Any) -> Any:
        """The second where either is NaN."""
        vector = first if isinstance(first, Vector) else second

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            pairs = zip(args, sig.args, strict=True)
            a, b = (v if isinstance(t, Vector) else _spread(builder, v, vector.llvm) for v, t in pairs)
            ordered = builder.fcmp_ordered if vector.kind == "f32" else builder.icmp_signed
            return builder.select(ordered(sign, a, b), a, b)

        scalar = types.float32 if vector.kind == "f32" else types.int32
        return vector(*(t if isinstance(t, Vector) else scalar for t in (first, second))), make

    return intrinsic(choose)


minimum, maximum = _chooser("<"), _chooser(">")


@intrinsic
def select(_: Any, mask: Any, first: Any, second: Any) -> Any:
    """`first` where the mask is set, else `second`."""
    vector = first if isinstance(first, Vector) else second

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        pairs = zip(args[1:], sig.args[1:], strict=True)
        a, b = (v if isinstance(t, Vector) else _spread(builder, v, vector.llvm) for v, t in pairs)
        return builder.select(args[0], a, b)

    scalar = types.float32 if vector.kind == "f32" else types.int32
    found = [t if isinstance(t, Vector) else scalar for t in (first, second)]
    return vector(mask, *found), make


def _converter(kind: str, instruction: str) -> Callable[..., Any]:
    def convert(_: Any, value: Any) -> Any:
        vector = value.of(kind)

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            return getattr(builder, instruction)(args[0], vector.llvm)

        return vector(value), make

    return intrinsic(convert)


to_int = _converter("i32", "fptosi")  # towards zero; of what fits
to_float = _converter("f32", "sitofp")
bits_of = _converter("i32", "bitcast")
float_of = _converter("f32", "bitcast")


@intrinsic
def dot4(_: Any, total: Any, bytes_: Any, signed: Any) -> Any:
    """Add to each of sixteen i32 lanes four products of unsigned with signed bytes, exactly."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return add_products(builder, *args)

    return total(total, bytes_, signed), make


@intrinsic
def gather_nearby(_: Any, pointer: Any, at: Any, step: Any, index: Any) -> Any:
    """Read sixteen float32: the first eight where their `index`, i32 lanes of 0 to 7, says, from `at` on.

    The others from `at + step` on; `step` is at most 8.
    """

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return pick(builder, *args)

    return index.of("f32")(pointer, types.intp, types.intp, index), make


@intrinsic(prefer_literal=True)
def packed(_: Any, value: Any, first: Any) -> Any:
    """The bytes of four i32 lanes, from the constant `first` on, as one word."""
    if not isinstance(first, types.IntegerLiteral):
        raise RequireLiteralValue("first")
    lanes = [first.literal_value + i for i in range(4)]

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        order = ir.Constant(ir.VectorType(_I32, 4), lanes)
        four = builder.shuffle_vector(args[0], ir.Constant(value.llvm, ir.Undefined), order)
        return builder.bitcast(builder.trunc(four, ir.VectorType(ir.IntType(8), 4)), _I32)

    return types.int32(value, first), make


# Lanes


@intrinsic
def sum_of_lanes(_: Any, value: Any) -> Any:
    """The lanes of f32 added up, halves by halves."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        total, lanes = args[0], value.lanes
        while lanes > 1:
            lanes //= 2
            undefined = ir.Constant(total.type, ir.Undefined)
            low, high = (
                builder.shuffle_vector(total, undefined, ir.Constant(ir.VectorType(_I32, lanes), list(order)))
                for order in (range(lanes), range(lanes, 2 * lanes))
            )
            total = builder.fadd(low, high)
        return builder.extract_element(total, ir.Constant(_I32, 0))

    return types.float32(value), make


@intrinsic
def all_lanes(_: Any, mask: Any) -> Any:
    """Whether all lanes of a mask are set, as a bool."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        word = ir.IntType(mask.lanes)
        return builder.icmp_unsigned("==", builder.bitcast(args[0], word), ir.Constant(word, -1))

    return types.boolean(mask), make


@intrinsic
def ramp16(_: Any) -> Any:
    """0, 1, ... 15 as i32."""
    vector = Vector("i32", 16)

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return ir.Constant(vector.llvm, list(range(16)))

    return vector(), make


@intrinsic
def spread16(_: Any, value: Any) -> Any:
    """A scalar in all of sixteen lanes."""
    vector = Vector("f32" if isinstance(value, types.Float) else "i32", 16)
    scalar = types.float32 if vector.kind == "f32" else types.int32

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return _spread(builder, args[0], vector.llvm)

    return vector(scalar), make
