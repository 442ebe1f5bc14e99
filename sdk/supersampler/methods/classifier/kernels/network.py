"""Layers of the int8 network of `classifier`; see `supersampler_export.quantize` for the quantization.

Images are rows of pixels of channels, bytes, within a border of one pixel where 3x3 convolutions reach. A
layer's sums of products become bytes again by a scale and a bias for each channel. Four bytes are multiplied
and added at once: a word is what a processor takes in, 32 sums of six pixels what its registers hold.
"""

import numpy as np

from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import (
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

SOON = 16  # pixels from what is read to what is called for: rows of the deepest level come from afar
SIX = 6  # pixels at once; rows have room for as many more


@device_function
def to_bytes(total, scales, biases, channel):
    """Sums as bytes, rounded."""
    value = to_float(total) * load16(scales, channel) + load16(biases, channel)
    return to_int(minimum(maximum(value, 0.0), 255.0) + 0.5)


@device_function
def two_by_six(x, pitch, words, weights, w, a, sums):
    """Add to the sums of six pixels and 32 channels."""
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
def nothing():
    """Sums to begin with."""
    z = spread16(np.int32(0))
    return z, z, z, z, z, z, z, z, z, z, z, z


@device_function
def pointwise_row(x, at, pitch, words, weights, blocks, scales, biases, out, to, out_pitch, width):
    """A 1x1 convolution of a row: words of four bytes in, `blocks` of 32 bytes out.

    x: `pitch` words a pixel from `at` on, of which `words` count; out: `out_pitch` bytes from `to` on. What
    follows a row is not written to, as another thread may read it, unless the row is shorter than SIX.
    """
    for first in range(0, width, SIX):
        p = min(first, max(width - SIX, 0))
        for block in range(blocks):
            sums = two_by_six(x, pitch, words, weights, 32 * words * block, at + p * pitch, nothing())
            put_six(sums, scales, biases, 32 * block, out, to + p * out_pitch, out_pitch)


@device_function
def pointwise_row_of_two(x, at, pitch, words, y, y_at, y_pitch, y_words, layer, out, to, out_pitch, width):
    """The same of pixels whose channels lie in two places."""
    weights, blocks, scales, biases = layer.weights, layer.blocks, layer.scale, layer.bias
    for p in range(0, width, SIX):
        for block in range(blocks):
            w = 32 * (words + y_words) * block
            sums = two_by_six(x, pitch, words, weights, w, at + p * pitch, nothing())
            sums = two_by_six(y, y_pitch, y_words, weights, w + 32 * words, y_at + p * y_pitch, sums)
            put_six(sums, scales, biases, 32 * block, out, to + p * out_pitch, out_pitch)


@device_function
def put_six(sums, scales, biases, channel, out, to, out_pitch):
    """Six pixels and 32 channels as bytes."""
    for i in range(SIX):
        here = to + i * out_pitch + channel
        store(out, here, to_bytes(sums[2 * i], scales, biases, channel))
        store(out, here + 16, to_bytes(sums[2 * i + 1], scales, biases, channel + 16))


@device_function
def clear(out, at, count):
    """The border after a row."""
    for c in range(0, count, 16):
        store(out, at + c, spread16(np.int32(0)))


@device_function
def column(x, at, row):
    """Three bytes above one another of sixteen channels, in a word each."""
    upper, lower = load16(x, at + row) << np.int32(8), load16(x, at + 2 * row) << np.int32(16)
    return load16(x, at) | upper | lower


@device_function
def depthwise_row(x, at, pitch, row, weights, channels, scales, biases, out, width):
    """A 3x3 convolution of each channel by itself; x with its border, from the upper left neighbour on.

    weights (channels / 16, 3, 16) words: a column of three for each channel.
    """
    for c in range(0, channels, 16):
        left, middle = load16(weights, 3 * c), load16(weights, 3 * c + 16)
        right = load16(weights, 3 * c + 32)
        a, b = column(x, at + c, row), column(x, at + c + pitch, row)
        for p in range(width):
            prefetch(x, at + c + 2 * row + (p + SOON) * pitch)
            d = column(x, at + c + (p + 2) * pitch, row)
            total = dot4(dot4(dot4(spread16(np.int32(0)), a, left), b, middle), d, right)
            store(out, p * channels + c, to_bytes(total, scales, biases, c))
            a, b = b, d


@device_function
def pool_row(x, at, pitch, row, channels, out, width):
    """The largest of each 2x2 pixels; whole sixteens of channels."""
    for p in range(width):
        for c in range(0, channels, 16):
            here = at + 2 * p * pitch + c
            upper = maximum(load16(x, here), load16(x, here + pitch))
            lower = maximum(load16(x, here + row), load16(x, here + row + pitch))
            store(out, p * channels + c, maximum(upper, lower))


@device_function
def concatenate_row(kept0, kept1, kept2, kept3, pitches, y, p0, p1, out):
    """What the levels hand to the decoder, 16 + 8 + 4 + 4 bytes, pixels shuffled into place.

    Bytes of a level lie as its pixels unpack: sub-pixel by sub-pixel. pitches: bytes a pixel and a row of
    each level.
    """
    row0, row1 = y * pitches[4], (y >> 1) * pitches[5] + 16 * (y & 1)
    row2, row3 = (y >> 2) * pitches[6] + 16 * (y & 3), (y >> 3) * pitches[7] + 32 * (y & 7)
    for p in range(p0, p1):
        prefetch(kept3, row3 + ((p + SOON) >> 3) * pitches[3])
        store(out, 32 * p, load16(kept0, row0 + p * pitches[0]))
        store(out, 32 * p + 16, load8(kept1, row1 + (p >> 1) * pitches[1] + 8 * (p & 1)))
        store(out, 32 * p + 24, load4(kept2, row2 + (p >> 2) * pitches[2] + 4 * (p & 3)))
        store(out, 32 * p + 28, load4(kept3, row3 + (p >> 3) * pitches[3] + 4 * (p & 7)))
