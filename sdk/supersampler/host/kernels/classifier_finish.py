"""Finish of `classifier` on a processor: what `Classifier.finish` does, in one pass."""

import numpy as np
from numba import njit

from supersampler.host.kernels.colors import (
    MAX_HALF,
    clamped,
    exponential,
    largest,
    luminance,
    rgb,
    ycocg,
)
from supersampler.host.kernels.network import two_by_six
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

TONED = 1.0 - 1e-4
SIDE, SHARPEST, DARKNESS = 0.01, 2.0, 1e-12
PLANES = 26


@njit
def mix_row(hidden, pitch, words, weights, scales, biases, row, half_width, out):
    """The last layer of a row of packed pixels: (half_width, 96) float32."""
    for p in range(0, half_width, 6):
        for block in range(3):
            sums = two_by_six(hidden, pitch, words, weights, 32 * words * block, row + p * pitch)
            c = 32 * block
            u, v = load16(scales, c), load16(scales, c + 16)
            s, t = load16(biases, c), load16(biases, c + 16)
            for i in range(6):
                store(out, (p + i) * 96 + c, to_float(sums[2 * i]) * u + s)
                store(out, (p + i) * 96 + c + 16, to_float(sums[2 * i + 1]) * v + t)


@njit
def said(mixing, at):
    """What the compositor says of sixteen pixels: sixteen of its channels from `at` on."""
    m = mixing
    return transposed((
        load16(m, at), load16(m, at + 20), load16(m, at + 96), load16(m, at + 116),
        load16(m, at + 192), load16(m, at + 212), load16(m, at + 288), load16(m, at + 308),
        load16(m, at + 384), load16(m, at + 404), load16(m, at + 480), load16(m, at + 500),
        load16(m, at + 576), load16(m, at + 596), load16(m, at + 672), load16(m, at + 692),
    ))  # fmt: skip


@njit
def factor(value):
    return exponential(clamped(value, -16.0, 16.0))


@njit
def kernel_of(samples, stride, w, h, row, near, down, across, factors, out):
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


