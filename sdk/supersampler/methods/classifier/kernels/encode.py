"""A level of the network of `classifier`, row by row, so that layers read rows from the cache."""

import numpy as np

from supersampler.backends.cpu.layout import PIXELS_AT_ONCE, RECORD_WORDS
from supersampler.backends.cpu.simd.vector import device_function
from supersampler.methods.classifier.kernels.network import clear, depthwise_row, pointwise_row, pool_row
from supersampler.methods.classifier.kernels.network_inputs import mean_difference_row
from supersampler.methods.classifier.structs import (
    LayerWeights,
    LevelAbove,
    LevelBuffers,
    LevelScratch,
    NetworkInputs,
)


@device_function
def repeat_last(records, at, half_width, width):
    """Repeat the last record of a row PIXELS_AT_ONCE times after the row, as far as it is read."""
    for p in range(half_width, width + PIXELS_AT_ONCE):
        for k in range(RECORD_WORDS):
            records[at + p * RECORD_WORDS + k] = records[at + (half_width - 1) * RECORD_WORDS + k]


def level(
    network: NetworkInputs, above: LevelAbove, first: LayerWeights, spatial: LayerWeights,
    last: LayerWeights, buffers: LevelBuffers, scratch: LevelScratch, first0: int, first1: int, y0: int,
    y1: int, x0: int, x1: int,
):  # fmt: skip
    """Run the first layer on rows first0 to first1, the other two on y0 to y1.

    These two read one more row on each side. The first level reads `network` and completes its records (see
    `mean_difference_row`); it repeats the last row and column beyond the image. The others pool `above`.
    """
    means, half_width, half_height = network.means, network.half_width, network.half_height
    half_stride, records, record_row = network.means_stride, network.records, network.row * RECORD_WORDS
    words, weights, blocks, scales, biases = first.words, first.weights, first.blocks, first.scale, first.bias
    x, pitch, row, width = buffers.x, buffers.pitch, buffers.row, buffers.width
    signed, unsigned, tent, codes = scratch.signed, scratch.absolute, scratch.tent, scratch.codes
    channels, between = above.channels, buffers.channels
    line, line_words = scratch.line, scratch.line_words
    count = x1 - x0
    start = np.int64(0)  # int64: numba would compile one function per literal
    for y in range(min(first0, y0), max(first1, y1 + 1)):
        if first0 <= y < first1:
            if channels:
                at = 2 * y * above.row + 2 * x0 * above.pitch
                pool_row(above.pixels, at, above.pitch, above.row, channels, line, count)
                source, at, step = line_words, start, channels // 4
            else:
                here = min(y, half_height - 1)
                at = here * record_row
                mean_difference_row(
                    means, half_height, half_stride, here, x0, min(x1, half_width), signed, unsigned,
                    tent, codes, records, at,
                )  # fmt: skip
                if x1 == width:
                    repeat_last(records, at, half_width, width)
                source, at, step = records, at + x0 * RECORD_WORDS, np.int64(RECORD_WORDS)
            to = (y + 1) * row + (x0 + 1) * pitch
            pointwise_row(source, at, step, words, weights, blocks, scales, biases, x, to, pitch, count)
            if x1 == width:
                clear(x, (y + 1) * row + (width + 1) * pitch, pitch)
        done = y - 1  # all rows that it reads are computed
        if y0 <= done < y1:
            at = done * row + x0 * pitch
            depthwise_row(
                x, at, pitch, row, spatial.weights, between, spatial.scale, spatial.bias, line, count
            )  # fmt: skip
            to = done * buffers.out_row + x0 * buffers.out_pitch
            pointwise_row(
                line_words, start, between // 4, between // 4, last.weights, last.blocks, last.scale,
                last.bias, buffers.out, to, buffers.out_pitch, count,
            )  # fmt: skip
