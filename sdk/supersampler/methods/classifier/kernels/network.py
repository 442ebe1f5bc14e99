"""Layers of the int8 network of `classifier`; see `supersampler_export.quantize` for the quantization.

Images are NHWC bytes; images that 3x3 convolutions read have a border of one pixel. A layer sums products of
bytes, and converts the sums back to bytes with a scale and a bias per channel. Instructions multiply and add
the four bytes of a word; the sums of 32 channels of PIXELS_AT_ONCE pixels stay in registers.
"""

import numpy as np

from supersampler.backends.cpu.layout import PIXELS_AT_ONCE
from supersampler.backends.cpu.simd.vector import (
    device_function,
    dot4,
    load4,
    load8,
    load16,
    maximum,
    minimum,
    prefetch,
    spread16,
    store,
    to_float,
    to_int,
)

PREFETCH_PIXELS = 16  # distance of prefetches in a row, as rows of the deepest level are not in the cache


@device_function
def to_bytes(total, scales, biases, channel):
    """Convert the sums of sixteen channels to bytes, rounded and clamped."""
    value = to_float(total) * load16(scales, channel) + load16(biases, channel)
    return to_int(minimum(maximum(value, 0.0), 255.0) + 0.5)


@device_function
def add_products(x, pitch, words, weights, w, a, sums):
    """Add the products of `words` words to the sums of six pixels and 32 channels; `a`, `w`: offsets."""
    a0, a1, b0, b1, c0, c1, d0, d1, e0, e1, f0, f1 = sums
    for k in range(words):
        u, v = load16(weights, w + 32 * k), load16(weights, w + 32 * k + 16)
        t = spread16(x[a + k])
        a0, a1 = dot4(a0, t, u), dot4(a1, t, v)
        t = spread16(x[a + pitch + k])
        b0, b1 = dot4(b0, t, u), dot4(b1, t, v)
        t = spread16(x[a + 2 * pitch + k])
        c0, c1 = dot4(c0, t, u), dot4(c1, t, v)
        t = spread16(x[a + 3 * pitch + k])
        d0, d1 = dot4(d0, t, u), dot4(d1, t, v)
        t = spread16(x[a + 4 * pitch + k])
        e0, e1 = dot4(e0, t, u), dot4(e1, t, v)
        t = spread16(x[a + 5 * pitch + k])
        f0, f1 = dot4(f0, t, u), dot4(f1, t, v)
    return a0, a1, b0, b1, c0, c1, d0, d1, e0, e1, f0, f1


@device_function
def zero_sums():
    """Return zeros for `add_products`."""
    z = spread16(np.int32(0))
    return z, z, z, z, z, z, z, z, z, z, z, z


@device_function
def pointwise_row(x, offset, pitch, words, weights, blocks, scales, biases, out, to, out_pitch, width):
    """Compute a 1x1 convolution of a row: words of four bytes to `blocks` of 32 bytes.

    x: pixels of `pitch` words from `offset` on, of which `words` are read; out: pixels of `out_pitch` bytes
    from `to` on. Nothing is written after a row of at least PIXELS_AT_ONCE pixels: other threads may read it.
    """
    for first in range(0, width, PIXELS_AT_ONCE):
        p = min(first, max(width - PIXELS_AT_ONCE, 0))
        for block in range(blocks):
            sums = add_products(x, pitch, words, weights, 32 * words * block, offset + p * pitch, zero_sums())
            store_pixels(sums, scales, biases, 32 * block, out, to + p * out_pitch, out_pitch)


