"""What tells whether anything changed: sums over the bits of tiles of a frame's inputs."""

import numpy as np

from supersampler.backends.cpu.kernels.frame import LONGEST
from supersampler.backends.cpu.kernels.types import Floats, Words
from supersampler.backends.cpu.layout import SAMPLES, TILE
from supersampler.backends.cpu.simd.device_function import inner
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

STILL = 1e-3  # of a sample: what a matrix leaves of no motion
FACTOR = np.int32(0x2C1B3C6D)  # odd: a change of one word is never lost


@inner
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


@inner
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
    tiles = (w + SAMPLES - 1) // SAMPLES
    for ty in range(y0, y1):
        for tx in range(tiles):
            first, count = SAMPLES * ty * w + SAMPLES * tx, min(SAMPLES, w - SAMPLES * tx)
            height = min(SAMPLES, h - SAMPLES * ty)
            total = spread16(np.int32(0))
            if not moves(moved, 2 * first, 2 * w, count, height):
                total = total + np.int32(1)
                for y in range(height):
                    at = first + y * w
                    total = added(total, color, 3 * at, 3 * count)
                    total = added(total, depth, at, count)
                    total = added(total, motion, 2 * at, 2 * count)
            store(out, 16 * (ty * tiles + tx), total)


def show(pixels: Floats, channels: int, big_w: int, y0: int, y1: int, x0: int, x1: int, image: Floats):
    """Colours of rows y0 to y1 and columns x0 to x1, as they are."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            at, to = (y * big_w + x) * channels, (y * big_w + x) * 3
            image[to] = pixels[at]
            image[to + 1] = pixels[at + 1]
            image[to + 2] = pixels[at + 2]


def look(
    pixels: Floats, channels: int, big_w: int, big_h: int, columns: int, exposure: float, y0: int, y1: int,
    x0: int, x1: int, looks: Floats, changes: Floats,
):  # fmt: skip
    """Mean square of how far tiles are from what they were when last looked at, as a screen shows it.

    Rows y0 to y1 and columns x0 to x1 of tiles, `columns` in a row; looks (big_h, big_w, 3) is what they
    were. A pixel is as far as its farthest channel.
    """
    for ty in range(y0, y1):
        for tx in range(x0, x1):
            total = np.float32(0.0)
            bottom, right = min(ty * TILE + TILE, big_h), min(tx * TILE + TILE, big_w)
            for y in range(ty * TILE, bottom):
                for x in range(tx * TILE, right):
                    at, to = (y * big_w + x) * channels, (y * big_w + x) * 3
                    off = bright = np.float32(0.0)
                    for c in range(3):
                        now, then = pixels[at + c], looks[to + c]
                        off = max(off, abs(now - then))
                        bright = max(bright, max(now, then))
                    off = off * exposure / (np.float32(1.0) + bright * exposure)
                    total += off * off
            changes[ty * columns + tx] = total / np.float32((bottom - ty * TILE) * (right - tx * TILE))
