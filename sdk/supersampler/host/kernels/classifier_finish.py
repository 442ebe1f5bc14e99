"""Finish of `classifier` on a processor: the network's last layers, and what `Classifier.finish` does."""

import numpy as np
from numba import njit

from supersampler.host.kernels.classifier_gather import (
    CONFIDENCE,
    COUNT,
    DETAIL,
    FRAME,
    LEAST,
    MEAN,
    MOST,
    OWN,
    REACH,
    SAMPLE,
    SURFACE,
    TONED,
)
from supersampler.host.kernels.colors import (
    clamped,
    largest,
    linear_of,
    luminance,
    rgb,
    ycocg,
)
from supersampler.host.kernels.network import concatenate_row, pointwise_row, pointwise_row_of_two
from supersampler.host.kernels.types import Bytes, Floats, Halves, Words
from supersampler.host.layout import PAST, RECORD, REST, SAID, SEEN
from supersampler.host.shuffles import (
    first_third,
    last_third,
    load_columns,
    load_columns4,
    rows8,
    second_third,
    shifted_in,
    shifted_out,
    zipped,
)
from supersampler.host.vector import (
    absolute,
    dot4,
    float_of,
    floor,
    load4,
    load8,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    spread16,
    store,
    stream,
    to_float,
    to_int,
)

SIDE, SHARPEST = 0.01, 2.0
STREAMS_HISTORY, STREAMS_IMAGE = 1, 2  # where rows begin at lines of the caches
SHARPNESS, CROSS, KERNEL = 6, 7, 11  # of SAID, after logarithms of weights: of the past, of this frame
WIDE = 16  # words of what the hidden layer gives


@njit
def mix_row(hidden, words, weights, scales, biases, p0, p1, pitch, columns, out, logits, scale, classes, to):
    """The last layer of packed pixels p0 to p1 of a row, (4 SAID, pitch), and the shares of their classes.

    Sixteen pixels side by side: columns (WIDE, 16) is scratch, their bytes word by word.
    """
    for p in range(p0, p1, 16):
        rows = load_columns(hidden, WIDE * p)
        for k in range(WIDE):
            store(columns, 16 * k, rows[k])
        for c in range(0, 4 * SAID, 8):
            sums = eight_sums(columns, words, weights, c * words)
            for i in range(8):
                store(out, (c + i) * pitch + p, to_float(sums[i]) * scales[c + i] + biases[c + i])
        hold(columns, logits, scale, p1 - p, classes, to + 8 * p)


@njit
def eight_sums(columns, words, weights, first):
    """Eight outputs of sixteen pixels."""
    a = b = c = d = e = f = g = h = spread16(np.int32(0))
    for k in range(words):
        x = load16(columns, 16 * k)
        w = first + k
        a, b = dot4(a, x, spread16(weights[w])), dot4(b, x, spread16(weights[w + words]))
        w = w + 2 * words
        c, d = dot4(c, x, spread16(weights[w])), dot4(d, x, spread16(weights[w + words]))
        w = w + 2 * words
        e, f = dot4(e, x, spread16(weights[w])), dot4(f, x, spread16(weights[w + words]))
        w = w + 2 * words
        g, h = dot4(g, x, spread16(weights[w])), dot4(h, x, spread16(weights[w + words]))
    return a, b, c, d, e, f, g, h


