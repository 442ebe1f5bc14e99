"""Device functions that reproject: they resample the history at the previous positions of pixels."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import clamped
from supersampler.backends.cpu.layout import PAD
from supersampler.backends.cpu.simd.shuffles import joined, low_half
from supersampler.backends.cpu.simd.vector import (
    absolute,
    device_function,
    floor,
    load4,
    load8,
    maximum,
    minimum,
    prefetch,
    select,
    store,
    to_int,
)


@device_function
def cubic(t, sharpness):
    """Return the weights of four samples of a cubic; t: distance from the second sample, [0, 1)."""
    s = 1.0 - t
    before, after = t * s * s * -sharpness, s * t * t * -sharpness
    second = ((t * (sharpness - 2.0) + (3.0 - 2.0 * sharpness)) * t + sharpness) * t
    return before, 1.0 - before - after - second, second, after


@device_function
def store_offsets(position, first, last, count, pitch, offsets, slot):
    """Store the offsets of samples floor(position) + first to floor(position) + last; return the fraction.

    count: samples of the axis, which bound the offsets; pitch: values from sample to sample; slot: index of
    the first sixteen offsets.
    """
    whole = floor(position)
    i = to_int(whole)
    for k in range(first, last + 1):
        inside = minimum(maximum(i + np.int32(k), np.int32(0)), np.int32(count - 1))
        store(offsets, 16 * (slot + k - first), inside * np.int32(pitch))
    return position - whole


@device_function
def prepare_warp(px, py, width, height, pitch, sharpness, offsets, weights):
    """Store the offsets and weights with which sixteen pixels resample the history.

    px, py: previous positions; pitch: values per pixel; offsets (8, 16): four columns, then four rows;
    weights (10, 16): of a bicubic filter without corners, columns then rows; then fractions for a linear one.
    """
    tx = store_offsets(px, -1, 2, width, pitch, offsets, 0)
    ty = store_offsets(py, -1, 2, height, pitch * width, offsets, 4)
    x0, x1, x2, x3 = cubic(tx, sharpness)
    y0, y1, y2, y3 = cubic(ty, sharpness)
    middle, sides = x1 + x2, y1 + y2
    scale = 1.0 / (middle * sides + (x0 + x3) * sides + middle * (y0 + y3))  # without the corners
    for slot, weight in enumerate((x0, x1, x2, x3, y0 * scale, y1 * scale, y2 * scale, y3 * scale, tx, ty)):
        store(weights, 16 * slot, weight)


@device_function
def prepare_own_warp(px, py, width, height, pitch, offsets, weights):
    """Store the same for linear filters at the positions of the pixels' own motion, after `prepare_warp`."""
    store(weights, 160, store_offsets(px, 0, 1, width, pitch, offsets, 8))
    store(weights, 176, store_offsets(py, 0, 1, height, pitch * width, offsets, 10))


@device_function
def cubic4(h, offsets, weights, i):
    """Resample four values for pixel `i` with the bicubic filter."""
    a, b, c, d = offsets[i], offsets[16 + i], offsets[32 + i], offsets[48 + i]
    j, k, m, n = offsets[64 + i], offsets[80 + i], offsets[96 + i], offsets[112 + i]
    x0, x1, x2, x3 = weights[i], weights[16 + i], weights[32 + i], weights[48 + i]
    top = load4(h, j + b) * x1 + load4(h, j + c) * x2
    upper = load4(h, k + a) * x0 + load4(h, k + b) * x1 + load4(h, k + c) * x2 + load4(h, k + d) * x3
    lower = load4(h, m + a) * x0 + load4(h, m + b) * x1 + load4(h, m + c) * x2 + load4(h, m + d) * x3
    bottom = load4(h, n + b) * x1 + load4(h, n + c) * x2
    sharp = top * weights[64 + i] + upper * weights[80 + i] + lower * weights[96 + i]
    return sharp + bottom * weights[112 + i]


@device_function
def linear4(h, a, b, c, d, t, u):
    """Interpolate four values linearly between offsets: upper left and right, lower left and right."""
    one = np.float32(1.0)
    upper = load4(h, a) * (one - t) + load4(h, b) * t
    lower = load4(h, c) * (one - t) + load4(h, d) * t
    return upper * (one - u) + lower * u


