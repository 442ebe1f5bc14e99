"""Kernels of `guided-warp`; supersampler_model.methods.extrapolation.guided defines and explains them.

Sixteen pixels of a row at a time. Where all of them lead to samples that lie side by side, as they do but for
edges of things that move otherwise, samples are read sixteen at once.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    DARKNESS,
    MAX_HALF,
    clamped,
    exponential,
    logarithm,
    sanitize,
    usable,
)
from supersampler.backends.cpu.kernels.frame import FARTHEST_MOTION, MAX_MOTION, motion_at, places_of
from supersampler.backends.cpu.layout import GUIDE_PLANES
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    floor,
    gather,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    spread16,
    store,
    to_float,
    to_int,
)
from supersampler.backends.cpu.structs import Floats, Words
from supersampler.methods.extrapolation.spec import GUIDED_WARP
from supersampler.methods.extrapolation.structs import ExtrapolationOutput, Rings, UnshadedFrame
from supersampler.methods.spec import constant_indices

C = constant_indices(GUIDED_WARP)
THEN_W, THEN_H, BEFORE_W, BEFORE_H, JITTER, _, THEN_JITTER, _, BEFORE_JITTER, _, MOVED, HAS_DEPTH = range(
    len(C), len(C) + 12
)
"""Of `numbers`, after the constants of `guided-warp`; two for each jitter, across and down; MOVED: 0 where
`before` is zeros; HAS_DEPTH: 0 where the shaded frame has no depth at all."""
FARTHEST, NOWHERE = 1e-30, 1e4
STEPS, MOST, NUMBERS = 16.0, 262143.0, 64.0
MARGIN = 0.999  # of a distance, so that no rounding leaves out a sample that would have been taken


@device_function
def known(value):
    return absolute(value) <= MAX_HALF


@device_function
def three_at(image, at, pixel, plane):
    """Three channels, of which values are `pixel` apart from sample to sample, `plane` from each other."""
    first = at * np.int32(pixel)
    return (
        gather(image, first),
        gather(image, first + np.int32(plane)),
        gather(image, first + np.int32(2 * plane)),
    )


@device_function
def reflectance_of(base, normal, least):
    """Return the divisor of each colour channel; 1 at the sky."""
    sky = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] < 0.1
    return (
        select(sky, 1.0, base[0] + least),
        select(sky, 1.0, base[1] + least),
        select(sky, 1.0, base[2] + least),
    )


@device_function
def guides_at(base, normal, depth, at, pixel, plane, valid, numbers):
    """Return the guides of sixteen surfaces, in standard deviations, and their reflectance; valid: a mask."""
    b, n = three_at(base, at, pixel, plane), three_at(normal, at, pixel, plane)
    d = gather(depth, at)
    valid = valid & known(b[0]) & known(b[1]) & known(b[2]) & known(n[0]) & known(n[1]) & known(n[2])
    valid = valid & (d >= 0.0) & (d <= 1e30)
    b = (color_of(b[0]), color_of(b[1]), color_of(b[2]))
    n = (side_of(n[0]), side_of(n[1]), side_of(n[2]))
    far = select(valid, logarithm(maximum(d, FARTHEST)) / numbers[C.depth_sigma], NOWHERE)
    s = numbers[C.surface_sigma]
    guides = (b[0] / s, b[1] / s, b[2] / s, n[0] / s, n[1] / s, n[2] / s, far)
    return guides, reflectance_of(b, n, numbers[C.least])


@device_function
def color_of(value):
    return select(known(value), clamped(value, 0.0, 1.0), 0.0)


@device_function
def side_of(value):
    return select(known(value), clamped(value, -1.0, 1.0), 0.0)


def read_shaded(
    color: Floats, base: Floats, normal: Floats, depth: Floats, numbers: Floats, w: int, h: int, stride: int,
    y0: int, y1: int, samples: Floats,
):  # fmt: skip
    """Write rows y0 to y1 of the samples of a shaded frame, (SHADED_PLANES, h, stride): guides, then light.

    color to depth: planes (channels, h, w).
    """
    size = h * stride
    for y in range(y0, y1):
        for x in range(0, w, 16):
            at, to = places_of(x, y, w), y * stride + x
            r, g, b = three_at(color, at, 1, w * h)
            guides, reflectance = guides_at(base, normal, depth, at, 1, w * h, usable(r, g, b), numbers)
            for c, value in enumerate(guides):
                store(samples, c * size + to, value)
            store(samples, GUIDE_PLANES * size + to, sanitize(r) / reflectance[0])
            store(samples, (GUIDE_PLANES + 1) * size + to, sanitize(g) / reflectance[1])
            store(samples, (GUIDE_PLANES + 2) * size + to, sanitize(b) / reflectance[2])


@device_function
def reproject(place, jitter, other, size, other_size):
    """Return a position in another frame, in its samples; 0 is its first sample."""
    return (place + (jitter + np.float32(0.5))) * other_size / size - (other + np.float32(0.5))


@device_function
def usable_at(plane, at):
    value = gather(plane, at)
    return select(absolute(value) <= MAX_MOTION, clamped(value, -FARTHEST_MOTION, FARTHEST_MOTION), 0.0)


@device_function
def between(plane, first, x, y, w, h):
    """Usable motion, of a plane (h, w) that begins at `first`, at a place: linear; the border beyond it."""
    x, y = clamped(x, 0.0, np.float32(w - 1)), clamped(y, 0.0, np.float32(h - 1))
    left, top = floor(x), floor(y)
    s, t = x - left, y - top
    column, row = to_int(left), to_int(top)
    right, start = minimum(column + np.int32(1), np.int32(w - 1)), np.int32(first)
    here, below = row * np.int32(w) + start, minimum(row + np.int32(1), np.int32(h - 1)) * np.int32(w) + start
    upper = usable_at(plane, here + column) * (1.0 - s) + usable_at(plane, here + right) * s
    lower = usable_at(plane, below + column) * (1.0 - s) + usable_at(plane, below + right) * s
    return upper * (1.0 - t) + lower * t


@device_function
def back_to_shaded(motion, before, at, column, row, w, h, n):
    """Return the motion of sixteen pixels to the shaded frame: their own, plus that of the previous frame."""
    wide, high = np.float32(w), np.float32(h)
    mx, my = motion_at(motion, at)
    if n[MOVED] == 0.0:
        return mx, my
    x = reproject(column + mx, n[JITTER], n[BEFORE_JITTER], wide, n[BEFORE_W])
    y = reproject(my + row, n[JITTER + 1], n[BEFORE_JITTER + 1], high, n[BEFORE_H])
    before_w, before_h = int(n[BEFORE_W]), int(n[BEFORE_H])
    across = between(before, 0, x, y, before_w, before_h) * wide / n[BEFORE_W]
    down = between(before, before_w * before_h, x, y, before_w, before_h) * high / n[BEFORE_H]
    return clamped(mx + across, -FARTHEST_MOTION, FARTHEST_MOTION), clamped(
        my + down, -FARTHEST_MOTION, FARTHEST_MOTION
    )


@device_function
def load_samples(samples, c, size, at, first, together):
    """A plane's values at sixteen samples, the first of which is `first`."""
    return load16(samples, c * size + first) if together else gather(samples, at + np.int32(c * size))


