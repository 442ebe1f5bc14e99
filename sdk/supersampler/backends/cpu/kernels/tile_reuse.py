"""Kernels of static-tile reuse: fingerprints of a frame's tiles, and copies of an image's."""

import numpy as np

from supersampler.backends.cpu.kernels.frame import MAX_MOTION
from supersampler.backends.cpu.layout import RENDER_TILE
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    gather,
    load16,
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
def has_motion(motion, at, count):
    """Return whether a row of a tile has motion; unusable motion counts as none, as in `frame.motion_at`."""
    longest = spread16(np.float32(0.0))
    for half in range(2):
        index = minimum(ramp16() + np.int32(16 * half), np.int32(2 * count - 1)) + np.int32(at)
        length = absolute(gather(motion, index))
        longest = select((length > longest) & (length <= MAX_MOTION), length, longest)
    return not all_lanes(longest <= MIN_MOTION)


@device_function
def hash_row(total, words, at, count):
    """Hash `count` words of a row into `total`, sixteen at a time; the last word is repeated as padding."""
    for k in range(0, count, 16):
        if k + 16 <= count:
            word = load16(words, at + k)
        else:
            word = gather(words, minimum(ramp16() + np.int32(k), np.int32(count - 1)) + np.int32(at))
        total = (total + word) * FACTOR
    return total


def fingerprints(
    color: Words, depth: Words, motion: Words, moved: Floats, w: int, h: int, wanted: Bytes, step: int,
    y0: int, y1: int, out: Words,
):  # fmt: skip
    """Write sixteen words per tile of tile rows y0 to y1, (tile rows, tiles, 16); 0 where a tile has motion.

    motion and moved: the same array, as words and as floats. wanted: tiles; others are left as they are.
    step: one row of samples in so many is read.
    """
    tiles = (w + RENDER_TILE - 1) // RENDER_TILE
    for ty in range(y0, y1):
        height = min(RENDER_TILE, h - RENDER_TILE * ty)
        for tx in range(tiles):
            if wanted[ty * tiles + tx] == 0:
                continue
            first, count = RENDER_TILE * ty * w + RENDER_TILE * tx, min(RENDER_TILE, w - RENDER_TILE * tx)
            total = spread16(np.int32(1))
            for y in range(step // 2, height, step):
                at = first + y * w
                if has_motion(moved, 2 * at, count):
                    total = spread16(np.int32(0))
                    break
                total = hash_row(total, color, 3 * at, 3 * count)
                total = hash_row(total, depth, at, count)
                total = hash_row(total, motion, 2 * at, 2 * count)
            store(out, 16 * (ty * tiles + tx), total)


def copy_colors(pixels: Floats, channels: int, big_w: int, y0: int, y1: int, x0: int, x1: int, image: Floats):
    """Copy the first three channels of rows y0 to y1 and columns x0 to x1."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            at, to = (y * big_w + x) * channels, (y * big_w + x) * 3
            image[to] = pixels[at]
            image[to + 1] = pixels[at + 1]
            image[to + 2] = pixels[at + 2]
