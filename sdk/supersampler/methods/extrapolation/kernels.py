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
from supersampler.backends.cpu.kernels.frame import FARTHEST_MOTION, MAX_MOTION, motion_at, sample_indices
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
(
    SHADED_W,
    SHADED_H,
    PREVIOUS_W,
    PREVIOUS_H,
    JITTER,
    _,
    SHADED_JITTER,
    _,
    PREVIOUS_JITTER,
    _,
    HAS_PREVIOUS_MOTION,
    HAS_DEPTH,
) = range(len(C), len(C) + 12)
"""Of `numbers`, after the constants of `guided-warp`; two for each jitter, across and down; MOVED: 0 where
`previous_motion` is zeros; HAS_DEPTH: 0 where the shaded frame has no depth at all."""
MIN_DEPTH, NO_SURFACE = 1e-30, 1e4
DISTANCE_STEPS, MAX_DISTANCE, MAX_TAPS = 16.0, 262143.0, 64.0
MARGIN = 0.999  # of a distance, so that no rounding leaves out a sample that would have been taken


@device_function
def is_usable(value):
    return absolute(value) <= MAX_HALF


@device_function
def three_at(image, index, pixel, plane):
    """Three channels, of which values are `pixel` apart from sample to sample, `plane` from each other."""
    first = index * np.int32(pixel)
    return (
        gather(image, first),
        gather(image, first + np.int32(plane)),
        gather(image, first + np.int32(2 * plane)),
    )


@device_function
def reflectance_of(base, normal, nearest):
    """Return the divisor of each colour channel; 1 at the sky."""
    sky = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] < 0.1
    return (
        select(sky, 1.0, base[0] + nearest),
        select(sky, 1.0, base[1] + nearest),
        select(sky, 1.0, base[2] + nearest),
    )


@device_function
def guides_at(base, normal, depth, index, pixel, plane, valid, numbers):
    """Return the guides of sixteen surfaces, in standard deviations, and their reflectance; valid: a mask."""
    b, n = three_at(base, index, pixel, plane), three_at(normal, index, pixel, plane)
    d = gather(depth, index)
    valid = (
        valid
        & is_usable(b[0])
        & is_usable(b[1])
        & is_usable(b[2])
        & is_usable(n[0])
        & is_usable(n[1])
        & is_usable(n[2])
    )
    valid = valid & (d >= 0.0) & (d <= 1e30)
    b = (sanitized_color(b[0]), sanitized_color(b[1]), sanitized_color(b[2]))
    n = (sanitized_normal(n[0]), sanitized_normal(n[1]), sanitized_normal(n[2]))
    far = select(valid, logarithm(maximum(d, MIN_DEPTH)) / numbers[C.depth_sigma], NO_SURFACE)
    s = numbers[C.surface_sigma]
    guides = (b[0] / s, b[1] / s, b[2] / s, n[0] / s, n[1] / s, n[2] / s, far)
    return guides, reflectance_of(b, n, numbers[C.nearest])


@device_function
def sanitized_color(value):
    return select(is_usable(value), clamped(value, 0.0, 1.0), 0.0)


@device_function
def sanitized_normal(value):
    return select(is_usable(value), clamped(value, -1.0, 1.0), 0.0)


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
            index, to = sample_indices(x, y, w), y * stride + x
            r, g, b = three_at(color, index, 1, w * h)
            guides, reflectance = guides_at(base, normal, depth, index, 1, w * h, usable(r, g, b), numbers)
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
def usable_motion(plane, index):
    value = gather(plane, index)
    return select(absolute(value) <= MAX_MOTION, clamped(value, -FARTHEST_MOTION, FARTHEST_MOTION), 0.0)


@device_function
def interpolated_motion(plane, first, x, y, w, h):
    """Usable motion, of a plane (h, w) that begins at `first`, at a place: linear; the border beyond it."""
    x, y = clamped(x, 0.0, np.float32(w - 1)), clamped(y, 0.0, np.float32(h - 1))
    left, top = floor(x), floor(y)
    s, t = x - left, y - top
    column, row = to_int(left), to_int(top)
    right, start = minimum(column + np.int32(1), np.int32(w - 1)), np.int32(first)
    here, below = row * np.int32(w) + start, minimum(row + np.int32(1), np.int32(h - 1)) * np.int32(w) + start
    upper = usable_motion(plane, here + column) * (1.0 - s) + usable_motion(plane, here + right) * s
    lower = usable_motion(plane, below + column) * (1.0 - s) + usable_motion(plane, below + right) * s
    return upper * (1.0 - t) + lower * t