@device_function
def pointwise_row_of_two(
    x, offset, pitch, words, y, y_offset, y_pitch, y_words, layer, out, to, out_pitch, width
):
    """Compute a 1x1 convolution of pixels whose channels are in two images, x and y."""
    weights, blocks, scales, biases = layer.weights, layer.blocks, layer.scale, layer.bias
    for p in range(0, width, PIXELS_AT_ONCE):
        for block in range(blocks):
            w = 32 * (words + y_words) * block
            sums = add_products(x, pitch, words, weights, w, offset + p * pitch, zero_sums())
            sums = add_products(y, y_pitch, y_words, weights, w + 32 * words, y_offset + p * y_pitch, sums)
            store_pixels(sums, scales, biases, 32 * block, out, to + p * out_pitch, out_pitch)


@device_function
def store_pixels(sums, scales, biases, channel, out, to, out_pitch):
    """Store the sums of six pixels and 32 channels as bytes."""
    for i in range(PIXELS_AT_ONCE):
        here = to + i * out_pitch + channel
        store(out, here, to_bytes(sums[2 * i], scales, biases, channel))
        store(out, here + 16, to_bytes(sums[2 * i + 1], scales, biases, channel + 16))


@device_function
def clear(out, offset, count):
    """Clear `count` bytes."""
    for c in range(0, count, 16):
        store(out, offset + c, spread16(np.int32(0)))


@device_function
def column(x, offset, row):
    """Load three rows of sixteen channels; each word holds the three bytes of a channel."""
    upper, lower = load16(x, offset + row) << np.int32(8), load16(x, offset + 2 * row) << np.int32(16)
    return load16(x, offset) | upper | lower


@device_function
def depthwise_row(x, offset, pitch, row, weights, channels, scales, biases, out, width):
    """Compute a depthwise 3x3 convolution of a row; `offset`: of the upper left neighbour, in the border.

    weights (channels / 16, 3, 16) words: a column of three weights for each channel.
    """
    for c in range(0, channels, 16):
        left, middle = load16(weights, 3 * c), load16(weights, 3 * c + 16)
        right = load16(weights, 3 * c + 32)
        a, b = column(x, offset + c, row), column(x, offset + c + pitch, row)
        for p in range(width):
            prefetch(x, offset + c + 2 * row + (p + PREFETCH_PIXELS) * pitch)
            d = column(x, offset + c + (p + 2) * pitch, row)
            total = dot4(dot4(dot4(spread16(np.int32(0)), a, left), b, middle), d, right)
            store(out, p * channels + c, to_bytes(total, scales, biases, c))
            a, b = b, d


@device_function
def pool_row(x, offset, pitch, row, channels, out, width):
    """Pool 2x2 pixels by maximum; channels are a multiple of 16."""
    for p in range(width):
        for c in range(0, channels, 16):
            here = offset + 2 * p * pitch + c
            upper = maximum(load16(x, here), load16(x, here + pitch))
            lower = maximum(load16(x, here + row), load16(x, here + row + pitch))
            store(out, p * channels + c, maximum(upper, lower))


@device_function
def concatenate_row(kept0, kept1, kept2, kept3, pitches, y, p0, p1, out):
    """Gather the input of the decoder from the levels: 16 + 8 + 4 + 4 bytes per pixel.

    A pixel of a lower level holds the bytes of all pixels that it covers, one after the other. pitches: bytes
    per pixel of each level, then bytes per row.
    """
    row0, row1 = y * pitches[4], (y >> 1) * pitches[5] + 16 * (y & 1)
    row2, row3 = (y >> 2) * pitches[6] + 16 * (y & 3), (y >> 3) * pitches[7] + 32 * (y & 7)
    for p in range(p0, p1):
        prefetch(kept3, row3 + ((p + PREFETCH_PIXELS) >> 3) * pitches[3])
        store(out, 32 * p, load16(kept0, row0 + p * pitches[0]))
        store(out, 32 * p + 16, load8(kept1, row1 + (p >> 1) * pitches[1] + 8 * (p & 1)))
        store(out, 32 * p + 24, load4(kept2, row2 + (p >> 2) * pitches[2] + 4 * (p & 3)))
        store(out, 32 * p + 28, load4(kept3, row3 + (p >> 3) * pitches[3] + 4 * (p & 7)))
