"""Guided colour of the variant `guided`; same as supersampler_model.methods.gbuffer_fast.

Light of this frame is resampled at display pixels by the agreement of surfaces. A vector holds one channel of
sixteen pixels.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import clamped, exponential, largest, sanitize, toned
from supersampler.backends.cpu.kernels.filters import add_tap, places_in
from supersampler.backends.cpu.kernels.frame import (
    color_at,
    filled_at,
    repeat_ends,
    sample_indices,
    usable_depth,
)
from supersampler.backends.cpu.layout import PAD, SAMPLE_PLANES, SURFACE_PLANES
from supersampler.backends.cpu.simd.shuffles import load_columns4
from supersampler.backends.cpu.simd.vector import (
    absolute,
    device_function,
    gather,
    gather_nearby,
    load4,
    load16,
    maximum,
    minimum,
    select,
    spread16,
    store,
    to_float,
    to_int,
)
from supersampler.backends.cpu.structs import Floats, FrameInputs
from supersampler.io.display import MAX_HALF
from supersampler.methods.classifier.structs import Guide
from supersampler.methods.constants import MAX_DEPTH, MAX_TONED, MIN_NORMAL
from supersampler.methods.gbuffer.spec import STEP_COST
from supersampler.methods.gbuffer_fast.spec import MAX_DEPTH_COST, MIN_SIMILARITY

USABLE = 3
"""Plane of the samples' colours: 1 where usable."""


@device_function
def in_range(values, least):
    """Return values in [least, 1]; others, and NaN, become 0."""
    return select((values >= least) & (values <= 1.0), values, 0.0)


@device_function
def surface_at(base_color, normal, index):
    """Return sanitized base colour and normal of sixteen pixels."""
    r, g, b = color_at(base_color, index)
    x, y, z = color_at(normal, index)
    color = in_range(r, 0.0), in_range(g, 0.0), in_range(b, 0.0)
    return color, (in_range(x, -1.0), in_range(y, -1.0), in_range(z, -1.0))


@device_function
def reflectance(color, normal, least):
    """Return the reflectance of surfaces; 1 at the sky, which has no normal."""
    x, y, z = normal
    sky, scale = x * x + y * y + z * z < MIN_NORMAL, 1.0 - least
    r, g, b = color[0] * scale + least, color[1] * scale + least, color[2] * scale + least
    return select(sky, 1.0, r), select(sky, 1.0, g), select(sky, 1.0, b)


def prepare_surfaces(
    frame: FrameInputs, base_color: Floats, normal: Floats, guide: Guide, w: int, padded_width: int,
    y0: int, y1: int,
):  # fmt: skip
    """Write rows y0 to y1 of `guide.samples`: light and features of the samples of a frame.

    base_color, normal: (h, w, 3) of the frame.
    """
    planes, exposure = guide.samples, frame.exposure
    of_normal, of_color = guide.normal_scale, guide.color_scale
    for y in range(y0, y1):
        for x in range(0, w, 16):
            index = sample_indices(x, y, w)
            (r, g, b), _ = filled_at(frame, x, y, index)
            base, facing = surface_at(base_color, normal, index)
            i, j, k = reflectance(base, facing, guide.min_reflectance)
            light = toned(r * exposure / i, g * exposure / j, b * exposure / k)
            facing = facing[0] * of_normal, facing[1] * of_normal, facing[2] * of_normal
            base = base[0] * of_color, base[1] * of_color, base[2] * of_color
            to = SURFACE_PLANES * y * padded_width + PAD + x
            for c, value in enumerate((*light, *facing, *base)):
                store(planes, to + c * padded_width, value)
        for c in range(SURFACE_PLANES):
            repeat_ends(planes, (SURFACE_PLANES * y + c) * padded_width + PAD, w)


def prepare_depth(depth: Floats, w: int, pitch: int, y0: int, y1: int, out: Floats):
    """Write rows y0 to y1 of sanitized depth, (h, w), to rows of PAD + pitch + PAD."""
    for y in range(y0, y1):
        to = y * (pitch + 2 * PAD) + PAD
        for x in range(0, w, 16):
            d = gather(depth, sample_indices(x, y, w))
            store(out, to + x, usable_depth(d))
        repeat_ends(out, to, w)


@device_function
def edge_at(depth, y, x, height, padded_width):
    """Return the relative range of depth in 3x3 pixels; same as `edge_of`."""
    closest = farthest = load16(depth, y * padded_width + PAD + x)
    for line in range(-1, 2):
        row = min(max(y + line, 0), height - 1) * padded_width + PAD + x
        for column in range(-1, 2):
            d = load16(depth, row + column)
            closest, farthest = maximum(d, closest), minimum(d, farthest)
    return clamped((closest - maximum(farthest, 0.0)) / maximum(closest, 1e-12), 0.0, 1.0)


@device_function
def squared_difference(plane, at, step, index, target):
    """Return the squared difference of a plane at a sample of each pixel to its target."""
    apart = gather_nearby(plane, at, step, index) - target
    return apart * apart


