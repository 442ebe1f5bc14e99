"""Kernels of `taau`, one pass over the display; supersampler_model.methods.taau defines them."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    CONFIRMED,
    DARKNESS,
    GLARE,
    clamped,
    largest,
    linear_of,
    quarantined,
    rgb,
    toned,
    without_glare,
    ycocg,
)
from supersampler.backends.cpu.kernels.filters import (
    filter_across,
    filter_all_across,
    filter_all_down,
    filter_down,
    span,
)
from supersampler.backends.cpu.kernels.frame import fours, opened_at, repeat_ends
from supersampler.backends.cpu.kernels.warp import (
    aim,
    around,
    disoccluded,
    followed,
    mean_of,
    on_screen,
    warp5,
)
from supersampler.backends.cpu.layout import FILTERED, PAD, SAMPLED, TAAU_PIXEL
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import (
    first_third,
    gather4,
    last_third,
    load_columns8,
    rows8,
    second_third,
)
from supersampler.backends.cpu.simd.vector import (
    absolute,
    floor,
    gather,
    load4,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    square_root,
    store,
    sum_of_lanes,
    to_float,
)
from supersampler.backends.cpu.structs import Floats, FrameSamples, Output, ResampleTables
from supersampler.methods.spec import constant_indices
from supersampler.methods.taau.spec import FLASH, LEAST_FLASH, TAAU
from supersampler.methods.taau.structs import TaauHistoryInput, TaauScratch

NOTICEABLE, UNKNOWN, UNSEEN, SEEN = 0.004, 1e-3, 1e-3, 0.5
C = constant_indices(TAAU)
(
    EXPOSURE, W, H, BIG_W, BIG_H, OLD_W, OLD_H, JITTER_X, JITTER_Y, CHANGE, GLARES, UNCONFIRMED,
) = range(len(C), len(C) + 12)  # fmt: skip
"""Of `numbers`, after the constants of `taau`: exposure; sizes of this frame, the display and the previous
frame, and its jitter; by how much the exposure has changed; whether any light may be unconfirmed; whether
light of this frame is: 1 where it raises contrast, 2 everywhere."""


@device_function
def sum3(line, at):
    """Sums of three neighbours."""
    return load16(line, at - 1) + load16(line, at) + load16(line, at + 1)


def shade(read: FrameSamples, line: Floats, surface: Floats, sums: Floats, y0: int, y1: int):
    """Write what the next frame compares with: opened depth, mean and deviation of luma, glare.

    line: (3, PAD + stride + PAD) scratch; surface: (height, PAD + stride + PAD, 4), the padding repeats the
    border; sums: (height, 2) of means and of squared deviations of each row.
    """
    samples, own, glares, eroded = read.color, read.own, read.glares, read.eroded_depth
    w, h, stride = read.width, read.height, read.stride
    wide = stride + 2 * PAD
    for y in range(y0, y1):
        above, below = max(y - 1, 0), min(y + 1, h - 1)
        for x in range(0, w, 16):
            luma = square = seen = load16(eroded, 0) * 0.0
            for row in (above, y, below):
                at = SAMPLED * row * wide + PAD + x
                luma, square = luma + load16(samples, at + 4 * wide), square + load16(samples, at + 7 * wide)
                seen = seen + load16(samples, at + 3 * wide)
            store(line, PAD + x, luma)
            store(line, wide + PAD + x, square)
            store(line, 2 * wide + PAD + x, seen)
        for c in range(3):
            first = c * wide + PAD
            line[first - 1], line[first + w] = line[first], line[first + w - 1]
        here = y * wide + PAD
        glares_near = glares[above] + glares[y] + glares[below] > 0.0
        light = contrast = load16(eroded, 0) * 0.0
        for x in range(0, w, 16):
            seen = sum3(line, 2 * wide + PAD + x)
            scale = 1.0 / maximum(seen, 9e-6)
            mean = sum3(line, PAD + x) * scale
            deviation = square_root(maximum(sum3(line, wide + PAD + x) * scale - mean * mean, 0.0))
            glare = seen * 0.0
            if glares_near:
                glare = gather(own, (ramp16() + np.int32(y * stride + x)) * 4 + 3)
            opened = opened_at(eroded, above * wide + PAD, here, below * wide + PAD, x)
            deviation = select(seen > 9.0 * UNSEEN, deviation, 1.0)
            fours(surface, 4 * (here + x), opened, mean, deviation, glare)
            inside = ramp16() + np.int32(x) < np.int32(w)
            light = light + select(inside, mean, 0.0)
            contrast = contrast + select(inside, deviation * deviation, 0.0)
        sums[2 * y], sums[2 * y + 1] = sum_of_lanes(light), sum_of_lanes(contrast)
        repeat_ends(surface, here, w, 4)


@device_function
def present_of(p, q, sharpness):
    """This frame at sixteen pixels, YCoCg: smooth, nearest, its confidence, mean and spread around."""
    a, b = 1.0 / maximum(p[3], 1e-6), 1.0 / maximum(p[7], 1e-6)
    sharp = select(p[7] > 0.9, sharpness, p[3] * 0.0)
    r, g, e = p[0] * a, p[1] * a, p[2] * a
    frame = ycocg(
        r + sharp * (p[4] * b - r),
        g + sharp * (p[5] * b - g),
        e + sharp * (p[6] * b - e),
    )
    a = 1.0 / maximum(q[3], 1e-6)
    sample = ycocg(q[0] * a, q[1] * a, q[2] * a)
    a, seen = 1.0 / maximum(p[14], 1e-6), p[14] > SEEN
    mean = p[8] * a, p[9] * a, p[10] * a
    spread = (
        deviation(select(seen, p[11] * a, 1.0), mean[0]),
        deviation(select(seen, p[12] * a, 1.0), mean[1]),
        deviation(select(seen, p[13] * a, 1.0), mean[2]),
    )
    return frame, sample, minimum(q[3], 1.0), mean, spread


@device_function
def deviation(square, mean):
    return square_root(maximum(square - mean * mean, 0.0))


@device_function
def light_changed(numbers, mean, spread, mean_before, spread_before):
    """`change_of_light`: 1 where the mean of a neighbourhood moved by more than jitter explains."""
    noise = maximum(spread, spread_before) * numbers[C.change_deviation]
    noise = noise + maximum(mean, mean_before) * numbers[C.change_relative] + NOTICEABLE
    moved = absolute(mean - mean_before)
    return clamped((moved / noise - 1.0) / numbers[C.change_ramp], 0.0, 1.0)


@device_function
def clipped(color, mean, spread, gamma, floor_):
    """`clip_to_center`, and how far outside of its box a colour was, in half extents."""
    y, o, g = color[0] - mean[0], color[1] - mean[1], color[2] - mean[2]
    over = largest(
        absolute(y) / maximum(spread[0] * gamma + floor_, 1e-5),
        absolute(o) / maximum(spread[1] * gamma + floor_, 1e-5),
        absolute(g) / maximum(spread[2] * gamma + floor_, 1e-5),
    )
    cut = 1.0 / maximum(over, 1.0)
    return (mean[0] + y * cut, mean[1] + o * cut, mean[2] + g * cut), over


@device_function
def blend(numbers, present, past, light, count, power, surface, unchanged, glare, flash, speed, blur):
    """`Taau.network` and `finish` of sixteen pixels.

    Linear RGB, the same as it is left, count, power, and the past's weight. `glare`: 1 where this frame has
    light over GLARING near; `flash`: 1 where its light is unconfirmed.
    """
    n = numbers
    frame, sample, confidence, mean, spread = present
    gamma = minimum(speed / n[C.gamma_speed], 1.0) * (n[C.gamma_moving] - n[C.gamma_still]) + n[C.gamma_still]
    glared = power * 0.0
    if n[GLARES] > 0.0:
        power, glared = without_glare(power)
        unchanged = select((glared > 0.0) & (glared < CONFIRMED), 1.0, unchanged)
    root = square_root(power)
    rectified, over = clipped(past, mean, spread, gamma, root * unchanged * n[C.gamma_time])
    inside = 1.0 - clamped((over - 1.0) * n[C.forget], 0.0, 1.0)
    limit = n[C.samples] / (blur * n[C.blur_cost] + speed * n[C.speed_cost] + 1.0)
    holds = surface * unchanged
    samples = minimum(count * holds * inside, limit)
    weight = confidence / maximum(samples + confidence, 1e-6)
    known, settled = samples > UNKNOWN, minimum(samples / n[C.settled], 1.0)
    y = select(known, mixed(rectified[0], mixed(frame[0], sample[0], settled), weight), frame[0])
    o = select(known, mixed(rectified[1], mixed(frame[1], sample[1], settled), weight), frame[1])
    g = select(known, mixed(rectified[2], mixed(frame[2], sample[2], settled), weight), frame[2])
    r, e, b = rgb(y, o, g)
    color = linear_of(maximum(r, 0.0), maximum(e, 0.0), maximum(b, 0.0), n[EXPOSURE])

    off = minimum(absolute(sample[0] - past[0]), root + n[C.spread_step])
    rate = confidence / maximum(minimum(samples, n[C.spread_samples]) + confidence, 1e-6)
    left = maximum(power + rate * (off * off - power) - DARKNESS, 0.0)
    left = select(known, holds * left, 0.0)
    lit, counted = color, samples + confidence
    if n[GLARES] > 0.0:
        unconfirmed = select(glared < CONFIRMED - 1.0, glare, 0.0)
        trusted = select(unconfirmed > 0.0, surface, holds)
        kept = minimum(count * trusted, limit)
        adds = select(maximum(unconfirmed, flash) > 0.0, kept, 0.0) <= UNKNOWN
        lit = (
            select(adds, color[0], light[0]),
            select(adds, color[1], light[1]),
            select(adds, color[2], light[2]),
        )
        left = select(
            adds,
            left + glare * (GLARE * CONFIRMED),
            trusted * power + minimum(glared + glare, CONFIRMED) * GLARE,
        )
        counted = select(adds, counted, kept)
    return color, lit, counted, left, select(known, 1.0 - weight, 0.0)


@device_function
def mixed(a, b, share):
    return a + share * (b - a)


def step_rows(
    read: FrameSamples, surface: Floats, history: TaauHistoryInput, tables: ResampleTables, numbers: Floats,
    scratch: TaauScratch, output: Output, y0: int, y1: int, x0: int, x1: int,
):  # fmt: skip
    """Compute rows y0 to y1 and columns x0 to x1 of the image and the next history.

    surface: as `shade` wrote it for this frame.
    """
    samples, stride, before = read.color, read.stride, history.surface
    rows, down = tables.row_samples, tables.row_weights
    starts, across = tables.column_start, tables.column_weights
    line, slots, weights = scratch.line, scratch.slots, scratch.weights
    warped, out = scratch.warped, scratch.out
    next_history, image = output.next_history, output.image
    big_w, big_h, width = output.width, output.height, output.pitch
    old_w, old_h = np.int64(numbers[OLD_W]), np.int64(numbers[OLD_H])
    w_big, h_big, change = numbers[BIG_W], numbers[BIG_H], numbers[CHANGE]
    scale_x, scale_y = w_big / numbers[W], h_big / numbers[H]
    wide = stride + 2 * PAD
    for y in range(y0, y1):
        filter_all_down(samples, rows, down, big_h, y, starts, x0, x1, wide, line)
        near, (first, last) = 4 * (3 * big_h + y), span(starts, x0, x1)
        filter_down(samples, 0, 4, rows, down, y, near, wide, first, last, line, FILTERED * wide)
        for x in range(x0, x1, 16):
            lane = to_float(ramp16() + np.int32(x))
            depth, mx, my, _ = gather4(
                read.dilated, tables.first_column, x, 4, 4 * tables.first_row[y] * stride
            )
            mx, my = mx * scale_x, my * scale_y
            px, py = followed(lane, y, mx, my, w_big, h_big)
            on = on_screen(px, py, w_big, h_big)
            aim(px, py, big_w, big_h, TAAU_PIXEL, numbers[C.history_sharpness], slots, weights)
            warp5(history.pixels, slots, weights, warped)
            q = load_columns8(warped, 0)
            e = numbers[EXPOSURE]
            light = quarantined(q[0]), quarantined(q[1]), quarantined(q[2])
            past = ycocg(*toned(light[0] * e, light[1] * e, light[2] * e))
            # the surface that the past shows, and its light
            sx = (px + 0.5) * numbers[OLD_W] / w_big - 0.5 - numbers[JITTER_X]
            sy = (py + 0.5) * numbers[OLD_H] / h_big - 0.5 - numbers[JITTER_Y]
            shares = around(sx, sy, old_w, old_h, history.pitch, slots)
            a, b = gather4(before, slots, 0, 4, 0), gather4(before, slots, 0, 4, 4)
            c, d = gather4(before, slots, 16, 4, 0), gather4(before, slots, 16, 4, 4)
            depths = a[0], b[0], c[0], d[0]
            cover = disoccluded(depth, shares, depths, numbers[C.depth_margin], numbers[C.depth_ramp])
            same = select(on, maximum(1.0 - cover * 2.0, 0.0), 0.0)
            mean = mean_of((a[1], b[1], c[1], d[1]), shares)
            spread = mean_of((a[2], b[2], c[2], d[2]), shares)
            dim = 1.0 / (mean * (change - np.float32(1.0)) + 1.0)
            _, now, spread_now, glare = gather4(
                surface, tables.nearest_column, x, 4, 4 * (tables.nearest_row[y] * wide + PAD)
            )
            mean, spread = mean * change * dim, spread * change * dim * dim
            changed = light_changed(numbers, now, spread_now, mean, spread)
            flash = depth * 0.0 + numbers[UNCONFIRMED]
            if numbers[UNCONFIRMED] == 1.0:
                risen = spread_now * spread_now > spread * spread * FLASH + LEAST_FLASH
                flash = select(risen, 1.0, depth * 0.0)
            tx, ty = px - floor(px), py - floor(py)
            sums = filter_all_across(line, wide, starts, across, width, x)
            sample = filter_across(line, FILTERED * wide, wide, starts, across, 12, width, x)
            color, lit, count, power, kept = blend(
                numbers, present_of(sums, sample, numbers[C.frame_sharpness]), past, light, q[6], q[7],
                same, 1.0 - changed, glare, flash, square_root(mx * mx + my * my),
                (tx * (1.0 - tx) + ty * (1.0 - ty)) * 2.0,
            )  # fmt: skip
            if output.has_weight:
                store(output.weight, y * width + x, kept)
            r, g, b = color
            pairs = rows8((*lit, count, power, r, g, b))
            for i in range(8):
                store(out, 16 * i, pairs[i])
            pixel = y * big_w + x
            for i in range(min(16, x1 - x)):
                store(next_history, TAAU_PIXEL * (pixel + i), load4(out, 8 * i))
                next_history[TAAU_PIXEL * (pixel + i) + 4] = out[8 * i + 4]
            if x1 - x >= 16:
                store(image, 3 * pixel, first_third(r, g, b))
                store(image, 3 * pixel + 16, second_third(r, g, b))
                store(image, 3 * pixel + 32, last_third(r, g, b))
            else:
                for i in range(x1 - x):
                    for c in range(3):
                        image[3 * (pixel + i) + c] = out[8 * i + 5 + c]
