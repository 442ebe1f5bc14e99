"""Kernels of `guided-warp`; same as `supersampler_model.methods.guided_warp`.

Device functions compute sixteen pixels of a row at once. Where these lead to neighbouring samples of the
shaded frame, which is the usual case, one load reads the samples of all sixteen.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    clamped,
    exponential,
    logarithm,
    sanitize,
    select3,
    usable,
)
from supersampler.backends.cpu.kernels.frame import motion_at, sample_indices
from supersampler.backends.cpu.layout import GUIDE_PLANES
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    device_function,
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
from supersampler.io.display import MAX_HALF
from supersampler.methods.constants import DARKNESS, FINITE_MOTION, MAX_DEPTH, MAX_MOTION, MIN_NORMAL
from supersampler.methods.extrapolation.spec import (
    GUIDED_WARP,
    INVALID_DEPTH,
    KEY_INDICES,
    KEY_STEPS,
    MAX_KEY,
    SKY_DEPTH,
)
from supersampler.methods.extrapolation.structs import ExtrapolationOutput, Rings, UnshadedFrame
from supersampler.methods.spec import constant_indices

C = constant_indices(GUIDED_WARP)
(
    SHADED_W, SHADED_H, PREVIOUS_W, PREVIOUS_H, JITTER, _, SHADED_JITTER, _, PREVIOUS_JITTER, _,
    HAS_PREVIOUS_MOTION, HAS_DEPTH,
) = range(len(C), len(C) + 12)  # fmt: skip
"""Indices into `numbers`, after the constants of `guided-warp`.

