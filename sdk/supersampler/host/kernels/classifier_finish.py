"""Finish of `classifier` on a processor: the network's last layers, and what `Classifier.finish` does."""

import numpy as np
from numba import njit

from supersampler.host.kernels.classifier_gather import (
    CONFIDENCE,
    COUNT,
    DETAIL,
    FRAME,
    HALVES,
    LEAST,
    MEAN,
    MOST,
    OWN,
    PAST,
    REACH,
    SAMPLE,
    SURFACE,
    TONED,
    WHOLE,
)
from supersampler.host.kernels.colors import (
    clamped,
    exponential,
    largest,
    linear_of,
    luminance,
    rgb,
    ycocg,
)
from supersampler.host.kernels.network import SIX, concatenate_row, pointwise_row, two_by_six
from supersampler.host.kernels.types import Bytes, Floats, Halves, Words
from supersampler.host.vector import (
    absolute,
    load4,
    load8,
    load16,
    load_columns,
    maximum,
    minimum,
    ramp16,
    select,
    spread16,
    store,
    to_float,
    to_int,
    transposed,
)

SIDE, SHARPEST = 0.01, 2.0
SAID, MIXING = 20, 96  # numbers of a pixel; of four, with room


@njit
def mix_row(hidden, pitch, words, weights, scales, biases, half_width, out):
    """The last layer of a row of packed pixels: (half_width, MIXING) float32."""
    for p in range(0, half_width, SIX):
        for block in range(3):
            sums = two_by_six(hidden, pitch, words, weights, 32 * words * block, p * pitch)
            c = 32 * block
            u, v = load16(scales, c), load16(scales, c + 16)
            s, t = load16(biases, c), load16(biases, c + 16)
            for i in range(SIX):
                store(out, (p + i) * MIXING + c, to_float(sums[2 * i]) * u + s)
                store(out, (p + i) * MIXING + c + 16, to_float(sums[2 * i + 1]) * v + t)


@njit
def hold_row(hidden, pitch, first, scale, half_width, rows, classes, to):
    """Shares of the classes of packed pixels, eight bytes each, from their logits."""
    for x in range(0, half_width, 16):
        for i in range(16):
            at = min(x + i, half_width - 1) * pitch + first
            store(rows, 16 * i, (to_float(load16(hidden, at)) - 128.0) * scale)
        q = load_columns(rows, 0)
        a, b, c = factor(q[0]), factor(q[1]), factor(q[2])
        d, e, f = factor(q[3]), factor(q[4]), factor(q[5])
        one, two = 255.0 / (a + b + c), 255.0 / (d + e + f)
        zero = spread16(np.float32(0.0))
        back = transposed((
            a * one, b * one, c * one, d * two, e * two, f * two, zero, zero,
            zero, zero, zero, zero, zero, zero, zero, zero,
        ))  # fmt: skip
        for i in range(16):
            store(rows, 16 * i, back[i])
        for i in range(min(16, half_width - x)):
            store(classes, to + 8 * (x + i), to_int(load8(rows, 16 * i) + 0.5))


@njit
def factor(value):
    return exponential(clamped(value, -16.0, 16.0))


@njit
def said(mixing, at):
    """What the compositor says of sixteen pixels: sixteen of its numbers from `at` on."""
    m = mixing
    return transposed((
        load16(m, at), load16(m, at + 20), load16(m, at + 96), load16(m, at + 116),
        load16(m, at + 192), load16(m, at + 212), load16(m, at + 288), load16(m, at + 308),
        load16(m, at + 384), load16(m, at + 404), load16(m, at + 480), load16(m, at + 500),
        load16(m, at + 576), load16(m, at + 596), load16(m, at + 672), load16(m, at + 692),
    ))  # fmt: skip


