"""Kernels of `taa` (Salvi 2016, his defaults); supersampler_model.methods.taa defines them.

A step reads the samples, fills a box of allowed colors for each, then computes the display in one pass.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import from_ycocg, linear_of, sanitize, toned, usable, ycocg
from supersampler.backends.cpu.kernels.frame import color_at, motion_at, places_of, repeat_ends
from supersampler.backends.cpu.kernels.warp import cubic4, on_screen, prepare_warp, previous_position
from supersampler.backends.cpu.layout import PAD, TAA_BOX, TAA_PIXEL, TAA_PLANES
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import load_columns4, transposed
from supersampler.backends.cpu.simd.vector import (
    absolute,
    gather,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    square_root,
    store,
    to_float,
)
from supersampler.backends.cpu.structs import Floats, FrameInputs, Output
from supersampler.methods.taa.structs import LinearAxis, TaaSamples, TaaScratch

(EXPOSURE, W, H, BIG_W, BIG_H, ALPHA, GAMMA, SHARPNESS) = range(8)
"""Indices into `numbers`; ALPHA is 1 where there is no history."""
UNUSABLE = 2.0
"""Low luma of a box, in place of one up to 1, where a sample around is not usable."""


def read_samples(frame: FrameInputs, samples: TaaSamples, y0: int, y1: int):
    """Fill rows y0 to y1 of `samples.planes`, see TAA_PLANES; the padding repeats the border."""
    color, motion, exposure, planes, w = (
        frame.color,
        frame.motion,
        frame.exposure,
        samples.planes,
        samples.width,
    )
    wide = samples.stride + 2 * PAD
    for y in range(y0, y1):
        for x in range(0, w, 16):
            at = places_of(x, y, w)
            r, g, b = color_at(color, at)
            good = usable(r, g, b)
            r, g, b = toned(sanitize(r) * exposure, sanitize(g) * exposure, sanitize(b) * exposure)
            luma, co, cg = ycocg(r, g, b)
            mx, my = motion_at(motion, at)
            for c, value in enumerate((luma, co, cg, mx, my, select(good, 1.0, luma * 0.0))):
                store(planes, (TAA_PLANES * y + c) * wide + PAD + x, value)
        for c in range(TAA_PLANES):
            repeat_ends(planes, (TAA_PLANES * y + c) * wide + PAD, w)


def fill_boxes(samples: TaaSamples, y0: int, y1: int):
    """Fill rows y0 to y1 of `samples.boxes` from the 3x3 samples around each."""
    planes, boxes, gamma, stride = samples.planes, samples.boxes, samples.gamma, samples.stride
    w, h, wide = samples.width, samples.height, stride + 2 * PAD
    for y in range(y0, y1):
        above, here, below = (
            TAA_PLANES * max(y - 1, 0) * wide + PAD,
            TAA_PLANES * y * wide + PAD,
            TAA_PLANES * min(y + 1, h - 1) * wide + PAD,
        )
        for x in range(0, w, 16):
            for c in range(3):
                low = high = load16(planes, here + c * wide + x)
                first = second = low * 0.0
                for row in (above, here, below):
                    for column in range(-1, 2):
                        v = load16(planes, row + c * wide + x + column)
                        low, high = minimum(v, low), maximum(v, high)
                        first, second = first + v, second + v * v
                mean = first * (1.0 / 9.0)
                extent = square_root(maximum(second * (1.0 / 9.0) - mean * mean, 0.0)) * gamma
                store(boxes, (TAA_BOX * y + c) * stride + x, maximum(mean - extent, low))
                store(boxes, (TAA_BOX * y + 3 + c) * stride + x, minimum(mean + extent, high))
            mx, my = load16(planes, here + 3 * wide + x), load16(planes, here + 4 * wide + x)
            length, good = mx * mx + my * my, load16(planes, here + 5 * wide + x)
            for row in (above, here, below):
                for column in range(-1, 2):
                    u, v = (
                        load16(planes, row + 3 * wide + x + column),
                        load16(planes, row + 4 * wide + x + column),
                    )
                    other = u * u + v * v
                    longer = other > length
                    length = select(longer, other, length)
                    mx, my = select(longer, u, mx), select(longer, v, my)
                    good = minimum(load16(planes, row + 5 * wide + x + column), good)
            low = load16(boxes, TAA_BOX * y * stride + x)
            store(boxes, TAA_BOX * y * stride + x, select(good > 0.0, low, UNUSABLE))
            store(boxes, (TAA_BOX * y + 6) * stride + x, mx)
            store(boxes, (TAA_BOX * y + 7) * stride + x, my)


@device_function
def upsampled(planes, c, wide, column, row, across, down):
    """Interpolate a plane linearly between two columns and two rows."""
    a, b = row[0] + np.int32(c * wide), row[1] + np.int32(c * wide)
    upper = gather(planes, a + column[0]) * across[0] + gather(planes, a + column[1]) * across[1]
    lower = gather(planes, b + column[0]) * across[0] + gather(planes, b + column[1]) * across[1]
    return upper * down[0] + lower * down[1]


@device_function
def segment_in_slab(color, sample, low, high):
    """Return where the segment from `color` (0) to `sample` (1) enters and leaves a slab."""
    step = sample - color
    step = select(absolute(step) < 1e-6, 1e-6, step)
    first, second = (low - color) / step, (high - color) / step
    return minimum(first, second), maximum(first, second)


@device_function
def clip_to_sample(history, sample, low, high):
    """Clip the history where the segment to the sample enters the box; see `ops.rectification`."""
    a, b = segment_in_slab(history[0], sample[0], low[0], high[0])
    c, d = segment_in_slab(history[1], sample[1], low[1], high[1])
    e, f = segment_in_slab(history[2], sample[2], low[2], high[2])
    first, last = maximum(maximum(a, c), e), minimum(minimum(b, d), f)
    intersects = (first <= last) & (first <= 1.0) & (last >= 0.0)
    share = minimum(maximum(first, 0.0), 1.0)
    center_y, center_co, center_cg = (
        (low[0] + high[0]) * 0.5,
        (low[1] + high[1]) * 0.5,
        (low[2] + high[2]) * 0.5,
    )
    overshoot = maximum(
        maximum(
            overshoot_of(history[0], center_y, low[0], high[0]),
            overshoot_of(history[1], center_co, low[1], high[1]),
        ),
        overshoot_of(history[2], center_cg, low[2], high[2]),
    )
    scale = 1.0 / maximum(overshoot, 1.0)
    return (
        select(
            intersects,
            history[0] + share * (sample[0] - history[0]),
            center_y + (history[0] - center_y) * scale,
        ),
        select(
            intersects,
            history[1] + share * (sample[1] - history[1]),
            center_co + (history[1] - center_co) * scale,
        ),
        select(
            intersects,
            history[2] + share * (sample[2] - history[2]),
            center_cg + (history[2] - center_cg) * scale,
        ),
    )


@device_function
def overshoot_of(value, center, low, high):
    """Return the distance from the centre of an interval, in half extents."""
    return absolute(value - center) / maximum((high - low) * 0.5, 1e-5)


def step_rows(
    samples: TaaSamples, history: Floats, columns: LinearAxis, rows: LinearAxis, numbers: Floats,
    scratch: TaaScratch, output: Output, y0: int, y1: int, x0: int, x1: int,
):  # fmt: skip
    """Compute rows y0 to y1, columns x0 to x1 of the image; history: (height, width, TAA_PIXEL)."""
    planes, box, stride = samples.planes, samples.boxes, samples.stride
    slots, weights, warped, out = scratch.slots, scratch.weights, scratch.warped, scratch.out
    next_history, image, big_w, big_h = output.next_history, output.image, output.width, output.height
    w_big, h_big, e = numbers[BIG_W], numbers[BIG_H], numbers[EXPOSURE]
    scale_x, scale_y = w_big / numbers[W], h_big / numbers[H]
    wide, alpha = stride + 2 * PAD, numbers[ALPHA]
    kept = np.float32(0.0) if alpha < 1.0 else np.float32(1.0)
    for y in range(y0, y1):
        row = (
            np.int32(rows.first[y] * TAA_PLANES * wide + PAD),
            np.int32(rows.second[y] * TAA_PLANES * wide + PAD),
        )
        down = rows.first_weight[y], rows.second_weight[y]
        for x in range(x0, x1, 16):
            lane = to_float(ramp16() + np.int32(x))
            at = load16(columns.nearest, x) + np.int32(rows.nearest[y] * TAA_BOX * stride)
            mx = gather(box, at + np.int32(6 * stride)) * scale_x
            my = gather(box, at + np.int32(7 * stride)) * scale_y
            px, py = previous_position(lane, y, mx, my, w_big, h_big)
            on = on_screen(px, py, w_big, h_big)
            prepare_warp(px, py, big_w, big_h, TAA_PIXEL, numbers[SHARPNESS], slots, weights)
            for i in range(16):
                store(warped, 4 * i, cubic4(history, slots, weights, i))
            q = load_columns4(warped, 0)
            r, g, b = toned(sanitize(q[0]) * e, sanitize(q[1]) * e, sanitize(q[2]) * e)
            warped_color = ycocg(r, g, b)
            column = load16(columns.first, x), load16(columns.second, x)
            across = load16(columns.first_weight, x), load16(columns.second_weight, x)
            sample = (
                upsampled(planes, 0, wide, column, row, across, down),
                upsampled(planes, 1, wide, column, row, across, down),
                upsampled(planes, 2, wide, column, row, across, down),
            )
            s = np.int32(stride)
            low = gather(box, at), gather(box, at + s), gather(box, at + s * np.int32(2))
            at = at + s * np.int32(3)
            high = gather(box, at), gather(box, at + s), gather(box, at + s * np.int32(2))
            clipped, good = clip_to_sample(warped_color, sample, low, high), low[0] < UNUSABLE
            warped_color = (
                select(good, clipped[0], warped_color[0]),
                select(good, clipped[1], warped_color[1]),
                select(good, clipped[2], warped_color[2]),
            )
            weight = select(on, select(good, alpha, lane * 0.0 + kept), 1.0)
            r, g, b = from_ycocg(
                warped_color[0] + weight * (sample[0] - warped_color[0]),
                warped_color[1] + weight * (sample[1] - warped_color[1]),
                warped_color[2] + weight * (sample[2] - warped_color[2]),
            )
            r, g, b = linear_of(maximum(r, 0.0), maximum(g, 0.0), maximum(b, 0.0), e)
            if output.has_weight:
                store(output.weight, y * output.pitch + x, 1.0 - weight)
            zero = lane * 0.0
            pixels = transposed((
                r, g, b, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero,
            ))  # fmt: skip
            for i in range(16):
                store(out, 16 * i, pixels[i])
            for i in range(min(16, x1 - x)):
                pixel = 3 * (y * big_w + x + i)
                for c in range(3):
                    next_history[pixel + c] = image[pixel + c] = out[16 * i + c]
