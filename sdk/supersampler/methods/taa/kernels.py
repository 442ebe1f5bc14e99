"""Kernels of `taa` (Salvi 2016, with his defaults); same as `supersampler_model.methods.taa`.

They tone the samples, compute a variance box around each, then compute the image in one pass.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    from_ycocg,
    largest,
    lerp3,
    linear_of,
    sanitize,
    scaled3,
    select3,
    toned,
    ycocg,
)
from supersampler.backends.cpu.kernels.frame import filled_at, motion_at, repeat_ends, sample_indices
from supersampler.backends.cpu.kernels.warp import cubic4, on_screen, prepare_warp, previous_position
from supersampler.backends.cpu.layout import PAD, TAA_BOX, TAA_PIXEL, TAA_PLANES
from supersampler.backends.cpu.simd.shuffles import load_columns4, transposed
from supersampler.backends.cpu.simd.vector import (
    absolute,
    device_function,
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
from supersampler.methods.taa.cpu import LinearAxis, TaaSamples, TaaScratch

EXPOSURE, ALPHA, SHARPNESS = range(3)
"""Indices into `numbers`; ALPHA is 1 where there is no history."""
UNUSABLE = 2.0
"""Low luma of a box, in place of one up to 1, where a sample around is not usable."""


def read_samples(frame: FrameInputs, samples: TaaSamples, y0: int, y1: int):
    """Fill rows y0 to y1 of `samples.planes`, see TAA_PLANES; the padding repeats the border."""
    motion, exposure = frame.motion, frame.exposure
    planes, w = samples.planes, samples.width
    padded_width = samples.stride + 2 * PAD
    for y in range(y0, y1):
        for x in range(0, w, 16):
            index = sample_indices(x, y, w)
            color, good = filled_at(frame, x, y, index)
            r, g, b = toned(*scaled3(color, exposure))
            luma, co, cg = ycocg(r, g, b)
            mx, my = motion_at(motion, index)
            for c, value in enumerate((luma, co, cg, mx, my, select(good, 1.0, luma * 0.0))):
                store(planes, (TAA_PLANES * y + c) * padded_width + PAD + x, value)
        for c in range(TAA_PLANES):
            repeat_ends(planes, (TAA_PLANES * y + c) * padded_width + PAD, w)


def fill_boxes(samples: TaaSamples, y0: int, y1: int):
    """Fill rows y0 to y1 of `samples.boxes` with the variance box and the longest motion of 3x3 samples."""
    planes, boxes, gamma, stride = samples.planes, samples.boxes, samples.gamma, samples.stride
    w, h, padded_width = samples.width, samples.height, stride + 2 * PAD
    for y in range(y0, y1):
        row_pitch = TAA_PLANES * padded_width
        above, below = max(y - 1, 0) * row_pitch + PAD, min(y + 1, h - 1) * row_pitch + PAD
        here = y * row_pitch + PAD
        for x in range(0, w, 16):
            for c in range(3):
                low = high = load16(planes, here + c * padded_width + x)
                first = second = low * 0.0
                for row in (above, here, below):
                    for column in range(-1, 2):
                        v = load16(planes, row + c * padded_width + x + column)
                        low, high = minimum(v, low), maximum(v, high)
                        first, second = first + v, second + v * v
                mean = first * (1.0 / 9.0)
                extent = square_root(maximum(second * (1.0 / 9.0) - mean * mean, 0.0)) * gamma
                store(boxes, (TAA_BOX * y + c) * stride + x, maximum(mean - extent, low))
                store(boxes, (TAA_BOX * y + 3 + c) * stride + x, minimum(mean + extent, high))
            mx, my = load16(planes, here + 3 * padded_width + x), load16(planes, here + 4 * padded_width + x)
            length, good = mx * mx + my * my, load16(planes, here + 5 * padded_width + x)
            for row in (above, here, below):
                for column in range(-1, 2):
                    index = row + 3 * padded_width + x + column
                    u, v = load16(planes, index), load16(planes, index + padded_width)
                    other = u * u + v * v
                    longer = other > length
                    length = select(longer, other, length)
                    mx, my = select(longer, u, mx), select(longer, v, my)
                    good = minimum(load16(planes, row + 5 * padded_width + x + column), good)
            low = load16(boxes, TAA_BOX * y * stride + x)
            store(boxes, TAA_BOX * y * stride + x, select(good > 0.0, low, UNUSABLE))
            store(boxes, (TAA_BOX * y + 6) * stride + x, mx)
            store(boxes, (TAA_BOX * y + 7) * stride + x, my)


@device_function
def upsampled(planes, c, padded_width, column, row, across, down):
    """Interpolate a plane linearly between two columns and two rows."""
    a, b = row[0] + np.int32(c * padded_width), row[1] + np.int32(c * padded_width)
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
    """Clip the history to the point where the segment to the sample enters the box.

    Without an intersection, clip it towards the box's centre; see `supersampler_model.ops.blending`.
    """
    a, b = segment_in_slab(history[0], sample[0], low[0], high[0])
    c, d = segment_in_slab(history[1], sample[1], low[1], high[1])
    e, f = segment_in_slab(history[2], sample[2], low[2], high[2])
    first, last = maximum(maximum(a, c), e), minimum(minimum(b, d), f)
    intersects = (first <= last) & (first <= 1.0) & (last >= 0.0)
    entry = minimum(maximum(first, 0.0), 1.0)
    center = (low[0] + high[0]) * 0.5, (low[1] + high[1]) * 0.5, (low[2] + high[2]) * 0.5
    overshoot = largest(
        overshoot_of(history[0], center[0], low[0], high[0]),
        overshoot_of(history[1], center[1], low[1], high[1]),
        overshoot_of(history[2], center[2], low[2], high[2]),
    )
    return select3(
        intersects, lerp3(history, sample, entry), lerp3(center, history, 1.0 / maximum(overshoot, 1.0))
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
    next_history, image = output.next_history, output.image
    display_w, display_h, exposure = output.width, output.height, numbers[EXPOSURE]
    float_w, float_h = np.float32(display_w), np.float32(display_h)
    scale_x, scale_y = float_w / np.float32(samples.width), float_h / np.float32(samples.height)
    padded_width, alpha = stride + 2 * PAD, numbers[ALPHA]
    kept = np.float32(0.0) if alpha < 1.0 else np.float32(1.0)
    for y in range(y0, y1):
        row = (
            np.int32(rows.first[y] * TAA_PLANES * padded_width + PAD),
            np.int32(rows.second[y] * TAA_PLANES * padded_width + PAD),
        )
        down = rows.first_weight[y], rows.second_weight[y]
        for x in range(x0, x1, 16):
            lane = to_float(ramp16() + np.int32(x))
            index = load16(columns.nearest, x) + np.int32(rows.nearest[y] * TAA_BOX * stride)
            mx = gather(box, index + np.int32(6 * stride)) * scale_x
            my = gather(box, index + np.int32(7 * stride)) * scale_y
            px, py = previous_position(lane, y, mx, my, float_w, float_h)
            on = on_screen(px, py, float_w, float_h)
            prepare_warp(px, py, display_w, display_h, TAA_PIXEL, numbers[SHARPNESS], slots, weights)
            for i in range(16):
                store(warped, 4 * i, cubic4(history, slots, weights, i))
            q = load_columns4(warped, 0)
            warped_color = ycocg(*toned(*scaled3((sanitize(q[0]), sanitize(q[1]), sanitize(q[2])), exposure)))
            column = load16(columns.first, x), load16(columns.second, x)
            across = load16(columns.first_weight, x), load16(columns.second_weight, x)
            sample = (
                upsampled(planes, 0, padded_width, column, row, across, down),
                upsampled(planes, 1, padded_width, column, row, across, down),
                upsampled(planes, 2, padded_width, column, row, across, down),
            )
            s = np.int32(stride)
            low = gather(box, index), gather(box, index + s), gather(box, index + s * np.int32(2))
            index = index + s * np.int32(3)
            high = gather(box, index), gather(box, index + s), gather(box, index + s * np.int32(2))
            good = low[0] < UNUSABLE
            warped_color = select3(good, clip_to_sample(warped_color, sample, low, high), warped_color)
            weight = select(on, select(good, alpha, lane * 0.0 + kept), 1.0)
            if samples.has_reactive > 0:
                nearest = load16(columns.nearest, x) + np.int32(rows.nearest[y] * samples.width)
                reactive = select(good, gather(samples.reactive, nearest), lane * 0.0)
                weight = weight + (1.0 - weight) * reactive
            r, g, b = from_ycocg(*lerp3(warped_color, sample, weight))
            r, g, b = linear_of(maximum(r, 0.0), maximum(g, 0.0), maximum(b, 0.0), exposure)
            if output.has_weight:
                store(output.weight, y * output.pitch + x, 1.0 - weight)
            zero = lane * 0.0
            pixels = transposed((
                r, g, b, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero,
            ))  # fmt: skip
            for i in range(16):
                store(out, 16 * i, pixels[i])
            for i in range(min(16, x1 - x)):
                pixel = 3 * (y * display_w + x + i)
                for c in range(3):
                    next_history[pixel + c] = image[pixel + c] = out[16 * i + c]
