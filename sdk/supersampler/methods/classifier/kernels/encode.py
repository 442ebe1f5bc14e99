"""A level of the network of `classifier`: row by row, so that what a layer gives is near for the next."""

import numpy as np

from supersampler.backends.cpu.kernels.types import Bytes, Floats, Words
from supersampler.backends.cpu.layout import RECORD
from supersampler.backends.cpu.simd.device_function import inner
from supersampler.methods.classifier.kernels.network import SIX, clear, depthwise_row, pointwise_row, pool_row
from supersampler.methods.classifier.kernels.network_inputs import around_row


@inner
def repeat_last(records, at, half_width, width):
    """Beyond the picture its last column is repeated, and beyond the row, as far as it is read."""
    for p in range(half_width, width + SIX):
        for k in range(RECORD):
            records[at + p * RECORD + k] = records[at + (half_width - 1) * RECORD + k]


def level(
    means: Floats, half_width: int, half_height: int, half_stride: int, records: Words, record_row: int,
    above: Bytes, above_pitch: int, above_row: int, channels: int, words: int, weights: Words, blocks: int,
    scales: Floats, biases: Floats, x: Bytes, pitch: int, row: int, width: int, between: int,
    spatial_weights: Words, spatial_scales: Floats, spatial_biases: Floats, last_weights: Words,
    last_blocks: int, last_scales: Floats, last_biases: Floats, out: Bytes, out_pitch: int, out_row: int,
    drift: Floats, grain: Floats, tent: Floats, codes: Words, line: Bytes, line_words: Words, first0: int,
    first1: int, y0: int, y1: int, x0: int, x1: int,
):  # fmt: skip
    """The first layer of rows first0 to first1, the other two of y0 to y1, which see one row around them.

    Of records, which `means` complete first (see `around_row`), where `channels` is 0; beyond the picture its
    last row and column are repeated. Else of so many channels of the level above, pooled. drift to codes, and
    line, which line_words is too: scratch. between: channels that the last two layers have.
    """
    count = x1 - x0
    start = np.int64(0)  # of a literal numba would make functions of its own
    for y in range(min(first0, y0), max(first1, y1 + 1)):
        if first0 <= y < first1:
            if channels:
                at = 2 * y * above_row + 2 * x0 * above_pitch
                pool_row(above, at, above_pitch, above_row, channels, line, count)
                source, at, step = line_words, start, channels // 4
            else:
                here = min(y, half_height - 1)
                at = here * record_row
                around_row(
                    means, half_height, half_stride, here, x0, min(x1, half_width), drift, grain, tent, codes,
                    records, at,
                )  # fmt: skip
                if x1 == width:
                    repeat_last(records, at, half_width, width)
                source, at, step = records, at + x0 * RECORD, np.int64(RECORD)
            to = (y + 1) * row + (x0 + 1) * pitch
            pointwise_row(source, at, step, words, weights, blocks, scales, biases, x, to, pitch, count)
            if x1 == width:
                clear(x, (y + 1) * row + (width + 1) * pitch, pitch)
        done = y - 1  # has all that it sees
        if y0 <= done < y1:
            at = done * row + x0 * pitch
            depthwise_row(
                x, at, pitch, row, spatial_weights, between, spatial_scales, spatial_biases, line, count
            )  # fmt: skip
            to = done * out_row + x0 * out_pitch
            pointwise_row(
                line_words, start, between // 4, between // 4, last_weights, last_blocks, last_scales,
                last_biases, out, to, out_pitch, count,
            )  # fmt: skip
