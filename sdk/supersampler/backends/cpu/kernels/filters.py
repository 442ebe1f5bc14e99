"""Separable filters of the samples around display pixels, of sixteen pixels at once.

Rows of samples are summed to a line, plane by plane, then what lies around each pixel on the line. Rows have
PAD samples before and after them that repeat their ends; `wide` is from one plane to the next.
"""

import numpy as np

from supersampler.backends.cpu.layout import PAD, SAMPLE_PLANES
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import load16, picked, ramp16, select, spread16, store


@device_function
def span(starts, x0, x1):
    """Columns that pixels x0 to before x1 look at, the first of them at a whole vector; starts (W,)."""
    return (PAD + np.int64(starts[x0]) - 1) // 16 * 16, PAD + np.int64(starts[x1 - 1]) + 3


@device_function
def filter_down(samples, plane, count, rows, down, y, filter_at, wide, x0, x1, line, to):
    """Sum the four rows of samples that display row y looks at, from `plane` on, into lines from `to` on.

    rows (H, 4) says which; down (., 4), from `filter_at` on, with what weights; columns x0 to x1 count.
    """
    pitch = SAMPLE_PLANES * wide
    i, j = rows[4 * y] * pitch, rows[4 * y + 1] * pitch
    k, m = rows[4 * y + 2] * pitch, rows[4 * y + 3] * pitch
    t, u, v, w = down[filter_at], down[filter_at + 1], down[filter_at + 2], down[filter_at + 3]
    for c in range(plane, plane + count):
        for x in range(c * wide + x0, c * wide + x1, 16):
            upper = load16(samples, i + x) * t + load16(samples, j + x) * u
            lower = load16(samples, k + x) * v + load16(samples, m + x) * w
            store(line, to + x - plane * wide, upper + lower)


@device_function
def places_in(starts, x):
    """Where sixteen pixels from x on look, as `picked` reads it; starts (W,).

    Where the first does, how much farther the ninth, and each from that of its eight on.
    """
    first, ninth = np.int64(starts[x]), np.int64(starts[x + 8])
    base = select(ramp16() < np.int32(8), spread16(np.int32(first)), spread16(np.int32(ninth)))
    return first, ninth - first, load16(starts, x) - base


@device_function
def looked(line, at, step, index, weight, total):
    """Add a sample for each pixel."""
    return total + picked(line, at, step, index) * weight


@device_function
def tap(line, at, wide, step, index, weight, sums):
    """Add a sample of four planes."""
    a, b, c, d = sums
    a, b = looked(line, at, step, index, weight, a), looked(line, at + wide, step, index, weight, b)
    c = looked(line, at + 2 * wide, step, index, weight, c)
    return a, b, c, looked(line, at + 3 * wide, step, index, weight, d)


@device_function
def filter_across(line, to, wide, starts, across, row, width, x):
    """Sum the four samples around each of sixteen pixels from x on, of four planes of a line from `to` on.

    starts (W,): the sample at or before where a pixel looks; across (., W), from `row` on: weights of the
    four around.
    """
    first, step, index = places_in(starts, x)
    none = load16(line, 0) * 0.0
    sums = none, none, none, none
    for k in range(4):
        weight = load16(across, (row + k) * width + x)
        sums = tap(line, to + PAD + first + k - 1, wide, step, index, weight, sums)
    return sums


@device_function
def filter_all_down(samples, rows, down, height, y, starts, x0, x1, wide, line):
    """Filter the columns that pixels x0 to x1 of row y read: line (FILTER_LINES, wide), by three filters.

    down (., H, 4): weights of the filters.
    """
    first, last = span(starts, x0, x1)
    one, two, three = 4 * y, 4 * (height + y), 4 * (2 * height + y)
    none, alone, usable, four, six = (  # of literals numba would make functions of their own
        np.int64(0), np.int64(1), np.int64(3), np.int64(4), np.int64(6),
    )  # fmt: skip
    filter_down(samples, none, four, rows, down, y, one, wide, first, last, line, none)
    filter_down(samples, none, four, rows, down, y, two, wide, first, last, line, 4 * wide)
    filter_down(samples, four, six, rows, down, y, three, wide, first, last, line, 8 * wide)
    filter_down(samples, usable, alone, rows, down, y, three, wide, first, last, line, 14 * wide)


@device_function
def filter_all_across(line, wide, starts, across, width, x):
    """Sums of all lines for sixteen pixels."""
    a = filter_across(line, 0, wide, starts, across, 0, width, x)
    b = filter_across(line, 4 * wide, wide, starts, across, 4, width, x)
    c = filter_across(line, 8 * wide, wide, starts, across, 8, width, x)
    return (*a, *b, *c, *filter_across(line, 12 * wide, wide, starts, across, 8, width, x))