@njit
def hold(columns, logits, scale, count, classes, to):
    """Shares of the classes of up to sixteen packed pixels, eight bytes each."""
    a, b, c = (
        odds_of(columns, logits, scale),
        odds_of(columns, logits + 1, scale),
        odds_of(columns, logits + 2, scale),
    )
    d, e, f = (
        odds_of(columns, logits + 3, scale),
        odds_of(columns, logits + 4, scale),
        odds_of(columns, logits + 5, scale),
    )
    one, two = 255.0 / (a + b + c), 255.0 / (d + e + f)
    low = (
        share(a * one)
        | share(b * one) << np.int32(8)
        | share(c * one) << np.int32(16)
        | share(d * two) << np.int32(24)
    )
    high = share(e * two) | share(f * two) << np.int32(8)
    store(columns, 0, low)
    store(columns, 16, high)
    for i in range(min(16, count)):
        classes[to // 4 + 2 * i] = columns[i]
        classes[to // 4 + 2 * i + 1] = columns[16 + i]


@njit
def odds_of(columns, byte, scale):
    value = load16(columns, 16 * (byte // 4)) >> np.int32(8 * (byte % 4)) & np.int32(255)
    return factor((to_float(value) - 128.0) * scale)


@njit
def share(value):
    return to_int(value + 0.5)


@njit
def factor(value):
    """e^x, to 1e-5 of it: steps of bytes are larger."""
    x = clamped(value, -16.0, 16.0) * 1.4426950408889634
    past_planes = floor(x + 0.5)
    f = x - past_planes
    p = (((f * 9.58285e-3 + 5.590642e-2) * f + 2.4024099e-1) * f + 6.9312419e-1) * f + 1.0
    return p * float_of((to_int(past_planes) + np.int32(127)) << np.int32(23))


@njit
def said(mixing, pitch, number, half):
    """A number of sixteen pixels in a row, of the left and the right of packed pixels from `half` on."""
    left, right = load8(mixing, number * pitch + half), load8(mixing, (number + SAID) * pitch + half)
    return zipped(left, right)


@njit
def moved_past(past_planes, above, at, below, rest, half, lane, big_w, sharp, up, left, right, low):
    """The past filtered by the learned cross and sharpened: `Classifier.pasts`, the first."""
    first, last = lane == np.int32(0), lane == np.int32(big_w - 1)
    scale = 1.0 / (up + left + right + low + 1.0)
    r = g = b = sharp
    for c in range(3):
        p = 16 * c
        v = load16(past_planes, at + p)
        beside = select(first, v, shifted_in(load16(past_planes, max(at - 16 * PAST, 0) + p), v)) * left
        beside = beside + select(last, v, shifted_out(v, load16(past_planes, at + 16 * PAST + p))) * right
        moved = v + load16(past_planes, above + p) * up + beside + load16(past_planes, below + p) * low
        v = moved * scale + sharp * load16(rest, half + 16 * (DETAIL + c))
        r, g, b = g, b, clamped(v, 0.0, TONED)
    return r, g, b


@njit
def cut_to_box(color, rest, at):
    """`clip_to_center`, back in RGB."""
    mean = three(rest, at + 16 * MEAN)
    reach = three(rest, at + 16 * REACH)
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
def three(planes, at):
    return load16(planes, at), load16(planes, at + 16), load16(planes, at + 32)


@njit
def kernel_of(samples, stride, w, h, row, columns_near, x, near, factors, out):
    """Sums of sixteen pixels' 3x3 samples by learned weights, (16, 4): of colours, and of the weights."""
    column = load16(columns_near, x)
    for k in range(3):
        inside = minimum(maximum(column + np.int32(k - 1), np.int32(0)), np.int32(w - 1))
        store(near, 16 * k, inside * np.int32(16))
    a = max(row - 1, 0) * stride * 16
    b, c = row * stride * 16, min(row + 1, h - 1) * stride * 16
    for i in range(16):
        j, k, m = near[i], near[16 + i], near[32 + i]
        upper = load4(samples, a + j) * factors[i] + load4(samples, a + k) * factors[16 + i]
        upper = upper + load4(samples, a + m) * factors[32 + i]
        middle = load4(samples, b + j) * factors[48 + i] + load4(samples, b + k) * factors[64 + i]
        middle = middle + load4(samples, b + m) * factors[80 + i]
        lower = load4(samples, c + j) * factors[96 + i] + load4(samples, c + k) * factors[112 + i]
        lower = lower + load4(samples, c + m) * factors[128 + i]
        store(out, 4 * i, upper + middle + lower)


@njit
def added(sums, weight, color):
    """Sums of weighted colours and of the weights."""
    r, g, b, total = sums
    return r + color[0] * weight, g + color[1] * weight, b + color[2] * weight, total + weight


@njit
def compose_row(
    y, mixing, mixing_pitch, past_planes, rest, width, samples, stride, w, h, columns_near, row_near, across,
    down, near, factors, out, big_w, big_h, exposure, most_samples, contraction, history, image, weight,
    tells, streams, x0, x1,
):  # fmt: skip
    """Compose columns x0 to x1 of a row, count, and go back to linear RGB."""
    zero = spread16(np.float32(0.0))
    above, below = max(y - 1, 0) * width, min(y + 1, big_h - 1) * width
    for x in range(x0, x1, 16):
        at, half = (y * width + x) * PAST, (y * width + x) * REST
        m, pixels = 2 * SAID * (y % 2), x // 2
        # the past
        lane = ramp16() + np.int32(x)
        color = moved_past(
            past_planes, (above + x) * PAST, at, (below + x) * PAST, rest, half, lane, big_w,
            clamped(said(mixing, mixing_pitch, m + SHARPNESS, pixels), 0.0, SHARPEST),
            factor(said(mixing, mixing_pitch, m + CROSS, pixels)) * SIDE,
            factor(said(mixing, mixing_pitch, m + CROSS + 1, pixels)) * SIDE,
            factor(said(mixing, mixing_pitch, m + CROSS + 2, pixels)) * SIDE,
            factor(said(mixing, mixing_pitch, m + CROSS + 3, pixels)) * SIDE,
        )  # fmt: skip
        count = load16(rest, half + 16 * COUNT)
        known = count > 0.0
        other = select(known, count * 0.1 + 1e-3, 0.0)
        begun = select(known, count * load16(rest, half + 16 * SURFACE) + 1e-3, 0.0)
        none = zero, zero, zero, zero
        past = added(none, begun * factor(said(mixing, mixing_pitch, m, pixels)), color)
        past = added(
            past, other * factor(said(mixing, mixing_pitch, m + 1, pixels)), cut_to_box(color, rest, half)
        )
        past = added(
            past, other * factor(said(mixing, mixing_pitch, m + 2, pixels)), three(rest, half + 16 * OWN)
        )
        kept = past[3]
        # this frame
        for k in range(9):
            begun = load16(across, (k % 3) * width + x) * down[3 * y + k // 3] + 1e-4
            store(factors, 16 * k, begun * factor(said(mixing, mixing_pitch, m + KERNEL + k, pixels)))
        kernel_of(samples, stride, w, h, row_near, columns_near, x, near, factors, out)
        q = load_columns4(out, 0)
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
        now = added(none, sampled * factor(said(mixing, mixing_pitch, m + 3, pixels)), sample)
        now = added(now, beside * factor(said(mixing, mixing_pitch, m + 4, pixels)), frame)
        now = added(now, beside * factor(said(mixing, mixing_pitch, m + 5, pixels)), filtered)
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
        least, most = load16(rest, half + 16 * LEAST), load16(rest, half + 16 * MOST)
        least = minimum(least, luma) + rate * maximum(luma - least, 0.0)
        most = maximum(most, luma) - rate * maximum(most - luma, 0.0)
        least, most = luma + held * (least - luma), luma + held * (most - luma)
        remember(r, g, b, worth, least, most, y * big_w + x, big_w - x, streams, history, image, out)


@njit
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


@njit
def put(pointer, index, vector, past_caches):
    if past_caches:
        stream(pointer, index, vector)
    else:
        store(pointer, index, vector)


def finish_rows(
    kept0: Bytes, kept1: Bytes, kept2: Bytes, kept3: Bytes, pitches: Words, read: Bytes, read_words: Words,
    decoder: Words, decoder_scale: Floats, decoder_bias: Floats, decoded: Bytes, decoded_words: Words,
    records: Words, record_row: int, hidden_weights: Words, blocks: int, hidden_scale: Floats,
    hidden_bias: Floats,
    hidden: Bytes, hidden_words: Words, logits: int, logits_scale: float, mixing_words: int,
    mixing_weights: Words, mixing_scale: Floats, mixing_bias: Floats, mixing: Floats, classes: Words,
    past_planes: Floats, rest: Halves, width: int, samples: Floats, stride: int, w: int, h: int,
    columns_near: Words, rows_near: Words, across: Floats, down: Floats, near: Words, factors: Floats,
    out: Floats, big_w: int, big_h: int, exposure: float, most_samples: float, contraction: float,
    history: Floats, image: Floats, weight: Floats, tells: int, streams: int, y0: int, y1: int,
    p0: int, p1: int,
):  # fmt: skip
    """Decode, compose and remember packed rows y0 to y1, packed pixels p0 to p1.

    kept0 to kept3: what the levels gave; read, decoded, hidden (each also as words), mixing, near, factors,
    out: scratch rows. classes, history, image, weight (where `tells`): what comes out.
    """
    half_w = (big_w + 1) // 2
    mixing_pitch = (half_w + 15) // 16 * 16
    for y in range(y0, y1):
        concatenate_row(kept0, kept1, kept2, kept3, pitches, y, p0, p1, read)
        pointwise_row(
            read_words, 8 * p0, 8, 8, decoder, 1, decoder_scale, decoder_bias, decoded, 32 * p0, 32, p1 - p0
        )
        pointwise_row_of_two(
            records, y * record_row + RECORD * p0, RECORD, SEEN, decoded_words, 8 * p0, 8, 8, hidden_weights,
            blocks, hidden_scale, hidden_bias, hidden, 4 * WIDE * p0, 4 * WIDE, p1 - p0,
        )  # fmt: skip
        mix_row(
            hidden_words, mixing_words, mixing_weights, mixing_scale, mixing_bias, p0, p1, mixing_pitch, near,
            mixing, logits, logits_scale, classes, 8 * y * half_w,
        )  # fmt: skip
        for row in range(2 * y, min(2 * y + 2, big_h)):
            compose_row(
                row, mixing, mixing_pitch, past_planes, rest, width, samples, stride, w, h, columns_near,
                rows_near[row], across, down, near, factors, out, big_w, big_h, exposure, most_samples,
                contraction,
                history, image, weight, tells, streams, 2 * p0, min(2 * p1, width),
            )  # fmt: skip
