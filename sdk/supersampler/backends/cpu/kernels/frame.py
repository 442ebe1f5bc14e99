"""Kernels that preprocess a frame: toned samples, sanitized depth and motion, dilated motion."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    clamped,
    largest,
    logarithm,
    luminance,
    sanitize,
    select3,
    toned,
    usable,
    ycocg,
)
from supersampler.backends.cpu.layout import PAD, SAMPLE_PLANES
from supersampler.backends.cpu.simd.shuffles import rows4, zipped
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
    sum_of_lanes,
    to_float,
    to_int,
)
from supersampler.backends.cpu.structs import Floats, FrameInputs, FrameSamples
from supersampler.io.display import DARKEST
from supersampler.methods.at_rest import MAX_STATIC_MOTION
from supersampler.methods.constants import (
    FILL_WINDOW,
    FINITE_MOTION,
    GLARE_TONED,
    MAX_DEPTH,
    MAX_MOTION,
    SAME_THIN_DEPTH,
    THIN_MOTION,
    UNKNOWN_DEPTH,
)


@device_function
def sample_indices(x, y, w):
    """Return the indices of sixteen samples of row y from x on; the last sample of the row is repeated."""
    return minimum(ramp16() + np.int32(x), np.int32(w - 1)) + np.int32(y * w)


@device_function
def color_at(color, index):
    """Return the RGB of sixteen samples."""
    return gather(color, index * 3), gather(color, index * 3 + 1), gather(color, index * 3 + 2)


@device_function
def filled_at(frame, x, y, index):
    """Return the RGB of sixteen samples of row y from x on, missing ones filled, and which are usable."""
    r, g, b = color_at(frame.color, index)
    good = usable(r, g, b)
    color = sanitize(r), sanitize(g), sanitize(b)
    if frame.fill_across > 0:
        at = 3 * (y // FILL_WINDOW * frame.fill_across + x // FILL_WINDOW)
        fill, zero = frame.fill, color[0] * 0.0
        color = select3(good, color, (zero + fill[at], zero + fill[at + 1], zero + fill[at + 2]))
    return color, good


@device_function
def or_fill(found, color, samples, tables, x, y):
    """Return toned RGB of sixteen pixels of row y, or what fills missing samples where none was found."""
    row = 3 * (tables.nearest_row[y] // FILL_WINDOW) * samples.fill_pitch + x
    fill = (
        load16(samples.fill, row),
        load16(samples.fill, row + samples.fill_pitch),
        load16(samples.fill, row + 2 * samples.fill_pitch),
    )
    return select3(found, color, fill)


@device_function
def motion_at(motion, index):
    """Return the sanitized motion of sixteen samples: 0 where it is not finite."""
    mx, my = gather(motion, index * 2), gather(motion, index * 2 + 1)
    x, y = clamped(mx, -MAX_MOTION, MAX_MOTION), clamped(my, -MAX_MOTION, MAX_MOTION)
    return select(absolute(mx) <= FINITE_MOTION, x, 0.0), select(absolute(my) <= FINITE_MOTION, y, 0.0)


@device_function
def usable_depth(depth):
    """Return depth, UNKNOWN_DEPTH where it is negative, too large or NaN."""
    return select((depth >= 0.0) & (depth <= MAX_DEPTH), depth, UNKNOWN_DEPTH)


@device_function
def reactive_at(samples, tables, x, y):
    """Return the reactive mask at the samples nearest to sixteen pixels of row y; see `FrameInputs`."""
    row = np.int32(tables.nearest_row[y] * samples.width)
    return gather(samples.reactive, load16(tables.nearest_column, x) + row)


def measure(color: Floats, w: int, y0: int, y1: int, rows: Floats):
    """Write sums of rows y0 to y1 to `rows`, (h, 2): log luminance of usable samples, and their number."""
    zero = spread16(np.float32(0.0))
    for y in range(y0, y1):
        logs = count = zero
        for x in range(0, w, 16):
            r, g, b = color_at(color, sample_indices(x, y, w))
            good = usable(r, g, b) & (ramp16() + np.int32(x) < np.int32(w))
            luma = luminance(sanitize(r), sanitize(g), sanitize(b))
            logs = logs + select(good, logarithm(maximum(luma, DARKEST)), zero)
            count = count + select(good, spread16(np.float32(1.0)), zero)
        rows[2 * y] = sum_of_lanes(logs)
        rows[2 * y + 1] = sum_of_lanes(count)


def prepare(frame: FrameInputs, samples: FrameSamples, y0: int, y1: int):
    """Write color, depth, motion, glares and still rows y0 to y1 of `samples`."""
    color, exposure, colors, w = frame.color, frame.exposure, samples.color, samples.width
    zero = spread16(np.float32(0.0))
    padded_width = samples.stride + 2 * PAD
    for y in range(y0, y1):
        brightest, slowest = zero, zero + np.float32(1.0)
        for x in range(0, w, 16):
            index = sample_indices(x, y, w)
            r, g, b = color_at(color, index)
            usable_here = select(usable(r, g, b), 1.0, zero)
            r, g, b = toned(sanitize(r) * exposure, sanitize(g) * exposure, sanitize(b) * exposure)
            r, g, b = r * usable_here, g * usable_here, b * usable_here
            brightest = maximum(brightest, largest(r, g, b))
            luma, co, cg = ycocg(r, g, b)
            squares = luma * luma, co * co, cg * cg
            to = SAMPLE_PLANES * y * padded_width + PAD + x
            for c, value in enumerate((r, g, b, usable_here, luma, co, cg, *squares)):
                store(colors, to + c * padded_width, value)
            d, (mx, my) = gather(frame.depth, index), motion_at(frame.motion, index)
            to = y * padded_width + PAD + x
            store(samples.depth, to, usable_depth(d))
            store(samples.motion_x, to, mx)
            store(samples.motion_y, to, my)
            slowest = minimum(slowest, mx * mx + my * my)
        samples.glares[y] = 0.0 if all_lanes(brightest <= GLARE_TONED) else 1.0
        samples.still_rows[y] = 0.0 if all_lanes(slowest > MAX_STATIC_MOTION * MAX_STATIC_MOTION) else 1.0
        for c in range(SAMPLE_PLANES):
            repeat_ends(colors, (SAMPLE_PLANES * y + c) * padded_width + PAD, w)
        for plane in (samples.depth, samples.motion_x, samples.motion_y):
            repeat_ends(plane, y * padded_width + PAD, w)


@device_function
def repeat_ends(plane, first, count, channels=1):
    """Fill the padding before and after `count` samples, of `channels` values each, from `first` on."""
    for x in range(PAD):
        for c in range(channels):
            plane[channels * (first - 1 - x) + c] = plane[channels * first + c]
            plane[channels * (first + count + x) + c] = plane[channels * (first + count - 1) + c]


def dilate(samples: FrameSamples, y0: int, y1: int):
    """Fill `dilated`, `own` and `eroded_depth` of rows y0 to y1 of `samples`, after `prepare`."""
    colors, glares, depths = samples.color, samples.glares, samples.depth
    across, down = samples.motion_x, samples.motion_y
    w, h, stride = samples.width, samples.height, samples.stride
    padded_width, zero = stride + 2 * PAD, spread16(np.float32(0.0))
    for y in range(y0, y1):
        above, here, below = (
            max(y - 1, 0) * padded_width + PAD,
            y * padded_width + PAD,
            min(y + 1, h - 1) * padded_width + PAD,
        )
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
                    glare = maximum(
                        glare, glare_at(colors, SAMPLE_PLANES * (row - PAD) + PAD + x, padded_width)
                    )
            store4(samples.own, 4 * (y * stride + x), mx, my, edge, glare)
            for index in (here + x + 1, below + x, below + x + 1):
                other = load16(depths, index)
                closer = other > d
                d = select(closer, other, d)
                mx, my = select(closer, load16(across, index), mx), select(closer, load16(down, index), my)
            store4(samples.dilated, 4 * (y * stride + x), d, mx, my, zero)
        repeat_ends(samples.eroded_depth, here, w)


@device_function
def glare_at(colors, index, padded_width):
    """Return 1 where one of three neighbouring samples of a row is over GLARE_TONED, else 0."""
    brightest = spread16(np.float32(0.0))
    for channel in range(3):
        for column in range(-1, 2):
            brightest = maximum(brightest, load16(colors, index + channel * padded_width + column))
    return select(brightest > GLARE_TONED, 1.0, brightest * 0.0)


@device_function
def store4(out, index, first, second, third, fourth):
    """Store four vectors as sixteen samples of four interleaved values."""
    for i, row in enumerate(rows4((first, second, third, fourth))):
        store(out, index + 16 * i, row)


@device_function
def occluding_at(samples, y, x):
    """Return the occluding depth of sixteen samples; same as `occluding_depth` of the torch methods."""
    eroded, depths, h = samples.eroded_depth, samples.depth, samples.height
    padded_width = samples.stride + 2 * PAD
    here = y * padded_width + PAD + x
    opened = load16(eroded, here)
    for row in range(max(y - 1, 0), min(y + 2, h)):
        for column in range(-1, 2):
            opened = maximum(load16(eroded, row * padded_width + PAD + x + column), opened)
    opened = maximum(opened, 0.0)
    depth = load16(depths, here)
    if not all_lanes(load16(eroded, here) >= SAME_THIN_DEPTH * depth):
        across, down, farthest = motion_over_background(samples, y, x)
        across, down = whole_steps(across), whole_steps(down)
        apart = (farthest >= 0.0) & (farthest < SAME_THIN_DEPTH * depth)
        steps = select(apart, maximum(absolute(across), absolute(down)), 0.0)
        if not all_lanes(steps <= 0.0):
            follows = closest_around(samples, across + to_float(ramp16() + np.int32(x)), down + np.float32(y))
            opened = select((steps > 0.0) & (follows < SAME_THIN_DEPTH * depth), depth * -1.0, opened)
    return opened


@device_function
def whole_steps(motion):
    """Round components below one sample: from THIN_MOTION on to one, else to 0."""
    length = absolute(motion)
    step = select(length >= THIN_MOTION, 1.0, length * 0.0)
    return select(length < 1.0, select(motion < 0.0, step * -1.0, step), motion)


@device_function
def motion_over_background(samples, y, x):
    """Return the motion of sixteen samples less that of the farthest of 3x3, and the depth of the latter."""
    depths, across, down = samples.depth, samples.motion_x, samples.motion_y
    padded_width = samples.stride + 2 * PAD
    above, here, below = max(y - 1, 0), y, min(y + 1, samples.height - 1)
    index = here * padded_width + PAD + x
    farthest, mx, my = load16(depths, index), load16(across, index), load16(down, index)
    for row in (here, above, below):  # of equals, the one that `_farthest_3x3` takes
        for column in (0, -1, 1):
            at = row * padded_width + PAD + x + column
            other = load16(depths, at)
            farther = other < farthest
            farthest = select(farther, other, farthest)
            mx, my = select(farther, load16(across, at), mx), select(farther, load16(down, at), my)
    return load16(across, index) - mx, load16(down, index) - my, farthest


@device_function
def closest_around(samples, x, y):
    """Return the depth of the closest of the four samples around sixteen positions, clamped to the frame."""
    x, y = clamped(x, 0.0, np.float32(samples.width - 1)), clamped(y, 0.0, np.float32(samples.height - 1))
    left, right = to_int(floor(x)), to_int(0.0 - floor(0.0 - x))
    closest = x * 0.0 - 1.0
    for row in (to_int(floor(y)), to_int(0.0 - floor(0.0 - y))):
        line = row * np.int32(samples.stride + 2 * PAD) + np.int32(PAD)
        closest = maximum(gather(samples.depth, line + left), closest)
        closest = maximum(gather(samples.depth, line + right), closest)
    return closest


def keep_depth(samples: FrameSamples, next_depth: Floats, y0: int, y1: int):
    """Write the depth for disocclusion tests of the next frame: unchanged, and occluding.

    next_depth: (height, PAD + stride + PAD, 2); the padding repeats the border.
    """
    w, padded_width = samples.width, samples.stride + 2 * PAD
    for y in range(y0, y1):
        here = y * padded_width + PAD
        for x in range(0, w, 16):
            depth, occluding = load16(samples.depth, here + x), occluding_at(samples, y, x)
            store(next_depth, 2 * (here + x), zipped(depth, occluding))
        repeat_ends(next_depth, here, w, 2)
