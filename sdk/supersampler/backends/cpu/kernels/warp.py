"""Reprojection: device functions that resample the history where motion leads."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import clamped
from supersampler.backends.cpu.layout import PAD
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import joined, low_half
from supersampler.backends.cpu.simd.vector import (
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
    """Weights of the four samples around a place between the middle two."""
    s = 1.0 - t
    before, after = t * s * s * -sharpness, s * t * t * -sharpness
    second = ((t * (sharpness - 2.0) + (3.0 - 2.0 * sharpness)) * t + sharpness) * t
    return before, 1.0 - before - after - second, second, after


@device_function
def place(position, first, last, count, pitch, at, slot):
    """Put the offsets of the samples `first` to `last` beside floor(position) into slots; return the rest."""
    whole = floor(position)
    i = to_int(whole)
    for k in range(first, last + 1):
        inside = minimum(maximum(i + np.int32(k), np.int32(0)), np.int32(count - 1))
        store(at, 16 * (slot + k - first), inside * np.int32(pitch))
    return position - whole


@device_function
def aim(px, py, width, height, pitch, sharpness, at, weights):
    """Offsets and weights of sixteen warps: ten slots of sixteen, read back pixel by pixel.

    at: of four columns and four rows, of images of `pitch` values a pixel; weights: of a cubic without its
    corners, and what is left of the place for a linear warp.
    """
    tx = place(px, -1, 2, width, pitch, at, 0)
    ty = place(py, -1, 2, height, pitch * width, at, 4)
    x0, x1, x2, x3 = cubic(tx, sharpness)
    y0, y1, y2, y3 = cubic(ty, sharpness)
    middle, sides = x1 + x2, y1 + y2
    scale = 1.0 / (middle * sides + (x0 + x3) * sides + middle * (y0 + y3))  # without the corners
    for slot, weight in enumerate((x0, x1, x2, x3, y0 * scale, y1 * scale, y2 * scale, y3 * scale, tx, ty)):
        store(weights, 16 * slot, weight)


@device_function
def aim_own(px, py, width, height, pitch, at, weights):
    """The same of linear warps alone, in the slots after those of `aim`."""
    store(weights, 160, place(px, 0, 1, width, pitch, at, 8))
    store(weights, 176, place(py, 0, 1, height, pitch * width, at, 10))


@device_function
def cubic4(h, at, weights, i):
    """Four values of the pixel `i` by a cubic."""
    a, b, c, d = at[i], at[16 + i], at[32 + i], at[48 + i]
    j, k, m, n = at[64 + i], at[80 + i], at[96 + i], at[112 + i]
    x0, x1, x2, x3 = weights[i], weights[16 + i], weights[32 + i], weights[48 + i]
    top = load4(h, j + b) * x1 + load4(h, j + c) * x2
    upper = load4(h, k + a) * x0 + load4(h, k + b) * x1 + load4(h, k + c) * x2 + load4(h, k + d) * x3
    lower = load4(h, m + a) * x0 + load4(h, m + b) * x1 + load4(h, m + c) * x2 + load4(h, m + d) * x3
    bottom = load4(h, n + b) * x1 + load4(h, n + c) * x2
    sharp = top * weights[64 + i] + upper * weights[80 + i] + lower * weights[96 + i]
    return sharp + bottom * weights[112 + i]


@device_function
def linear4(h, a, b, c, d, t, u):
    """Four values between four places: upper left and right, lower left and right."""
    one = np.float32(1.0)
    upper = load4(h, a) * (one - t) + load4(h, b) * t
    lower = load4(h, c) * (one - t) + load4(h, d) * t
    return upper * (one - u) + lower * u


@device_function
def warp(history, at, weights, alone, out):
    """Resample sixteen pixels of the history, (16, 16): linear; color by a cubic; color by own motion.

    history (H, W, 8). `alone`: the pixels' own motion leads to the same places, so it is left out.
    """
    h = history
    one = np.float32(1.0)
    after = at[63] + at[127] + 8 * 16  # lower right of the sixteen pixels after the next: rows from afar
    for i in range(16):
        prefetch(h, after + 8 * i)
        a, b, c, d = at[i], at[16 + i], at[32 + i], at[48 + i]
        j, k, m, n = at[64 + i], at[80 + i], at[96 + i], at[112 + i]
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
        soft = upper8 * (one - u) + lower8 * u
        own = sharp
        if not alone:
            a, b, j, k = at[128 + i], at[144 + i], at[160 + i], at[176 + i]
            own = linear4(h, j + a, j + b, k + a, k + b, weights[160 + i], weights[176 + i])
        store(out, 16 * i, joined(soft, joined(sharp, own)))


@device_function
def warp5(history, at, weights, out):
    """Resample sixteen pixels of five values, (16, 8): the first four by a cubic; the last four, linear."""
    h = history
    for i in range(16):
        store(out, 8 * i, cubic4(h, at, weights, i))
        b, c, k, m = at[16 + i] + 1, at[32 + i] + 1, at[80 + i], at[96 + i]
        soft = linear4(h, k + b, k + c, m + b, m + c, weights[128 + i], weights[144 + i])
        store(out, 8 * i + 4, soft)


@device_function
def on_screen(px, py, width, height):
    """Whether the place in the previous frame is on screen."""
    return (px > -0.5) & (px < width - 0.5) & (py > -0.5) & (py < height - 0.5)


@device_function
def followed(lane, y, mx, my, width, height):
    """Places of sixteen pixels in the previous frame, kept within two pixels of the screen."""
    return clamped(lane + mx, -2.0, width + 1.0), clamped(my + np.float32(y), -2.0, height + 1.0)


@device_function
def around(x, y, w, h, wide, places):
    """Return the four samples around places in the previous frame, and their weights.

    places (2, 16): of the upper and the lower left one, in a plane of rows of PAD, w and at least PAD
    samples, `wide` from row to row, whose ends repeat the border.
    """
    fx, fy = floor(x), floor(y)
    tx, ty = x - fx, y - fy
    left = minimum(maximum(to_int(fx), np.int32(1 - PAD)), np.int32(w + PAD - 2)) + np.int32(PAD)
    top = to_int(fy)
    upper = minimum(maximum(top, np.int32(0)), np.int32(h - 1)) * np.int32(wide)
    lower = minimum(maximum(top + np.int32(1), np.int32(0)), np.int32(h - 1)) * np.int32(wide)
    store(places, 0, upper + left)
    store(places, 16, lower + left)
    sx, sy = 1.0 - tx, 1.0 - ty
    return sx * sy, tx * sy, sx * ty, tx * ty


@device_function
def disoccluded(depth, weights, befores, margin, ramp):
    """Weight of the four samples of the previous frame that were closer than `depth`: the disocclusion."""
    share = depth * 0.0
    for before, weight in zip(befores, weights):  # noqa: B905  # numba has no strict
        closer = (before - depth) / maximum(maximum(before, depth), 1e-12)
        share = share + weight * clamped((closer - margin) / ramp, 0.0, 1.0)
    return select(depth >= 0.0, share, 0.0)


@device_function
def mean_of(values, weights):
    """Linear interpolation."""
    upper = values[0] * weights[0] + values[1] * weights[1]
    return upper + values[2] * weights[2] + values[3] * weights[3]
