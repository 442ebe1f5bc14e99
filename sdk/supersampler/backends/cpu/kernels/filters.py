"""Separable filters of the samples around display pixels, of sixteen pixels at once.

The first pass sums rows of samples to a line, plane by plane; the second sums the samples of the line around
each pixel. Rows have PAD samples before and after them that repeat their ends; `wide` is the pitch of planes.
"""

import numpy as np

from supersampler.backends.cpu.layout import PAD, SAMPLE_PLANES
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import load16, picked, ramp16, select, spread16, store


@device_function
def span(starts, x0, x1):
    """Return the columns that pixels x0 to before x1 read, from a whole vector on; starts (W,)."""
    return (PAD + np.int64(starts[x0]) - 1) // 16 * 16, PAD + np.int64(starts[x1 - 1]) + 3


@device_function
def filter_down(colors, plane, count, rows, down, y, filter_at, wide, x0, x1, line, to):
    """Sum the four rows of samples that display row y reads into lines, from `to` on.

    rows (H, 4): these rows; down (., 4), from `filter_at` on: their weights; `count` planes from `plane` on;
    columns x0 to x1.
    """
    pitch = SAMPLE_PLANES * wide
    i, j = rows[4 * y] * pitch, rows[4 * y + 1] * pitch
    k, m = rows[4 * y + 2] * pitch, rows[4 * y + 3] * pitch
    t, u, v, w = down[filter_at], down[filter_at + 1], down[filter_at + 2], down[filter_at + 3]
    for c in range(plane, plane + count):
        for x in range(c * wide + x0, c * wide + x1, 16):
            upper = load16(colors, i + x) * t + load16(colors, j + x) * u
            lower = load16(colors, k + x) * v + load16(colors, m + x) * w
            store(line, to + x - plane * wide, upper + lower)


@device_function
def places_in(starts, x):
    """Return the samples that sixteen pixels from x on read, as `picked` takes them; starts (W,).

    That is: the sample of the first pixel; the distance from it to the ninth's; for each pixel, the distance
    from the first of its eight.
    """
    first, ninth = np.int64(starts[x]), np.int64(starts[x + 8])
    base = select(ramp16() < np.int32(8), spread16(np.int32(first)), spread16(np.int32(ninth)))
    return first, ninth - first, load16(starts, x) - base


@device_function
def add_tap(line, at, step, index, weight, total):
    """Add a weighted sample of each pixel."""
    return total + picked(line, at, step, index) * weight


@device_function
def tap(line, at, wide, step, index, weight, sums):
    """Add a weighted sample of four planes."""
    a, b, c, d = sums
    a, b = add_tap(line, at, step, index, weight, a), add_tap(line, at + wide, step, index, weight, b)
    c = add_tap(line, at + 2 * wide, step, index, weight, c)
    return a, b, c, add_tap(line, at + 3 * wide, step, index, weight, d)


@device_function
def filter_across(line, to, wide, starts, across, row, width, x):
    """Sum the four samples around each of sixteen pixels from x on, of four planes of a line from `to` on.

    starts (W,): the sample at or before a pixel's position; across (., W), from `row` on: weights of the four
    samples.
    """
    first, step, index = places_in(starts, x)
    none = load16(line, 0) * 0.0
    sums = none, none, none, none
    for k in range(4):
        weight = load16(across, (row + k) * width + x)
        sums = tap(line, to + PAD + first + k - 1, wide, step, index, weight, sums)
    return sums


@device_function
def filter_all_down(colors, rows, down, height, y, starts, x0, x1, wide, line):
    """Filter the columns that pixels x0 to x1 of row y read: line (FILTER_LINES, wide), by three filters.

    down (., H, 4): weights of the filters.
    """
    first, last = span(starts, x0, x1)
    one, two, three = 4 * y, 4 * (height + y), 4 * (2 * height + y)
    zero, one_plane, usable, four, six = (  # int64: numba would compile one function per literal
        np.int64(0), np.int64(1), np.int64(3), np.int64(4), np.int64(6),
    )  # fmt: skip
    filter_down(colors, zero, four, rows, down, y, one, wide, first, last, line, zero)
    filter_down(colors, zero, four, rows, down, y, two, wide, first, last, line, 4 * wide)
    filter_down(colors, four, six, rows, down, y, three, wide, first, last, line, 8 * wide)
    filter_down(colors, usable, one_plane, rows, down, y, three, wide, first, last, line, 14 * wide)


@device_function
def filter_all_across(line, wide, starts, across, width, x):
    """Return the sums of all lines for sixteen pixels: sixteen vectors."""
    a = filter_across(line, 0, wide, starts, across, 0, width, x)
    b = filter_across(line, 4 * wide, wide, starts, across, 4, width, x)
    c = filter_across(line, 8 * wide, wide, starts, across, 8, width, x)
    return (*a, *b, *c, *filter_across(line, 12 * wide, wide, starts, across, 8, width, x))
