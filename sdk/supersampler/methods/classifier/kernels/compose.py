"""Compositor of `classifier`: the twin of `Classifier.finish`, by the network's blend parameters."""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    CONFIRMED,
    GLARE,
    clamped,
    largest,
    linear_of,
    luminance,
    rgb,
    without_glare,
    ycocg,
)
from supersampler.backends.cpu.kernels.filters import places_in, tap
from supersampler.backends.cpu.layout import PAD, PAST, SAMPLED
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import (
    first_third,
    last_third,
    rows8,
    second_third,
    shifted_in,
    shifted_out,
    zipped,
)
from supersampler.backends.cpu.simd.vector import (
    absolute,
    bits_of,
    float_of,
    load8,
    load16,
    maximum,
    minimum,
    prefetch,
    ramp16,
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
    LEAST,
    MOST,
    SAMPLE,
    SURFACE,
    TONED,
)
from supersampler.methods.classifier.variant import Variant

SIDE, SHARPEST = 0.01, 2.0
ROUNDS = 12582912.0  # added to a number, leaves it rounded, in the last bits
HALVES = 32  # of a line of the caches
STREAMS_HISTORY, STREAMS_IMAGE = 1, 2  # where rows begin at lines of the caches


@device_function
def factor(value):
    """e^x, to 1e-5 of it: steps of bytes are larger."""
    x = clamped(value, -16.0, 16.0) * 1.4426950408889634
    rounded = x + ROUNDS
    f = x - (rounded - ROUNDS)
    p = (((f * 9.58285e-3 + 5.590642e-2) * f + 2.4024099e-1) * f + 6.9312419e-1) * f + 1.0
    return float_of(bits_of(p) + (bits_of(rounded) << np.int32(23)))


@device_function
def blend_parameters(blend, pitch, number, numbers, half):
    """One of so many numbers, of sixteen pixels in a row: left and right of packed ones from `half` on."""
    left, right = load8(blend, number * pitch + half), load8(blend, (number + numbers) * pitch + half)
    return zipped(left, right)


@device_function
def sharpened(color, sharp, detail):
    """A channel of the past with more of what the cubic has sharpened: `Classifier.pasts`, the first."""
    return clamped(color + sharp * detail, 0.0, TONED)


@device_function
def crossed(past_planes, above, at, below, first, last, sides, scale, sharp, detail):
    """The same, filtered by the learned cross before; first, last: where there is no left, no right."""
    up, left, right, low = sides
    v = load16(past_planes, at)
    beside = select(first, v, shifted_in(load16(past_planes, max(at - 16 * PAST, 0)), v)) * left
    beside = beside + select(last, v, shifted_out(v, load16(past_planes, at + 16 * PAST))) * right
    moved = v + load16(past_planes, above) * up + beside + load16(past_planes, below) * low
    return clamped(moved * scale + sharp * detail, 0.0, TONED)


@device_function
def cut_to_box(color, mean, reach):
    """`clip_to_center`, back in RGB."""
    y, o, g = ycocg(color[0], color[1], color[2])
    y, o, g = y - mean[0], o - mean[1], g - mean[2]
    over = largest(
        absolute(y) / maximum(reach[0], 1e-5),
        absolute(o) / maximum(reach[1], 1e-5),
        absolute(g) / maximum(reach[2], 1e-5),
    )
    cut = 1.0 / maximum(over, 1.0)
    r, g, b = rgb(mean[0] + y * cut, mean[1] + o * cut, mean[2] + g * cut)
    return clamped(r, 0.0, TONED), clamped(g, 0.0, TONED), clamped(b, 0.0, TONED)


@device_function
def three(planes, at):
    return load16(planes, at), load16(planes, at + 16), load16(planes, at + 32)


@device_function
def added(sums, weight, color):
    """Sums of weighted colours and of the weights."""
    r, g, b, total = sums
    return r + color[0] * weight, g + color[1] * weight, b + color[2] * weight, total + weight