@device_function
def warp(history, offsets, weights, same_motion, out):
    """Resample sixteen pixels to (16, 16): eight values linear; four bicubic; four by their own motion.

    history (H, W, 8). The last four are linear, or bicubic where `same_motion`: own equals dilated motion.
    """
    h = history
    one = np.float32(1.0)
    after = offsets[63] + offsets[127] + 8 * 16  # lower right samples of the pixels that follow in two steps
    for i in range(16):
        prefetch(h, after + 8 * i)
        a, b, c, d = offsets[i], offsets[16 + i], offsets[32 + i], offsets[48 + i]
        j, k, m, n = offsets[64 + i], offsets[80 + i], offsets[96 + i], offsets[112 + i]
        t, u = weights[128 + i], weights[144 + i]
        x0, x1, x2, x3 = weights[i], weights[16 + i], weights[32 + i], weights[48 + i]
        top = load4(h, j + b) * x1 + load4(h, j + c) * x2
        ka, kb, kc, kd = load4(h, k + a), load8(h, k + b), load8(h, k + c), load4(h, k + d)
        upper = ka * x0 + low_half(kb) * x1 + low_half(kc) * x2 + kd * x3
        ma, mb, mc, md = load4(h, m + a), load8(h, m + b), load8(h, m + c), load4(h, m + d)
        lower = ma * x0 + low_half(mb) * x1 + low_half(mc) * x2 + md * x3
        bottom = load4(h, n + b) * x1 + load4(h, n + c) * x2
        sharp = top * weights[64 + i] + upper * weights[80 + i] + lower * weights[96 + i]
        sharp = sharp + bottom * weights[112 + i]
        upper8 = kb * (one - t) + kc * t
        lower8 = mb * (one - t) + mc * t
        linear = upper8 * (one - u) + lower8 * u
        own = sharp
        if not same_motion:
            a, b, j, k = offsets[128 + i], offsets[144 + i], offsets[160 + i], offsets[176 + i]
            own = linear4(h, j + a, j + b, k + a, k + b, weights[160 + i], weights[176 + i])
        store(out, 16 * i, joined(linear, joined(sharp, own)))


@device_function
def warp5(history, offsets, weights, out):
    """Resample sixteen pixels of five values to (16, 8): the first four bicubic; the last four linear."""
    h = history
    for i in range(16):
        store(out, 8 * i, cubic4(h, offsets, weights, i))
        b, c, k, m = offsets[16 + i] + 1, offsets[32 + i] + 1, offsets[80 + i], offsets[96 + i]
        linear = linear4(h, k + b, k + c, m + b, m + c, weights[128 + i], weights[144 + i])
        store(out, 8 * i + 4, linear)


@device_function
def on_screen(px, py, width, height):
    """Return where previous positions are on screen."""
    return (px > -0.5) & (px < width - 0.5) & (py > -0.5) & (py < height - 0.5)


@device_function
def previous_position(lane, y, mx, my, width, height):
    """Return the previous positions of sixteen pixels, clamped to two pixels around the screen."""
    return clamped(lane + mx, -2.0, width + 1.0), clamped(my + np.float32(y), -2.0, height + 1.0)


@device_function
def linear_taps(x, y, w, h, padded_width, places):
    """Store the offsets of samples around positions in the previous frame; return the weights of all four.

    places (2, 16): the upper left and the lower left sample in a plane with rows of `padded_width` samples.
    """
    fx, fy = floor(x), floor(y)
    tx, ty = x - fx, y - fy
    left = minimum(maximum(to_int(fx), np.int32(1 - PAD)), np.int32(w + PAD - 2)) + np.int32(PAD)
    top = to_int(fy)
    upper = minimum(maximum(top, np.int32(0)), np.int32(h - 1)) * np.int32(padded_width)
    lower = minimum(maximum(top + np.int32(1), np.int32(0)), np.int32(h - 1)) * np.int32(padded_width)
    store(places, 0, upper + left)
    store(places, 16, lower + left)
    sx, sy = 1.0 - tx, 1.0 - ty
    return sx * sy, tx * sy, sx * ty, tx * ty


@device_function
def occlusion(depth, weights, depths_before, margin, ramp):
    """Return `occlusion` of the torch methods: depths_before are four values of `occluding_depth`."""
    occluded = left = depth * 0.0
    for value, weight in zip(depths_before, weights):  # noqa: B905  # numba has no strict
        before = absolute(value)
        closer = (before - depth) / maximum(maximum(before, depth), 1e-12)
        closer = clamped((closer - margin) / ramp, 0.0, 1.0)
        occluded = occluded + weight * closer
        left = select(value < 0.0, maximum(left, closer), left)
    return select(depth >= 0.0, maximum(occluded, left), 0.0)


@device_function
def mean_of(values, weights):
    """Return the weighted sum of four values."""
    upper = values[0] * weights[0] + values[1] * weights[1]
    return upper + values[2] * weights[2] + values[3] * weights[3]
