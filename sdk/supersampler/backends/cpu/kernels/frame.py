"""Kernels that read a frame: toned samples, usable depth and motion, motion of the closest of 2x2 samples."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    GLARING,
    clamped,
    largest,
    logarithm,
    luminance,
    quarantined,
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
LONGEST, FAR = 3e38, 1e6
"""Of motion, in pixels: what is no number, or more than that, is none; where it may lead at most."""


@device_function
def places_of(x, y, w):
    """Sixteen samples of a row from x on, the last repeated."""
    return minimum(ramp16() + np.int32(x), np.int32(w - 1)) + np.int32(y * w)


@device_function
def color_at(color, at):
    return gather(color, at * 3), gather(color, at * 3 + 1), gather(color, at * 3 + 2)


@device_function
def motion_at(motion, at):
    """Usable motion: what is not a number is none, what leads far off screen as far as is of any use."""
    mx, my = gather(motion, at * 2), gather(motion, at * 2 + 1)
    x, y = clamped(mx, -FAR, FAR), clamped(my, -FAR, FAR)
    return select(absolute(mx) <= LONGEST, x, 0.0), select(absolute(my) <= LONGEST, y, 0.0)


def measure(color: Floats, w: int, y0: int, y1: int, rows: Floats):
    """Sums of rows y0 to y1: of the logarithms of luminance of usable samples, and of how many there are."""
    zero = spread16(np.float32(0.0))
    for y in range(y0, y1):
        logs = count = zero
        for x in range(0, w, 16):
            r, g, b = color_at(color, places_of(x, y, w))
            good = usable(r, g, b) & (ramp16() + np.int32(x) < np.int32(w))
            luma = luminance(quarantined(r), quarantined(g), quarantined(b))
            logs = logs + select(good, logarithm(maximum(luma, DARKEST)), zero)
            count = count + select(good, spread16(np.float32(1.0)), zero)
        rows[2 * y] = sum_of_lanes(logs)
        rows[2 * y + 1] = sum_of_lanes(count)


def prepare(frame: FrameInputs, read: FrameSamples, y0: int, y1: int):
    """Fill color, depth, motion and glares of rows y0 to y1 of `read`."""
    color, exposure, samples, w = frame.color, frame.exposure, read.color, read.width
    zero = spread16(np.float32(0.0))
    wide = read.stride + 2 * PAD
    for y in range(y0, y1):
        most = zero
        for x in range(0, w, 16):
            at = places_of(x, y, w)
            r, g, b = color_at(color, at)
            good = select(usable(r, g, b), 1.0, zero)
            r, g, b = toned(quarantined(r) * exposure, quarantined(g) * exposure, quarantined(b) * exposure)
            r, g, b = r * good, g * good, b * good
            most = maximum(most, largest(r, g, b))
            luma, orange, green = ycocg(r, g, b)
            squares = luma * luma, orange * orange, green * green
            to = SAMPLE_PLANES * y * wide + PAD + x
            for c, value in enumerate((r, g, b, good, luma, orange, green, *squares)):
                store(samples, to + c * wide, value)
            d, (mx, my) = gather(frame.depth, at), motion_at(frame.motion, at)
            to = y * wide + PAD + x
            store(read.depth, to, select((d >= 0.0) & (d <= 1e30), d, -1.0))
            store(read.motion_x, to, mx)
            store(read.motion_y, to, my)
        read.glares[y] = 0.0 if all_lanes(most <= GLARING) else 1.0
        for c in range(SAMPLE_PLANES):
            repeat_ends(samples, (SAMPLE_PLANES * y + c) * wide + PAD, w)
        for plane in (read.depth, read.motion_x, read.motion_y):
            repeat_ends(plane, y * wide + PAD, w)


@device_function
def repeat_ends(plane, first, count, channels=1):
    """Fill the padding before and after `count` samples, of `channels` values each, from `first` on."""
    for x in range(PAD):
        for c in range(channels):
            plane[channels * (first - 1 - x) + c] = plane[channels * first + c]
            plane[channels * (first + count + x) + c] = plane[channels * (first + count - 1) + c]


def dilate(read: FrameSamples, y0: int, y1: int):
    """Fill `dilated`, `own` and `eroded_depth` of rows y0 to y1 of `read` from what `prepare` filled."""
    samples, glares, depths, across, down = read.color, read.glares, read.depth, read.motion_x, read.motion_y
    w, h, stride = read.width, read.height, read.stride
    wide, zero = stride + 2 * PAD, spread16(np.float32(0.0))
    for y in range(y0, y1):
        above, here, below = max(y - 1, 0) * wide + PAD, y * wide + PAD, min(y + 1, h - 1) * wide + PAD
        glares_near = glares[max(y - 1, 0)] + glares[y] + glares[min(y + 1, h - 1)] > 0.0
        for x in range(0, w, 16):
            near = far = load16(depths, here + x)
            for row in (above, here, below):
                for column in range(-1, 2):
                    d = load16(depths, row + x + column)
                    near, far = maximum(d, near), minimum(d, far)
            edge = clamped((near - maximum(far, 0.0)) / maximum(near, 1e-12), 0.0, 1.0)
            store(read.eroded_depth, here + x, far)
            d, mx, my = load16(depths, here + x), load16(across, here + x), load16(down, here + x)
            glare = zero
            if glares_near:
                for row in (above, here, below):
                    glare = maximum(glare, glare_at(samples, SAMPLE_PLANES * (row - PAD) + PAD + x, wide))
            fours(read.own, 4 * (y * stride + x), mx, my, edge, glare)
            for at in (here + x + 1, below + x, below + x + 1):
                other = load16(depths, at)
                closer = other > d
                d = select(closer, other, d)
                mx, my = select(closer, load16(across, at), mx), select(closer, load16(down, at), my)
            fours(read.dilated, 4 * (y * stride + x), d, mx, my, zero)
        repeat_ends(read.eroded_depth, here, w)


@device_function
def glare_at(samples, at, wide):
    """1 where one of three samples side by side is over GLARING, else 0."""
    most = spread16(np.float32(0.0))
    for channel in range(3):
        for column in range(-1, 2):
            most = maximum(most, load16(samples, at + channel * wide + column))
    return select(most > GLARING, 1.0, most * 0.0)


@device_function
def fours(out, at, first, second, third, fourth):
    """Write four vectors as sixteen samples of four values."""
    for i, row in enumerate(rows4((first, second, third, fourth))):
        store(out, at + 16 * i, row)


@device_function
def opened_at(eroded, above, here, below, x):
    """Depth by morphological opening, of sixteen samples."""
    opened = load16(eroded, here + x)
    for row in (above, here, below):
        for column in range(-1, 2):
            opened = maximum(load16(eroded, row + x + column), opened)
    return opened


def keep_depth(read: FrameSamples, next_depth: Floats, y0: int, y1: int):
    """Write the depth that the next frame compares with: as it is, and by morphological opening.

    next_depth: (height, PAD + stride + PAD, 2); the padding repeats the border.
    """
    w, h = read.width, read.height
    wide = read.stride + 2 * PAD
    for y in range(y0, y1):
        above, here, below = max(y - 1, 0) * wide + PAD, y * wide + PAD, min(y + 1, h - 1) * wide + PAD
        for x in range(0, w, 16):
            opened = opened_at(read.eroded_depth, above, here, below, x)
            store(next_depth, 2 * (here + x), zipped(load16(read.depth, here + x), opened))
        repeat_ends(next_depth, here, w, 2)
