"""Kernels that preprocess a frame: toned samples, usable depth and motion, dilated motion."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    GLARING,
    clamped,
    largest,
    logarithm,
    luminance,
    sanitize,
    toned,
    usable,
    ycocg,
)
from supersampler.backends.cpu.layout import PAD, SAMPLE_PLANES
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import rows4, zipped
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    gather,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    spread16,
    store,
    sum_of_lanes,
)
from supersampler.backends.cpu.structs import Floats, FrameInputs, FrameSamples

DARKEST = 1e-4
MAX_MOTION, FARTHEST_MOTION = 3e38, 1e6
"""In pixels: motion above the first, or not a number, counts as 0; the rest is clamped to the second."""


@device_function
def places_of(x, y, w):
    """Return the indices of sixteen samples of a row from x on; the last sample is repeated."""
    return minimum(ramp16() + np.int32(x), np.int32(w - 1)) + np.int32(y * w)


@device_function
def color_at(color, at):
    """Return the RGB of sixteen samples."""
    return gather(color, at * 3), gather(color, at * 3 + 1), gather(color, at * 3 + 2)


@device_function
def motion_at(motion, at):
    """Return usable motion; see MAX_MOTION."""
    mx, my = gather(motion, at * 2), gather(motion, at * 2 + 1)
    x, y = clamped(mx, -FARTHEST_MOTION, FARTHEST_MOTION), clamped(my, -FARTHEST_MOTION, FARTHEST_MOTION)
    return select(absolute(mx) <= MAX_MOTION, x, 0.0), select(absolute(my) <= MAX_MOTION, y, 0.0)


def measure(color: Floats, w: int, y0: int, y1: int, rows: Floats):
    """Write sums over rows y0 to y1 to `rows`, (h, 2): log luminance of usable samples; their number."""
    zero = spread16(np.float32(0.0))
    for y in range(y0, y1):
        logs = count = zero
        for x in range(0, w, 16):
            r, g, b = color_at(color, places_of(x, y, w))
            good = usable(r, g, b) & (ramp16() + np.int32(x) < np.int32(w))
            luma = luminance(sanitize(r), sanitize(g), sanitize(b))
            logs = logs + select(good, logarithm(maximum(luma, DARKEST)), zero)
            count = count + select(good, spread16(np.float32(1.0)), zero)
        rows[2 * y] = sum_of_lanes(logs)
        rows[2 * y + 1] = sum_of_lanes(count)


def prepare(frame: FrameInputs, samples: FrameSamples, y0: int, y1: int):
    """Write color, depth, motion and glares of rows y0 to y1 of `samples`."""
    color, exposure, colors, w = frame.color, frame.exposure, samples.color, samples.width
    zero = spread16(np.float32(0.0))
    wide = samples.stride + 2 * PAD
    for y in range(y0, y1):
        brightest = zero
        for x in range(0, w, 16):
            at = places_of(x, y, w)
            r, g, b = color_at(color, at)
            usable_here = select(usable(r, g, b), 1.0, zero)
            r, g, b = toned(sanitize(r) * exposure, sanitize(g) * exposure, sanitize(b) * exposure)
            r, g, b = r * usable_here, g * usable_here, b * usable_here
            brightest = maximum(brightest, largest(r, g, b))
            luma, co, cg = ycocg(r, g, b)
            squares = luma * luma, co * co, cg * cg
            to = SAMPLE_PLANES * y * wide + PAD + x
            for c, value in enumerate((r, g, b, usable_here, luma, co, cg, *squares)):
                store(colors, to + c * wide, value)
            d, (mx, my) = gather(frame.depth, at), motion_at(frame.motion, at)
            to = y * wide + PAD + x
            store(samples.depth, to, select((d >= 0.0) & (d <= 1e30), d, -1.0))
            store(samples.motion_x, to, mx)
            store(samples.motion_y, to, my)
        samples.glares[y] = 0.0 if all_lanes(brightest <= GLARING) else 1.0
        for c in range(SAMPLE_PLANES):
            repeat_ends(colors, (SAMPLE_PLANES * y + c) * wide + PAD, w)
        for plane in (samples.depth, samples.motion_x, samples.motion_y):
            repeat_ends(plane, y * wide + PAD, w)


@device_function
def repeat_ends(plane, first, count, channels=1):
    """Fill the padding before and after `count` samples, of `channels` values each, from `first` on."""
    for x in range(PAD):
        for c in range(channels):
            plane[channels * (first - 1 - x) + c] = plane[channels * first + c]
            plane[channels * (first + count + x) + c] = plane[channels * (first + count - 1) + c]


def dilate(samples: FrameSamples, y0: int, y1: int):
    """Fill `dilated`, `own` and `eroded_depth` of rows y0 to y1 of `samples`, after `prepare`."""
    colors, glares, depths, across, down = (
        samples.color,
        samples.glares,
        samples.depth,
        samples.motion_x,
        samples.motion_y,
    )
    w, h, stride = samples.width, samples.height, samples.stride
    wide, zero = stride + 2 * PAD, spread16(np.float32(0.0))
    for y in range(y0, y1):
        above, here, below = max(y - 1, 0) * wide + PAD, y * wide + PAD, min(y + 1, h - 1) * wide + PAD
        glares_near = glares[max(y - 1, 0)] + glares[y] + glares[min(y + 1, h - 1)] > 0.0
        for x in range(0, w, 16):
            closest = farthest = load16(depths, here + x)
            for row in (above, here, below):
                for column in range(-1, 2):
                    d = load16(depths, row + x + column)
                    closest, farthest = maximum(d, closest), minimum(d, farthest)
            edge = clamped((closest - maximum(farthest, 0.0)) / maximum(closest, 1e-12), 0.0, 1.0)
            store(samples.eroded_depth, here + x, farthest)
            d, mx, my = load16(depths, here + x), load16(across, here + x), load16(down, here + x)
            glare = zero
            if glares_near:
                for row in (above, here, below):
                    glare = maximum(glare, glare_at(colors, SAMPLE_PLANES * (row - PAD) + PAD + x, wide))
            store4(samples.own, 4 * (y * stride + x), mx, my, edge, glare)
            for at in (here + x + 1, below + x, below + x + 1):
                other = load16(depths, at)
                closer = other > d
                d = select(closer, other, d)
                mx, my = select(closer, load16(across, at), mx), select(closer, load16(down, at), my)
            store4(samples.dilated, 4 * (y * stride + x), d, mx, my, zero)
        repeat_ends(samples.eroded_depth, here, w)


@device_function
def glare_at(colors, at, wide):
    """1 where one of three samples side by side is over GLARING, else 0."""
    brightest = spread16(np.float32(0.0))
    for channel in range(3):
        for column in range(-1, 2):
            brightest = maximum(brightest, load16(colors, at + channel * wide + column))
    return select(brightest > GLARING, 1.0, brightest * 0.0)


@device_function
def store4(out, at, first, second, third, fourth):
    """Write four vectors as sixteen samples of four values."""
    for i, row in enumerate(rows4((first, second, third, fourth))):
        store(out, at + 16 * i, row)


@device_function
def opened_at(eroded, above, here, below, x):
    """Return the depth of sixteen samples by morphological opening."""
    opened = load16(eroded, here + x)
    for row in (above, here, below):
        for column in range(-1, 2):
            opened = maximum(load16(eroded, row + x + column), opened)
    return opened


def keep_depth(samples: FrameSamples, next_depth: Floats, y0: int, y1: int):
    """Write the depth that the next frame compares with: as it is, and by morphological opening.

    next_depth: (height, PAD + stride + PAD, 2); the padding repeats the border.
    """
    w, h = samples.width, samples.height
    wide = samples.stride + 2 * PAD
    for y in range(y0, y1):
        above, here, below = max(y - 1, 0) * wide + PAD, y * wide + PAD, min(y + 1, h - 1) * wide + PAD
        for x in range(0, w, 16):
            opened = opened_at(samples.eroded_depth, above, here, below, x)
            store(next_depth, 2 * (here + x), zipped(load16(samples.depth, here + x), opened))
        repeat_ends(next_depth, here, w, 2)
