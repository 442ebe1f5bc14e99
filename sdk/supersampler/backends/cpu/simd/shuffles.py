"""Shuffles of lanes, which transpose interleaved pixels to a vector per channel and back.

They use perfect shuffles: a round of `low_zip` and `high_zip` on the two halves of n vectors rotates the bits
of each value's position (vector number, then lane) by one; several rounds transpose.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.extending import intrinsic

from supersampler.backends.cpu.simd.vector import Vector, device_function, lane_indices, load4, load16


def _shuffler(order: Callable[[int], list[int]]) -> Callable[..., Any]:
    def shuffle(_: Any, first: Any, second: Any) -> Any:
        lanes = order(first.lanes)
        vector = Vector(first.kind, len(lanes))

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            return builder.shuffle_vector(*args, lane_indices(lanes))

        return vector(first, second), make

    return intrinsic(shuffle)


@intrinsic
def low_half(_: Any, whole: Any) -> Any:
    """Return the first half of the lanes."""
    vector = Vector(whole.kind, whole.lanes // 2)

    def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
        undefined = ir.Constant(whole.llvm, ir.Undefined)
        return builder.shuffle_vector(args[0], undefined, lane_indices(range(vector.lanes)))

    return vector(whole), make


joined = _shuffler(lambda n: list(range(2 * n)))  # concatenates two vectors
zipped = _shuffler(
    lambda n: [i // 2 + n * (i % 2) for i in range(2 * n)]
)  # alternates the lanes of two vectors
evens = _shuffler(lambda n: list(range(0, 2 * n, 2)))  # even lanes of both vectors
odds = _shuffler(lambda n: list(range(1, 2 * n, 2)))
low_zip = _shuffler(lambda n: [i // 2 + n * (i % 2) for i in range(n)])  # first half of `zipped`
high_zip = _shuffler(lambda n: [n // 2 + i // 2 + n * (i % 2) for i in range(n)])
shifted_in = _shuffler(
    lambda n: list(range(n - 1, 2 * n - 1))
)  # last lane of one, then the other's without its last
shifted_out = _shuffler(
    lambda n: list(range(1, n + 1))
)  # one's lanes without its first, then the other's first


def _shuffler_of_three(order: Callable[[int], list[int]]) -> Callable[..., Any]:
    """Like `_shuffler`, of three vectors in a row."""

    def shuffle(_: Any, first: Any, second: Any, third: Any) -> Any:
        n, places = first.lanes, order(first.lanes)

        def make(context: Any, builder: ir.IRBuilder, sig: Any, args: list[ir.Value]) -> ir.Value:
            pairs = [place if place < 2 * n else 0 for place in places]
            lanes = [i if place < 2 * n else place - n for i, place in enumerate(places)]
            of_two = builder.shuffle_vector(args[0], args[1], lane_indices(pairs))
            return builder.shuffle_vector(of_two, args[2], lane_indices(lanes))

        return first(first, second, third), make

    return intrinsic(shuffle)


def _third(part: int) -> Callable[..., Any]:
    return _shuffler_of_three(lambda n: [i % 3 * n + i // 3 for i in range(part * n, part * n + n)])


def _every_third(first: int) -> Callable[..., Any]:
    return _shuffler_of_three(lambda n: [3 * i + first for i in range(n)])


first_third, second_third, last_third = _third(0), _third(1), _third(2)
"""Thirds of three interleaved vectors: lane 0 of each, then lane 1 of each, ..."""
every_first, every_second, every_third = _every_third(0), _every_third(1), _every_third(2)
"""Every third lane of three vectors in a row, from lane 0, 1 or 2 on: the inverse of interleaving."""


@device_function
def transposed(rows: Any) -> Any:
    """Transpose sixteen vectors of sixteen lanes."""
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
    """Load sixteen pixels of sixteen channels as a vector per channel."""
    p = pointer
    return transposed((
        load16(p, index), load16(p, index + 16), load16(p, index + 32), load16(p, index + 48),
        load16(p, index + 64), load16(p, index + 80), load16(p, index + 96), load16(p, index + 112),
        load16(p, index + 128), load16(p, index + 144), load16(p, index + 160), load16(p, index + 176),
        load16(p, index + 192), load16(p, index + 208), load16(p, index + 224), load16(p, index + 240),
    ))  # fmt: skip


@device_function
def shuffled8(rows: Any, rounds: int) -> Any:
    """Apply rounds of the perfect shuffle to eight vectors."""
    for _ in range(rounds):
        a, b, c, d, e, f, g, h = rows
        rows = (
            low_zip(a, e), high_zip(a, e), low_zip(b, f), high_zip(b, f),
            low_zip(c, g), high_zip(c, g), low_zip(d, h), high_zip(d, h),
        )  # fmt: skip
    return rows


@device_function
def shuffled4(rows: Any, rounds: int) -> Any:
    """Apply rounds of the perfect shuffle to four vectors."""
    for _ in range(rounds):
        a, b, c, d = rows
        rows = low_zip(a, c), high_zip(a, c), low_zip(b, d), high_zip(b, d)
    return rows


@device_function
def load_columns8(pointer: Any, index: int) -> Any:
    """Load sixteen pixels of eight channels as a vector per channel."""
    p = pointer
    rows = (
        load16(p, index), load16(p, index + 16), load16(p, index + 32), load16(p, index + 48),
        load16(p, index + 64), load16(p, index + 80), load16(p, index + 96), load16(p, index + 112),
    )  # fmt: skip
    return shuffled8(rows, 4)


@device_function
def columns4(rows: Any) -> Any:
    """Convert four vectors of four pixels to a vector per channel."""
    return shuffled4(rows, 4)


@device_function
def load_columns4(pointer: Any, index: int) -> Any:
    """Load sixteen pixels of four channels as a vector per channel."""
    p = pointer
    return columns4((load16(p, index), load16(p, index + 16), load16(p, index + 32), load16(p, index + 48)))


@device_function
def four_places(pointer: Any, places: Any, first: int, pitch: int, offset: int) -> Any:
    """Load four values at each of four places; see `gather4`."""
    p, i, o = pointer, first, offset
    upper = joined(load4(p, pitch * places[i] + o), load4(p, pitch * places[i + 1] + o))
    return joined(upper, joined(load4(p, pitch * places[i + 2] + o), load4(p, pitch * places[i + 3] + o)))


@device_function
def gather4(pointer: Any, places: Any, first: int, pitch: int, offset: int) -> Any:
    """Load four values from pitch * place + offset on, for sixteen places, as four vectors."""
    a = four_places(pointer, places, first, pitch, offset)
    b = four_places(pointer, places, first + 4, pitch, offset)
    c = four_places(pointer, places, first + 8, pitch, offset)
    return columns4((a, b, c, four_places(pointer, places, first + 12, pitch, offset)))


@device_function
def rows4(columns: Any) -> Any:
    """Convert a vector per channel to four vectors of four interleaved pixels."""
    return shuffled4(columns, 2)


@device_function
def rows8(columns: Any) -> Any:
    """Convert a vector per channel to sixteen interleaved pixels of eight channels."""
    return shuffled8(columns, 3)
