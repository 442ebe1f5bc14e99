"""Kernel of the filter to the display; same as `supersampler_model.ops.sampling`."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import clamped, linear_of, toned
from supersampler.backends.cpu.kernels.frame import color_at, sample_indices, store4
from supersampler.backends.cpu.simd.shuffles import (
    every_first,
    every_second,
    every_third,
    first_third,
    gather4,
    last_third,
    second_third,
)
from supersampler.backends.cpu.simd.vector import device_function, load16, spread16, store
from supersampler.backends.cpu.structs import Floats
from supersampler.methods.classifier_large.downsampling import RING, TAPS, Downsampling
from supersampler.methods.constants import MAX_TONED


@device_function
def tone_row(work, y, out, to):
    """Write a row of the image to `out`, toned, in four values per pixel."""
    e, width = work.exposure, work.large_width
    for x in range(0, width, 16):
        at = 3 * (y * width + x)
        if width - x >= 16:
            first, second = load16(work.image, at), load16(work.image, at + 16)
            third = load16(work.image, at + 32)
            r, g = every_first(first, second, third), every_second(first, second, third)
            b = every_third(first, second, third)
        else:
            r, g, b = color_at(work.image, sample_indices(x, y, width))
        r, g, b = toned(r * e, g * e, b * e)
        store4(out, to + 4 * x, r, g, b, r * 0.0)


@device_function
def filter_down(work, y, ring, pitch, to):
    """Write the sum of the toned rows that display row y reads; pitch: values of a row of the ring."""
    zero = spread16(np.float32(0.0))
    for x in range(0, 4 * work.large_width, 16):
        total = zero
        for tap in range(TAPS):
            row = work.rows[TAPS * y + tap] % RING
            total = total + load16(ring, row * pitch + x) * work.row_weights[TAPS * y + tap]
        store(ring, to + x, total)


@device_function
def filter_across(work, line, at, x):
    """Return the toned colours of sixteen pixels of the display from x on; `line` from `at` on."""
    zero = spread16(np.float32(0.0))
    r, g, b = zero, zero, zero
    for tap in range(TAPS):
        columns = tap * work.pitch + x
        weight = load16(work.column_weights, columns)
        pixel = gather4(line, work.columns, columns, 4, at)
        r, g, b = r + pixel[0] * weight, g + pixel[1] * weight, b + pixel[2] * weight
    return clamped(r, 0.0, MAX_TONED), clamped(g, 0.0, MAX_TONED), clamped(b, 0.0, MAX_TONED)


def downsample(work: Downsampling, scratch: Floats, y0: int, y1: int):
    """Filter the image to rows y0 to y1 of the display.

    scratch: a ring of RING rows of the image, and one more, of whole vectors.
    """
    pitch, width, out = 4 * ((work.large_width + 15) // 16 * 16), work.width, work.output
    line, ready = RING * pitch, np.int64(work.rows[TAPS * y0])
    for y in range(y0, y1):
        for row in range(ready, work.rows[TAPS * y + TAPS - 1] + 1):
            tone_row(work, row, scratch, row % RING * pitch)
        ready = max(ready, np.int64(work.rows[TAPS * y + TAPS - 1]) + 1)
        filter_down(work, y, scratch, pitch, line)
        for x in range(0, width, 16):
            r, g, b = filter_across(work, scratch, line, x)
            r, g, b = linear_of(r, g, b, work.exposure)
            at = 3 * (y * width + x)
            if width - x >= 16:
                store(out, at, first_third(r, g, b))
                store(out, at + 16, second_third(r, g, b))
                store(out, at + 32, last_third(r, g, b))
            else:
                store(scratch, line, first_third(r, g, b))
                store(scratch, line + 16, second_third(r, g, b))
                store(scratch, line + 32, last_third(r, g, b))
                for i in range(3 * (width - x)):
                    out[at + i] = scratch[line + i]