def finish_rows(
    gathered, hidden, pitch, words, mix_weights, mix_scales, mix_biases, mixing, samples, stride, columns_near, rows_near, down, across,
    numbers, sizes, y0, y1, near, factors, out, history, image, weight, tells,
):  # fmt: skip
    """Compose rows y0 to y1, count, and go back to linear RGB."""
    w, h, big_w, big_h, width = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4]
    half_width, hidden_row = sizes[5], sizes[6]
    exposure, samples_most, contraction = numbers[0], numbers[1], numbers[2]
    per_exposure = np.float32(1.0) / exposure
    zero = spread16(np.float32(0.0))
    for y in range(y0, y1):
        if y % 2 == 0:
            row = y // 2 * hidden_row
            mix_row(hidden, pitch, words, mix_weights, mix_scales, mix_biases, row, half_width, mixing)
        here = y * PLANES * width
        above, below = max(y - 1, 0) * PLANES * width, min(y + 1, big_h - 1) * PLANES * width
        for x in range(0, width, 16):
            at = here + x
            lane = ramp16() + np.int32(x)
            first, last = lane == np.int32(0), lane == np.int32(big_w - 1)
            m = said(mixing, 48 * x + 40 * (y % 2))
            n = said(mixing, 48 * x + 40 * (y % 2) + 4)
            up, left = factor(m[7]) * SIDE, factor(m[8]) * SIDE
            right, low = factor(m[9]) * SIDE, factor(m[10]) * SIDE
            scale = 1.0 / (up + left + right + low + 1.0)
            sharp = clamped(m[6], 0.0, SHARPEST)
            r = g = b = zero
            for c in range(3):
                p = (13 + c) * width
                v = load16(gathered, at + p)
                beside = select(first, v, load16(gathered, at + p - 1)) * left
                beside = beside + select(last, v, load16(gathered, at + p + 1)) * right
                moved = v + load16(gathered, above + x + p) * up + beside + load16(gathered, below + x + p) * low
                v = moved * scale + sharp * load16(gathered, at + (16 + c) * width)
                r, g, b = g, b, clamped(v, 0.0, TONED)
            count, surface = load16(gathered, at + 22 * width), load16(gathered, at + 23 * width)
            known = count > 0.0
            other = select(known, count * 0.1 + 1e-3, 0.0)
            w0 = select(known, count * surface + 1e-3, 0.0) * factor(m[0])
            w1 = other * factor(m[1])
            w2 = other * factor(m[2])
            luma, orange, green = ycocg(r, g, b)
            my, mo, mg = (
                load16(gathered, at + 7 * width), load16(gathered, at + 8 * width), load16(gathered, at + 9 * width),
            )  # fmt: skip
            luma, orange, green = luma - my, orange - mo, green - mg
            over = largest(
                absolute(luma) / maximum(load16(gathered, at + 10 * width), 1e-5),
                absolute(orange) / maximum(load16(gathered, at + 11 * width), 1e-5),
                absolute(green) / maximum(load16(gathered, at + 12 * width), 1e-5),
            )
            cut = 1.0 / maximum(over, 1.0)
            cr, cg, cb = rgb(my + luma * cut, mo + orange * cut, mg + green * cut)
            red = r * w0 + clamped(cr, 0.0, TONED) * w1 + load16(gathered, at + 19 * width) * w2
            grn = g * w0 + clamped(cg, 0.0, TONED) * w1 + load16(gathered, at + 20 * width) * w2
            blu = b * w0 + clamped(cb, 0.0, TONED) * w1 + load16(gathered, at + 21 * width) * w2
            kept = w0 + w1 + w2
            # this frame
            store(near, 0, load16(columns_near, x))
            for dy in range(3):
                for dx in range(3):
                    k = 3 * dy + dx
                    begun = load16(across, dx * width + x) * down[3 * y + dy] + 1e-4
                    store(factors, 16 * k, begun * factor(n[7 + k]))
            kernel_of(samples, stride, w, h, rows_near[y], near, down, across, factors, out)
            q = load_columns(out, 0)
            fr, fg, fb = load16(gathered, at), load16(gathered, at + width), load16(gathered, at + 2 * width)
            scale = 1.0 / maximum(q[3], 1e-12)
            some = q[3] > 1e-9
            kr, kg, kb = select(some, q[0] * scale, fr), select(some, q[1] * scale, fg), select(some, q[2] * scale, fb)
            confidence = load16(gathered, at + 6 * width)
            there = select(q[3] > 0.0, spread16(np.float32(1.0)), zero)
            b3, b4 = there * (confidence + 1e-3), there * 0.05
            w3 = b3 * factor(m[3])
            w4 = b4 * factor(m[4])
            w5 = b4 * factor(m[5])
            sr, sg, sb = (
                load16(gathered, at + 3 * width), load16(gathered, at + 4 * width), load16(gathered, at + 5 * width),
            )  # fmt: skip
            red = red + sr * w3 + fr * w4 + kr * w5
            grn = grn + sg * w3 + fg * w4 + kg * w5
            blu = blu + sb * w3 + fb * w4 + kb * w5
            new = w3 + w4 + w5
            scale = 1.0 / maximum(kept + new, 1e-12)
            red, grn, blu = red * scale, grn * scale, blu * scale
            back = per_exposure / maximum(1.0 - largest(red, grn, blu), 1.0 / MAX_HALF)
            red, grn, blu = minimum(red * back, MAX_HALF), minimum(grn * back, MAX_HALF), minimum(blu * back, MAX_HALF)
            red = select(red >= DARKNESS, red, 0.0)
            grn = select(grn >= DARKNESS, grn, 0.0)
            blu = select(blu >= DARKNESS, blu, 0.0)
            if tells:
                store(weight, y * width + x, kept * scale)
            # what the next frame looks back on
            odds = kept / maximum(new, 1e-12) * (b3 + b4 + b4)
            worth = minimum(minimum(odds, count), samples_most) + confidence
            luma = luminance(sr, sg, sb)
            held = select(known, minimum(odds * 4.0 / maximum(count, 1e-6), 1.0), 0.0)
            rate = confidence * contraction
            least, most = load16(gathered, at + 24 * width), load16(gathered, at + 25 * width)
            least = minimum(least, luma) + rate * maximum(luma - least, 0.0)
            most = maximum(most, luma) - rate * maximum(most - luma, 0.0)
            least, most = luma + held * (least - luma), luma + held * (most - luma)
            rows = transposed((
                red, grn, blu, worth, least, most, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero,
            ))  # fmt: skip
            for i in range(16):
                store(out, 16 * i, rows[i])
            for i in range(min(16, big_w - x)):
                pixel = y * big_w + x + i
                store(history, 8 * pixel, load8(out, 16 * i))
                image[3 * pixel] = out[16 * i]
                image[3 * pixel + 1] = out[16 * i + 1]
                image[3 * pixel + 2] = out[16 * i + 2]


def hold_rows(hidden, pitch, scale, half_width, row, y0, y1, rows, classes):
    """Shares of the classes of packed pixels, (half_height, half_width, 8) bytes, from their logits."""
    for y in range(y0, y1):
        for x in range(0, half_width, 16):
            for i in range(16):
                at = y * row + (min(x + i, half_width - 1)) * pitch + 36
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
                store(classes, 8 * (y * half_width + x + i), to_int(load8(rows, 16 * i) + 0.5))
