"""Kernels of settling tiles: sums of the samples in each pixel, errors of their means, and fades to these.

Sums are those of West (1979): weight times color, weight, and weight times squared distance from the mean.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import MAX_HALF
from supersampler.backends.cpu.layout import LANES, STATIC_TILE, SUM_VALUES
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import load16, spread16, store
from supersampler.backends.cpu.structs import AddedSamples, Floats, MeanErrors
from supersampler.methods.convergence import PERIOD

KEEP, ADD = 1, 2
"""Modes of a tile: its sums go on from those before, not from 0; the frame's samples are added."""
LEAST_WEIGHT = np.float32(1e-6)
STILL_WEIGHT = np.float32(2.0 * PERIOD)
"""Weight of a tile's mean in the method's own: samples then change it as little as after two periods."""


@device_function
def begin_with(sums, sums_before, begin, count, keep):
    """Copy the sums of a row of a tile, or write 0."""
    for at in range(begin, begin + count - LANES + 1, LANES):
        store(sums, at, load16(sums_before, at) if keep else spread16(np.float32(0.0)))
    for at in range(begin + count - count % LANES, begin + count):
        sums[at] = sums_before[at] if keep else np.float32(0.0)


@device_function
def within_half(value):
    """Clamp a number to [0, MAX_HALF]."""
    return min(max(value, np.float32(0.0)), np.float32(MAX_HALF))


@device_function
def add_sample(sums, at, color, sample, weight):
    """Add a sample to the sums of a pixel, clamped to [0, MAX_HALF]; leave out one with a NaN."""
    r, g, b = color[sample], color[sample + 1], color[sample + 2]
    if r != r or g != g or b != b:
        return
    r, g, b = within_half(r), within_half(g), within_half(b)
    before = sums[at + 3]
    after = before + weight
    if before > LEAST_WEIGHT:
        change = np.float32(0.0)
        for c in range(3):
            value, total = within_half(color[sample + c]), sums[at + c]
            change += (value - total / before) * (value - (total + weight * value) / after)
        sums[at + 4] += weight * change * np.float32(1.0 / 3.0)
    sums[at] += weight * r
    sums[at + 1] += weight * g
    sums[at + 2] += weight * b
    sums[at + 3] = after


def add_samples(tiles: AddedSamples, y0: int, y1: int, x0: int, x1: int):
    """Add the frame's samples to the sums of static tiles, rows y0 to y1 and columns x0 to x1 of these."""
    rows, columns = tiles.rows, tiles.columns
    sums, sums_before, width = tiles.sums, tiles.sums_before, tiles.width
    across = (width + STATIC_TILE - 1) // STATIC_TILE
    for ty in range(y0, y1):
        for y in range(ty * STATIC_TILE, min(ty * STATIC_TILE + STATIC_TILE, tiles.height)):
            row, row_kind = rows.sample[y], rows.kind[y] * tiles.column_kinds
            for tx in range(x0, x1):
                mode = tiles.modes[ty * across + tx]
                if mode == 0:
                    continue
                begin = (y * width + tx * STATIC_TILE) * SUM_VALUES
                count = min(STATIC_TILE, width - tx * STATIC_TILE) * SUM_VALUES
                begin_with(sums, sums_before, begin, count, mode & KEEP)
                if mode & ADD == 0 or row < 0:
                    continue
                for x in range(tx * STATIC_TILE, min(tx * STATIC_TILE + STATIC_TILE, width)):
                    column = columns.sample[x]
                    if column < 0:
                        continue
                    weight = tiles.weights[row_kind + columns.kind[x]]
                    if weight > np.float32(0.0):
                        sample = (row * tiles.samples_across + column) * 3
                        add_sample(sums, (y * width + x) * SUM_VALUES, tiles.color, sample, weight)


def mean_errors(means: MeanErrors, y0: int, y1: int, x0: int, x1: int):
    """Write the mean square error of toned means of static tiles, rows y0 to y1 and columns x0 to x1.

    A pixel without samples has an error of 1.
    """
    sums, width, height, exposure = means.sums, means.width, means.height, means.exposure
    across = (width + STATIC_TILE - 1) // STATIC_TILE
    for ty in range(y0, y1):
        for tx in range(x0, x1):
            total = np.float32(0.0)
            bottom, right = (
                min(ty * STATIC_TILE + STATIC_TILE, height),
                min(tx * STATIC_TILE + STATIC_TILE, width),
            )
            for y in range(ty * STATIC_TILE, bottom):
                for x in range(tx * STATIC_TILE, right):
                    at = (y * width + x) * SUM_VALUES
                    weight = sums[at + 3]
                    if weight > LEAST_WEIGHT:
                        brightest = max(sums[at], max(sums[at + 1], sums[at + 2])) / weight
                        slope = exposure / (np.float32(1.0) + exposure * brightest)
                        total += min(sums[at + 4] / weight * means.share * slope * slope, np.float32(1.0))
                    else:
                        total += np.float32(1.0)
            means.errors[ty * across + tx] = total / np.float32(
                (bottom - ty * STATIC_TILE) * (right - tx * STATIC_TILE)
            )


def fade_to_means(
    sums: Floats, parts: Floats, width: int, height: int, channels: int,
    y0: int, y1: int, x0: int, x1: int, pixels: Floats, image: Floats, still: Floats, has_still: int,
):  # fmt: skip
    """Move the colors of tiles towards the means, rows y0 to y1 and columns x0 to x1 of these.

    parts: (rows, columns) of tiles: 1 writes the mean. pixels: (height, width, channels), RGB first; image:
    (height, width, 3). still: (height, width, 4) the method's own mean and its weight, if has_still is 1: it
    becomes the color that is written, so that the method can go on from there. A pixel without samples stays
    as it is.
    """
    across = (width + STATIC_TILE - 1) // STATIC_TILE
    for ty in range(y0, y1):
        for y in range(ty * STATIC_TILE, min(ty * STATIC_TILE + STATIC_TILE, height)):
            for tx in range(x0, x1):
                part = parts[ty * across + tx]
                for x in range(tx * STATIC_TILE, min(tx * STATIC_TILE + STATIC_TILE, width)):
                    pixel = y * width + x
                    weight = sums[pixel * SUM_VALUES + 3]
                    scale = part / weight if weight > LEAST_WEIGHT else np.float32(0.0)
                    rest = np.float32(1.0) - part if weight > LEAST_WEIGHT else np.float32(1.0)
                    for c in range(3):
                        at = pixel * channels + c
                        mean = max(
                            min(scale * sums[pixel * SUM_VALUES + c], np.float32(MAX_HALF)), np.float32(0.0)
                        )
                        value = rest * pixels[at] + mean
                        pixels[at] = value
                        image[pixel * 3 + c] = value
                        if has_still > 0 and weight > LEAST_WEIGHT:
                            still[pixel * 4 + c] = value
                    if has_still > 0 and weight > LEAST_WEIGHT:
                        own = abs(still[pixel * 4 + 3])
                        still[pixel * 4 + 3] = rest * own + part * STILL_WEIGHT
