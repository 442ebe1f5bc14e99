"""Compositor of `classifier`; same as `Classifier.finish` for one row of display pixels."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    clamped,
    from_ycocg,
    largest,
    linear_of,
    luminance,
    without_glare,
    ycocg,
)
from supersampler.backends.cpu.kernels.filters import places_in, tap
from supersampler.backends.cpu.kernels.frame import reactive_at
from supersampler.backends.cpu.layout import HISTORY_PLANES, PAD, SAMPLE_PLANES
from supersampler.backends.cpu.simd.shuffles import first_third, last_third, rows8, second_third, zipped
from supersampler.backends.cpu.simd.vector import (
    absolute,
    bits_of,
    device_function,
    float_of,
    load8,
    load16,
    maximum,
    minimum,
    prefetch,
    select,
    spread16,
    store,
    stream,
)
from supersampler.methods.classifier.kernels.gather import (
    CONFIDENCE,
    COUNT,
    DETAIL,
    FRAME,
    MAX_LUMA,
    MIN_LUMA,
    SAMPLE,
    SURFACE,
    light_rises,
)
from supersampler.methods.classifier.spec import (
    FRAME_PRIOR,
    HALF_COUNT,
    MAX_LOG_FACTOR,
    MAX_SHARPNESS,
    MIN_PRIOR,
    OTHER_PRIOR,
)
from supersampler.methods.classifier.structs import Variant
from supersampler.methods.constants import CONFIRMED, GLARE, MAX_TONED, MIN_KERNEL_WEIGHT
from supersampler.methods.gbuffer.spec import NEIGHBOUR_WEIGHTS

CENTER, SIDE, CORNER = (np.float32(NEIGHBOUR_WEIGHTS[k]) for k in (4, 1, 0))
ROUNDS = 12582912.0  # 1.5 * 2^23: the sum has the rounded number in its last bits
HALVES = 32  # fp16 values of a cache line
STREAMS_HISTORY, STREAMS_IMAGE = 1, 2  # bits of `streams`: rows begin at cache lines, and bypass the caches


@device_function
def factor(value):
    """Return e^x for x clamped to [-16, 16], with a relative error of 1e-5."""
    x = clamped(value, -MAX_LOG_FACTOR, MAX_LOG_FACTOR) * 1.4426950408889634
    rounded = x + ROUNDS
    f = x - (rounded - ROUNDS)
    p = (((f * 9.58285e-3 + 5.590642e-2) * f + 2.4024099e-1) * f + 6.9312419e-1) * f + 1.0
    return float_of(bits_of(p) + (bits_of(rounded) << np.int32(23)))


@device_function
def blend_parameters(blend, pitch, index, count, half):
    """Return one of `count` blend parameters at sixteen pixels of a row, from packed pixel `half` on."""
    left, right = load8(blend, index * pitch + half), load8(blend, (index + count) * pitch + half)
    return zipped(left, right)


@device_function
def sharpened(color, sharpness, detail):
    """Return a channel of the history with detail added; see `Classifier.history_colors`."""
    return clamped(color + sharpness * detail, 0.0, MAX_TONED)


@device_function
def clip_to_center(color, mean, extents):
    """Clip RGB towards the centre of a variance box in YCoCg; return RGB."""
    y, co, cg = ycocg(color[0], color[1], color[2])
    y, co, cg = y - mean[0], co - mean[1], cg - mean[2]
    overshoot = largest(
        absolute(y) / maximum(extents[0], 1e-5),
        absolute(co) / maximum(extents[1], 1e-5),
        absolute(cg) / maximum(extents[2], 1e-5),
    )
    scale = 1.0 / maximum(overshoot, 1.0)
    r, g, b = from_ycocg(mean[0] + y * scale, mean[1] + co * scale, mean[2] + cg * scale)
    return clamped(r, 0.0, MAX_TONED), clamped(g, 0.0, MAX_TONED), clamped(b, 0.0, MAX_TONED)


@device_function
def three(planes, at):
    """Load three vectors that lie one after the other."""
    return load16(planes, at), load16(planes, at + 16), load16(planes, at + 32)


@device_function
def added(sums, weight, color):
    """Add a weighted colour to the sums of colours and of weights."""
    r, g, b, total = sums
    return r + color[0] * weight, g + color[1] * weight, b + color[2] * weight, total + weight


@device_function
def neighbour_weight(k):
    """Return the initial weight of one of 3x3 pixels."""
    if k == 4:
        return CENTER
    return SIDE if k % 2 else CORNER


def make_compose_row(variant: Variant):
    """Return `compose_row` of a variant."""
    rectified, own_motion, guided = variant
    planes, mean, own, sampled_plane = variant.rest, variant.mean, variant.own, variant.sampled
    sample_weight, sharpness, kernel = variant.history_colors, variant.sharpness, variant.kernel_weights
    parameters = variant.blend_parameters

    @device_function
    def compose_row(y, blend, blend_pitch, gathered, samples, tables, constants, output, out, x0, x1):
        """Compute the image, linear RGB, and the next history of columns x0 to x1 of row y."""
        warped_planes, rest, width = gathered.history, gathered.rest, gathered.pitch
        colors, padded_width, h = samples.color, samples.stride + 2 * PAD, samples.height
        columns_near, row_near = tables.nearest_column, tables.nearest_row[y]
        across, down = tables.column_windows, tables.row_windows
        exposure, glares, streams = constants.exposure, constants.glares, constants.streams
        flash, guided_image, image_pitch = constants.flash, gathered.image, width + 2 * PAD
        big_w, big_h, history_out, image = output.width, output.height, output.next_history, output.image
        zero = spread16(np.float32(0.0))
        m = 2 * parameters * (y % 2)
        for x in range(x0, x1, 16):
            at, rest_at = (y * width + x) * HISTORY_PLANES, (y * width + x) * planes
            pixels = x // 2
            for line in range(0, 16 * planes, HALVES):
                prefetch(rest, rest_at + 16 * planes + line)
            # current colours
            none = zero, zero, zero, zero
            sums = none
            if guided:
                for k in range(9):
                    number, row = m + kernel + k, min(max(y + k // 3 - 1, 0), big_h - 1)
                    tap_weight = neighbour_weight(k) * factor(
                        blend_parameters(blend, blend_pitch, number, parameters, pixels)
                    )
                    place = 3 * row * image_pitch + PAD + x + k % 3 - 1
                    neighbour = (
                        load16(guided_image, place),
                        load16(guided_image, place + image_pitch),
                        load16(guided_image, place + 2 * image_pitch),
                    )
                    sums = added(sums, tap_weight, neighbour)
            else:
                first, step, index = places_in(columns_near, x)
                for k in range(9):
                    initial = load16(across, (k % 3) * width + x) * down[3 * y + k // 3] + MIN_KERNEL_WEIGHT
                    number = m + kernel + k
                    tap_weight = initial * factor(
                        blend_parameters(blend, blend_pitch, number, parameters, pixels)
                    )
                    row = min(max(row_near + k // 3 - 1, 0), h - 1)
                    at_row = SAMPLE_PLANES * row * padded_width + PAD + first
                    sums = tap(colors, at_row + k % 3 - 1, padded_width, step, index, tap_weight, sums)
            frame = three(rest, rest_at + 16 * FRAME)
            any_usable, scale = sums[3] > 1e-9, 1.0 / maximum(sums[3], 1e-12)
            filtered = (
                select(any_usable, sums[0] * scale, frame[0]),
                select(any_usable, sums[1] * scale, frame[1]),
                select(any_usable, sums[2] * scale, frame[2]),
            )
            confidence = load16(rest, rest_at + 16 * CONFIDENCE)
            if guided:
                sampled_here = load16(rest, rest_at + 16 * sampled_plane)
            else:
                sampled_here = select(sums[3] > 0.0, spread16(np.float32(1.0)), zero)
            sampled, frame_weight = sampled_here * (confidence + MIN_PRIOR), sampled_here * FRAME_PRIOR
            sample = three(rest, rest_at + 16 * SAMPLE)
            number = m + sample_weight
            current = added(
                none,
                sampled * factor(blend_parameters(blend, blend_pitch, number, parameters, pixels)),
                sample,
            )
            current = added(
                current,
                frame_weight * factor(blend_parameters(blend, blend_pitch, number + 1, parameters, pixels)),
                frame,
            )
            current = added(
                current,
                frame_weight * factor(blend_parameters(blend, blend_pitch, number + 2, parameters, pixels)),
                filtered,
            )
            # history colours
            number, count = m + sample_weight - 1, load16(rest, rest_at + 16 * COUNT)
            visible = count * load16(rest, rest_at + 16 * SURFACE)
            known = visible > 0.0
            initial = select(known, visible + MIN_PRIOR, 0.0)
            other = select(known, count * OTHER_PRIOR + MIN_PRIOR, 0.0)
            first = initial * factor(blend_parameters(blend, blend_pitch, m, parameters, pixels))
            second = third = zero
            history_weight = zero + first
            if rectified:
                second = other * factor(blend_parameters(blend, blend_pitch, m + 1, parameters, pixels))
                history_weight = history_weight + second
            if own_motion:
                third = other * factor(blend_parameters(blend, blend_pitch, number, parameters, pixels))
                history_weight = history_weight + third
            strength = clamped(
                blend_parameters(blend, blend_pitch, m + sharpness, parameters, pixels), 0.0, MAX_SHARPNESS
            )
            detail = three(rest, rest_at + 16 * DETAIL)
            warped = three(warped_planes, at)
            color = (
                sharpened(warped[0], strength, detail[0]),
                sharpened(warped[1], strength, detail[1]),
                sharpened(warped[2], strength, detail[2]),
            )
            kept = zero + 1.0
            if samples.has_reactive > 0:
                reactive, now = reactive_at(samples, tables, x, y), maximum(current[3], 1e-12)
                kept = (1.0 - reactive) * (now / (now + reactive * history_weight))
            first, second, third = first * kept, second * kept, third * kept
            history_weight = history_weight * kept
            history = added(none, first, color)
            if rectified:
                clipped = clip_to_center(
                    color, three(rest, rest_at + 16 * mean), three(rest, rest_at + 16 * (mean + 3))
                )
                history = added(history, second, clipped)
            if own_motion:
                history = added(history, third, three(rest, rest_at + 16 * own))
            current_weight = current[3]
            total = history_weight + current_weight
            scale, found = 1.0 / maximum(total, 1e-12), total > 0.0
            r, g, b = (
                select(found, (history[0] + current[0]) * scale, frame[0]),
                select(found, (history[1] + current[1]) * scale, frame[1]),
                select(found, (history[2] + current[2]) * scale, frame[2]),
            )
            r, g, b = linear_of(r, g, b, exposure)
            if output.has_weight:
                store(output.weight, y * width + x, history_weight * scale)
            # next history
            odds = history_weight / maximum(current_weight, 1e-12) * (sampled + frame_weight + frame_weight)
            next_count = minimum(minimum(odds, count), constants.most_samples) + confidence
            luma = luminance(sample[0], sample[1], sample[2])
            trust = select(known, minimum(odds * HALF_COUNT / maximum(count, 1e-6), 1.0), 0.0)
            rate = confidence * constants.contraction
            low, high = load16(rest, rest_at + 16 * MIN_LUMA), load16(rest, rest_at + 16 * MAX_LUMA)
            warped_glare = high * 0.0
            if glares:
                high, warped_glare = without_glare(high)
                if constants.rises:
                    surface = load16(rest, rest_at + 16 * SURFACE)
                    rises = light_rises(luma, high, count, surface)
                    warped_glare = maximum(warped_glare, select(rises, 1.0, zero))
                next_count = select((warped_glare > 0.0) & (warped_glare < CONFIRMED), 0.0, next_count)
            if flash:
                next_count = zero
            low = minimum(low, luma) + rate * maximum(luma - low, 0.0)
            high = maximum(high, luma) - rate * maximum(high - luma, 0.0)
            low, high = luma + trust * (low - luma), luma + trust * (high - luma)
            high = high + warped_glare * GLARE
            store_pixels(
                r, g, b, next_count, low, high, y * big_w + x, big_w - x, streams, history_out, image, out
            )

    return compose_row


@device_function
def store_pixels(r, g, b, count, low, high, pixel, remaining, streams, history, image, out):
    """Write up to sixteen pixels of the image and of the next history."""
    zero = count * 0.0
    rows = rows8((r, g, b, count, low, high, zero, zero))
    if remaining < 16:
        for i in range(8):
            store(out, 16 * i, rows[i])
        for i in range(remaining):
            store(history, 8 * (pixel + i), load8(out, 8 * i))
            for c in range(3):
                image[3 * (pixel + i) + c] = out[8 * i + c]
        return
    for i in range(8):
        store_or_stream(history, 8 * pixel + 16 * i, rows[i], streams & STREAMS_HISTORY)
    store_or_stream(image, 3 * pixel, first_third(r, g, b), streams & STREAMS_IMAGE)
    store_or_stream(image, 3 * pixel + 16, second_third(r, g, b), streams & STREAMS_IMAGE)
    store_or_stream(image, 3 * pixel + 32, last_third(r, g, b), streams & STREAMS_IMAGE)


@device_function
def store_or_stream(pointer, index, vector, streams):
    """Store a vector, past the caches where `streams` is set."""
    if streams:
        stream(pointer, index, vector)
    else:
        store(pointer, index, vector)