@njit
def moved_past(whole, above, at, below, halves, half, pitch, lane, big_w, m):
    """The past filtered by the learned cross and sharpened: `Classifier.pasts`, the first."""
    first, last = lane == np.int32(0), lane == np.int32(big_w - 1)
    up, left, right, low = factor(m[7]) * SIDE, factor(m[8]) * SIDE, factor(m[9]) * SIDE, factor(m[10]) * SIDE
    scale, sharp = 1.0 / (up + left + right + low + 1.0), clamped(m[6], 0.0, SHARPEST)
    r = g = b = sharp
    for c in range(3):
        p = (PAST + c) * pitch
        v = load16(whole, at + p)
        beside = select(first, v, load16(whole, at + p - 1)) * left
        beside = beside + select(last, v, load16(whole, at + p + 1)) * right
        moved = v + load16(whole, above + p) * up + beside + load16(whole, below + p) * low
        v = moved * scale + sharp * load16(halves, half + (DETAIL + c) * pitch)
        r, g, b = g, b, clamped(v, 0.0, TONED)
    return r, g, b


@njit
def cut_to_box(color, halves, at, pitch):
    """`clip_to_center`, back in RGB."""
    mean = three(halves, at + MEAN * pitch, pitch)
    reach = three(halves, at + REACH * pitch, pitch)
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


@njit
def three(planes, at, pitch):
    return load16(planes, at), load16(planes, at + pitch), load16(planes, at + 2 * pitch)


@njit
def kernel_of(samples, stride, w, h, row, near, factors, out):
    """Sums of sixteen pixels' 3x3 samples by learned weights: red, green, blue and of the weights."""
    for i in range(16):
        column = near[i]
        total = load4(samples, 0) * np.float32(0.0)
        for dy in range(3):
            y = min(max(row + dy - 1, 0), h - 1) * stride
            for dx in range(3):
                x = min(max(column + dx - 1, 0), w - 1)
                total = total + load4(samples, 16 * (y + x)) * factors[16 * (3 * dy + dx) + i]
        store(out, 16 * i, total)


@njit
def added(sums, weight, color):
    """Sums of weighted colours and of the weights."""
    r, g, b, total = sums
    return r + color[0] * weight, g + color[1] * weight, b + color[2] * weight, total + weight


