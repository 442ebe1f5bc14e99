"""x86 instructions (AVX2, AVX-512, VNNI) that LLVM does not choose by itself, with portable fallbacks."""

from collections.abc import Iterable

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils, config

_I16, _I32 = ir.IntType(16), ir.IntType(32)
LANES, HALF = 16, 8


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
    half = ir.VectorType(_I32, HALF)
    parts = ([_slice(builder, v, first, HALF) for v in (total, unsigned, signed)] for first in (0, HALF))
    return _concatenated(
        builder, *(_call(builder, "llvm.x86.avx512.vpdpbusd.256", half, *part) for part in parts)
    )


def _products_in_halves(builder: ir.IRBuilder, unsigned: ir.Value, signed: ir.Value) -> ir.Value:
    """Return sums of four products, from 16-bit products of the even bytes and of the odd bytes."""
    words = ir.VectorType(_I16, 2 * LANES)
    eight, low = ir.Constant(words, [8] * 2 * LANES), ir.Constant(words, [255] * 2 * LANES)
    one, other = builder.bitcast(unsigned, words), builder.bitcast(signed, words)
    even = builder.and_(one, low), builder.ashr(builder.shl(other, eight), eight)
    odd = builder.lshr(one, eight), builder.ashr(other, eight)
    return builder.add(_pair_sums(builder, *even), _pair_sums(builder, *odd))


def _pair_sums(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    """Return sums of two products of 16-bit numbers."""
    if has("avx2"):
        whole = ir.VectorType(_I32, HALF)
        parts = [(_slice(builder, v, 0, LANES), _slice(builder, v, LANES, LANES)) for v in (one, other)]
        found = [_call(builder, "llvm.x86.avx2.pmadd.wd", whole, a, b) for a, b in zip(*parts, strict=True)]
        return _concatenated(builder, *found)
    wide = ir.VectorType(_I32, 2 * LANES)
    products = builder.mul(builder.sext(one, wide), builder.sext(other, wide))
    first, second = (
        builder.shuffle_vector(products, products, lane_indices(range(begin, 2 * LANES, 2)))
        for begin in (0, 1)
    )
    return builder.add(first, second)


def gather_nearby(
    builder: ir.IRBuilder, pointer: ir.Value, offset: ir.Value, step: ir.Value, index: ir.Value
) -> ir.Value:
    """Load sixteen f32: lane i from `offset + index[i]`, lanes 8 to 15 from `offset + step + index[i]`.

    `index` is i32 in 0 to 7; `step` is at most 8.
    """
    if has("avx512f"):
        return _gather_permuted(builder, pointer, offset, step, index)
    low, high = _slice(builder, index, 0, HALF), _slice(builder, index, HALF, HALF)
    halves = [(offset, low), (builder.add(offset, step), high)]
    if has("avx2"):
        permps = "llvm.x86.avx2.permps"
        found = [(_load(builder, pointer, begin, HALF), lanes) for begin, lanes in halves]
        return _concatenated(builder, *(_call(builder, permps, v.type, v, lanes) for v, lanes in found))
    gathered = ir.Constant(ir.VectorType(ir.FloatType(), LANES), ir.Undefined)
    for lane in range(LANES):
        begin, lanes = halves[lane // HALF]
        element = builder.and_(builder.extract_element(lanes, _lane(lane % HALF)), _lane(HALF - 1))
        value = builder.load(builder.gep(pointer, [builder.add(begin, builder.zext(element, begin.type))]))
        gathered = builder.insert_element(gathered, value, _lane(lane))
    return gathered


def _gather_permuted(
    builder: ir.IRBuilder, pointer: ir.Value, offset: ir.Value, step: ir.Value, index: ir.Value
) -> ir.Value:
    zeros = ir.Constant(index.type, [0] * LANES)
    ninth = builder.insert_element(zeros, builder.trunc(step, _I32), _lane(HALF))
    steps = builder.shuffle_vector(ninth, ninth, ir.Constant(index.type, [0] * HALF + [HALF] * HALF))
    values = _load(builder, pointer, offset, LANES)
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