@device_function
def back_to_shaded(motion, previous_motion, index, column, row, w, h, n):
    """Return the motion of sixteen pixels to the shaded frame: their own, plus that of the previous frame."""
    float_w, float_h = np.float32(w), np.float32(h)
    mx, my = motion_at(motion, index)
    if n[HAS_PREVIOUS_MOTION] == 0.0:
        return mx, my
    x = reproject(column + mx, n[JITTER], n[PREVIOUS_JITTER], float_w, n[PREVIOUS_W])
    y = reproject(my + row, n[JITTER + 1], n[PREVIOUS_JITTER + 1], float_h, n[PREVIOUS_H])
    previous_w, previous_h = int(n[PREVIOUS_W]), int(n[PREVIOUS_H])
    across = interpolated_motion(previous_motion, 0, x, y, previous_w, previous_h) * float_w / n[PREVIOUS_W]
    down = (
        interpolated_motion(previous_motion, previous_w * previous_h, x, y, previous_w, previous_h)
        * float_h
        / n[PREVIOUS_H]
    )
    return clamped(mx + across, -FARTHEST_MOTION, FARTHEST_MOTION), clamped(
        my + down, -FARTHEST_MOTION, FARTHEST_MOTION
    )


@device_function
def load_samples(samples, c, size, index, first, together):
    """A plane's values at sixteen samples, the first of which is `first`."""
    return load16(samples, c * size + first) if together else gather(samples, index + np.int32(c * size))


@device_function
def squared(value):
    return value * value


@device_function
def squared_distance(own, samples, size, index, first, together):
    """Return the squared distance of sixteen surfaces from sixteen samples, over all guides."""
    total = squared(own[0] - load_samples(samples, 0, size, index, first, together))
    for c in range(1, GUIDE_PLANES):
        total = total + squared(own[c] - load_samples(samples, c, size, index, first, together))
    return total


@device_function
def clamped_index(place, count):
    """The column or row of a place, that of the border beyond it."""
    return to_int(clamped(place, 0.0, np.float32(count - 1)))


@device_function
def sorted_pair(kept, other):
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
def insert_sorted(nearest, sample):
    """The four least of four, in order, and another."""
    a, sample = sorted_pair(nearest[0], sample)
    b, sample = sorted_pair(nearest[1], sample)
    c, sample = sorted_pair(nearest[2], sample)
    d, sample = sorted_pair(nearest[3], sample)
    return a, b, c, d


@device_function
def sort_key(distance, number):
    return minimum(floor(distance * DISTANCE_STEPS), MAX_DISTANCE) * MAX_TAPS + number


@device_function
def nearest_four(own, samples, size, w, h, stride, x, y, across, down, strides, rings, sigma, index_scratch):
    """The samples around sixteen places that weigh most.

    What is farther off than the fourth of them could be, however like its surface is, is not looked at.
    """
    left, top = floor(x + 0.5), floor(y + 0.5)
    index = to_int(top) * np.int32(stride) + to_int(left)
    store(index_scratch, 0, index)
    first = index_scratch[0]
    row, column, reach = first // stride, first % stride, strides[rings - 1]
    together = (
        all_lanes(index == ramp16() + np.int32(first))
        and row >= reach and row < h - reach and column >= reach and column + 15 < w - reach
    )  # fmt: skip
    center_distance = maximum(absolute(left - x), absolute(top - y))
    farthest = spread16(np.float32(3e38))
    nearest = (
        (farthest, farthest, index),
        (farthest, farthest, index),
        (farthest, farthest, index),
        (farthest, farthest, index),
    )
    center = index
    for ring in range(rings):
        if ring:
            near = (center_distance * -1.0 + np.float32(strides[ring])) / sigma
            if all_lanes(floor(squared(near) * (0.5 * MARGIN * DISTANCE_STEPS)) * MAX_TAPS >= nearest[3][0]):
                break
        for k in range(8 * ring + 1 if ring else 0, 8 * ring + 9):
            u, v = left + across[k], top + down[k]
            step = int(down[k]) * stride + int(across[k])
            index = (
                center + np.int32(step)
                if together
                else clamped_index(v, h) * np.int32(stride) + clamped_index(u, w)
            )
            distance = squared_distance(own, samples, size, index, first + step, together)
            u, v = (u - x) / sigma, (v - y) / sigma
            distance = (distance + (u * u + v * v)) * 0.5
            nearest = insert_sorted(nearest, (sort_key(distance, np.float32(k)), distance, index))
    return nearest


