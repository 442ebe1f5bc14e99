"""What the network of `classifier` sees, in bytes: twins of `classifier_inputs`.

A record is what is known of four pixels: 18 words of four bytes. Words 0 to 15 are SEEN, a word a name, a
byte a pixel; 16 and 17 are at half size: six classes, drift, grain.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import clamped, root
from supersampler.backends.cpu.kernels.frame import repeat_ends
from supersampler.backends.cpu.kernels.warp import place
from supersampler.backends.cpu.layout import PAD, RECORD, SEEN
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import evens, odds, transposed
from supersampler.backends.cpu.simd.vector import (
    absolute,
    load8,
    load16,
    maximum,
    minimum,
    packed,
    select,
    spread16,
    store,
    to_float,
    to_int,
)

(
    FRAME, SAMPLE, PAST, TO_SAMPLE, TO_FRAME, CONTRAST, PAST_CONTRAST, BEYOND, LEAST, MOST, DETAIL,
    CONFIDENCE, COUNT, DIFFERENCE, SURFACE, EDGE,
) = range(16)  # fmt: skip
CLASSES = 16  # word of a record


@device_function
def put(seen, at, value):
    """What the network sees, as a byte."""
    store(seen, at, to_int(clamped(value, 0.0, 1.0) * 255.0 + 0.5))


@device_function
def contrast_row(ring, above, here, below, wide, seen, seen_row, width, x0, x1):
    """How much the past differs around each pixel, and how far this frame's sample is outside of that."""
    for x in range(x0, x1, 16):
        low = high = load16(ring, here * wide + PAD + x)
        for line in (above, here, below):
            for column in range(-1, 2):
                other = load16(ring, line * wide + PAD + x + column)
                low, high = minimum(other, low), maximum(other, high)
        luma = to_float(load16(seen, SAMPLE * width + seen_row + x)) * (1.0 / 255.0)
        put(seen, PAST_CONTRAST * width + seen_row + x, high - low)
        put(seen, BEYOND * width + seen_row + x, maximum(maximum(low - luma, luma - high), 0.0))


@device_function
def words_of(seen, upper, lower):
    """Sixteen packed pixels: two of each row in the bytes of a word."""
    a, b = load16(seen, upper), load16(seen, upper + 16)
    c, d = load16(seen, lower), load16(seen, lower + 16)
    return evens(a, b) | odds(a, b) << np.int32(8) | evens(c, d) << np.int32(16) | odds(c, d) << np.int32(24)


@device_function
def pack_rows(seen, upper, lower, width, p0, p1, records, to):
    """Put two rows of bytes into records p0 to p1."""
    for x in range(p0, p1, 16):
        u, v, w = upper + 2 * x, lower + 2 * x, width
        rows = transposed((
            words_of(seen, u, v), words_of(seen, u + w, v + w),
            words_of(seen, u + 2 * w, v + 2 * w), words_of(seen, u + 3 * w, v + 3 * w),
            words_of(seen, u + 4 * w, v + 4 * w), words_of(seen, u + 5 * w, v + 5 * w),
            words_of(seen, u + 6 * w, v + 6 * w), words_of(seen, u + 7 * w, v + 7 * w),
            words_of(seen, u + 8 * w, v + 8 * w), words_of(seen, u + 9 * w, v + 9 * w),
            words_of(seen, u + 10 * w, v + 10 * w), words_of(seen, u + 11 * w, v + 11 * w),
            words_of(seen, u + 12 * w, v + 12 * w), words_of(seen, u + 13 * w, v + 13 * w),
            words_of(seen, u + 14 * w, v + 14 * w), words_of(seen, u + 15 * w, v + 15 * w),
        ))  # fmt: skip
        for i in range(16):
            store(records, to + RECORD * (x + i), rows[i])


@device_function
def recall(classes, places, at, weights, width, big_w, big_h, p0, p1, records, to):
    """What packed pixels p0 to p1 of a row were held for, (H / 2, W / 2, 8) bytes: two of its words.

    at and weights: scratch, slots of sixteen.
    """
    half_w, half_h = (big_w + 1) // 2, (big_h + 1) // 2
    half, right, bottom = np.float32(0.5), np.float32(big_w) - 0.5, np.float32(big_h) - 0.5
    for x in range(p0, p1, 16):
        px = evens(load16(places, 2 * x), load16(places, 2 * x + 16))
        py = evens(load16(places, width + 2 * x), load16(places, width + 2 * x + 16))
        on = (px > -half) & (px < right) & (py > -half) & (py < bottom)
        store(weights, 0, place(px * half, 0, 1, half_w, 8, at, 0))
        store(weights, 16, place(py * half, 0, 1, half_h, 8 * half_w, at, 2))
        store(at, 64, select(on, spread16(np.int32(-1)), spread16(np.int32(0))))
        for i in range(min(16, p1 - x)):
            j, k, m, n = at[i], at[16 + i], at[32 + i], at[48 + i]
            t, u = weights[i], weights[16 + i]
            a, b = to_float(load8(classes, m + j)), to_float(load8(classes, m + k))
            c, d = to_float(load8(classes, n + j)), to_float(load8(classes, n + k))
            upper, lower = a + (b - a) * t, c + (d - c) * t
            value = to_int(upper + (lower - upper) * u + 0.5)
            first = to + RECORD * (x + i) + CLASSES
            records[first] = packed(value, 0) & at[64 + i]
            records[first + 1] = packed(value, 4) & at[64 + i]