def make_compose_row(variant: Variant):
    """Return `compose_row` of a variant."""
    corrected, rectified, own_motion = variant
    planes, mean, own = variant.rest, variant.mean, variant.own
    sample_weight, sharpness, kernel = variant.pasts, variant.sharpness, variant.kernel_weights
    numbers = variant.blend_parameters

    @device_function
    def compose_row(y, blend, blend_pitch, gathered, read, tables, constants, output, out, x0, x1):
        """Compose columns x0 to x1 of a row, count, and go back to linear RGB."""
        past_planes, rest, width = gathered.history, gathered.rest, gathered.pitch
        samples, wide, h = read.color, read.stride + 2 * PAD, read.height
        columns_near, row_near = tables.nearest_column, tables.nearest_row[y]
        across, down = tables.column_windows, tables.row_windows
        exposure, glares, streams = constants.exposure, constants.glares, constants.streams
        flash = constants.flash
        big_w, big_h, history, image = output.width, output.height, output.next_history, output.image
        zero = spread16(np.float32(0.0))
        above, below = max(y - 1, 0) * width, min(y + 1, big_h - 1) * width
        m = 2 * numbers * (y % 2)
        for x in range(x0, x1, 16):
            at, half = (y * width + x) * PAST, (y * width + x) * planes
            pixels = x // 2
            for line in range(0, 16 * planes, HALVES):
                prefetch(rest, half + 16 * planes + line)
            # the past
            sharp = clamped(
                blend_parameters(blend, blend_pitch, m + sharpness, numbers, pixels), 0.0, SHARPEST
            )
            detail = three(rest, half + 16 * DETAIL)
            if corrected:
                lane, cross = ramp16() + np.int32(x), m + sharpness + 1
                first, last = lane == np.int32(0), lane == np.int32(big_w - 1)
                up = factor(blend_parameters(blend, blend_pitch, cross, numbers, pixels)) * SIDE
                left = factor(blend_parameters(blend, blend_pitch, cross + 1, numbers, pixels)) * SIDE
                right = factor(blend_parameters(blend, blend_pitch, cross + 2, numbers, pixels)) * SIDE
                low = factor(blend_parameters(blend, blend_pitch, cross + 3, numbers, pixels)) * SIDE
                sides, scale = (up, left, right, low), 1.0 / (up + left + right + low + 1.0)
                a, c = (above + x) * PAST, (below + x) * PAST
                color = (
                    crossed(past_planes, a, at, c, first, last, sides, scale, sharp, detail[0]),
                    crossed(
                        past_planes, a + 16, at + 16, c + 16, first, last, sides, scale, sharp, detail[1]
                    ),
                    crossed(
                        past_planes, a + 32, at + 32, c + 32, first, last, sides, scale, sharp, detail[2]
                    ),
                )
            else:
                moved = three(past_planes, at)
                color = (
                    sharpened(moved[0], sharp, detail[0]),
                    sharpened(moved[1], sharp, detail[1]),
                    sharpened(moved[2], sharp, detail[2]),
                )
            count = load16(rest, half + 16 * COUNT)
            known = count > 0.0
            other = select(known, count * 0.1 + 1e-3, 0.0)
            begun = select(known, count * load16(rest, half + 16 * SURFACE) + 1e-3, 0.0)
            none = zero, zero, zero, zero
            past = added(
                none, begun * factor(blend_parameters(blend, blend_pitch, m, numbers, pixels)), color
            )
            if rectified:
                cut = cut_to_box(color, three(rest, half + 16 * mean), three(rest, half + 16 * (mean + 3)))
                past = added(
                    past, other * factor(blend_parameters(blend, blend_pitch, m + 1, numbers, pixels)), cut
                )
            if own_motion:
                moved = three(rest, half + 16 * own)
                number = m + sample_weight - 1
                past = added(
                    past, other * factor(blend_parameters(blend, blend_pitch, number, numbers, pixels)), moved
                )
            kept = past[3]
            # this frame
            first, step, index = places_in(columns_near, x)
            q = zero, zero, zero, zero
            for k in range(9):
                begun = load16(across, (k % 3) * width + x) * down[3 * y + k // 3] + 1e-4
                number = m + kernel + k
                weigh = begun * factor(blend_parameters(blend, blend_pitch, number, numbers, pixels))
                row = min(max(row_near + k // 3 - 1, 0), h - 1)
                at_row = SAMPLED * row * wide + PAD + first
                q = tap(samples, at_row + k % 3 - 1, wide, step, index, weigh, q)
            frame = three(rest, half + 16 * FRAME)
            some, scale = q[3] > 1e-9, 1.0 / maximum(q[3], 1e-12)
            filtered = (
                select(some, q[0] * scale, frame[0]),
                select(some, q[1] * scale, frame[1]),
                select(some, q[2] * scale, frame[2]),
            )
            confidence = load16(rest, half + 16 * CONFIDENCE)
            there = select(q[3] > 0.0, spread16(np.float32(1.0)), zero)
            sampled, beside = there * (confidence + 1e-3), there * 0.05
            sample = three(rest, half + 16 * SAMPLE)
            number = m + sample_weight
            now = added(
                none, sampled * factor(blend_parameters(blend, blend_pitch, number, numbers, pixels)), sample
            )
            now = added(
                now, beside * factor(blend_parameters(blend, blend_pitch, number + 1, numbers, pixels)), frame
            )
            now = added(
                now,
                beside * factor(blend_parameters(blend, blend_pitch, number + 2, numbers, pixels)),
                filtered,
            )
            new = now[3]
            scale = 1.0 / maximum(kept + new, 1e-12)
            r, g, b = (past[0] + now[0]) * scale, (past[1] + now[1]) * scale, (past[2] + now[2]) * scale
            r, g, b = linear_of(r, g, b, exposure)
            if output.has_weight:
                store(output.weight, y * width + x, kept * scale)
            # what the next frame looks back on
            odds = kept / maximum(new, 1e-12) * (sampled + beside + beside)
            worth = minimum(minimum(odds, count), constants.most_samples) + confidence
            luma = luminance(sample[0], sample[1], sample[2])
            held = select(known, minimum(odds * 4.0 / maximum(count, 1e-6), 1.0), 0.0)
            rate = confidence * constants.contraction
            least, most = load16(rest, half + 16 * LEAST), load16(rest, half + 16 * MOST)
            glared = most * 0.0
            if glares:
                most, glared = without_glare(most)
                worth = select((glared > 0.0) & (glared < CONFIRMED), 0.0, worth)
            if flash:
                worth = zero
            least = minimum(least, luma) + rate * maximum(luma - least, 0.0)
            most = maximum(most, luma) - rate * maximum(most - luma, 0.0)
            least, most = luma + held * (least - luma), luma + held * (most - luma)
            most = most + glared * GLARE
            remember(r, g, b, worth, least, most, y * big_w + x, big_w - x, streams, history, image, out)

    return compose_row


@device_function
def remember(r, g, b, count, least, most, pixel, room, streams, history, image, out):
    """Write up to sixteen pixels of the picture, and what goes from frame to frame."""
    zero = count * 0.0
    rows = rows8((r, g, b, count, least, most, zero, zero))
    if room < 16:
        for i in range(8):
            store(out, 16 * i, rows[i])
        for i in range(room):
            store(history, 8 * (pixel + i), load8(out, 8 * i))
            for c in range(3):
                image[3 * (pixel + i) + c] = out[8 * i + c]
        return
    for i in range(8):
        put(history, 8 * pixel + 16 * i, rows[i], streams & STREAMS_HISTORY)
    put(image, 3 * pixel, first_third(r, g, b), streams & STREAMS_IMAGE)
    put(image, 3 * pixel + 16, second_third(r, g, b), streams & STREAMS_IMAGE)
    put(image, 3 * pixel + 32, last_third(r, g, b), streams & STREAMS_IMAGE)


@device_function
def put(pointer, index, vector, past_caches):
    if past_caches:
        stream(pointer, index, vector)
    else:
        store(pointer, index, vector)
