"""Kernels of static-tile reuse: fingerprints of a frame's tiles, and how much tiles of the image changed."""

import numpy as np

from supersampler.backends.cpu.kernels.frame import LONGEST
from supersampler.backends.cpu.layout import RENDER_TILE, TILE
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
from supersampler.backends.cpu.structs import Floats, TileComparison, Words

STILL = 1e-3  # of a sample: what a matrix leaves of no motion
FACTOR = np.int32(0x2C1B3C6D)  # odd: a change of one word is never lost


@device_function
def moves(motion, at, row, count, height):
    """Whether anything in a tile moves; motion that is none counts as none, as in `frame.motion_at`."""
    most = spread16(np.float32(0.0))
    last = np.int32(2 * count - 1)
    for y in range(height):
        for half in range(2):
            place = minimum(ramp16() + np.int32(16 * half), last) + np.int32(at + y * row)
            length = absolute(gather(motion, place))
            most = select((length > most) & (length <= LONGEST), length, most)
    return not all_lanes(most <= STILL)


@device_function
def added(total, words, at, count):
    """Add `count` words of a row, sixteen at a time; the last is repeated up to whole sixteens."""
    for k in range(0, count, 16):
        if k + 16 <= count:
            word = load16(words, at + k)
        else:
            word = gather(words, minimum(ramp16() + np.int32(k), np.int32(count - 1)) + np.int32(at))
        total = (total + word) * FACTOR
    return total


def fingerprints(
    color: Words, depth: Words, motion: Words, moved: Floats, w: int, h: int, y0: int, y1: int, out: Words
):
    """Sums of each tile of tile rows y0 to y1, sixteen words (tile rows, tiles, 16); 0 where anything moves.

    motion and moved: the same array.
    """
    tiles = (w + RENDER_TILE - 1) // RENDER_TILE
    for ty in range(y0, y1):
        for tx in range(tiles):
            first, count = RENDER_TILE * ty * w + RENDER_TILE * tx, min(RENDER_TILE, w - RENDER_TILE * tx)
            height = min(RENDER_TILE, h - RENDER_TILE * ty)
            total = spread16(np.int32(0))
            if not moves(moved, 2 * first, 2 * w, count, height):
                total = total + np.int32(1)
                for y in range(height):
                    at = first + y * w
                    total = added(total, color, 3 * at, 3 * count)
                    total = added(total, depth, at, count)
                    total = added(total, motion, 2 * at, 2 * count)
            store(out, 16 * (ty * tiles + tx), total)


def copy_colors(pixels: Floats, channels: int, big_w: int, y0: int, y1: int, x0: int, x1: int, image: Floats):
    """Copy the first three channels of rows y0 to y1 and columns x0 to x1."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            at, to = (y * big_w + x) * channels, (y * big_w + x) * 3
            image[to] = pixels[at]
            image[to + 1] = pixels[at + 1]
            image[to + 2] = pixels[at + 2]


def compare_tiles(tiles: TileComparison, y0: int, y1: int, x0: int, x1: int):
    """Write the mean square change of tiles, rows y0 to y1 and columns x0 to x1, of toned colors.

    The change of a pixel is that of the channel that changed most.
    """
    pixels, reference, channels, exposure = tiles.pixels, tiles.reference, tiles.channels, tiles.exposure
    big_w, big_h = tiles.width, tiles.height
    for ty in range(y0, y1):
        for tx in range(x0, x1):
            total = np.float32(0.0)
            bottom, right = min(ty * TILE + TILE, big_h), min(tx * TILE + TILE, big_w)
            for y in range(ty * TILE, bottom):
                for x in range(tx * TILE, right):
                    at, to = (y * big_w + x) * channels, (y * big_w + x) * 3
                    off = bright = np.float32(0.0)
                    for c in range(3):
                        now, then = pixels[at + c], reference[to + c]
                        off = max(off, abs(now - then))
                        bright = max(bright, max(now, then))
                    off = off * exposure / (np.float32(1.0) + bright * exposure)
                    total += off * off
            count = np.float32((bottom - ty * TILE) * (right - tx * TILE))
            tiles.changes[ty * tiles.columns + tx] = total / count
