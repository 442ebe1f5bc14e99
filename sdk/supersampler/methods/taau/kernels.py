"""Kernels of `taau`; same as `supersampler_model.methods.taau`, in one pass over the image.

Device functions compute sixteen pixels at once, with a vector per channel.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    clamped,
    from_ycocg,
    largest,
    lerp3,
    linear_of,
    sanitize,
    scaled3,
    select3,
    toned,
    without_glare,
    ycocg,
)
from supersampler.backends.cpu.kernels.filters import (
    filter_across,
    filter_all_across,
    filter_all_down,
    filter_down,
    filter_line_across,
    span,
)
from supersampler.backends.cpu.kernels.frame import occluding_at, or_fill, reactive_at, repeat_ends, store4
from supersampler.backends.cpu.kernels.warp import (
    linear_taps,
    mean_of,
    occlusion,
    on_screen,
    prepare_warp,
    previous_position,
    warp5,
)
from supersampler.backends.cpu.layout import FILTER_LINES, PAD, SAMPLE_PLANES, TAAU_PIXEL
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
    device_function,
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
from supersampler.methods.at_rest import BLOCK
from supersampler.methods.constants import (
    CONFIRMED,
    DARKNESS,
    FULL_WEIGHT,
    GLARE,
    MIN_CUBIC_WEIGHT,
    MIN_WEIGHT,
)
from supersampler.methods.spec import constant_indices
from supersampler.methods.taau.cpu import ComparedBlocks, TaauHistoryInput, TaauScratch
from supersampler.methods.taau.spec import (
    FIT,
    FLASH,
    LAG_STEP,
    LEAST_FLASH,
    MIN_BOX_WEIGHT,
    MIN_CHANGE,
    MIN_SAMPLES,
    TAAU,
    UNFIT,
)

STEPS = BLOCK // LAG_STEP
"""Samples of a block that are compared with the history, along an axis."""
C = constant_indices(TAAU)
EXPOSURE, PREVIOUS_W, PREVIOUS_H, JITTER_X, JITTER_Y, CHANGE, GLARES, UNCONFIRMED = range(len(C), len(C) + 8)
"""Indices into `numbers`, after the constants of `taau`.

