"""Separable filters of the samples around display pixels, for sixteen pixels at once.

The first pass filters rows of samples vertically to a line, plane by plane; the second filters the line
horizontally at each pixel. Rows of `padded_width` samples have PAD samples before and after, which repeat the
border.
"""

import numpy as np

from supersampler.backends.cpu.layout import PAD, SAMPLE_PLANES
from supersampler.backends.cpu.simd.vector import (
    device_function,
    gather_nearby,
    load16,
    ramp16,
    select,
    spread16,
    store,
)


@device_function
def span(starts, x0, x1):
    """Return the first and one past the last column that pixels x0 to x1 - 1 read; the first is aligned."""
    return (PAD + np.int64(starts[x0]) - 1) // 16 * 16, PAD + np.int64(starts[x1 - 1]) + 3


@device_function
def filter_down(colors, plane, count, rows, down, y, filter_at, padded_width, x0, x1, line, to):
    """Filter the four rows of samples that display row y reads, in columns x0 to x1, to lines from `to` on.

    rows (H, 4): these rows; down (., 4), from `filter_at` on: their weights. `count` planes from `plane` on.
    """
    row_pitch = SAMPLE_PLANES * padded_width
    i, j = rows[4 * y] * row_pitch, rows[4 * y + 1] * row_pitch
    k, m = rows[4 * y + 2] * row_pitch, rows[4 * y + 3] * row_pitch
    t, u, v, w = down[filter_at], down[filter_at + 1], down[filter_at + 2], down[filter_at + 3]
    for c in range(plane, plane + count):
        for x in range(c * padded_width + x0, c * padded_width + x1, 16):
            upper = load16(colors, i + x) * t + load16(colors, j + x) * u
            lower = load16(colors, k + x) * v + load16(colors, m + x) * w
            store(line, to + x - plane * padded_width, upper + lower)


@device_function
def places_in(starts, x):
    """Return the samples that sixteen pixels from x on read, in the format of `gather_nearby`; starts (W,).

    The result is the sample of the first pixel, the distance from it to the sample of the ninth, and for each
    pixel the distance from the first of its eight.
    """
    first, ninth = np.int64(starts[x]), np.int64(starts[x + 8])
    base = select(ramp16() < np.int32(8), spread16(np.int32(first)), spread16(np.int32(ninth)))
    return first, ninth - first, load16(starts, x) - base


@device_function
def add_tap(line, offset, step, index, weight, total):
    """Add a weighted sample of each pixel to a total."""
    return total + gather_nearby(line, offset, step, index) * weight


@device_function
def tap(line, offset, padded_width, step, index, weight, sums):
    """Add a weighted sample of four planes to four sums."""
    a, b, c, d = sums
    a, b = (
        add_tap(line, offset, step, index, weight, a),
        add_tap(line, offset + padded_width, step, index, weight, b),
    )
    c = add_tap(line, offset + 2 * padded_width, step, index, weight, c)
    return a, b, c, add_tap(line, offset + 3 * padded_width, step, index, weight, d)


@device_function
def filter_across(line, to, padded_width, starts, across, row, width, x):
    """Filter the four samples around each of sixteen pixels from x on, in four planes of a line from `to` on.

    starts (W,): the sample at or before a pixel's position; across (., W), from `row` on: weights of the four
    samples.
    """
    first, step, index = places_in(starts, x)
    zero = load16(line, 0) * 0.0
    sums = zero, zero, zero, zero
    for k in range(4):
        weight = load16(across, (row + k) * width + x)
        sums = tap(line, to + PAD + first + k - 1, padded_width, step, index, weight, sums)
    return sums


@device_function
def filter_line_across(line, to, starts, across, row, width, x):
    """Do what `filter_across` does with one plane: the line from `to` on."""
    first, step, index = places_in(starts, x)
    total = load16(line, 0) * 0.0
    for k in range(4):
        total = add_tap(
            line, to + PAD + first + k - 1, step, index, load16(across, (row + k) * width + x), total
        )
    return total


@device_function
def filter_all_down(colors, rows, down, height, y, starts, x0, x1, padded_width, line, second=True):
    """Filter the columns that pixels x0 to x1 of row y read with three filters, to FILTER_LINES lines.

    down (., H, 4): weights of the filters; second: whether the second one is needed.
    """
    first, last = span(starts, x0, x1)
    one, two, three = 4 * y, 4 * (height + y), 4 * (2 * height + y)
    zero, one_plane, usable, four, six = (  # int64: numba would compile one function per literal
        np.int64(0), np.int64(1), np.int64(3), np.int64(4), np.int64(6),
    )  # fmt: skip
    filter_down(colors, zero, four, rows, down, y, one, padded_width, first, last, line, zero)
    if second:
        filter_down(colors, zero, four, rows, down, y, two, padded_width, first, last, line, 4 * padded_width)
    filter_down(colors, four, six, rows, down, y, three, padded_width, first, last, line, 8 * padded_width)
    filter_down(
        colors, usable, one_plane, rows, down, y, three, padded_width, first, last, line, 14 * padded_width
    )


@device_function
def filter_all_across(line, padded_width, starts, across, width, x, second=True):
    """Filter all lines for sixteen pixels from x on; return sixteen vectors; see `filter_all_down`."""
    a = b = filter_across(line, 0, padded_width, starts, across, 0, width, x)
    if second:
        b = filter_across(line, 4 * padded_width, padded_width, starts, across, 4, width, x)
    c = filter_across(line, 8 * padded_width, padded_width, starts, across, 8, width, x)
    return (*a, *b, *c, *filter_across(line, 12 * padded_width, padded_width, starts, across, 8, width, x))
