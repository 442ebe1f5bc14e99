"""What a frame brings, as kernels want it: toned samples, usable depth and motion, what is in front."""

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
from supersampler.backends.cpu.kernels.types import Floats
from supersampler.backends.cpu.layout import PAD, SAMPLED
from supersampler.backends.cpu.simd.device_function import inner
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

DARKEST = 1e-4
LONGEST, FAR = 3e38, 1e6
"""Of motion, in pixels: what is no number, or more than that, is none; where it may lead at most."""


@inner
def places_of(x, y, w):
    """Sixteen samples of a row from x on, the last repeated."""
    return minimum(ramp16() + np.int32(x), np.int32(w - 1)) + np.int32(y * w)


@inner
def color_at(color, at):
    return gather(color, at * 3), gather(color, at * 3 + 1), gather(color, at * 3 + 2)


@inner
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


def prepare(
    color: Floats, depth: Floats, motion: Floats, exposure: float, w: int, stride: int, y0: int, y1: int,
    samples: Floats, depths: Floats, across: Floats, down: Floats, glares: Floats,
):  # fmt: skip
    """Tone the samples; depth and motion, where they are usable; and which rows have a sample over GLARING.

    samples (h, SAMPLED, PAD + stride + PAD); depths, across, down (h, PAD + stride + PAD): ends repeat the
    border; glares (h,): 1 or 0.
    """
    zero = spread16(np.float32(0.0))
    wide = stride + 2 * PAD
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
            to = SAMPLED * y * wide + PAD + x
            for c, value in enumerate((r, g, b, good, luma, orange, green, *squares)):
                store(samples, to + c * wide, value)
            d, (mx, my) = gather(depth, at), motion_at(motion, at)
            to = y * wide + PAD + x
            store(depths, to, select((d >= 0.0) & (d <= 1e30), d, -1.0))
            store(across, to, mx)
            store(down, to, my)
        glares[y] = 0.0 if all_lanes(most <= GLARING) else 1.0
        for c in range(SAMPLED):
            repeat_ends(samples, (SAMPLED * y + c) * wide + PAD, w)
        for plane in (depths, across, down):
            repeat_ends(plane, y * wide + PAD, w)


@inner
def repeat_ends(plane, first, count, channels=1):
    """Fill the padding before and after `count` samples, of `channels` values each, from `first` on."""
    for x in range(PAD):
        for c in range(channels):
            plane[channels * (first - 1 - x) + c] = plane[channels * first + c]
            plane[channels * (first + count + x) + c] = plane[channels * (first + count - 1) + c]


def closest(
    samples: Floats, glares: Floats, depths: Floats, across: Floats, down: Floats, w: int, h: int,
    stride: int, y0: int, y1: int, front: Floats, own: Floats, eroded: Floats,
):  # fmt: skip
    """What is in front of rows y0 to y1, what they are themselves, and the farthest of 3x3 samples.

    front (h, stride, 4): depth and motion of the closest of four samples; own (h, stride, 4): motion, the
    range of depth in 3x3, and 1 where one of them is over GLARING; eroded: as `depths`.
    """
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
            store(eroded, here + x, far)
            d, mx, my = load16(depths, here + x), load16(across, here + x), load16(down, here + x)
            glare = zero
            if glares_near:
                for row in (above, here, below):
                    glare = maximum(glare, glare_at(samples, SAMPLED * (row - PAD) + PAD + x, wide))
            fours(own, 4 * (y * stride + x), mx, my, edge, glare)
            for at in (here + x + 1, below + x, below + x + 1):
                other = load16(depths, at)
                closer = other > d
                d = select(closer, other, d)
                mx, my = select(closer, load16(across, at), mx), select(closer, load16(down, at), my)
            fours(front, 4 * (y * stride + x), d, mx, my, zero)
        repeat_ends(eroded, here, w)


@inner
def glare_at(samples, at, wide):
    """1 where one of three samples side by side is over GLARING, else 0."""
    most = spread16(np.float32(0.0))
    for channel in range(3):
        for column in range(-1, 2):
            most = maximum(most, load16(samples, at + channel * wide + column))
    return select(most > GLARING, 1.0, most * 0.0)


@inner
def fours(out, at, first, second, third, fourth):
    """Write four vectors as sixteen samples of four values."""
    for i, row in enumerate(rows4((first, second, third, fourth))):
        store(out, at + 16 * i, row)


@inner
def opened_at(eroded, above, here, below, x):
    """Depth without thin things, of sixteen samples."""
    opened = load16(eroded, here + x)
    for row in (above, here, below):
        for column in range(-1, 2):
            opened = maximum(load16(eroded, row + x + column), opened)
    return opened


def surfaces(
    depths: Floats, eroded: Floats, w: int, h: int, stride: int, y0: int, y1: int, left: Floats,
):  # fmt: skip
    """Depth as it is, and without thin things: what the next frame looks back on.

    left (h, stride + 2 PAD, 2): ends repeat the border.
    """
    wide = stride + 2 * PAD
    for y in range(y0, y1):
        above, here, below = max(y - 1, 0) * wide + PAD, y * wide + PAD, min(y + 1, h - 1) * wide + PAD
        for x in range(0, w, 16):
            opened = opened_at(eroded, above, here, below, x)
            store(left, 2 * (here + x), zipped(load16(depths, here + x), opened))
        repeat_ends(left, here, w, 2)