PREVIOUS_W, PREVIOUS_H, JITTER: render size and jitter of the previous frame. CHANGE: exposure over the
previous exposure. GLARES: 1 where any light may be unconfirmed, else 0. UNCONFIRMED: 1 where light of this
frame that raises the contrast is unconfirmed, 2 where all of it is.
"""


@device_function
def sum3(line, index):
    """Return the sums of three neighbours in a row."""
    return load16(line, index - 1) + load16(line, index) + load16(line, index + 1)


@device_function
def fit_of(across, down, deviation):
    """Return whether 3x3 samples are on a plane, [0, 1]; same as in torch.

    across: sum of the samples to the right less that of those to the left; down: of those below less above.
    """
    fraction = (
        (across * across + down * down) * np.float32(6.0 / 9.0 / 36.0) / maximum(deviation * deviation, 1e-7)
    )
    return clamped((fraction - UNFIT) * (1.0 / (FIT - UNFIT)), 0.0, 1.0)


def shade(samples: FrameSamples, line: Floats, surface: Floats, sums: Floats, y0: int, y1: int):
    """Write rows y0 to y1 of the surface, for disocclusion and lighting tests of the next frame.

    Same as `shade_of`.

    Args:
        samples: the frame.
        line: (4, PAD + stride + PAD) scratch.
        surface: (height, PAD + stride + PAD, 4), written to: occluding depth, mean and deviation of toned
            luma over 3x3 samples, whether these are on a plane, [0, 1], plus 2 where one is over
            GLARE_EXPOSED. The padding repeats the border.
        sums: (height, 2), written to: sums of each row's means and squared deviations.
        y0: the first row.
        y1: the row after the last.
    """
    colors, own, glares, eroded = samples.color, samples.own, samples.glares, samples.eroded_depth
    w, h, stride = samples.width, samples.height, samples.stride
    padded_width = stride + 2 * PAD
    for y in range(y0, y1):
        above, below = max(y - 1, 0), min(y + 1, h - 1)
        for x in range(0, w, 16):
            luma = square = usable = load16(eroded, 0) * 0.0
            for row in (above, y, below):
                index = SAMPLE_PLANES * row * padded_width + PAD + x
                luma, square = (
                    luma + load16(colors, index + 4 * padded_width),
                    square + load16(colors, index + 7 * padded_width),
                )
                usable = usable + load16(colors, index + 3 * padded_width)
            first = (SAMPLE_PLANES * above + 4) * padded_width + PAD + x
            last = (SAMPLE_PLANES * below + 4) * padded_width + PAD + x
            store(line, PAD + x, luma)
            store(line, padded_width + PAD + x, square)
            store(line, 2 * padded_width + PAD + x, usable)
            store(line, 3 * padded_width + PAD + x, load16(colors, last) - load16(colors, first))
        for c in range(4):
            first = c * padded_width + PAD
            line[first - 1], line[first + w] = line[first], line[first + w - 1]
        here = y * padded_width + PAD
        glares_near = glares[above] + glares[y] + glares[below] > 0.0
        mean_sum = square_sum = load16(eroded, 0) * 0.0
        for x in range(0, w, 16):
            usable = sum3(line, 2 * padded_width + PAD + x)
            scale = 1.0 / maximum(usable, 9e-6)
            mean = sum3(line, PAD + x) * scale
            deviation = square_root(maximum(sum3(line, padded_width + PAD + x) * scale - mean * mean, 0.0))
            glare = usable * 0.0
            if glares_near:
                glare = gather(own, (ramp16() + np.int32(y * stride + x)) * 4 + 3)
            occluding = occluding_at(samples, y, x)
            deviation = select(usable > 9.0 * MIN_WEIGHT, deviation, 1.0)
            across = load16(line, PAD + x + 1) - load16(line, PAD + x - 1)
            fit = fit_of(across, sum3(line, 3 * padded_width + PAD + x), deviation)
            fit = select(usable > 9.0 * FULL_WEIGHT, fit, 0.0)
            store4(surface, 4 * (here + x), occluding, mean, deviation, fit + 2.0 * glare)
            inside = ramp16() + np.int32(x) < np.int32(w)
            mean_sum = mean_sum + select(inside, mean, 0.0)
            square_sum = square_sum + select(inside, deviation * deviation, 0.0)
        sums[2 * y], sums[2 * y + 1] = sum_of_lanes(mean_sum), sum_of_lanes(square_sum)
        repeat_ends(surface, here, w, 4)


@device_function
def current_frame(sums, near, across, shift_x, shift_y, fit, sharpness):
    """Return `CurrentFrame` of sixteen pixels, toned YCoCg: frame, sample, confidence, centre and deviations.

    Args:
        sums: sixteen vectors by `filter_all_across`, of which the last is the slope of luma down.
        near: RGB and weight by the filter of the nearest samples.
        across: slope of luma to the right.
        shift_x: by `line_filters`.
        shift_y: the same.
        fit: whether the samples are on a plane, [0, 1].
        sharpness: fraction of Catmull-Rom in `frame`.
    """
    scale, sharp_scale = 1.0 / maximum(sums[3], 1e-6), 1.0 / maximum(sums[7], 1e-6)
    sharp = select(sums[7] > MIN_CUBIC_WEIGHT, sharpness, sums[3] * 0.0)
    smooth = scaled3((sums[0], sums[1], sums[2]), scale)
    frame = ycocg(*lerp3(smooth, scaled3((sums[4], sums[5], sums[6]), sharp_scale), sharp))
    sample = ycocg(*scaled3((near[0], near[1], near[2]), 1.0 / maximum(near[3], 1e-6)))
    scale, known = 1.0 / maximum(sums[14], 1e-6), sums[14] > MIN_BOX_WEIGHT
    luma, orange, green = scaled3((sums[8], sums[9], sums[10]), scale)
    squares = scaled3((sums[11], sums[12], sums[13]), scale)
    variance = maximum(squares[0] - luma * luma, 0.0)
    down = sums[15]
    fit = select(sums[14] > FULL_WEIGHT, fit, 0.0)
    center = luma - fit * (across * shift_x + down * shift_y), orange, green
    deviations = (
        square_root(select(known, maximum(variance - fit * (across * across + down * down), 0.0), 1.0)),
        square_root(select(known, maximum(squares[1] - orange * orange, 0.0), 1.0)),
        square_root(select(known, maximum(squares[2] - green * green, 0.0), 1.0)),
    )
    return frame, sample, minimum(near[3], 1.0), center, deviations


@device_function
def change_of_light(numbers, mean, deviation, mean_before, deviation_before):
    """Return 1 where the mean luma of a neighbourhood changed by more than jitter explains, in [0, 1]."""
    noise = maximum(deviation, deviation_before) * numbers[C.change_deviation]
    noise = noise + maximum(mean, mean_before) * numbers[C.change_relative] + MIN_CHANGE
    moved = absolute(mean - mean_before)
    return clamped((moved / noise - 1.0) / numbers[C.change_ramp], 0.0, 1.0)


@device_function
def clip_to_center(color, mean, deviations, gamma, box_floor):
    """Clip a colour towards the centre of its variance box; also return its distance, in half extents."""
    overshoot = largest(
        absolute(color[0] - mean[0]) / maximum(deviations[0] * gamma + box_floor, 1e-5),
        absolute(color[1] - mean[1]) / maximum(deviations[1] * gamma + box_floor, 1e-5),
        absolute(color[2] - mean[2]) / maximum(deviations[2] * gamma + box_floor, 1e-5),
    )
    return lerp3(mean, color, 1.0 / maximum(overshoot, 1.0)), overshoot


@device_function
def color_at_places(pixels, place):
    """Return the RGB of sixteen pixels."""
    return gather(pixels, place), gather(pixels, place + 1), gather(pixels, place + 2)


def compare_with_history(samples: FrameSamples, blocks: ComparedBlocks, y0: int, y1: int):
    """Write the sums of rows y0 to y1 of blocks; see `lag`. Sixteen blocks at once."""
    colors, stride = samples.color, samples.stride + 2 * PAD
    last_row = (samples.height - 1) // LAG_STEP * LAG_STEP
    last_column = np.int32((samples.width - 1) // LAG_STEP * LAG_STEP)
    plane = blocks.down * blocks.pitch
    for by in range(y0, y1):
        for first in range(0, blocks.across, 16):
            block = minimum(ramp16() + np.int32(first), np.int32(blocks.across - 1)) * np.int32(BLOCK)
            zero = to_float(block) * np.float32(0.0)
            apart, level = (zero, zero, zero), (zero, zero, zero)
            for i in range(STEPS * STEPS):
                row = min(BLOCK * by + LAG_STEP * (i // STEPS), last_row)
                column = minimum(block + np.int32(LAG_STEP * (i % STEPS)), last_column)
                at = column + np.int32(SAMPLE_PLANES * row * stride + PAD)
                place = gather(blocks.columns, column) + np.int32(blocks.rows[row] * blocks.width)
                place = place * np.int32(TAAU_PIXEL)
                r, g, b = color_at_places(blocks.pixels, place)
                r, g, b = toned(*scaled3((r, g, b), blocks.exposure))
                r, g, b = scaled3((r, g, b), gather(colors, at + np.int32(3 * stride)))
                level = level[0] + r, level[1] + g, level[2] + b
                apart = (
                    apart[0] + gather(colors, at) - r,
                    apart[1] + gather(colors, at + np.int32(stride)) - g,
                    apart[2] + gather(colors, at + np.int32(2 * stride)) - b,
                )
            to = by * blocks.pitch + first
            for c in range(3):
                store(blocks.sums, c * plane + to, apart[c])
                store(blocks.sums, (3 + c) * plane + to, level[c])


@device_function
def blend(
    numbers, current, around, warped_color, warped_light, warped_samples, warped_power, surface, unchanged,
    fit, glare, flash, moved, mask,
):  # fmt: skip
    """Compute `Taau.network` and `Taau.finish` of sixteen pixels.

    Args:
        numbers: constants, then the numbers of this frame.
        current: by `current_frame`.
        around: mean toned luma of 3x3 samples.
        warped_color: toned YCoCg of the warped history.
        warped_light: the same, linear RGB.
        warped_samples: number of samples in the history.
        warped_power: mean square of sample - history, toned luma; also holds the glare, see `without_glare`.
        surface: 0 where the surface was occluded in the previous frame, 1 where it was visible.
        unchanged: 1 - `change_of_light`.
        fit: whether 3x3 samples are on a plane, [0, 1].
        glare: 1 where this frame has light over GLARE_EXPOSED nearby.
        flash: 1 where the light of this frame is unconfirmed.
        moved: speed, display pixels; blur of the resampling, 0 on a pixel's centre, 1 on a corner of four.
        mask: fraction of the image that is this frame alone; 0 where the frame has no reactive mask, else 1.

    Returns:
        Linear RGB of the image; of the next history linear RGB, samples and power; weight of the history.
    """
    n, (speed, blur), (reactive, has_reactive) = numbers, moved, mask
    frame, sample, confidence, mean, deviations = current
    gamma = minimum(speed / n[C.gamma_speed], 1.0) * (n[C.gamma_moving] - n[C.gamma_still]) + n[C.gamma_still]
    warped_glare = warped_power * 0.0
    if n[GLARES] > 0.0:
        warped_power, warped_glare = without_glare(warped_power)
        unchanged = select((warped_glare > 0.0) & (warped_glare < CONFIRMED), 1.0, unchanged)
    warped_spread = square_root(warped_power)
    rectified, overshoot = clip_to_center(
        warped_color, mean, deviations, gamma, warped_spread * unchanged * n[C.gamma_time]
    )
    inside = 1.0 - clamped((overshoot - 1.0) * n[C.forget], 0.0, 1.0)
    limit = n[C.samples] / (blur * n[C.blur_cost] + speed * n[C.speed_cost] + 1.0)
    holds = surface * unchanged
    samples = minimum(warped_samples * holds * inside, limit)
    weight = confidence / maximum(samples + confidence, 1e-6)
    known, settled = samples > MIN_SAMPLES, minimum(samples / n[C.settled], 1.0)
    blended = lerp3(rectified, lerp3(frame, sample, settled), weight)
    shown, history_weight = select3(known, blended, frame), select(known, 1.0 - weight, 0.0)
    if has_reactive > 0:
        shown, history_weight = lerp3(shown, frame, reactive), history_weight * (1.0 - reactive)
        samples = samples * (1.0 - reactive)
    r, g, b = from_ycocg(*shown)
    color = linear_of(maximum(r, 0.0), maximum(g, 0.0), maximum(b, 0.0), n[EXPOSURE])

    contrast = absolute(sample[0] - around)
    contrast = contrast + fit * (minimum(absolute(sample[0] - mean[0]), contrast) - contrast)
    error = minimum(absolute(sample[0] - warped_color[0]), contrast)
    error = minimum(error, warped_spread + n[C.spread_step])
    rate = confidence / maximum(minimum(samples, n[C.spread_samples]) + confidence, 1e-6)
    next_power = maximum(warped_power + rate * (error * error - warped_power) - DARKNESS, 0.0)
    next_power = select(known, holds * next_power, 0.0)
    next_color, next_samples = color, samples + confidence
    if n[GLARES] > 0.0:
        glares = select(warped_glare < CONFIRMED - 1.0, glare, 0.0)
        trusted = select(glares > 0.0, surface, holds)
        kept = minimum(warped_samples * trusted, limit)
        adds_sample = select(maximum(glares, flash) > 0.0, kept, 0.0) <= MIN_SAMPLES
        next_color = select3(adds_sample, color, warped_light)
        next_power = select(
            adds_sample,
            next_power + glare * (GLARE * CONFIRMED),
            trusted * warped_power + minimum(warped_glare + glare, CONFIRMED) * GLARE,
        )
        next_samples = select(adds_sample, next_samples, kept)
    return color, next_color, next_samples, next_power, history_weight


def step_rows(
    samples: FrameSamples, surface: Floats, history: TaauHistoryInput, tables: ResampleTables,
    numbers: Floats, scratch: TaauScratch, output: Output, y0: int, y1: int, x0: int, x1: int,
):  # fmt: skip
    """Compute rows y0 to y1 and columns x0 to x1 of the image and the next history.

    surface: of this frame, by `shade`.
    """
    colors, stride, history_surface = samples.color, samples.stride, history.surface
    rows, down = tables.row_samples, tables.row_weights
    starts, across = tables.column_start, tables.column_weights
    line, slots, weights = scratch.line, scratch.slots, scratch.weights
    warped, out = scratch.warped, scratch.out
    next_history, image = output.next_history, output.image
    display_w, display_h, width = output.width, output.height, output.pitch
    float_w, float_h = np.float32(display_w), np.float32(display_h)
    previous_w, previous_h = np.int64(numbers[PREVIOUS_W]), np.int64(numbers[PREVIOUS_H])
    scale_x, scale_y = float_w / np.float32(samples.width), float_h / np.float32(samples.height)
    exposure, exposure_change = numbers[EXPOSURE], numbers[CHANGE]
    padded_width = stride + 2 * PAD
    luma, one_plane = np.int64(4), np.int64(1)  # as in `filter_all_down`
    for y in range(y0, y1):
        filter_all_down(colors, rows, down, display_h, y, starts, x0, x1, padded_width, line)
        near, slope, (first, last) = 4 * (3 * display_h + y), 4 * (4 * display_h + y), span(starts, x0, x1)
        filter_down(
            colors, 0, 4, rows, down, y, near, padded_width, first, last, line, FILTER_LINES * padded_width
        )
        filter_down(
            colors, luma, one_plane, rows, down, y, slope, padded_width, first, last, line, 15 * padded_width
        )
        for x in range(x0, x1, 16):
            lane = to_float(ramp16() + np.int32(x))
            depth, mx, my, _ = gather4(
                samples.dilated, tables.first_column, x, 4, 4 * tables.first_row[y] * stride
            )
            mx, my = mx * scale_x, my * scale_y
            px, py = previous_position(lane, y, mx, my, float_w, float_h)
            on = on_screen(px, py, float_w, float_h)
            prepare_warp(
                px, py, display_w, display_h, TAAU_PIXEL, numbers[C.history_sharpness], slots, weights
            )
            warp5(history.pixels, slots, weights, warped)
            q = load_columns8(warped, 0)
            warped_light = sanitize(q[0]), sanitize(q[1]), sanitize(q[2])
            warped_color = ycocg(*toned(*scaled3(warped_light, exposure)))
            # visibility and light of the surface in the previous frame
            sx = (px + 0.5) * numbers[PREVIOUS_W] / float_w - 0.5 - numbers[JITTER_X]
            sy = (py + 0.5) * numbers[PREVIOUS_H] / float_h - 0.5 - numbers[JITTER_Y]
            tap_weights = linear_taps(sx, sy, previous_w, previous_h, history.pitch, slots)
            a, b = gather4(history_surface, slots, 0, 4, 0), gather4(history_surface, slots, 0, 4, 4)
            c, d = gather4(history_surface, slots, 16, 4, 0), gather4(history_surface, slots, 16, 4, 4)
            depths_before = a[0], b[0], c[0], d[0]
            occluded = occlusion(
                depth, tap_weights, depths_before, numbers[C.depth_margin], numbers[C.depth_ramp]
            )
            same = select(on, maximum(1.0 - occluded * 2.0, 0.0), 0.0)
            mean_before = mean_of((a[1], b[1], c[1], d[1]), tap_weights)
            deviation_before = mean_of((a[2], b[2], c[2], d[2]), tap_weights)
            dim = 1.0 / (mean_before * (exposure_change - np.float32(1.0)) + 1.0)
            _, mean, deviation, fit = gather4(
                surface, tables.nearest_column, x, 4, 4 * (tables.nearest_row[y] * padded_width + PAD)
            )
            glare = select(fit > 1.5, 1.0, fit * 0.0)
            fit = fit - 2.0 * glare
            mean_before = mean_before * exposure_change * dim
            deviation_before = deviation_before * exposure_change * dim * dim
            changed = change_of_light(numbers, mean, deviation, mean_before, deviation_before)
            flash = depth * 0.0 + numbers[UNCONFIRMED]
            if numbers[UNCONFIRMED] == 1.0:
                risen = deviation * deviation > deviation_before * deviation_before * FLASH + LEAST_FLASH
                flash = select(risen, 1.0, depth * 0.0)
            tx, ty = px - floor(px), py - floor(py)
            sums = filter_all_across(line, padded_width, starts, across, width, x)
            sample = filter_across(
                line, FILTER_LINES * padded_width, padded_width, starts, across, 12, width, x
            )
            current = current_frame(
                sums, sample, filter_line_across(line, 8 * padded_width, starts, across, 16, width, x),
                load16(across, 20 * width + x), down[4 * (5 * display_h + y)], fit,
                numbers[C.frame_sharpness],
            )  # fmt: skip
            if samples.fill_pitch > 0:
                found = sums[3] > MIN_WEIGHT
                frame = ycocg(*or_fill(found, from_ycocg(*current[0]), samples, tables, x, y))
                current = frame, current[1], current[2], current[3], current[4]
            reactive = depth * 0.0
            if samples.has_reactive > 0:
                reactive = reactive_at(samples, tables, x, y)
            before_samples = q[6]
            if history.has_kept > 0:
                kept = load16(history.kept, history.kept_rows[y] * history.kept_pitch + x)
                before_samples = minimum(before_samples, kept)
            color, next_color, next_samples, next_power, weight = blend(
                numbers, current, mean, warped_color, warped_light, before_samples, q[7], same, 1.0 - changed,
                fit, glare, flash,
                (square_root(mx * mx + my * my), (tx * (1.0 - tx) + ty * (1.0 - ty)) * 2.0),
                (reactive, samples.has_reactive),
            )  # fmt: skip
            if output.has_weight:
                store(output.weight, y * width + x, weight)
            r, g, b = color
            pairs = rows8((*next_color, next_samples, next_power, r, g, b))
            for i in range(8):
                store(out, 16 * i, pairs[i])
            pixel = y * display_w + x
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
