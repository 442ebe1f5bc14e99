"""Kernels that compare samples with the mean of static pixels: twins of `supersampler_model.ops.convergence`.

Planes of the frame have rows of `padded_width` = PAD + stride + PAD samples.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import luminance
from supersampler.backends.cpu.kernels.frame import store4
from supersampler.backends.cpu.layout import PAD
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import gather4, load_columns4
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    spread16,
    square_root,
    store,
)
from supersampler.backends.cpu.structs import Floats, MeanHistory, SampleTables, StillSamples
from supersampler.methods.convergence import (
    DOUBTED,
    FOLLOWS,
    FOLLOWS_DOUBTED,
    LEARNED,
    LEAST_CONTRAST,
    LEAST_RELATIVE_CONTRAST,
    MARGIN,
    MARGIN_LEARNING,
    MOST_LEARNING,
    PATTERN_READY,
    READY,
    SPREADS,
    UNBOUNDED,
)

COVERED, DARK = 0.999, 0.002
"""As in the torch module."""
REACH = 2
"""Samples on either side over which residuals are averaged."""
ROWS = 2 * REACH + 1
"""Rows, and columns, over which that is."""
SUMS = 6
"""Lines of a row that are sums over ROWS columns: of differences, of their squares, of lumas of the mean, of
their squares, of products of both, and of counted samples."""
LINES = SUMS + 3
"""Lines of a row: the sums; 1 where the sample is known; where its mean is also not doubted, or the doubt
stays; where it is also of enough samples to compare the pattern."""


@device_function
def shown_luma(r, g, b, exposure):
    """Return luma nearly as a screen shows it."""
    luma = luminance(r, g, b) * exposure
    return square_root(luma / (luma + 1.0) + DARK)


@device_function
def add_pixel(total, pixel, weight):
    """Add a pixel of the mean to the total: RGB, whether it is ready, is doubted, has few samples."""
    ready = select(absolute(pixel[3]) > READY, weight, weight * 0.0)
    doubted = select(pixel[3] < 0.0, weight, weight * 0.0)
    r, g, b = total[0] + pixel[0] * weight, total[1] + pixel[1] * weight, total[2] + pixel[2] * weight
    young = select(absolute(pixel[3]) < PATTERN_READY, weight, weight * 0.0)
    return r, g, b, total[3] + ready, total[4] + doubted, total[5] + young


@device_function
def mean_at_samples(history, tables, y, x):
    """Read the mean bilinearly at sixteen samples of row y; see `add_pixel`."""
    zero = load16(tables.column_weights, 0) * 0.0
    total = zero, zero, zero, zero, zero, zero
    for i in range(2):
        row, down = 4 * history.width * tables.rows[2 * y + i], tables.row_weights[2 * y + i]
        for j in range(2):
            columns = j * tables.columns_pitch + x
            pixel = gather4(history.pixels, tables.columns, columns, 4, row)
            total = add_pixel(total, pixel, load16(tables.column_weights, columns) * down)
    return total


@device_function
def compare_row(history, still, tables, y, x0, x1, ring, slot, line):
    """Write row y: the last three of LINES from `slot` on; from `line` on what SUMS are the sums of."""
    pitch, zero = still.padded_width, spread16(np.float32(0.0))
    for x in range(x0 - 16, x1 + 16, 16):
        to = PAD + x
        difference = expected = counted = known = certain = comparable = zero
        if 0 <= y < still.height and 0 <= x < still.width:
            at = 4 * y * pitch + to
            moving = load16(still.moving, y * pitch + to)
            if not all_lanes(moving > 0.0):
                r, g, b, ready, doubted, young = mean_at_samples(history, tables, y, x)
                inside = ramp16() + np.int32(x) < np.int32(still.width)
                known = select((ready > COVERED) & (moving < 1.0) & inside, 1.0, zero)
                certain = select(doubted * still.counts > 0.0, zero, known)
                comparable = select(young > 0.0, zero, known * still.counts)
                counted = known * load16(still.color, at + 3 * pitch)
                sample = shown_luma(
                    load16(still.color, at), load16(still.color, at + pitch),
                    load16(still.color, at + 2 * pitch), still.exposure,
                )  # fmt: skip
                expected = shown_luma(r, g, b, still.exposure)
                difference, expected = (sample - expected) * counted, expected * counted
        store(ring, line + to, difference)
        store(ring, line + pitch + to, difference * difference)
        store(ring, line + 2 * pitch + to, expected)
        store(ring, line + 3 * pitch + to, expected * expected)
        store(ring, line + 4 * pitch + to, difference * expected)
        store(ring, line + 5 * pitch + to, counted)
        store(ring, slot + SUMS * pitch + to, known)
        store(ring, slot + (SUMS + 1) * pitch + to, certain)
        store(ring, slot + (SUMS + 2) * pitch + to, comparable)


def measure_residuals(
    history: MeanHistory, still: StillSamples, tables: SampleTables, next_opening: Floats, ring: Floats,
    y0: int, y1: int, x0: int, x1: int,
):  # fmt: skip
    """Compare the samples with the mean: write the next opening and what opens; x0 is a multiple of 16.

    ring: (ROWS * LINES + SUMS, padded_width) scratch: LINES of ROWS rows, and a row before it is summed.
    """
    pitch, zero = still.padded_width, spread16(np.float32(0.0))
    line = ROWS * LINES * pitch
    for below in range(y0 - REACH, y1 + REACH):
        slot = (below + ROWS) % ROWS * LINES * pitch
        compare_row(history, still, tables, below, x0, x1, ring, slot, line)
        for c in range(SUMS):
            for x in range(x0, x1, 16):
                at = line + c * pitch + PAD + x
                total = load16(ring, at - 2) + load16(ring, at - 1)
                for k in range(3):
                    total = total + load16(ring, at + k)
                store(ring, slot + c * pitch + PAD + x, total)
        y = below - REACH
        if y < y0:
            continue
        opened = zero
        for x in range(x0, x1, 16):
            here = PAD + x
            own = (y + ROWS) % ROWS * LINES * pitch + here
            known, certain = load16(ring, own + SUMS * pitch), load16(ring, own + (SUMS + 1) * pitch)
            scale = 1.0 / maximum(column_sum(ring, y, 5, here, pitch), 1e-6)
            residual = column_sum(ring, y, 0, here, pitch) * scale
            variance = maximum(column_sum(ring, y, 1, here, pitch) * scale - residual * residual, 0.0)
            spread = square_root(variance)
            other_pattern = follows_other_pattern(ring, y, here, pitch, scale, residual, variance, certain)
            low, high, learned = zero, zero, zero
            if history.has_opening > 0:
                low, high, learned, _ = load_columns4(history.opening, 4 * (y * pitch + here))
            learning = learned < LEARNED
            margin = minimum(spread * SPREADS + MARGIN_LEARNING, MOST_LEARNING)
            margin = select(learning, margin, MARGIN)
            below, above = residual < low - margin, residual > high + margin
            opens = select((load16(ring, own + (SUMS + 2) * pitch) > 0.0) & other_pattern, DOUBTED, zero)
            opens = select((known > 0.0) & (below | above), 1.0, opens)
            learns = learning & (opens <= 0.0)
            low = select(learns, minimum(low, residual), low)
            high = select(learns, maximum(high, residual), high)
            low, high = select(above, -UNBOUNDED, low), select(below, UNBOUNDED, high)
            learned = minimum(select(learns, learned + still.learned_step, learned), LEARNED)
            store4(
                next_opening, 4 * (y * pitch + here), low * certain, high * certain, learned * certain, zero
            )
            store(still.opens, y * pitch + here, opens)
            opened = maximum(opened, opens)
        if not all_lanes(opened <= 0.0):
            still.rows_opened[y] = 1.0


@device_function
def follows_other_pattern(ring, y, at, pitch, scale, residual, variance, certain):
    """Whether the samples around sixteen of row y follow another pattern than the mean.

    scale: 1 by the counted samples; residual, variance: mean and variance of the differences; certain: 1
    where the mean is not doubted.
    """
    expected = column_sum(ring, y, 2, at, pitch) * scale
    contrast = column_sum(ring, y, 3, at, pitch) * scale - expected * expected
    covariance = column_sum(ring, y, 4, at, pitch) * scale - residual * expected
    least = variance * LEAST_RELATIVE_CONTRAST + LEAST_CONTRAST * LEAST_CONTRAST
    slope = certain * (FOLLOWS - FOLLOWS_DOUBTED) + FOLLOWS_DOUBTED
    return (contrast > least) & (contrast + covariance < contrast * slope)


@device_function
def column_sum(ring, y, c, at, pitch):
    """Return the sum of line c of the rows from y - REACH to y + REACH."""
    total = load16(ring, ((y - REACH + ROWS) % ROWS * LINES + c) * pitch + at)
    for k in range(1 - REACH, REACH + 1):
        total = total + load16(ring, ((y + k + ROWS) % ROWS * LINES + c) * pitch + at)
    return total


def widen_openings(still: StillSamples, y0: int, y1: int):
    """Write the maximum of 5x5 samples of `opens` to `opened`, rows y0 to y1."""
    pitch, w, h = still.padded_width, still.width, still.height
    for y in range(y0, y1):
        for x in range(w):
            found = np.float32(0.0)
            for row in range(max(y - REACH, 0), min(y + REACH + 1, h)):
                if still.rows_opened[row] > 0.0:
                    for column in range(max(x - REACH, 0), min(x + REACH + 1, w)):
                        found = max(found, still.opens[row * pitch + PAD + column])
            still.opened[y * pitch + PAD + x] = found
