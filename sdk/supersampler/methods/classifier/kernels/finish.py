"""Finish of `classifier` on a processor: the network's last layers, and what they say, composed."""

import numpy as np

from supersampler.backends.cpu.kernels.types import Bytes, Floats, Halves, Words
from supersampler.backends.cpu.layout import RECORD, SEEN
from supersampler.backends.cpu.simd.device_function import inner
from supersampler.backends.cpu.simd.shuffles import load_columns
from supersampler.backends.cpu.simd.vector import dot4, load16, spread16, store, to_float, to_int
from supersampler.methods.classifier.kernels.compose import factor, make_compose_row
from supersampler.methods.classifier.kernels.network import (
    concatenate_row,
    pointwise_row,
    pointwise_row_of_two,
)
from supersampler.methods.classifier.variant import Variant

WIDE = 16  # words of what the hidden layer gives


@inner
def mix_row(
    hidden, words, weights, scales, biases, outputs, p0, p1, pitch, columns, out, logits, scale, classes, to
):
    """The last layer of packed pixels p0 to p1 of a row, (outputs, pitch), and the shares of their classes.

    Sixteen pixels side by side: columns (WIDE, 16) is scratch, their bytes word by word.
    """
    for p in range(p0, p1, 16):
        rows = load_columns(hidden, WIDE * p)
        for k in range(WIDE):
            store(columns, 16 * k, rows[k])
        for c in range(0, outputs, 8):
            sums = eight_sums(columns, words, weights, c * words)
            for i in range(8):
                store(out, (c + i) * pitch + p, to_float(sums[i]) * scales[c + i] + biases[c + i])
        hold(columns, logits, scale, p1 - p, classes, to + 8 * p)


@inner
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


@inner
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


@inner
def odds_of(columns, byte, scale):
    value = load16(columns, 16 * (byte // 4)) >> np.int32(8 * (byte % 4)) & np.int32(255)
    return factor((to_float(value) - 128.0) * scale)


@inner
def share(value):
    return to_int(value + 0.5)


def make_finish_rows(*parts: str):
    """Return `finish_rows` of the variant with these parts."""
    variant = Variant.with_parts(*parts)
    compose_row = make_compose_row(variant)
    outputs = variant.outputs

    def finish_rows(
        kept0: Bytes, kept1: Bytes, kept2: Bytes, kept3: Bytes, pitches: Words, read: Bytes,
        read_words: Words, decoder: Words, decoder_scale: Floats, decoder_bias: Floats, decoded: Bytes,
        decoded_words: Words, records: Words, record_row: int, hidden_weights: Words, blocks: int,
        hidden_scale: Floats, hidden_bias: Floats, hidden: Bytes, hidden_words: Words, logits: int,
        logits_scale: float, mixing_words: int, mixing_weights: Words, mixing_scale: Floats,
        mixing_bias: Floats, mixing: Floats, classes: Words, past_planes: Floats, rest: Halves, width: int,
        samples: Floats, wide: int, h: int, columns_near: Words, rows_near: Words, across: Floats,
        down: Floats, columns: Words, out: Floats, big_w: int, big_h: int, exposure: float,
        most_samples: float, contraction: float, glares: int, history: Floats, image: Floats,
        weight: Floats, tells: int, streams: int, y0: int, y1: int, p0: int, p1: int,
    ):  # fmt: skip
        """Decode, compose and remember packed rows y0 to y1, packed pixels p0 to p1.

        kept0 to kept3: what the levels gave; read, decoded, hidden (each also as words), mixing,
        columns, out: scratch rows. classes, history, image, weight (where `tells`): what comes out.
        """
        half_w = (big_w + 1) // 2
        mixing_pitch = (half_w + 15) // 16 * 16
        for y in range(y0, y1):
            concatenate_row(kept0, kept1, kept2, kept3, pitches, y, p0, p1, read)
            pointwise_row(
                read_words, 8 * p0, 8, 8, decoder, 1, decoder_scale, decoder_bias, decoded, 32 * p0, 32,
                p1 - p0,
            )  # fmt: skip
            pointwise_row_of_two(
                records, y * record_row + RECORD * p0, RECORD, SEEN, decoded_words, 8 * p0, 8, 8,
                hidden_weights, blocks, hidden_scale, hidden_bias, hidden, 4 * WIDE * p0, 4 * WIDE, p1 - p0,
            )  # fmt: skip
            mix_row(
                hidden_words, mixing_words, mixing_weights, mixing_scale, mixing_bias, outputs, p0, p1,
                mixing_pitch, columns, mixing, logits, logits_scale, classes, 8 * y * half_w,
            )  # fmt: skip
            for row in range(2 * y, min(2 * y + 2, big_h)):
                compose_row(
                    row, mixing, mixing_pitch, past_planes, rest, width, samples, wide, h, columns_near,
                    rows_near[row], across, down, out, big_w, big_h, exposure, most_samples,
                    contraction, glares, history, image, weight, tells, streams, 2 * p0, min(2 * p1, width),
                )  # fmt: skip

    return finish_rows
