"""Kernels of the mean of the samples where nothing moves: twins of `supersampler_model.ops.convergence`.

Planes of the frame have rows of `padded_width` = PAD + stride + PAD samples.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    DARKNESS,
    GLARING,
    MAX_HALF,
    clamped,
    largest,
    lerp,
    sanitize,
    scaled3,
)
from supersampler.backends.cpu.kernels.filters import places_in, span
from supersampler.backends.cpu.kernels.frame import color_at, reactive_at, sample_indices, store4
from supersampler.backends.cpu.layout import PAD, RENDER_TILE, SAMPLE_PLANES
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import (
    first_third,
    gather4,
    last_third,
    load_columns4,
    second_third,
)
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    gather_nearby,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    spread16,
    store,
)
from supersampler.backends.cpu.structs import (
    Bytes,
    ConvergedOutput,
    Floats,
    FrameSamples,
    MeanHistory,
    ResampleTables,
    StillSamples,
)
from supersampler.methods.convergence import BRIGHTENING, DOUBTED, FIREFLY, MAX_STATIC_MOTION, PERIOD, READY


@device_function
def squared_motion(samples, at):
    """Return the squared length of sixteen vectors, samples."""
    mx, my = load16(samples.motion_x, at), load16(samples.motion_y, at)
    return mx * mx + my * my


def find_still(samples: FrameSamples, found: Bytes):
    """Write to the tiles of `found` what does not move: 2: 2x2 samples, 1: a sample, 0: nothing.

    The first of the 2x2 samples lies in the tile; a frame repeats its border.
    """
    w, h = samples.width, samples.height
    tiles, padded_width = (w + RENDER_TILE - 1) // RENDER_TILE, samples.stride + 2 * PAD
    limit, outside = MAX_STATIC_MOTION * MAX_STATIC_MOTION, ramp16() >= np.int32(RENDER_TILE)
    for y in range(h):
        tile = y // RENDER_TILE * tiles
        if y % RENDER_TILE == 0:
            for tx in range(tiles):
                found[tile + tx] = 0
        if samples.still_rows[y] == 0.0:
            continue
        for tx in range(tiles):
            here = y * padded_width + PAD + RENDER_TILE * tx
            if found[tile + tx] == 2 or all_lanes(outside | (squared_motion(samples, here) > limit)):
                continue
            below = min(y + 1, h - 1) * padded_width + PAD + RENDER_TILE * tx
            moves = squared_motion_2x2(samples, here, below) > limit
            found[tile + tx] = 1 if all_lanes(outside | moves) else 2


@device_function
def squared_motion_2x2(samples, here, below):
    """Return the largest squared motion of 2x2 samples; here, below: sixteen samples of the two rows."""
    upper = maximum(squared_motion(samples, here), squared_motion(samples, here + 1))
    return maximum(upper, maximum(squared_motion(samples, below), squared_motion(samples, below + 1)))


def prepare_still(
    color: Floats, samples: FrameSamples, still: StillSamples, y0: int, y1: int, x0: int, x1: int
):
    """Fill `still` in rows y0 to y1 and columns x0 to x1; x0 is a multiple of 16. Nothing opens yet."""
    colors, w, h = samples.color, samples.width, samples.height
    padded_width, limit = samples.stride + 2 * PAD, MAX_STATIC_MOTION * MAX_STATIC_MOTION
    zero = spread16(np.float32(0.0))
    for y in range(y0, y1):
        linear, below = 4 * y * padded_width + PAD, min(y + 1, h - 1) * padded_width + PAD
        for x in range(x0, x1, 16):
            r, g, b = color_at(color, sample_indices(x, y, w))
            at = SAMPLE_PLANES * y * padded_width + PAD + x
            brightest = largest(
                load16(colors, at), load16(colors, at + padded_width), load16(colors, at + 2 * padded_width)
            )
            usable = select(brightest > GLARING, zero, load16(colors, at + 3 * padded_width))
            r, g, b = sanitize(r) * usable, sanitize(g) * usable, sanitize(b) * usable
            peak, to = largest(r, g, b) * still.exposure, linear + x
            if not all_lanes(peak <= FIREFLY):
                above = SAMPLE_PLANES * max(y - 1, 0) * padded_width + PAD + x
                under = SAMPLE_PLANES * min(y + 1, h - 1) * padded_width + PAD + x
                most = (brightest_around(colors, above, at, under, padded_width) + 1.0) * FIREFLY
                r, g, b = scaled3((r, g, b), most / maximum(peak, most))
            store(still.color, to, r)
            store(still.color, to + padded_width, g)
            store(still.color, to + 2 * padded_width, b)
            store(still.color, to + 3 * padded_width, usable)
            here = y * padded_width + PAD + x
            moves_2x2 = squared_motion_2x2(samples, here, below + x) > limit
            store(still.moving, here, select(squared_motion(samples, here) > limit, 1.0, zero))
            store(still.moving_2x2, here, select(moves_2x2, 1.0, zero))
            store(still.opens, here, zero)
        for c in range(4):  # what lies beside the frame repeats its border
            first = linear + c * padded_width
            if x0 == 0:
                still.color[first - 1] = still.color[first]
            if x1 >= w:
                still.color[first + w] = still.color[first + w - 1]


@device_function
def largest_toned(colors, index, padded_width):
    """Return the largest toned channel of sixteen samples, 0 where they glare."""
    toned = largest(
        load16(colors, index), load16(colors, index + padded_width), load16(colors, index + 2 * padded_width)
    )
    return select(toned > GLARING, 0.0, toned)


@device_function
def brightest_around(colors, above, here, below, padded_width):
    """Return the largest exposed channel of the eight neighbours of sixteen samples, without glare.

    colors: toned, as of `FrameSamples`; above, here, below: the sample in the first plane of the three rows.
    """
    pitch = padded_width
    brightest = maximum(largest_toned(colors, here - 1, pitch), largest_toned(colors, here + 1, pitch))
    for column in range(-1, 2):
        brightest = maximum(brightest, largest_toned(colors, above + column, pitch))
        brightest = maximum(brightest, largest_toned(colors, below + column, pitch))
    return brightest / (1.0 - brightest)


@device_function
def plane_at(plane, row, pitch, columns, x):
    """Read one sample for each of sixteen pixels from x on."""
    first, step, index = places_in(columns, x)
    return gather_nearby(plane, row * pitch + PAD + first, step, index)


@device_function
def near_samples(line, pitch, tables, weights, width, x):
    """Filter the two samples around each of sixteen pixels in four planes of a line."""
    first, step, index = places_in(tables.column_start, x)
    left, right = (
        load16(tables.column_weights, weights * width + x),
        load16(tables.column_weights, (weights + 1) * width + x),
    )
    at = PAD + first
    return (
        gather_nearby(line, at, step, index) * left + gather_nearby(line, at + 1, step, index) * right,
        gather_nearby(line, at + pitch, step, index) * left
        + gather_nearby(line, at + pitch + 1, step, index) * right,
        gather_nearby(line, at + 2 * pitch, step, index) * left
        + gather_nearby(line, at + 2 * pitch + 1, step, index) * right,
        gather_nearby(line, at + 3 * pitch, step, index) * left
        + gather_nearby(line, at + 3 * pitch + 1, step, index) * right,
    )


def add_samples(
    history: MeanHistory, still: StillSamples, tables: ResampleTables, line: Floats, output: ConvergedOutput,
    y0: int, y1: int, x0: int, x1: int,
):  # fmt: skip
    """Add the samples of the frame to the mean, and fade the image to it, in a rectangle of pixels.

    line: (4, padded_width) scratch.
    """
    pitch, width, image = still.padded_width, output.width, output.image
    zero = spread16(np.float32(0.0))
    adds_none = spread16(still.counts) <= 0.0
    for y in range(y0, y1):
        first, last = span(tables.column_start, x0, x1)
        upper, lower = 4 * tables.row_samples[4 * y + 1] * pitch, 4 * tables.row_samples[4 * y + 2] * pitch
        up = tables.row_weights[4 * (output.filter * output.height + y) + 1]
        down = tables.row_weights[4 * (output.filter * output.height + y) + 2]
        for c in range(4):
            for x in range(c * pitch + first, c * pitch + last, 16):
                store(line, x, load16(still.color, upper + x) * up + load16(still.color, lower + x) * down)
        for x in range(x0, x1, 16):
            whole, at = x1 - x >= 16, y * width + x
            r, g, b, added = near_samples(line, pitch, tables, 4 * output.filter + 1, output.pitch, x)
            scale = 1.0 / maximum(added, 1e-6)
            stands = 1.0 - plane_at(still.moving_2x2, tables.first_row[y], pitch, tables.first_column, x)
            opened = zero
            if output.any_opened > 0:
                opened = plane_at(still.opened, tables.nearest_row[y], pitch, tables.nearest_column, x)
            if whole:
                mean_r, mean_g, mean_b, weight = load_columns4(history.pixels, 4 * at)
            else:
                mean_r, mean_g, mean_b, weight = gather4(history.pixels, output.columns, x, 4, 4 * y * width)
            rejected, confirmed = (opened > 0.0) & (weight > 0.0), (opened > 0.0) & (weight < 0.0)
            doubted = rejected | ((weight < 0.0) & adds_none)
            kept = select(confirmed, zero, absolute(weight) * stands)
            added = select(rejected & (opened > DOUBTED), zero, added * stands * still.counts)
            total = kept + added
            mean, sample = (mean_r, mean_g, mean_b), (r * scale, g * scale, b * scale)
            mean_r, mean_g, mean_b = blended(mean, sample, kept, added, still.exposure)
            converged = clamped((total - READY) / (PERIOD - READY), 0.0, 1.0)
            converged = select(opened > DOUBTED, zero, converged)
            if still.has_reactive > 0:
                converged = converged * (1.0 - reactive_at(still, tables, x, y))
            weight = select(doubted, minimum(total, PERIOD) * -1.0, total)
            index = minimum(ramp16() + np.int32(x), np.int32(width - 1)) + np.int32(y * width)
            r, g, b = color_at(image, index)
            r = bounded(lerp(r, mean_r, converged))
            g = bounded(lerp(g, mean_g, converged))
            b = bounded(lerp(b, mean_b, converged))
            if output.has_converged > 0:
                store(output.converged, y * output.pitch + x, converged)
            if whole:
                store4(output.next_pixels, 4 * at, mean_r, mean_g, mean_b, weight)
                store(image, 3 * at, first_third(r, g, b))
                store(image, 3 * at + 16, second_third(r, g, b))
                store(image, 3 * at + 32, last_third(r, g, b))
            else:
                store4(line, 4 * pitch, mean_r, mean_g, mean_b, weight)
                store(line, 4 * pitch + 64, first_third(r, g, b))
                store(line, 4 * pitch + 80, second_third(r, g, b))
                store(line, 4 * pitch + 96, last_third(r, g, b))
                for i in range(4 * (x1 - x)):
                    output.next_pixels[4 * at + i] = line[4 * pitch + i]
                for i in range(3 * (x1 - x)):
                    image[3 * at + i] = line[4 * pitch + 64 + i]


@device_function
def blended(mean, sample, kept, added, exposure):
    """Return the mean after a sample; kept, added: the weights of the two. `darkening` limits both."""
    total = kept + added
    part = added / maximum(total + clamped(total - PERIOD, 0.0, PERIOD), 1e-6)
    mean_peak = largest(mean[0], mean[1], mean[2]) * exposure
    sample_peak = largest(sample[0], sample[1], sample[2]) * exposure
    early = (kept < READY) & (added > 0.0)
    mean = scaled3(mean, darkening(mean_peak, select(early, sample_peak, mean_peak)))
    sample = scaled3(sample, darkening(sample_peak, select(kept > 0.0, mean_peak, sample_peak)))
    return lerp(mean[0], sample[0], part), lerp(mean[1], sample[1], part), lerp(mean[2], sample[2], part)


@device_function
def darkening(peak, other):
    """Return the factor that limits an exposed peak to white plus BRIGHTENING times another."""
    most = other * BRIGHTENING + 1.0
    return most / maximum(peak, most)


@device_function
def bounded(c):
    """Limit a channel to [0, MAX_HALF]; what is nearly black becomes black."""
    c = minimum(c, MAX_HALF)
    return select(c >= DARKNESS, c, 0.0)