@device_function
def guide_pixels(samples, guide, tables, y, x, width, base, facing, depth):
    """Return light of sixteen pixels, agreement, where a sample is usable, and the surface's motion.

    base, facing, depth: base colour, normal and depth of the pixels' surfaces.
    """
    colors, planes, height = samples.color, guide.samples, samples.height
    padded_width = samples.stride + 2 * PAD
    across, down, near = tables.column_windows, tables.row_windows, tables.nearest_row[y]
    first, step, index = places_in(tables.nearest_column, x)
    of_normal, of_color = guide.normal_scale, guide.color_scale
    nx, ny, nz = facing[0] * of_normal, facing[1] * of_normal, facing[2] * of_normal
    br, bg, bb = base[0] * of_color, base[1] * of_color, base[2] * of_color
    zero = spread16(np.float32(0.0))
    r = g = b = total = similar = known = move_x = move_y = zero
    least = zero + np.float32(MAX_DEPTH)
    for k in range(9):
        line, column = k // 3 - 1, k % 3 - 1
        row = min(max(near + line, 0), height - 1)
        at = row * padded_width + PAD + first + column
        surface = SURFACE_PLANES * row * padded_width + PAD + first + column
        usable = SAMPLE_PLANES * row * padded_width + PAD + first + column + USABLE * padded_width
        d = gather_nearby(samples.depth, at, step, index)
        apart = absolute(d - depth) / maximum(maximum(d, depth), 1e-12)
        f = surface + 3 * padded_width
        exponent = squared_difference(planes, f, step, index, nx)
        exponent = exponent + squared_difference(planes, f + padded_width, step, index, ny)
        exponent = exponent + squared_difference(planes, f + 2 * padded_width, step, index, nz)
        exponent = exponent + squared_difference(planes, f + 3 * padded_width, step, index, br)
        exponent = exponent + squared_difference(planes, f + 4 * padded_width, step, index, bg)
        exponent = exponent + squared_difference(planes, f + 5 * padded_width, step, index, bb)
        exponent = exponent + minimum(apart * apart * guide.depth_scale, MAX_DEPTH_COST)
        similarity = exponential(zero - exponent)
        distance = load16(across, (k % 3) * width + x) * down[3 * y + k // 3] + MIN_SIMILARITY
        distance = distance * gather_nearby(colors, usable, step, index)
        weight = distance * (similarity + MIN_SIMILARITY)
        r = add_tap(planes, surface, step, index, weight, r)
        g = add_tap(planes, surface + padded_width, step, index, weight, g)
        b = add_tap(planes, surface + 2 * padded_width, step, index, weight, b)
        total, similar, known = total + weight, similar + distance * similarity, known + distance
        cost = apart + STEP_COST * np.float32(line * line + column * column)
        better = cost < least
        least = select(better, cost, least)
        move_x = select(better, gather_nearby(samples.motion_x, at, step, index), move_x)
        move_y = select(better, gather_nearby(samples.motion_y, at, step, index), move_y)
    scale, found = 1.0 / maximum(total, 1e-9), total > 0.0
    center = SURFACE_PLANES * near * padded_width + PAD + first
    light = (
        select(found, r * scale, gather_nearby(planes, center, step, index)),
        select(found, g * scale, gather_nearby(planes, center + padded_width, step, index)),
        select(found, b * scale, gather_nearby(planes, center + 2 * padded_width, step, index)),
    )
    sampled = select(known > 0.0, 1.0, zero)
    return light, minimum(similar, 1.0), sampled, move_x, move_y


@device_function
def lit(light, reflected):
    """Multiply toned light by the reflectance; the result is toned."""
    r, g, b = light[0] * reflected[0], light[1] * reflected[1], light[2] * reflected[2]
    dark = maximum(1.0 - largest(light[0], light[1], light[2]), 1.0 / MAX_HALF)
    scale = 1.0 / (dark + largest(r, g, b))
    return (
        clamped(r * scale, 0.0, MAX_TONED),
        clamped(g * scale, 0.0, MAX_TONED),
        clamped(b * scale, 0.0, MAX_TONED),
    )


@device_function
def kept_reflectance(reflected, words, pixel, remaining, scratch):
    """Write reflectance as bytes, 255 is one, to up to sixteen pixels; return it as the bytes hold it."""
    r, g = to_int(reflected[0] * 255.0 + 0.5), to_int(reflected[1] * 255.0 + 0.5)
    b = to_int(reflected[2] * 255.0 + 0.5)
    packed = r | g << np.int32(8) | b << np.int32(16)
    if remaining < 16:
        store(scratch, 0, packed)
        for i in range(remaining):
            words[pixel + i] = scratch[i]
    else:
        store(words, pixel, packed)
    one = np.float32(1.0 / 255.0)
    return to_float(r) * one, to_float(g) * one, to_float(b) * one


@device_function
def bytes4(pixels, at):
    """Load four bytes."""
    return to_float(load4(pixels, at))


@device_function
def warp_reflectance(before, offsets, weights, out):
    """Return the reflectance of the history, read linearly at the places of `prepare_own_warp`.

    before (H, W, 4): at half the offsets of pixels of eight values; out (16, 4): scratch.
    """
    one = np.float32(1.0)
    for i in range(16):
        a, b = offsets[128 + i] // 2, offsets[144 + i] // 2
        j, k = offsets[160 + i] // 2, offsets[176 + i] // 2
        t, u = weights[160 + i], weights[176 + i]
        upper = bytes4(before, j + a) * (one - t) + bytes4(before, j + b) * t
        lower = bytes4(before, k + a) * (one - t) + bytes4(before, k + b) * t
        store(out, 4 * i, upper * (one - u) + lower * u)
    r, g, b, _ = load_columns4(out, 0)
    scale = np.float32(1.0 / 255.0)
    return r * scale, g * scale, b * scale


@device_function
def relit(color, before, now, least):
    """Return linear colours of the history under the reflectance of now."""
    floor = least * np.float32(0.5)
    return (
        minimum(sanitize(color[0]) * now[0] / maximum(before[0], floor), MAX_HALF),
        minimum(sanitize(color[1]) * now[1] / maximum(before[1], floor), MAX_HALF),
        minimum(sanitize(color[2]) * now[2] / maximum(before[2], floor), MAX_HALF),
    )