@device_function
def mean_light(nearest, samples, size):
    """Mean light of the chosen samples."""
    p, q, r, s = nearest[0][1], nearest[1][1], nearest[2][1], nearest[3][1]
    best = minimum(minimum(minimum(p, q), r), s)
    p, q, r, s = exponential(best - p), exponential(best - q), exponential(best - r), exponential(best - s)
    total, index = p + q + r + s, (nearest[0][2], nearest[1][2], nearest[2][2], nearest[3][2])
    return (
        mean_of(samples, GUIDE_PLANES * size, index, (p, q, r, s)) / total,
        mean_of(samples, (GUIDE_PLANES + 1) * size, index, (p, q, r, s)) / total,
        mean_of(samples, (GUIDE_PLANES + 2) * size, index, (p, q, r, s)) / total,
    )


@device_function
def mean_of(samples, plane, index, weights):
    start = np.int32(plane)
    total = gather(samples, index[0] + start) * weights[0] + gather(samples, index[1] + start) * weights[1]
    return (
        total
        + gather(samples, index[2] + start) * weights[2]
        + gather(samples, index[3] + start) * weights[3]
    )


@device_function
def bounded(light, reflectance):
    """Return a colour channel, bounded."""
    value = minimum(light * reflectance, MAX_HALF)
    return select(value >= DARKNESS, value, 0.0)


def extrapolate_rows(
    frame: UnshadedFrame, previous_motion: Floats, samples: Floats, numbers: Floats, rings: Rings, index_scratch: Words,
    line: Floats, output: ExtrapolationOutput, y0: int, y1: int,
):  # fmt: skip
    """Compute rows y0 to y1 of the image of an unshaded frame, and its motion back to the shaded one.

    motion_before: planes (2, h'', w'') of the previous frame; samples: as `read_shaded` writes them; room,
    line: scratch of a thread.
    """
    base, normal, depth, motion = frame.base_color, frame.normal, frame.depth, frame.motion
    previous_motion, w, h, stride = previous_motion, frame.width, frame.height, frame.samples_stride
    across, down, strides = rings.x, rings.y, rings.strides
    total, image, n = output.motion, output.image, numbers
    shaded_w, shaded_h = int(n[SHADED_W]), int(n[SHADED_H])
    size, pixels = shaded_h * stride, w * h
    for y in range(y0, y1):
        for x in range(0, w, 16):
            index = sample_indices(x, y, w)
            column, row = to_float(index - np.int32(y * w)), np.float32(y)
            mx, my = back_to_shaded(motion, previous_motion, index, column, row, w, h, n)
            px = reproject(column + mx, n[JITTER], n[SHADED_JITTER], np.float32(w), n[SHADED_W])
            py = reproject(my + row, n[JITTER + 1], n[SHADED_JITTER + 1], np.float32(h), n[SHADED_H])
            px, py = clamped(px, 0.0, n[SHADED_W] - 1.0), clamped(py, 0.0, n[SHADED_H] - 1.0)
            valid = spread16(n[HAS_DEPTH]) > 0.0
            own, reflectance = guides_at(base, normal, depth, index, 3, 1, valid, n)
            nearest = nearest_four(
                own, samples, size, shaded_w, shaded_h, stride, px, py, across, down, strides, rings.rings,
                n[C.distance_sigma], index_scratch,
            )  # fmt: skip
            light = mean_light(nearest, samples, size)
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
