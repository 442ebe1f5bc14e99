"""Lanes in other places: vectors of pixels to vectors of channels and back, by perfect shuffles.

A round of `low_zip` and `high_zip` over the halves of n vectors moves the highest bit of a value's place, the
one that tells vectors apart, to the lowest; a few rounds turn rows into columns.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.extending import intrinsic

from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import Vector, load4, load16

_I32 = ir.IntType(32)


def _shuffler(order: Callable[[int], list[int]]) -> Callable[..., Any]:
    def shuffle(_: Any, first: Any, second: Any) -> Any:
        lanes = order(first.lanes)
        vector = Vector(first.kind, len(lanes))

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            return builder.shuffle_vector(*args, ir.Constant(ir.VectorType(_I32, len(lanes)), lanes))

        return vector(first, second), make

    return intrinsic(shuffle)


def _halver() -> Callable[..., Any]:
    def low_half(_: Any, whole: Any) -> Any:
        """The first half of the lanes."""
        vector = Vector(whole.kind, whole.lanes // 2)

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            lanes = ir.Constant(ir.VectorType(_I32, vector.lanes), list(range(vector.lanes)))
            return builder.shuffle_vector(args[0], ir.Constant(whole.llvm, ir.Undefined), lanes)

        return vector(whole), make

    return intrinsic(low_half)


joined = _shuffler(lambda n: list(range(2 * n)))  # the lanes of both, one after the other
low_half = _halver()
zipped = _shuffler(lambda n: [i // 2 + n * (i % 2) for i in range(2 * n)])  # in turns
evens = _shuffler(lambda n: list(range(0, 2 * n, 2)))  # of both
odds = _shuffler(lambda n: list(range(1, 2 * n, 2)))
low_zip = _shuffler(lambda n: [i // 2 + n * (i % 2) for i in range(n)])  # halves of `zipped`
high_zip = _shuffler(lambda n: [n // 2 + i // 2 + n * (i % 2) for i in range(n)])
shifted_in = _shuffler(
    lambda n: list(range(n - 1, 2 * n - 1))
)  # the last lane of one, then all but the other's last
shifted_out = _shuffler(lambda n: list(range(1, n + 1)))  # all but the first of one, then the other's first
_fours = _shuffler(lambda n: [0] * n + [1] * n + [2] * (2 * n))  # the first lanes of one, several times each


def _thirds(part: int) -> Callable[..., Any]:
    def third(_: Any, first: Any, second: Any, third: Any) -> Any:
        n = first.lanes

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            def mixed(one: ir.Value, other: ir.Value, lanes: list[int]) -> ir.Value:
                return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(_I32, len(lanes)), lanes))

            lanes = [divmod(i, 3) for i in range(part * n, part * n + n)]  # lane, and of which vector
            pairs = mixed(args[0], args[1], [lane + n * (which == 1) for lane, which in lanes])
            order = [n + lane if which == 2 else i for i, (lane, which) in enumerate(lanes)]
            return mixed(pairs, args[2], order)

        return first(first, second, third), make

    return intrinsic(third)


first_third, second_third, last_third = _thirds(0), _thirds(1), _thirds(2)
"""Parts of three vectors in turns: a lane of each, then the next."""


@device_function
def transposed(rows: Any) -> Any:
    """Sixteen vectors of sixteen lanes, rows to columns; four rounds of a perfect shuffle."""
    for _ in range(4):
        a, b, c, d, e, f, g, h, i, j, k, z, m, n, o, p = rows
        rows = (
            low_zip(a, i), high_zip(a, i), low_zip(b, j), high_zip(b, j),
            low_zip(c, k), high_zip(c, k), low_zip(d, z), high_zip(d, z),
            low_zip(e, m), high_zip(e, m), low_zip(f, n), high_zip(f, n),
            low_zip(g, o), high_zip(g, o), low_zip(h, p), high_zip(h, p),
        )  # fmt: skip
    return rows


@device_function
def load_columns(pointer: Any, index: int) -> Any:
    """Sixteen pixels of sixteen channels each, as sixteen vectors of a channel each."""
    p = pointer
    return transposed((
        load16(p, index), load16(p, index + 16), load16(p, index + 32), load16(p, index + 48),
        load16(p, index + 64), load16(p, index + 80), load16(p, index + 96), load16(p, index + 112),
        load16(p, index + 128), load16(p, index + 144), load16(p, index + 160), load16(p, index + 176),
        load16(p, index + 192), load16(p, index + 208), load16(p, index + 224), load16(p, index + 240),
    ))  # fmt: skip


@device_function
def shuffled8(rows: Any, rounds: int) -> Any:
    """Eight vectors, some rounds on."""
    for _ in range(rounds):
        a, b, c, d, e, f, g, h = rows
        rows = (
            low_zip(a, e), high_zip(a, e), low_zip(b, f), high_zip(b, f),
            low_zip(c, g), high_zip(c, g), low_zip(d, h), high_zip(d, h),
        )  # fmt: skip
    return rows


@device_function
def shuffled4(rows: Any, rounds: int) -> Any:
    """Four vectors, some rounds on."""
    for _ in range(rounds):
        a, b, c, d = rows
        rows = low_zip(a, c), high_zip(a, c), low_zip(b, d), high_zip(b, d)
    return rows


@device_function
def load_columns8(pointer: Any, index: int) -> Any:
    """Sixteen pixels of eight channels each, as eight vectors of a channel each."""
    p = pointer
    rows = (
        load16(p, index), load16(p, index + 16), load16(p, index + 32), load16(p, index + 48),
        load16(p, index + 64), load16(p, index + 80), load16(p, index + 96), load16(p, index + 112),
    )  # fmt: skip
    return shuffled8(rows, 4)


@device_function
def columns4(rows: Any) -> Any:
    """Four vectors of four pixels of four channels each, as four vectors of a channel each."""
    return shuffled4(rows, 4)


@device_function
def load_columns4(pointer: Any, index: int) -> Any:
    """Sixteen pixels of four channels each, as four vectors of a channel each."""
    p = pointer
    return columns4((load16(p, index), load16(p, index + 16), load16(p, index + 32), load16(p, index + 48)))


@device_function
def four_places(pointer: Any, places: Any, first: int, pitch: int, offset: int) -> Any:
    """Four values each of four places."""
    p, i, o = pointer, first, offset
    upper = joined(load4(p, pitch * places[i] + o), load4(p, pitch * places[i + 1] + o))
    return joined(upper, joined(load4(p, pitch * places[i + 2] + o), load4(p, pitch * places[i + 3] + o)))


@device_function
def gather4(pointer: Any, places: Any, first: int, pitch: int, offset: int) -> Any:
    """Four values each of sixteen places, from pitch * place + offset on, as four vectors."""
    a = four_places(pointer, places, first, pitch, offset)
    b = four_places(pointer, places, first + 4, pitch, offset)
    c = four_places(pointer, places, first + 8, pitch, offset)
    return columns4((a, b, c, four_places(pointer, places, first + 12, pitch, offset)))


@device_function
def rows4(columns: Any) -> Any:
    """Four vectors of a channel each as four vectors of four pixels each."""
    return shuffled4(columns, 2)


@device_function
def rows8(columns: Any) -> Any:
    """Eight vectors of a channel each as sixteen pixels of eight channels each."""
    return shuffled8(columns, 3)
