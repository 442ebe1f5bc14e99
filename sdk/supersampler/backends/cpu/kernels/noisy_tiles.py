"""Kernels of tiles with noise: what their samples average to, and compensated sums of these."""

import numpy as np

from supersampler.backends.cpu.kernels.frame import MAX_MOTION
from supersampler.backends.cpu.kernels.sample_sums import begin_with, within_half
from supersampler.backends.cpu.kernels.tile_reuse import MIN_MOTION
from supersampler.backends.cpu.layout import STATIC_TILE, SUM_VALUES
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.structs import AddedSamples, Floats, NoisyFrame

KEEP, ADD = 1, 2
"""As in `kernels.sample_sums`."""
MEASURES = 6
"""Values of a tile: samples, means of toned luma and of depth, variances of these means, motion."""


@device_function
def moves(motion, sample):
    """Return whether a sample moves; unusable motion counts as none."""
    longest = max(abs(motion[2 * sample]), abs(motion[2 * sample + 1]))
    return longest > MIN_MOTION and longest <= MAX_MOTION


def measure_noise(frame: NoisyFrame, y0: int, y1: int, x0: int, x1: int, measures: Floats):
    """Write MEASURES of static tiles, rows y0 to y1 and columns x0 to x1 of these, (rows, columns, 6)."""
    tiles, depth, exposure = frame.samples, frame.depth, frame.exposure
    rows, columns, color, width = tiles.rows, tiles.columns, tiles.color, tiles.width
    across = (width + STATIC_TILE - 1) // STATIC_TILE
    for ty in range(y0, y1):
        for tx in range(x0, x1):
            count, luma, lumas, near, nears, moving = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for y in range(ty * STATIC_TILE, min(ty * STATIC_TILE + STATIC_TILE, tiles.height)):
                row = rows.sample[y]
                if row < 0:
                    continue
                for x in range(tx * STATIC_TILE, min(tx * STATIC_TILE + STATIC_TILE, width)):
                    if columns.sample[x] < 0:
                        continue
                    sample = row * tiles.samples_across + columns.sample[x]
                    if moves(frame.motion, sample):
                        moving = 1.0
                    r, g, b = color[3 * sample], color[3 * sample + 1], color[3 * sample + 2]
                    if r == r and g == g and b == b:
                        light = within_half(r) + within_half(g) + within_half(b)
                        toned = light * exposure / (3.0 + light * exposure)
                        close = depth[sample] if depth[sample] >= 0.0 else np.float32(0.0)
                        count += 1.0
                        luma += toned
                        lumas += toned * toned
                        near += close
                        nears += close * close
            to, scale = (ty * across + tx) * MEASURES, 1.0 / max(count, 1.0)
            luma, near = luma * scale, near * scale
            measures[to] = np.float32(count)
            measures[to + 1], measures[to + 2] = np.float32(luma), np.float32(near)
            measures[to + 3] = np.float32(max(lumas * scale - luma * luma, 0.0) * scale)
            measures[to + 4] = np.float32(max(nears * scale - near * near, 0.0) * scale)
            measures[to + 5] = np.float32(moving)


@device_function
def add_compensated(sums, at, compensation, to, value):
    """Add a value to a sum without the error of rounding it (Kahan 1965)."""
    exact = value - compensation[to]
    total = sums[at] + exact
    compensation[to] = (total - sums[at]) - exact
    sums[at] = total


def add_noisy_samples(
    tiles: AddedSamples, compensation_before: Floats, y0: int, y1: int, x0: int, x1: int, compensation: Floats
):
    """Add the frame's samples to the sums of static tiles, rows y0 to y1 and columns x0 to x1 of these.

    compensation: (height, width, 4).
    """
    rows, columns = tiles.rows, tiles.columns
    sums, width, color = tiles.sums, tiles.width, tiles.color
    across = (width + STATIC_TILE - 1) // STATIC_TILE
    for ty in range(y0, y1):
        for y in range(ty * STATIC_TILE, min(ty * STATIC_TILE + STATIC_TILE, tiles.height)):
            row, row_kind = rows.sample[y], rows.kind[y] * tiles.column_kinds
            for tx in range(x0, x1):
                mode, first = tiles.modes[ty * across + tx], y * width + tx * STATIC_TILE
                if mode == 0:
                    continue
                count = min(STATIC_TILE, width - tx * STATIC_TILE)
                begin_with(sums, tiles.sums_before, first * SUM_VALUES, count * SUM_VALUES, mode & KEEP)
                begin_with(compensation, compensation_before, first * 4, count * 4, mode & KEEP)
                if mode & ADD == 0 or row < 0:
                    continue
                for x in range(tx * STATIC_TILE, min(tx * STATIC_TILE + STATIC_TILE, width)):
                    column = columns.sample[x]
                    if column < 0:
                        continue
                    weight = tiles.weights[row_kind + columns.kind[x]]
                    sample = (row * tiles.samples_across + column) * 3
                    r, g, b = color[sample], color[sample + 1], color[sample + 2]
                    if r == r and g == g and b == b:
                        at, to = (y * width + x) * SUM_VALUES, (y * width + x) * 4
                        for c in range(3):
                            value = weight * within_half(color[sample + c])
                            add_compensated(sums, at + c, compensation, to + c, value)
                        add_compensated(sums, at + 3, compensation, to + 3, weight)