@device_function
def squared(value):
    return value * value


@device_function
def squared_distance(own, samples, size, at, first, together):
    """Return the squared distance of sixteen surfaces from sixteen samples, over all guides."""
    total = squared(own[0] - load_samples(samples, 0, size, at, first, together))
    for c in range(1, GUIDE_PLANES):
        total = total + squared(own[c] - load_samples(samples, c, size, at, first, together))
    return total


@device_function
def inside(place, count):
    """The column or row of a place, that of the border beyond it."""
    return to_int(clamped(place, 0.0, np.float32(count - 1)))


@device_function
def swapped(kept, other):
    """The one with the lesser key, and the other; samples are key, -log of the weight, and place."""
    first = other[0] < kept[0]
    return (
        (
            select(first, other[0], kept[0]),
            select(first, other[1], kept[1]),
            select(first, other[2], kept[2]),
        ),
        (
            select(first, kept[0], other[0]),
            select(first, kept[1], other[1]),
            select(first, kept[2], other[2]),
        ),
    )


@device_function
def pushed(least, sample):
    """The four least of four, in order, and another."""
    a, sample = swapped(least[0], sample)
    b, sample = swapped(least[1], sample)
    c, sample = swapped(least[2], sample)
    d, sample = swapped(least[3], sample)
    return a, b, c, d


@device_function
def key_of(off, number):
    return minimum(floor(off * STEPS), MOST) * NUMBERS + number


