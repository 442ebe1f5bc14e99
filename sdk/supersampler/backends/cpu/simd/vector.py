"""The type `Vector` for kernels: its operators, loads, stores and lane-wise functions.

numba has only scalars and arrays, and LLVM does not vectorize loops such as a warp's by itself: loading a
pixel's eight channels at once makes it three times as fast. A vector is a value like a float. Operators act
on all lanes, and a scalar operand is broadcast. LLVM splits vectors that are wider than the registers.

Loads and stores take pointers and do not check bounds. The functions exist only in compiled code.
"""

import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import njit
from numba.core import cgutils, config, types
from numba.core.errors import RequireLiteralValue
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

_I16, _I32 = ir.IntType(16), ir.IntType(32)
_LANES, _HALF = 16, 8  # of a vector, and of half of it


# Instructions of x86 (AVX2, AVX-512, VNNI) that LLVM does not choose by itself, with portable fallbacks


def has(feature: str) -> bool:
    """Return whether the target processor has a feature, by LLVM's name."""
    features = config.CPU_FEATURES
    if features is None:
        features = llvm.get_host_cpu_features().flatten()
    return f"+{feature}" in features.split(",")


def add_products(builder: ir.IRBuilder, total: ir.Value, unsigned: ir.Value, signed: ir.Value) -> ir.Value:
    """Add to each i32 lane the four products of its unsigned and signed bytes."""
    if has("avx512vnni"):
        return _call(builder, "llvm.x86.avx512.vpdpbusd.512", total.type, total, unsigned, signed)
    if has("avxvnni"):  # Intel's desktop processors since 2021
        return _added_in_halves(builder, total, unsigned, signed)
    return builder.add(total, _products_in_halves(builder, unsigned, signed))


def _added_in_halves(
    builder: ir.IRBuilder, total: ir.Value, unsigned: ir.Value, signed: ir.Value
) -> ir.Value:
    """Compute `add_products` in two halves of eight lanes."""
    half = ir.VectorType(_I32, _HALF)
    parts = ([_slice(builder, v, first, _HALF) for v in (total, unsigned, signed)] for first in (0, _HALF))
    return _concatenated(
        builder, *(_call(builder, "llvm.x86.avx512.vpdpbusd.256", half, *part) for part in parts)
    )


def _products_in_halves(builder: ir.IRBuilder, unsigned: ir.Value, signed: ir.Value) -> ir.Value:
    """Return sums of four products, from 16-bit products of the even bytes and of the odd bytes."""
    words = ir.VectorType(_I16, 2 * _LANES)
    eight, low = ir.Constant(words, [8] * 2 * _LANES), ir.Constant(words, [255] * 2 * _LANES)
    one, other = builder.bitcast(unsigned, words), builder.bitcast(signed, words)
    even = builder.and_(one, low), builder.ashr(builder.shl(other, eight), eight)
    odd = builder.lshr(one, eight), builder.ashr(other, eight)
    return builder.add(_pair_sums(builder, *even), _pair_sums(builder, *odd))


