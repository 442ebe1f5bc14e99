"""What a processor does to sixteen lanes in an instruction or a few, which LLVM would not find by itself."""

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils, config

_I16, _I32 = ir.IntType(16), ir.IntType(32)
LANES = 16


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
    return builder.add(total, _products_in_halves(builder, unsigned, signed))


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
        whole = ir.VectorType(_I32, LANES // 2)
        parts = [(_lanes(builder, v, 0, LANES), _lanes(builder, v, LANES, LANES)) for v in (one, other)]
        found = [_call(builder, "llvm.x86.avx2.pmadd.wd", whole, a, b) for a, b in zip(*parts, strict=True)]
        return _joined(builder, *found)
    wide = ir.VectorType(_I32, 2 * LANES)
    products = builder.mul(builder.sext(one, wide), builder.sext(other, wide))
    first, second = (
        builder.shuffle_vector(products, products, _constant(range(begin, 2 * LANES, 2))) for begin in (0, 1)
    )
    return builder.add(first, second)


def permute(builder: ir.IRBuilder, vector: ir.Value, index: ir.Value) -> ir.Value:
    """Put lanes where `index`, i32 lanes of 0 to 15, says that they are read."""
    if has("avx512f"):
        return _call(builder, "llvm.x86.avx512.permvar.sf.512", vector.type, vector, index)
    if has("avx2"):
        return _permuted_in_halves(builder, vector, index)
    found = ir.Constant(vector.type, ir.Undefined)
    for lane in range(LANES):
        at = ir.Constant(_I32, lane)
        there = builder.and_(builder.extract_element(index, at), ir.Constant(_I32, LANES - 1))
        found = builder.insert_element(found, builder.extract_element(vector, there), at)
    return found


def _permuted_in_halves(builder: ir.IRBuilder, vector: ir.Value, index: ir.Value) -> ir.Value:
    half = LANES // 2
    low, high = (_lanes(builder, vector, first, half) for first in (0, half))
    last = ir.Constant(ir.VectorType(_I32, half), [half - 1] * half)
    found = []
    for first in (0, half):
        at = _lanes(builder, index, first, half)
        one, other = (_call(builder, "llvm.x86.avx2.permps", low.type, part, at) for part in (low, high))
        found.append(builder.select(builder.icmp_signed(">", at, last), other, one))
    return _joined(builder, *found)


def _call(builder: ir.IRBuilder, name: str, gives: ir.Type, *args: ir.Value) -> ir.Value:
    kind = ir.FunctionType(gives, [value.type for value in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)


def _constant(lanes: range) -> ir.Constant:
    return ir.Constant(ir.VectorType(_I32, len(lanes)), list(lanes))


def _lanes(builder: ir.IRBuilder, vector: ir.Value, first: int, count: int) -> ir.Value:
    return builder.shuffle_vector(vector, vector, _constant(range(first, first + count)))


def _joined(builder: ir.IRBuilder, one: ir.Value, other: ir.Value) -> ir.Value:
    return builder.shuffle_vector(one, other, _constant(range(2 * one.type.count)))