@device_function
def halve(apart, upper, lower, p0, p1, means, row, half_stride):
    """Means of four pixels of how far past and frame are apart: signed, and not."""
    for x in range(p0, p1, 16):
        a, b = load16(apart, upper + 2 * x), load16(apart, upper + 2 * x + 16)
        c, d = load16(apart, lower + 2 * x), load16(apart, lower + 2 * x + 16)
        i, j, k, m = evens(a, b), odds(a, b), evens(c, d), odds(c, d)
        at = row * 2 * half_stride + PAD + x
        store(means, at, (i + j + k + m) * 0.25)
        i, j, k, m = absolute(i), absolute(j), absolute(k), absolute(m)
        store(means, at + half_stride, (i + j + k + m) * 0.25)
    repeat_ends(means, row * 2 * half_stride + PAD + p0, p1 - p0)
    repeat_ends(means, (row * 2 + 1) * half_stride + PAD + p0, p1 - p0)


@device_function
def looks_at(row, y, height):
    """How many of the nine looks of two means of three rows, one of the other, around row y are at `row`."""
    count = 0
    for first in range(-1, 2):
        middle = min(max(y + first, 0), height - 1)
        for second in range(-1, 2):
            count += min(max(middle + second, 0), height - 1) == row
    return np.float32(count)


@device_function
def tent_row(means, height, half_stride, plane, y, p0, p1, tall, line):
    """A plane of means around row y by a tent of 5 x 5: `tall`, from PAD on, values to be cut to bytes."""
    a, b = looks_at(y - 2, y, height), looks_at(y - 1, y, height)
    c, d, e = looks_at(y, y, height), looks_at(y + 1, y, height), looks_at(y + 2, y, height)
    row, pitch = (
        plane * half_stride,
        2 * half_stride,
    )  # rows that are not there are not looked at: any will do
    i, j, k = row + max(y - 2, 0) * pitch, row + max(y - 1, 0) * pitch, row + y * pitch
    m, n = row + min(y + 1, height - 1) * pitch, row + min(y + 2, height - 1) * pitch
    for x in range(p0, p1 + 2 * PAD, 16):
        upper = load16(means, i + x) * a + load16(means, j + x) * b
        lower = load16(means, m + x) * d + load16(means, n + x) * e
        store(tall, x, upper + load16(means, k + x) * c + lower)
    for x in range(p0, p1, 16):
        at = PAD + x
        store(line, at, load16(tall, at - 1) + load16(tall, at) + load16(tall, at + 1))
    repeat_ends(line, PAD + p0, p1 - p0)
    for x in range(p0, p1, 16):
        at = PAD + x
        mean = (load16(line, at - 1) + load16(line, at) + load16(line, at + 1)) * (1.0 / 81.0)
        store(tall, at, minimum(root(absolute(mean)) * 255.0 + 0.5, 255.0))


@device_function
def around_row(means, half_h, half_stride, y, p0, p1, drift, grain, line, codes, records, row):
    """Drift and grain of packed pixels p0 to p1 of row y: bytes 6 and 7 of the half-size words of records.

    means (half_h, 2, half_stride), with PAD on either side; drift, grain, line and codes (half_stride,) are
    scratch; records from `row` on. What is beyond the border repeats it both times. Done again, it changes
    nothing.
    """
    # int64: of literals numba would make a function each
    tent_row(means, half_h, half_stride, np.int64(0), y, p0, p1, drift, line)
    tent_row(means, half_h, half_stride, np.int64(1), y, p0, p1, grain, line)
    for x in range(p0, p1, 16):
        at = PAD + x
        code = to_int(load16(drift, at)) << np.int32(16) | to_int(load16(grain, at)) << np.int32(24)
        store(codes, x, code)
    first = row + CLASSES + 1
    for x in range(p0, p1):
        at = first + x * RECORD
        records[at] = np.int32(records[at] & 0xFFFF) | codes[x]


@device_function
def complete(scratch, gathered, network, y, below, x0, x1):
    """Finish columns x0 to x1 of row y, whose rows around are known now; pack a second row with its first."""
    ring, seen, apart = scratch.ring, scratch.inputs, scratch.differences
    big_w, big_h, width = gathered.width, gathered.height, gathered.pitch
    wide = width + 2 * PAD
    row = (y % 4) * SEEN * width
    contrast_row(ring, max(y - 1, 0) % 3, y % 3, below % 3, wide, seen, row, width, x0, x1)
    if big_w % 2:
        for c in range(SEEN):
            seen[row + c * width + big_w] = seen[row + c * width + big_w - 1]
        apart[(y % 4) * width + big_w] = apart[(y % 4) * width + big_w - 1]
    if y % 2 or y == big_h - 1:
        first, p0, p1 = y - y % 2, x0 // 2, (min(x1, big_w) + 1) // 2
        upper, to = (first % 4) * SEEN * width, (y // 2) * network.row * RECORD
        pack_rows(seen, upper, row, width, p0, p1, network.records, to)
        upper, lower = (first % 4) * width, (y % 4) * width
        halve(apart, upper, lower, p0, p1, network.means, y // 2, network.means_stride)