@njit
def compose_row(
    y, mixing, whole, halves, width, samples, stride, w, h, columns_near, row_near, across, down,
    near, factors, out, big_w, big_h, exposure, most_samples, contraction, history, image, weight, tells,
):  # fmt: skip
    """Compose a row, count, and go back to linear RGB."""
    zero = spread16(np.float32(0.0))
    pitch = WHOLE * width
    above, below = max(y - 1, 0) * pitch, min(y + 1, big_h - 1) * pitch
    for x in range(0, width, 16):
        at, half = y * pitch + x, y * HALVES * width + x
        m = said(mixing, MIXING * x // 2 + 2 * SAID * (y % 2))
        n = said(mixing, MIXING * x // 2 + 2 * SAID * (y % 2) + SAID - 16)
        # the past
        lane = ramp16() + np.int32(x)
        color = moved_past(whole, above + x, at, below + x, halves, half, width, lane, big_w, m)
        count = load16(whole, at + COUNT * width)
        known = count > 0.0
        other = select(known, count * 0.1 + 1e-3, 0.0)
        begun = select(known, count * load16(halves, half + SURFACE * width) + 1e-3, 0.0)
        none = zero, zero, zero, zero
        past = added(none, begun * factor(m[0]), color)
        past = added(past, other * factor(m[1]), cut_to_box(color, halves, half, width))
        past = added(past, other * factor(m[2]), three(whole, at + OWN * width, width))
        kept = past[3]
        # this frame
        store(near, 0, load16(columns_near, x))
        for k in range(9):
            begun = load16(across, (k % 3) * width + x) * down[3 * y + k // 3] + 1e-4
            store(factors, 16 * k, begun * factor(n[7 + k]))
        kernel_of(samples, stride, w, h, row_near, near, factors, out)
        q = load_columns(out, 0)
        frame = three(halves, half + FRAME * width, width)
        some, scale = q[3] > 1e-9, 1.0 / maximum(q[3], 1e-12)
        filtered = (
            select(some, q[0] * scale, frame[0]),
            select(some, q[1] * scale, frame[1]),
            select(some, q[2] * scale, frame[2]),
        )
        confidence = load16(halves, half + CONFIDENCE * width)
        there = select(q[3] > 0.0, spread16(np.float32(1.0)), zero)
        sampled, beside = there * (confidence + 1e-3), there * 0.05
        sample = three(halves, half + SAMPLE * width, width)
        now = added(none, sampled * factor(m[3]), sample)
        now = added(now, beside * factor(m[4]), frame)
        now = added(now, beside * factor(m[5]), filtered)
        new = now[3]
        scale = 1.0 / maximum(kept + new, 1e-12)
        r, g, b = (past[0] + now[0]) * scale, (past[1] + now[1]) * scale, (past[2] + now[2]) * scale
        r, g, b = linear_of(r, g, b, exposure)
        if tells:
            store(weight, y * width + x, kept * scale)
        # what the next frame looks back on
        odds = kept / maximum(new, 1e-12) * (sampled + beside + beside)
        worth = minimum(minimum(odds, count), most_samples) + confidence
        luma = luminance(sample[0], sample[1], sample[2])
        held = select(known, minimum(odds * 4.0 / maximum(count, 1e-6), 1.0), 0.0)
        rate = confidence * contraction
        least, most = load16(whole, at + LEAST * width), load16(whole, at + MOST * width)
        least = minimum(least, luma) + rate * maximum(luma - least, 0.0)
        most = maximum(most, luma) - rate * maximum(most - luma, 0.0)
        least, most = luma + held * (least - luma), luma + held * (most - luma)
        rows = transposed((
            r, g, b, worth, least, most, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero,
        ))  # fmt: skip
        for i in range(16):
            store(out, 16 * i, rows[i])
        for i in range(min(16, big_w - x)):
            pixel = y * big_w + x + i
            store(history, 8 * pixel, load8(out, 16 * i))
            image[3 * pixel] = out[16 * i]
            image[3 * pixel + 1] = out[16 * i + 1]
            image[3 * pixel + 2] = out[16 * i + 2]


def finish_rows(
    kept0: Bytes, kept1: Bytes, kept2: Bytes, kept3: Bytes, pitches: Words, read: Bytes, read_words: Words,
    decoder: Words, decoder_scale: Floats, decoder_bias: Floats, records: Words, record_bytes: Bytes,
    record_row: int, hidden_weights: Words, blocks: int, hidden_scale: Floats, hidden_bias: Floats,
    hidden: Bytes, hidden_words: Words, logits: int, logits_scale: float, mixing_words: int,
    mixing_weights: Words, mixing_scale: Floats, mixing_bias: Floats, mixing: Floats, classes: Bytes,
    whole: Floats, halves: Halves, width: int, samples: Floats, stride: int, w: int, h: int,
    columns_near: Words, rows_near: Words, across: Floats, down: Floats, near: Words, factors: Floats,
    out: Floats, big_w: int, big_h: int, exposure: float, most_samples: float, contraction: float,
    history: Floats, image: Floats, weight: Floats, tells: int, y0: int, y1: int,
):  # fmt: skip
    """Decode, compose and remember packed rows y0 to y1.

    kept0 to kept3: what the levels gave; read, hidden (words of the same bytes), mixing, near, factors, out:
    scratch rows. classes, history, image, weight (where `tells`): what comes out.
    """
    half_w = (big_w + 1) // 2
    for y in range(y0, y1):
        concatenate_row(kept0, kept1, kept2, kept3, pitches, y, half_w, read)
        to = 4 * y * record_row + 80
        pointwise_row(
            read_words, 0, 8, 8, decoder, 1, decoder_scale, decoder_bias, record_bytes, to, 112, half_w
        )
        pointwise_row(
            records, y * record_row, 28, 28, hidden_weights, blocks, hidden_scale, hidden_bias,
            hidden, 0, 32 * blocks, half_w,
        )  # fmt: skip
        hold_row(hidden, 32 * blocks, logits, logits_scale, half_w, out, classes, 8 * y * half_w)
        mix_row(
            hidden_words, 8 * blocks, mixing_words, mixing_weights, mixing_scale, mixing_bias, half_w, mixing
        )
        for row in range(2 * y, min(2 * y + 2, big_h)):
            compose_row(
                row, mixing, whole, halves, width, samples, stride, w, h, columns_near, rows_near[row],
                across, down, near, factors, out, big_w, big_h, exposure, most_samples, contraction,
                history, image, weight, tells,
            )  # fmt: skip
