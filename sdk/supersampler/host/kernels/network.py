"""The network of `classifier` in bytes, for processors that multiply four bytes at once (VNNI).

Images are rows of pixels of channels, bytes, within a border of one pixel where 3x3 convolutions reach. A
layer's sums of products become bytes again by a scale and a bias for each channel.
"""

import numpy as np
from numba import njit

from supersampler.host.vector import (
    dot4,
    load4,
    load8,
    load16,
    maximum,
    minimum,
    spread16,
    store,
    to_float,
    to_int,
)


@njit
def to_bytes(total, scales, biases, channel):
    """Sums as bytes, rounded."""
    value = to_float(total) * load16(scales, channel) + load16(biases, channel)
    return to_int(minimum(maximum(value, 0.0), 255.0) + 0.5)


@njit
def two_by_six(x, pitch, words, weights, w, a):
    """Sums of six pixels and 32 channels."""
    zero = spread16(np.int32(0))
    a0 = a1 = b0 = b1 = c0 = c1 = d0 = d1 = e0 = e1 = f0 = f1 = zero
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


def pointwise(x, pitch, words, weights, blocks, scales, biases, out, out_pitch, sizes, y0, y1):
    """A 1x1 convolution of rows y0 to y1; `blocks` of 32 output channels.

    x: words of four bytes, `pitch` words a pixel, of which `words` count; out: `out_pitch` bytes a pixel.
    sizes: pixels in a row, words from row to row, bytes from row to row. Rows have room for six more pixels.
    """
    width, row, out_row = sizes[0], sizes[1], sizes[2]
    for y in range(y0, y1):
        for p in range(0, width, 6):
            for block in range(blocks):
                sums = two_by_six(x, pitch, words, weights, 32 * words * block, y * row + p * pitch)
                for i in range(6):
                    to = y * out_row + (p + i) * out_pitch + 32 * block
                    store(out, to, to_bytes(sums[2 * i], scales, biases, 32 * block))
                    store(out, to + 16, to_bytes(sums[2 * i + 1], scales, biases, 32 * block + 16))
        for c in range(0, 32 * blocks, 16):  # the border of what comes next
            store(out, y * out_row + width * out_pitch + c, spread16(np.int32(0)))


@njit
def column(x, at, row):
    """Three bytes above one another of sixteen channels, in a word each."""
    upper, lower = load16(x, at + row) << np.int32(8), load16(x, at + 2 * row) << np.int32(16)
    return load16(x, at) | upper | lower


def depthwise(x, weights, channels, scales, biases, out, sizes, y0, y1):
    """A 3x3 convolution of each channel by itself, rows y0 to y1.

    x: with its border; out: without. weights (channels / 16, 3, 16) words: a column of three for each channel.
    sizes: pixels in a row, bytes from row to row of x, of out.
    """
    width, row, out_row = sizes[0], sizes[1], sizes[2]
    for y in range(y0, y1):
        for c in range(0, channels, 16):
            left, middle = load16(weights, 3 * c), load16(weights, 3 * c + 16)
            right = load16(weights, 3 * c + 32)
            at = y * row + c
            a, b = column(x, at, row), column(x, at + channels, row)
            for p in range(width):
                d = column(x, at + (p + 2) * channels, row)
                total = dot4(dot4(dot4(spread16(np.int32(0)), a, left), b, middle), d, right)
                store(out, y * out_row + p * channels + c, to_bytes(total, scales, biases, c))
                a, b = b, d


def pool(x, first, channels, pitch, out, sizes, y0, y1):
    """The largest of each 2x2 pixels, of `channels` from `first` on; sizes: see `depthwise`, of the output."""
    width, row, out_row = sizes[0], sizes[1], sizes[2]
    for y in range(y0, y1):
        for p in range(width):
            at = 2 * y * row + 2 * p * pitch + first
            for c in range(0, channels, 16):
                upper = maximum(load16(x, at + c), load16(x, at + pitch + c))
                lower = maximum(load16(x, at + row + c), load16(x, at + row + pitch + c))
                store(out, y * out_row + p * channels + c, maximum(upper, lower))


def concatenate(kept0, kept1, kept2, kept3, out, sizes, y0, y1):
    """What the levels hand to the decoder, 16 + 8 + 4 + 4 channels, pixels shuffled into place.

    Channels of a level lie as its pixels unpack: sub-pixel by sub-pixel. sizes: pixels in a row, pixels from
    row to row of each level, of out.
    """
    width = sizes[0]
    for y in range(y0, y1):
        for p in range(width):
            to = 32 * (y * sizes[5] + p)
            store(out, to, load16(kept0, 32 * (y * sizes[1] + p)))
            at = 64 * ((y >> 1) * sizes[2] + (p >> 1)) + 8 * (2 * (y & 1) + (p & 1))
            store(out, to + 16, load8(kept1, at))
            at = 128 * ((y >> 2) * sizes[3] + (p >> 2)) + 4 * (4 * (y & 3) + (p & 3))
            store(out, to + 24, load4(kept2, at))
            at = 256 * ((y >> 3) * sizes[4] + (p >> 3)) + 4 * (8 * (y & 7) + (p & 7))
            store(out, to + 28, load4(kept3, at))