Sizes and jitters (x, then y) of the shaded and the previous frame. HAS_PREVIOUS_MOTION: 0 where the motion of
the previous frame is all zeros. HAS_DEPTH: 0 where the shaded frame has no valid depth.
"""
MARGIN = 1.0 - 1e-3  # against rounding, where a ring is skipped because all of its samples are too far away


@device_function
def is_usable(value):
    return absolute(value) <= MAX_HALF


@device_function
def are_usable(a, b, c):
    return is_usable(a) & is_usable(b) & is_usable(c)


@device_function
def sanitized(value, low):
    """Replace unusable values by 0, clamp others to [low, 1]."""
    return select(is_usable(value), clamped(value, low, 1.0), 0.0)


@device_function
def gather3(image, index, sample_pitch, channel_pitch):
    """Read three channels of sixteen samples; pitches: values from sample to sample, channel to channel."""
    first = index * np.int32(sample_pitch)
    second, third = first + np.int32(channel_pitch), first + np.int32(2 * channel_pitch)
    return gather(image, first), gather(image, second), gather(image, third)


@device_function
def reflectance_of(base, normal, least):
    """Return the divisor of each colour channel; 1 at the sky, where the normal is 0."""
    sky = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] < MIN_NORMAL
    one = 1.0, 1.0, 1.0
    return select3(sky, one, (base[0] + least, base[1] + least, base[2] + least))


@device_function
def guides_at(base, normal, depth, index, sample_pitch, channel_pitch, valid, numbers):
    """Return the guides of sixteen surfaces, in standard deviations, and their reflectance; valid: a mask."""
    b = gather3(base, index, sample_pitch, channel_pitch)
    n = gather3(normal, index, sample_pitch, channel_pitch)
    d = gather(depth, index)
    valid = (
        valid & are_usable(b[0], b[1], b[2]) & are_usable(n[0], n[1], n[2]) & (d >= 0.0) & (d <= MAX_DEPTH)
    )
    b = sanitized(b[0], 0.0), sanitized(b[1], 0.0), sanitized(b[2], 0.0)
    n = sanitized(n[0], -1.0), sanitized(n[1], -1.0), sanitized(n[2], -1.0)
    log_depth = select(valid, logarithm(maximum(d, SKY_DEPTH)) / numbers[C.depth_sigma], INVALID_DEPTH)
    s = numbers[C.surface_sigma]
    guides = (b[0] / s, b[1] / s, b[2] / s, n[0] / s, n[1] / s, n[2] / s, log_depth)
    return guides, reflectance_of(b, n, numbers[C.least])


def read_shaded(
    color: Floats, base: Floats, normal: Floats, depth: Floats, numbers: Floats, w: int, h: int, stride: int,
    y0: int, y1: int, samples: Floats,
):  # fmt: skip
    """Write rows y0 to y1 of the samples of a shaded frame, (SHADED_PLANES, h, stride): guides, then light.

    color, base, normal, depth: planes (channels, h, w).
    """
    size = h * stride
    for y in range(y0, y1):
        for x in range(0, w, 16):
            index, to = sample_indices(x, y, w), y * stride + x
            r, g, b = gather3(color, index, 1, w * h)
            guides, reflectance = guides_at(base, normal, depth, index, 1, w * h, usable(r, g, b), numbers)
            for c, value in enumerate(guides):
                store(samples, c * size + to, value)
            store(samples, GUIDE_PLANES * size + to, sanitize(r) / reflectance[0])
            store(samples, (GUIDE_PLANES + 1) * size + to, sanitize(g) / reflectance[1])
            store(samples, (GUIDE_PLANES + 2) * size + to, sanitize(b) / reflectance[2])


@device_function
def reproject(position, jitter, other_jitter, size, other_size):
    """Convert a position to samples of another frame; 0 is the first sample."""
    half = np.float32(0.5)
    return (position + (jitter + half)) * other_size / size - (other_jitter + half)


@device_function
def sanitized_motion(plane, index):
    """Return the sanitized motion of sixteen samples on one axis."""
    value = gather(plane, index)
    return select(absolute(value) <= FINITE_MOTION, clamped(value, -MAX_MOTION, MAX_MOTION), 0.0)


@device_function
def interpolated_motion(plane, first, x, y, w, h):
    """Interpolate the motion of a plane (h, w), which begins at `first`, linearly; clamped to the border."""
    x, y = clamped(x, 0.0, np.float32(w - 1)), clamped(y, 0.0, np.float32(h - 1))
    left, top = floor(x), floor(y)
    s, t = x - left, y - top
    column, row = to_int(left), to_int(top)
    right, start = minimum(column + np.int32(1), np.int32(w - 1)), np.int32(first)
    here, below = row * np.int32(w) + start, minimum(row + np.int32(1), np.int32(h - 1)) * np.int32(w) + start
    upper = sanitized_motion(plane, here + column) * (1.0 - s) + sanitized_motion(plane, here + right) * s
    lower = sanitized_motion(plane, below + column) * (1.0 - s) + sanitized_motion(plane, below + right) * s
    return upper * (1.0 - t) + lower * t


@device_function
def motion_to_shaded(motion, previous_motion, index, column, row, w, h, n):
    """Return the motion of sixteen pixels to the shaded frame: their own, plus that of the previous frame."""
    float_w, float_h = np.float32(w), np.float32(h)
    mx, my = motion_at(motion, index)
    if n[HAS_PREVIOUS_MOTION] == 0.0:
        return mx, my
    x = reproject(column + mx, n[JITTER], n[PREVIOUS_JITTER], float_w, n[PREVIOUS_W])
    y = reproject(my + row, n[JITTER + 1], n[PREVIOUS_JITTER + 1], float_h, n[PREVIOUS_H])
    previous_w, previous_h = int(n[PREVIOUS_W]), int(n[PREVIOUS_H])
    plane = previous_w * previous_h
    dx = interpolated_motion(previous_motion, 0, x, y, previous_w, previous_h) * float_w / n[PREVIOUS_W]
    dy = interpolated_motion(previous_motion, plane, x, y, previous_w, previous_h) * float_h / n[PREVIOUS_H]
    return clamped(mx + dx, -MAX_MOTION, MAX_MOTION), clamped(my + dy, -MAX_MOTION, MAX_MOTION)


@device_function
def load_samples(samples, c, size, index, first, adjacent):
    """Read plane `c` at sixteen samples; `adjacent`: they follow each other from `first` on."""
    return load16(samples, c * size + first) if adjacent else gather(samples, index + np.int32(c * size))


@device_function
def squared(value):
    return value * value


@device_function
def squared_distance(guides, samples, size, index, first, adjacent):
    """Return the squared distance between sixteen surfaces and sixteen samples, over all guides."""
    total = squared(guides[0] - load_samples(samples, 0, size, index, first, adjacent))
    for c in range(1, GUIDE_PLANES):
        total = total + squared(guides[c] - load_samples(samples, c, size, index, first, adjacent))
    return total


@device_function
def clamped_index(position, count):
    """Return the column or row of a position, clamped to the frame."""
    return to_int(clamped(position, 0.0, np.float32(count - 1)))


@device_function
def sorted_pair(first, second):
    """Return two candidates in the order of their keys; see `nearest_four`."""
    swap = second[0] < first[0]
    return select3(swap, second, first), select3(swap, first, second)


@device_function
def insert_sorted(nearest, candidate):
    """Return the four nearest of four sorted candidates and another one, sorted."""
    a, candidate = sorted_pair(nearest[0], candidate)
    b, candidate = sorted_pair(nearest[1], candidate)
    c, candidate = sorted_pair(nearest[2], candidate)
    d, candidate = sorted_pair(nearest[3], candidate)
    return a, b, c, d


@device_function
def sort_key(distance, tap):
    """Return a key that orders candidates by quantized distance, then by the number of the tap."""
    return minimum(floor(distance * KEY_STEPS), MAX_KEY) * KEY_INDICES + tap


@device_function
def nearest_four(guides, samples, size, w, h, stride, x, y, across, down, strides, rings, sigma, lanes):
    """Return the four samples around each of sixteen positions whose surfaces and positions are nearest.

    A candidate is a key, a distance (-log of the weight) and a sample index. Rings that are too far away for
    any surface are skipped. lanes: scratch, to read the first lane of a vector.
    """
    left, top = floor(x + 0.5), floor(y + 0.5)
    center = to_int(top) * np.int32(stride) + to_int(left)
    store(lanes, 0, center)
    first = lanes[0]
    row, column, reach = first // stride, first % stride, strides[rings - 1]
    adjacent = (
        all_lanes(center == ramp16() + np.int32(first))
        and row >= reach and row < h - reach and column >= reach and column + 15 < w - reach
    )  # fmt: skip
    to_center = maximum(absolute(left - x), absolute(top - y))
    infinite = spread16(np.float32(FINITE_MOTION))
    none = infinite, infinite, center
    nearest = none, none, none, none
    for ring in range(rings):
        if ring:
            gap = (to_center * -1.0 + np.float32(strides[ring])) / sigma
            least_key = floor(squared(gap) * (0.5 * MARGIN * KEY_STEPS)) * KEY_INDICES
            if all_lanes(least_key >= nearest[3][0]):
                break
        for k in range(8 * ring + 1 if ring else 0, 8 * ring + 9):
            u, v = left + across[k], top + down[k]
            step = int(down[k]) * stride + int(across[k])
            if adjacent:
                index = center + np.int32(step)
            else:
                index = clamped_index(v, h) * np.int32(stride) + clamped_index(u, w)
            distance = squared_distance(guides, samples, size, index, first + step, adjacent)
            u, v = (u - x) / sigma, (v - y) / sigma
            distance = (distance + (u * u + v * v)) * 0.5
            nearest = insert_sorted(nearest, (sort_key(distance, np.float32(k)), distance, index))
    return nearest


@device_function
def mean_light(nearest, samples, size):
    """Return the weighted mean light of four samples."""
    p, q, r, s = nearest[0][1], nearest[1][1], nearest[2][1], nearest[3][1]
    least = minimum(minimum(minimum(p, q), r), s)
    weights = exponential(least - p), exponential(least - q), exponential(least - r), exponential(least - s)
    total = weights[0] + weights[1] + weights[2] + weights[3]
    index = nearest[0][2], nearest[1][2], nearest[2][2], nearest[3][2]
    return (
        weighted_sum(samples, GUIDE_PLANES * size, index, weights) / total,
        weighted_sum(samples, (GUIDE_PLANES + 1) * size, index, weights) / total,
        weighted_sum(samples, (GUIDE_PLANES + 2) * size, index, weights) / total,
    )


@device_function
def weighted_sum(samples, plane, index, weights):
    """Return the weighted sum of four samples of the plane that begins at `plane`."""
    i, w, start = index, weights, np.int32(plane)
    total = gather(samples, i[0] + start) * w[0] + gather(samples, i[1] + start) * w[1]
    return total + gather(samples, i[2] + start) * w[2] + gather(samples, i[3] + start) * w[3]


@device_function
def shaded_color(light, reflectance):
    """Return a colour channel, bounded to what a history can hold."""
    value = minimum(light * reflectance, MAX_HALF)
    return select(value >= DARKNESS, value, 0.0)


def extrapolate_rows(
    frame: UnshadedFrame, previous_motion: Floats, samples: Floats, numbers: Floats, rings: Rings,
    lanes: Words, line: Floats, output: ExtrapolationOutput, y0: int, y1: int,
):  # fmt: skip
    """Compute rows y0 to y1 of the image of an unshaded frame, and its motion to the shaded frame.

    previous_motion: planes (2, height, width) of the previous frame; samples: by `read_shaded`; lanes, line:
    scratch of a thread.
    """
    base, normal, depth, motion = frame.base_color, frame.normal, frame.depth, frame.motion
    w, h, stride = frame.width, frame.height, frame.samples_stride
    across, down, strides = rings.x, rings.y, rings.strides
    next_motion, image, n = output.motion, output.image, numbers
    shaded_w, shaded_h = int(n[SHADED_W]), int(n[SHADED_H])
    size, pixels = shaded_h * stride, w * h
    for y in range(y0, y1):
        for x in range(0, w, 16):
            index = sample_indices(x, y, w)
            column, row = to_float(index - np.int32(y * w)), np.float32(y)
            mx, my = motion_to_shaded(motion, previous_motion, index, column, row, w, h, n)
            px = reproject(column + mx, n[JITTER], n[SHADED_JITTER], np.float32(w), n[SHADED_W])
            py = reproject(my + row, n[JITTER + 1], n[SHADED_JITTER + 1], np.float32(h), n[SHADED_H])
            px, py = clamped(px, 0.0, n[SHADED_W] - 1.0), clamped(py, 0.0, n[SHADED_H] - 1.0)
            valid = spread16(n[HAS_DEPTH]) > 0.0
            guides, reflectance = guides_at(base, normal, depth, index, 3, 1, valid, n)
            nearest = nearest_four(
                guides, samples, size, shaded_w, shaded_h, stride, px, py, across, down, strides,
                rings.rings, n[C.distance_sigma], lanes,
            )  # fmt: skip
            light = mean_light(nearest, samples, size)
            r, g = shaded_color(light[0], reflectance[0]), shaded_color(light[1], reflectance[1])
            b = shaded_color(light[2], reflectance[2])
            for c, value in enumerate((mx, my, r, g, b)):
                store(line, 16 * c, value)
            for i in range(min(16, w - x)):
                to = y * w + x + i
                next_motion[to], next_motion[pixels + to] = line[i], line[16 + i]
                for c in range(3):
                    image[3 * to + c] = line[16 * (2 + c) + i]
