"""What a processor does to sixteen lanes in an instruction or a few, which LLVM would not find by itself."""

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils, config

_I16, _I32 = ir.IntType(16), ir.IntType(32)
LANES, HALF = 16, 8


def has(feature: str) -> bool:
    """Whether the processor that is compiled for has it; the name is LLVM's."""
    features = config.CPU_FEATURES
    if features is None:
        features = llvm.get_host_cpu_features().flatten()
    return f"+{feature}" in features.split(",")


def add_products(builder: ir.IRBuilder, total: ir.Value, unsigned: ir.Value, signed: ir.Value) -> ir.Value:
    """Add to each i32 lane four products of its unsigned with its signed bytes."""
    if has("avx512vnni"):
        return _call(builder, "llvm.x86.avx512.vpdpbusd.512", total.type, total, unsigned, signed)
    if has("avxvnni"):  # Intel's desktops since 2021
        return _added_in_halves(builder, total, unsigned, signed)
    return builder.add(total, _products_in_halves(builder, unsigned, signed))


def _added_in_halves(
    builder: ir.IRBuilder, total: ir.Value, unsigned: ir.Value, signed: ir.Value
) -> ir.Value:
    """`add_products` of eight lanes and eight."""
    half = ir.VectorType(_I32, HALF)
    parts = ([_lanes(builder, v, first, HALF) for v in (total, unsigned, signed)] for first in (0, HALF))
    return _joined(builder, *(_call(builder, "llvm.x86.avx512.vpdpbusd.256", half, *part) for part in parts))


def _products_in_halves(builder: ir.IRBuilder, unsigned: ir.Value, signed: ir.Value) -> ir.Value:
    """Sums of four products: those of the even bytes and of the odd ones, as 16 bits, two and two."""
    words = ir.VectorType(_I16, 2 * LANES)
    eight, low = ir.Constant(words, [8] * 2 * LANES), ir.Constant(words, [255] * 2 * LANES)
    one, other = builder.bitcast(unsigned, words), builder.bitcast(signed, words)
    even = builder.and_(one, low), builder.ashr(builder.shl(other, eight), eight)
    odd = builder.lshr(one, eight), builder.ashr(other, eight)
    return builder.add(_pairs(builder, *even), _pairs(builder, *odd))


def _pairs(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    """Sums of the products of two 16-bit numbers each."""
    if has("avx2"):
        whole = ir.VectorType(_I32, HALF)
        parts = [(_lanes(builder, v, 0, LANES), _lanes(builder, v, LANES, LANES)) for v in (one, other)]
        found = [_call(builder, "llvm.x86.avx2.pmadd.wd", whole, a, b) for a, b in zip(*parts, strict=True)]
        return _joined(builder, *found)
    wide = ir.VectorType(_I32, 2 * LANES)
    products = builder.mul(builder.sext(one, wide), builder.sext(other, wide))
    first, second = (
        builder.shuffle_vector(products, products, _constant(range(begin, 2 * LANES, 2))) for begin in (0, 1)
    )
    return builder.add(first, second)


def pick(builder: ir.IRBuilder, pointer: ir.Value, at: ir.Value, step: ir.Value, index: ir.Value) -> ir.Value:
    """Read sixteen f32: the first eight where their `index`, i32 of 0 to 7, says, from `at` on.

    The others from `at + step` on; `step` is at most 8.
    """
    if has("avx512f"):
        return _picked_at_once(builder, pointer, at, step, index)
    ends = [
        (at, _lanes(builder, index, 0, HALF)),
        (builder.add(at, step), _lanes(builder, index, HALF, HALF)),
    ]
    if has("avx2"):
        permps = "llvm.x86.avx2.permps"
        found = [(_loaded(builder, pointer, begin, HALF), lanes) for begin, lanes in ends]
        return _joined(builder, *(_call(builder, permps, v.type, v, lanes) for v, lanes in found))
    picked = ir.Constant(ir.VectorType(ir.FloatType(), LANES), ir.Undefined)
    for lane in range(LANES):
        begin, lanes = ends[lane // HALF]
        there = builder.and_(builder.extract_element(lanes, _at(lane % HALF)), _at(HALF - 1))
        value = builder.load(builder.gep(pointer, [builder.add(begin, builder.zext(there, begin.type))]))
        picked = builder.insert_element(picked, value, _at(lane))
    return picked


def _picked_at_once(
    builder: ir.IRBuilder, pointer: ir.Value, at: ir.Value, step: ir.Value, index: ir.Value
) -> ir.Value:
    zeros = ir.Constant(index.type, [0] * LANES)
    ninth = builder.insert_element(zeros, builder.trunc(step, _I32), _at(HALF))
    steps = builder.shuffle_vector(ninth, ninth, ir.Constant(index.type, [0] * HALF + [HALF] * HALF))
    values = _loaded(builder, pointer, at, LANES)
    return _call(builder, "llvm.x86.avx512.permvar.sf.512", values.type, values, builder.add(index, steps))


def _loaded(builder: ir.IRBuilder, pointer: ir.Value, at: ir.Value, count: int) -> ir.Value:
    kind = ir.VectorType(ir.FloatType(), count).as_pointer()
    value = builder.load(builder.bitcast(builder.gep(pointer, [at]), kind))
    value.align = 4
    return value


def _at(lane: int) -> ir.Constant:
    return ir.Constant(_I32, lane)


def _call(builder: ir.IRBuilder, name: str, gives: ir.Type, *args: ir.Value) -> ir.Value:
    kind = ir.FunctionType(gives, [value.type for value in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)


def _constant(lanes: range) -> ir.Constant:
    return ir.Constant(ir.VectorType(_I32, len(lanes)), list(lanes))


def _lanes(builder: ir.IRBuilder, vector: ir.Value, first: int, count: int) -> ir.Value:
    return builder.shuffle_vector(vector, vector, _constant(range(first, first + count)))


def _joined(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    return builder.shuffle_vector(one, other, _constant(range(2 * one.type.count)))
