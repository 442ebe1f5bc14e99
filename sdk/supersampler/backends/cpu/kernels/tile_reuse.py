"""Kernels of static-tile reuse: fingerprints of a frame's tiles, and copies of an image's."""

import numpy as np

from supersampler.backends.cpu.kernels.frame import MAX_MOTION
from supersampler.backends.cpu.layout import LANES, RENDER_TILE
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    bits_of,
    gather,
    minimum,
    ramp16,
    select,
    spread16,
    store,
)
from supersampler.backends.cpu.structs import Bytes, Floats, Words

MIN_MOTION = 1e-3  # samples: shorter motion is rounding of camera matrices
FACTOR = np.int32(0x2C1B3C6D)  # odd: multiplication is invertible, so a change of one word changes the sum


@device_function
def write_fingerprint(words, at, out, to):
    """Write the fingerprint of a tile, two words, from one word per column of samples; 0 where one is 0."""
    moves, first, second = False, np.int32(0), np.int32(0)
    for column in range(0, RENDER_TILE, 2):
        even, odd = words[at + column], words[at + column + 1]
        moves = moves or even == 0 or odd == 0
        first, second = (first + even) * FACTOR, (second + odd) * FACTOR
    out[to] = np.int32(0) if moves else first | np.int32(1)
    out[to + 1] = np.int32(0) if moves else second


def fingerprints(
    color: Words, depth: Words, motion: Floats, w: int, h: int, wanted: Bytes, step: int, scratch: Words,
    y0: int, y1: int, out: Words,
):  # fmt: skip
    """Write the fingerprints of tiles, (rows, columns, 2), of tile rows y0 to y1; 0 where a tile moves.

    wanted: tiles; others may be left as they are. step: one row of samples in so many is read. scratch:
    LANES. Unusable motion counts as none, as in `frame.motion_at`.
    """
    tiles = (w + RENDER_TILE - 1) // RENDER_TILE
    for ty in range(y0, y1):
        for block in range((w + LANES - 1) // LANES):
            first = ty * tiles + block * (LANES // RENDER_TILE)
            last = min(first + LANES // RENDER_TILE, ty * tiles + tiles)
            asked = False
            for tile in range(first, last):
                asked = asked or wanted[tile] != 0
            if not asked:
                continue
            column = minimum(ramp16() + np.int32(LANES * block), np.int32(w - 1))
            total, longest = spread16(np.int32(1)), spread16(np.float32(0.0))
            for y in range(RENDER_TILE * ty + step // 2, min(RENDER_TILE * ty + RENDER_TILE, h), step):
                at = column + np.int32(y * w)
                x, y2 = gather(motion, at + at), gather(motion, at + at + np.int32(1))
                length = absolute(x)
                longest = select((length > longest) & (length <= MAX_MOTION), length, longest)
                length = absolute(y2)
                longest = select((length > longest) & (length <= MAX_MOTION), length, longest)
                if all_lanes(longest > MIN_MOTION):
                    break
                total = (total + bits_of(x)) * FACTOR
                total = (total + bits_of(y2)) * FACTOR
                total = (total + gather(depth, at)) * FACTOR
                at = at * np.int32(3)
                total = (total + gather(color, at)) * FACTOR
                total = (total + gather(color, at + np.int32(1))) * FACTOR
                total = (total + gather(color, at + np.int32(2))) * FACTOR
            store(scratch, 0, select(longest <= MIN_MOTION, total, np.int32(0)))
            for tile in range(first, last):
                write_fingerprint(scratch, (tile - first) * RENDER_TILE, out, 2 * tile)


def copy_colors(pixels: Floats, channels: int, big_w: int, y0: int, y1: int, x0: int, x1: int, image: Floats):
    """Copy the first three channels of rows y0 to y1 and columns x0 to x1."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            at, to = (y * big_w + x) * channels, (y * big_w + x) * 3
            image[to] = pixels[at]
            image[to + 1] = pixels[at + 1]
            image[to + 2] = pixels[at + 2]