@device_function
def four_least(own, samples, size, w, h, stride, x, y, across, down, strides, rings, sigma, room):
    """The samples around sixteen places that weigh most.

    What is farther off than the fourth of them could be, however like its surface is, is not looked at.
    """
    left, top = floor(x + 0.5), floor(y + 0.5)
    at = to_int(top) * np.int32(stride) + to_int(left)
    store(room, 0, at)
    first = room[0]
    row, column, reach = first // stride, first % stride, strides[rings - 1]
    together = (
        all_lanes(at == ramp16() + np.int32(first))
        and row >= reach and row < h - reach and column >= reach and column + 15 < w - reach
    )  # fmt: skip
    away = maximum(absolute(left - x), absolute(top - y))
    none = spread16(np.float32(3e38))
    least = (none, none, at), (none, none, at), (none, none, at), (none, none, at)
    middle = at
    for ring in range(rings):
        if ring:
            near = (away * -1.0 + np.float32(strides[ring])) / sigma
            if all_lanes(floor(squared(near) * (0.5 * MARGIN * STEPS)) * NUMBERS >= least[3][0]):
                break
        for k in range(8 * ring + 1 if ring else 0, 8 * ring + 9):
            u, v = left + across[k], top + down[k]
            step = int(down[k]) * stride + int(across[k])
            at = middle + np.int32(step) if together else inside(v, h) * np.int32(stride) + inside(u, w)
            off = squared_distance(own, samples, size, at, first + step, together)
            u, v = (u - x) / sigma, (v - y) / sigma
            off = (off + (u * u + v * v)) * 0.5
            least = pushed(least, (key_of(off, np.float32(k)), off, at))
    return least


@device_function
def light_at(least, samples, size):
    """Mean light of the chosen samples."""
    p, q, r, s = least[0][1], least[1][1], least[2][1], least[3][1]
    best = minimum(minimum(minimum(p, q), r), s)
    p, q, r, s = exponential(best - p), exponential(best - q), exponential(best - r), exponential(best - s)
    total, at = p + q + r + s, (least[0][2], least[1][2], least[2][2], least[3][2])
    return (
        mean_of(samples, GUIDE_PLANES * size, at, (p, q, r, s)) / total,
        mean_of(samples, (GUIDE_PLANES + 1) * size, at, (p, q, r, s)) / total,
        mean_of(samples, (GUIDE_PLANES + 2) * size, at, (p, q, r, s)) / total,
    )


@device_function
def mean_of(samples, plane, at, share):
    start = np.int32(plane)
    total = gather(samples, at[0] + start) * share[0] + gather(samples, at[1] + start) * share[1]
    return total + gather(samples, at[2] + start) * share[2] + gather(samples, at[3] + start) * share[3]


@device_function
def bounded(light, reflectance):
    """Return a colour channel, bounded."""
    value = minimum(light * reflectance, MAX_HALF)
    return select(value >= DARKNESS, value, 0.0)


def extrapolate_rows(
    frame: UnshadedFrame, motion_before: Floats, samples: Floats, numbers: Floats, rings: Rings, room: Words,
    line: Floats, output: ExtrapolationOutput, y0: int, y1: int,
):  # fmt: skip
    """Compute rows y0 to y1 of the image of an unshaded frame, and its motion back to the shaded one.

    motion_before: planes (2, h'', w'') of the previous frame; samples: as `read_shaded` writes them; room,
    line: scratch of a thread.
    """
    base, normal, depth, motion = frame.base_color, frame.normal, frame.depth, frame.motion
    before, w, h, stride = motion_before, frame.width, frame.height, frame.samples_stride
    across, down, strides = rings.x, rings.y, rings.strides
    total, image, n = output.motion, output.image, numbers
    then_w, then_h = int(n[THEN_W]), int(n[THEN_H])
    size, pixels = then_h * stride, w * h
    for y in range(y0, y1):
        for x in range(0, w, 16):
            at = places_of(x, y, w)
            column, row = to_float(at - np.int32(y * w)), np.float32(y)
            mx, my = back_to_shaded(motion, before, at, column, row, w, h, n)
            px = reproject(column + mx, n[JITTER], n[THEN_JITTER], np.float32(w), n[THEN_W])
            py = reproject(my + row, n[JITTER + 1], n[THEN_JITTER + 1], np.float32(h), n[THEN_H])
            px, py = clamped(px, 0.0, n[THEN_W] - 1.0), clamped(py, 0.0, n[THEN_H] - 1.0)
            every = spread16(n[HAS_DEPTH]) > 0.0
            own, reflectance = guides_at(base, normal, depth, at, 3, 1, every, n)
            least = four_least(
                own, samples, size, then_w, then_h, stride, px, py, across, down, strides, rings.rings,
                n[C.distance_sigma], room,
            )  # fmt: skip
            light = light_at(least, samples, size)
            for c, value in enumerate(
                (
                    mx,
                    my,
                    bounded(light[0], reflectance[0]),
                    bounded(light[1], reflectance[1]),
                    bounded(light[2], reflectance[2]),
                )
            ):
                store(line, 16 * c, value)
            for i in range(min(16, w - x)):
                to = y * w + x + i
                total[to], total[pixels + to] = line[i], line[16 + i]
                for c in range(3):
                    image[3 * to + c] = line[16 * (2 + c) + i]
