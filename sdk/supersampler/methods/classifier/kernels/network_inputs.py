"""Network inputs of `classifier`, as bytes; same as `pixel_inputs` and `neighbourhood_inputs`.

A record holds the inputs of a packed pixel (2x2 display pixels) in RECORD_WORDS words of four bytes. Words 0
to 15 hold one input of the four pixels each. Words 16 and 17 hold the inputs at half display size: six class
probabilities, mean_difference, mean_abs_difference.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import clamped, root
from supersampler.backends.cpu.kernels.frame import repeat_ends
from supersampler.backends.cpu.kernels.warp import store_offsets
from supersampler.backends.cpu.layout import INPUT_PLANES, PAD, RECORD_WORDS
from supersampler.backends.cpu.simd.shuffles import evens, odds, transposed
from supersampler.backends.cpu.simd.vector import (
    absolute,
    device_function,
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
    FRAME, SAMPLE, HISTORY, HISTORY_TO_SAMPLE, HISTORY_TO_FRAME, CONTRAST, HISTORY_CONTRAST, BEYOND_RANGE,
    MIN_LUMA, MAX_LUMA, DETAIL, CONFIDENCE, COUNT, DEPTH_DIFFERENCE, SURFACE, EDGE,
) = range(16)  # fmt: skip
"""Words of a record, by the names of `pixel_inputs`."""
RELIT_TO_FRAME, AGREEMENT = MIN_LUMA, MAX_LUMA
"""Inputs of the variant `guided` in their places."""
CLASSES = 16
"""First word of a record at half display size."""


@device_function
def store_input(inputs, at, value):
    """Store sixteen inputs in [0, 1] as bytes; 255 is one."""
    store(inputs, at, to_int(clamped(value, 0.0, 1.0) * 255.0 + 0.5))


@device_function
def contrast_row(ring, above, here, below, padded_width, inputs, first, width, x0, x1):
    """Write `history_contrast` and `beyond_range` of a row.

    ring (3, padded_width): luma of the warped history in three rows; above, here, below: their indices;
    first: of the row in `inputs`.
    """
    for x in range(x0, x1, 16):
        low = high = load16(ring, here * padded_width + PAD + x)
        for line in (above, here, below):
            for column in range(-1, 2):
                other = load16(ring, line * padded_width + PAD + x + column)
                low, high = minimum(other, low), maximum(other, high)
        luma = to_float(load16(inputs, SAMPLE * width + first + x)) * (1.0 / 255.0)
        store_input(inputs, HISTORY_CONTRAST * width + first + x, high - low)
        store_input(inputs, BEYOND_RANGE * width + first + x, maximum(maximum(low - luma, luma - high), 0.0))


@device_function
def packed_words(inputs, upper, lower):
    """Return sixteen packed pixels, two bytes of each row in a word."""
    a, b = load16(inputs, upper), load16(inputs, upper + 16)
    c, d = load16(inputs, lower), load16(inputs, lower + 16)
    return evens(a, b) | odds(a, b) << np.int32(8) | evens(c, d) << np.int32(16) | odds(c, d) << np.int32(24)


@device_function
def pack_rows(inputs, upper, lower, width, p0, p1, records, to):
    """Write two rows of inputs to records p0 to p1."""
    for x in range(p0, p1, 16):
        u, v, w = upper + 2 * x, lower + 2 * x, width
        rows = transposed((
            packed_words(inputs, u, v), packed_words(inputs, u + w, v + w),
            packed_words(inputs, u + 2 * w, v + 2 * w), packed_words(inputs, u + 3 * w, v + 3 * w),
            packed_words(inputs, u + 4 * w, v + 4 * w), packed_words(inputs, u + 5 * w, v + 5 * w),
            packed_words(inputs, u + 6 * w, v + 6 * w), packed_words(inputs, u + 7 * w, v + 7 * w),
            packed_words(inputs, u + 8 * w, v + 8 * w), packed_words(inputs, u + 9 * w, v + 9 * w),
            packed_words(inputs, u + 10 * w, v + 10 * w), packed_words(inputs, u + 11 * w, v + 11 * w),
            packed_words(inputs, u + 12 * w, v + 12 * w), packed_words(inputs, u + 13 * w, v + 13 * w),
            packed_words(inputs, u + 14 * w, v + 14 * w), packed_words(inputs, u + 15 * w, v + 15 * w),
        ))  # fmt: skip
        for i in range(16):
            store(records, to + RECORD_WORDS * (x + i), rows[i])


@device_function
def warp_classes(classes, places, at, weights, width, big_w, big_h, p0, p1, records, to):
    """Resample class probabilities at packed pixels p0 to p1 of a row, and write them to their records.

    classes: (H / 2, W / 2, 8) bytes of the history; places: previous positions of the row's pixels; at and
    weights: scratch, slots of sixteen.
    """
    half_w, half_h = (big_w + 1) // 2, (big_h + 1) // 2
    half, right, bottom = np.float32(0.5), np.float32(big_w) - 0.5, np.float32(big_h) - 0.5
    for x in range(p0, p1, 16):
        px = evens(load16(places, 2 * x), load16(places, 2 * x + 16))
        py = evens(load16(places, width + 2 * x), load16(places, width + 2 * x + 16))
        on = (px > -half) & (px < right) & (py > -half) & (py < bottom)
        store(weights, 0, store_offsets(px * half, 0, 1, half_w, 8, at, 0))
        store(weights, 16, store_offsets(py * half, 0, 1, half_h, 8 * half_w, at, 2))
        store(at, 64, select(on, spread16(np.int32(-1)), spread16(np.int32(0))))
        for i in range(min(16, p1 - x)):
            j, k, m, n = at[i], at[16 + i], at[32 + i], at[48 + i]
            t, u = weights[i], weights[16 + i]
            a, b = to_float(load8(classes, m + j)), to_float(load8(classes, m + k))
            c, d = to_float(load8(classes, n + j)), to_float(load8(classes, n + k))
            upper, lower = a + (b - a) * t, c + (d - c) * t
            value = to_int(upper + (lower - upper) * u + 0.5)
            first = to + RECORD_WORDS * (x + i) + CLASSES
            records[first] = packed(value, 0) & at[64 + i]
            records[first + 1] = packed(value, 4) & at[64 + i]


@device_function
def pack_means(differences, upper, lower, p0, p1, means, row, half_stride):
    """Write the means over four pixels of the difference of history and frame, and of its absolute value."""
    for x in range(p0, p1, 16):
        a, b = load16(differences, upper + 2 * x), load16(differences, upper + 2 * x + 16)
        c, d = load16(differences, lower + 2 * x), load16(differences, lower + 2 * x + 16)
        i, j, k, m = evens(a, b), odds(a, b), evens(c, d), odds(c, d)
        at = row * 2 * half_stride + PAD + x
        store(means, at, (i + j + k + m) * 0.25)
        i, j, k, m = absolute(i), absolute(j), absolute(k), absolute(m)
        store(means, at + half_stride, (i + j + k + m) * 0.25)
    repeat_ends(means, row * 2 * half_stride + PAD + p0, p1 - p0)
    repeat_ends(means, (row * 2 + 1) * half_stride + PAD + p0, p1 - p0)


@device_function
def tent_weight(row, y, height):
    """Return how often the mean of three rows, taken twice around row y, counts `row`, of nine times."""
    count = 0
    for first in range(-1, 2):
        middle = min(max(y + first, 0), height - 1)
        for second in range(-1, 2):
            count += min(max(middle + second, 0), height - 1) == row
    return np.float32(count)


@device_function
def tent_row(means, height, half_stride, plane, y, p0, p1, tall, line):
    """Blur a plane of means at row y by a 5x5 tent; write roots times 255 plus 0.5 to `tall`, from PAD on."""
    a, b = tent_weight(y - 2, y, height), tent_weight(y - 1, y, height)
    c, d, e = tent_weight(y, y, height), tent_weight(y + 1, y, height), tent_weight(y + 2, y, height)
    row, pitch = plane * half_stride, 2 * half_stride
    # rows outside the image have weight 0; any other row is read in their place
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
def mean_difference_row(means, half_h, half_stride, y, p0, p1, signed, unsigned, line, codes, records, row):
    """Write mean_difference and mean_abs_difference of packed pixels p0 to p1 of row y to their records.

    They are bytes 6 and 7 of the words at half size. Both blurs repeat the border. A second call changes
    nothing.

    means: (half_h, 2, half_stride), PAD columns on either side; signed, unsigned, line, codes: (half_stride,)
    scratch; row: first word of the row in `records`.
    """
    # int64: numba would compile one function per literal
    tent_row(means, half_h, half_stride, np.int64(0), y, p0, p1, signed, line)
    tent_row(means, half_h, half_stride, np.int64(1), y, p0, p1, unsigned, line)
    for x in range(p0, p1, 16):
        at = PAD + x
        code = to_int(load16(signed, at)) << np.int32(16) | to_int(load16(unsigned, at)) << np.int32(24)
        store(codes, x, code)
    first = row + CLASSES + 1
    for x in range(p0, p1):
        at = first + x * RECORD_WORDS
        records[at] = np.int32(records[at] & 0xFFFF) | codes[x]


@device_function
def complete_row(scratch, gathered, network, y, below, x0, x1):
    """Complete the inputs of columns x0 to x1 of row y once its neighbour rows exist; pack pairs of rows."""
    ring, inputs, differences = scratch.ring, scratch.inputs, scratch.differences
    big_w, big_h, width = gathered.width, gathered.height, gathered.pitch
    padded_width = width + 2 * PAD
    row = (y % 4) * INPUT_PLANES * width
    contrast_row(ring, max(y - 1, 0) % 3, y % 3, below % 3, padded_width, inputs, row, width, x0, x1)
    if big_w % 2:
        for c in range(INPUT_PLANES):
            inputs[row + c * width + big_w] = inputs[row + c * width + big_w - 1]
        differences[(y % 4) * width + big_w] = differences[(y % 4) * width + big_w - 1]
    if y % 2 or y == big_h - 1:
        first, p0, p1 = y - y % 2, x0 // 2, (min(x1, big_w) + 1) // 2
        upper, to = (first % 4) * INPUT_PLANES * width, (y // 2) * network.row * RECORD_WORDS
        pack_rows(inputs, upper, row, width, p0, p1, network.records, to)
        upper, lower = (first % 4) * width, (y % 4) * width
        pack_means(differences, upper, lower, p0, p1, network.means, y // 2, network.means_stride)