def _pair_sums(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    """Return sums of two products of 16-bit numbers."""
    if has("avx2"):
        whole = ir.VectorType(_I32, _HALF)
        parts = [(_slice(builder, v, 0, _LANES), _slice(builder, v, _LANES, _LANES)) for v in (one, other)]
        found = [_call(builder, "llvm.x86.avx2.pmadd.wd", whole, a, b) for a, b in zip(*parts, strict=True)]
        return _concatenated(builder, *found)
    wide = ir.VectorType(_I32, 2 * _LANES)
    products = builder.mul(builder.sext(one, wide), builder.sext(other, wide))
    first, second = (
        builder.shuffle_vector(products, products, lane_indices(range(begin, 2 * _LANES, 2)))
        for begin in (0, 1)
    )
    return builder.add(first, second)


def gather_eights(
    builder: ir.IRBuilder, pointer: ir.Value, offset: ir.Value, step: ir.Value, index: ir.Value
) -> ir.Value:
    """Load sixteen f32: lane i from `offset + index[i]`, lanes 8 to 15 from `offset + step + index[i]`.

    `index` is i32 in 0 to 7; `step` is at most 8.
    """
    if has("avx512f"):
        return _gather_permuted(builder, pointer, offset, step, index)
    low, high = _slice(builder, index, 0, _HALF), _slice(builder, index, _HALF, _HALF)
    halves = [(offset, low), (builder.add(offset, step), high)]
    if has("avx2"):
        permps = "llvm.x86.avx2.permps"
        found = [(_load(builder, pointer, begin, _HALF), lanes) for begin, lanes in halves]
        return _concatenated(builder, *(_call(builder, permps, v.type, v, lanes) for v, lanes in found))
    gathered = ir.Constant(ir.VectorType(ir.FloatType(), _LANES), ir.Undefined)
    for lane in range(_LANES):
        begin, lanes = halves[lane // _HALF]
        element = builder.and_(builder.extract_element(lanes, _lane(lane % _HALF)), _lane(_HALF - 1))
        value = builder.load(builder.gep(pointer, [builder.add(begin, builder.zext(element, begin.type))]))
        gathered = builder.insert_element(gathered, value, _lane(lane))
    return gathered


def _gather_permuted(
    builder: ir.IRBuilder, pointer: ir.Value, offset: ir.Value, step: ir.Value, index: ir.Value
) -> ir.Value:
    zeros = ir.Constant(index.type, [0] * _LANES)
    ninth = builder.insert_element(zeros, builder.trunc(step, _I32), _lane(_HALF))
    steps = builder.shuffle_vector(ninth, ninth, ir.Constant(index.type, [0] * _HALF + [_HALF] * _HALF))
    values = _load(builder, pointer, offset, _LANES)
    return _call(builder, "llvm.x86.avx512.permvar.sf.512", values.type, values, builder.add(index, steps))


def _load(builder: ir.IRBuilder, pointer: ir.Value, offset: ir.Value, count: int) -> ir.Value:
    kind = ir.VectorType(ir.FloatType(), count).as_pointer()
    value = builder.load(builder.bitcast(builder.gep(pointer, [offset]), kind))
    value.align = 4
    return value


def _lane(lane: int) -> ir.Constant:
    return ir.Constant(_I32, lane)


def _call(builder: ir.IRBuilder, name: str, gives: ir.Type, *args: ir.Value) -> ir.Value:
    kind = ir.FunctionType(gives, [value.type for value in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)


def lane_indices(indices: Iterable[int]) -> ir.Constant:
    """Return the indices that a shuffle takes."""
    lanes = list(indices)
    return ir.Constant(ir.VectorType(_I32, len(lanes)), lanes)


def _slice(builder: ir.IRBuilder, vector: ir.Value, first: int, count: int) -> ir.Value:
    return builder.shuffle_vector(vector, vector, lane_indices(range(first, first + count)))


def _concatenated(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    return builder.shuffle_vector(one, other, lane_indices(range(2 * one.type.count)))


_FAST = ("contract", "nsz")  # a * b + c may become one instruction; no other reordering
_I1, _F32 = ir.IntType(1), ir.FloatType()
_KINDS = {"f32": _F32, "i32": _I32, "mask": _I1}


class Vector(types.Type):  # numba is not typed
    """A vector of f32, i32, or mask lanes; comparisons return masks."""

    def __init__(self, kind: str, lanes: int) -> None:
        self.kind, self.lanes = kind, lanes
        super().__init__(f"{kind}x{lanes}")

    def of(self, kind: str) -> "Vector":
        """Return the type with as many lanes of another kind."""
        return Vector(kind, self.lanes)

    @property
    def llvm(self) -> ir.VectorType:
        """The type in LLVM."""
        return ir.VectorType(_KINDS[self.kind], self.lanes)

    def operands(self, *operands: types.Type) -> list[types.Type]:
        """Return the types of operands, of which scalars are converted to the type of a lane."""
        scalar = types.float32 if self.kind == "f32" else types.int32
        return [t if isinstance(t, Vector) else scalar for t in operands]


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, vector: Vector) -> None:
        super().__init__(manager, vector, vector.llvm)


def _broadcast(builder: ir.IRBuilder, scalar: ir.Value, vector: ir.VectorType) -> ir.Value:
    undefined = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(_I32, 0))
    return builder.shuffle_vector(first, undefined, lane_indices([0] * vector.count))


def _broadcast_scalars(
    builder: ir.IRBuilder, values: Sequence[ir.Value], operands: Sequence[types.Type], vector: Vector
) -> list[ir.Value]:
    return [
        value if isinstance(operand, Vector) else _broadcast(builder, value, vector.llvm)
        for value, operand in zip(values, operands, strict=True)
    ]


# Operators


def _operator(symbol: Callable[..., Any], instructions: dict[str, str], *, compares: bool = False) -> None:
    """Define an operator on vectors by LLVM's instruction for each kind."""

    @infer_global(symbol)
    class _Typing(AbstractTemplate):  # registered by the decorator
        def generic(self, args: tuple[types.Type, ...], kws: dict[str, Any]) -> Any:
            vectors = [a for a in args if isinstance(a, Vector)]
            if kws or not vectors or any(v != vectors[0] for v in vectors):
                return None
            vector = vectors[0]
            if vector.kind not in instructions:
                return None
            return signature(vector.of("mask") if compares else vector, *vector.operands(*args))

    def lower(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        vector = next(a for a in sig.args if isinstance(a, Vector))
        values = _broadcast_scalars(builder, args, sig.args, vector)
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
        """Load consecutive values from `index` on: int32 and bytes as i32, float32 and half floats as f32."""
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
    """Store all lanes from `index` on, converted to the pointer's type; i32 must fit into bytes."""
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
    """Store past the caches, for values that are not read again soon; aligned to the size of the vector.

    Other threads see the values after a lock operation, such as those of `ThreadPool`.
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
    """Prefetch the cache line at `index`; invalid addresses are ignored."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        place = builder.bitcast(builder.gep(args[0], [args[1]]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [place.type, _I32, _I32, _I32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [place, *(ir.Constant(_I32, n) for n in (0, 3, 1))])  # read, keep, data
        return context.get_dummy_value()

    return types.void(pointer, types.intp), make


@intrinsic
def gather(_: Any, pointer: Any, index: Any) -> Any:
    """Load a float32 or int32 for each lane from the i32 lanes of `index`."""
    vector = index.of("i32" if pointer.dtype == types.int32 else "f32")

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        value = ir.Constant(vector.llvm, ir.Undefined)
        for lane in range(vector.lanes):
            at = ir.Constant(_I32, lane)
            place = builder.gep(args[0], [builder.sext(builder.extract_element(args[1], at), ir.IntType(64))])
            value = builder.insert_element(value, builder.load(place), at)
        return value

    return vector(pointer, index), make


# Lane-wise functions


def _elementwise(name: str) -> Callable[..., Any]:
    def apply(_: Any, value: Any) -> Any:
        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            kind = ir.FunctionType(value.llvm, [value.llvm])
            full_name = f"llvm.{name}.v{value.lanes}f32"
            function = cgutils.get_or_insert_function(builder.module, kind, full_name)
            return builder.call(function, args)

        return value(value), make

    return intrinsic(apply)


square_root, floor, absolute = (_elementwise(name) for name in ("sqrt", "floor", "fabs"))


def _chooser(sign: str) -> Callable[..., Any]:
    def choose(_: Any, first: Any, second: Any) -> Any:
        """Return the minimum or maximum of two vectors; the second where either is NaN."""
        vector = first if isinstance(first, Vector) else second

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            a, b = _broadcast_scalars(builder, args, sig.args, vector)
            ordered = builder.fcmp_ordered if vector.kind == "f32" else builder.icmp_signed
            return builder.select(ordered(sign, a, b), a, b)

        return vector(*vector.operands(first, second)), make

    return intrinsic(choose)


minimum, maximum = _chooser("<"), _chooser(">")


@intrinsic
def select(_: Any, mask: Any, first: Any, second: Any) -> Any:
    """Return `first` where the mask is set, else `second`."""
    vector = first if isinstance(first, Vector) else second

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return builder.select(args[0], *_broadcast_scalars(builder, args[1:], sig.args[1:], vector))

    return vector(mask, *vector.operands(first, second)), make


def _converter(kind: str, instruction: str) -> Callable[..., Any]:
    def convert(_: Any, value: Any) -> Any:
        vector = value.of(kind)

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            return getattr(builder, instruction)(args[0], vector.llvm)

        return vector(value), make

    return intrinsic(convert)


to_int = _converter("i32", "fptosi")  # towards zero; values must fit
to_float = _converter("f32", "sitofp")
bits_of = _converter("i32", "bitcast")
float_of = _converter("f32", "bitcast")


@intrinsic
def dot4(_: Any, total: Any, bytes_: Any, signed: Any) -> Any:
    """Add the four products of unsigned and signed bytes in each of sixteen i32 lanes, exactly."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return add_products(builder, *args)

    return total(total, bytes_, signed), make


@intrinsic
def gather_nearby(_: Any, pointer: Any, at: Any, step: Any, index: Any) -> Any:
    """Load sixteen float32 from two runs of eight; see `gather_eights`."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return gather_eights(builder, *args)

    return index.of("f32")(pointer, types.intp, types.intp, index), make


@intrinsic(prefer_literal=True)
def packed(_: Any, value: Any, first: Any) -> Any:
    """Pack four i32 lanes, from the constant `first` on, as the bytes of a word."""
    if not isinstance(first, types.IntegerLiteral):
        raise RequireLiteralValue("first")
    lanes = range(first.literal_value, first.literal_value + 4)

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        undefined = ir.Constant(value.llvm, ir.Undefined)
        four = builder.shuffle_vector(args[0], undefined, lane_indices(lanes))
        return builder.bitcast(builder.trunc(four, ir.VectorType(ir.IntType(8), 4)), _I32)

    return types.int32(value, first), make


# Horizontal operations


@intrinsic
def sum_of_lanes(_: Any, value: Any) -> Any:
    """Return the sum of f32 lanes, added pairwise by halves."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        total, lanes = args[0], value.lanes
        while lanes > 1:
            lanes //= 2
            undefined = ir.Constant(total.type, ir.Undefined)
            low, high = (
                builder.shuffle_vector(total, undefined, lane_indices(half))
                for half in (range(lanes), range(lanes, 2 * lanes))
            )
            total = builder.fadd(low, high)
        return builder.extract_element(total, ir.Constant(_I32, 0))

    return types.float32(value), make


@intrinsic
def all_lanes(_: Any, mask: Any) -> Any:
    """Return whether all lanes of a mask are set."""

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        word = ir.IntType(mask.lanes)
        return builder.icmp_unsigned("==", builder.bitcast(args[0], word), ir.Constant(word, -1))

    return types.boolean(mask), make


@intrinsic
def ramp16(_: Any) -> Any:
    """Return 0, 1, ... 15 as i32."""
    vector = Vector("i32", 16)

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return ir.Constant(vector.llvm, list(range(16)))

    return vector(), make


@intrinsic
def spread16(_: Any, value: Any) -> Any:
    """Broadcast a scalar to sixteen lanes."""
    vector = Vector("f32" if isinstance(value, types.Float) else "i32", 16)

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        return _broadcast(builder, args[0], vector.llvm)

    return vector(*vector.operands(value)), make


device_function = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)
"""Without the wrappers and passes that only calls from Python need: a third of the compile time."""
