"""Finish of `classifier`: the last layers of the network, then the compositor."""

import numpy as np

from supersampler.backends.cpu.layout import INPUT_PLANES, RECORD_WORDS
from supersampler.backends.cpu.simd.shuffles import load_columns
from supersampler.backends.cpu.simd.vector import (
    device_function,
    dot4,
    load16,
    select,
    spread16,
    store,
    to_float,
    to_int,
)
from supersampler.backends.cpu.structs import FrameSamples, Output, ResampleTables, Words
from supersampler.methods.classifier.kernels.compose import factor, make_compose_row
from supersampler.methods.classifier.kernels.gather import COUNT
from supersampler.methods.classifier.kernels.network import (
    concatenate_row,
    pointwise_row,
    pointwise_row_of_two,
)
from supersampler.methods.classifier.spec import CLASSES
from supersampler.methods.classifier.structs import (
    EncodedLevels,
    FinishConstants,
    FinishLayers,
    FinishScratch,
    Gathered,
    NetworkInputs,
    Variant,
)

WIDE = 16  # words of the hidden layer's output
VISIBILITY = np.int32(255 << 8)  # of ghosting, in the first word of class probabilities: certain
OF_ALIASING = np.int32(-1 << 24)  # the byte of that word that is of aliasing


@device_function
def blend_row(hidden, layers, outputs, p0, p1, pitch, columns, out, classes, to):
    """Compute blend parameters, (outputs, pitch), and class probabilities of packed pixels p0 to p1.

    Logits follow the blend parameters.
    Sixteen pixels side by side: columns (WIDE, 16) is scratch, their bytes word by word.
    """
    layer, first, step = layers.blend, layers.logits, layers.logits_scale
    words, weights, scales, biases = layer.words, layer.weights, layer.scale, layer.bias
    for p in range(p0, p1, 16):
        rows = load_columns(hidden, WIDE * p)
        for k in range(WIDE):
            store(columns, 16 * k, rows[k])
        for c in range(0, outputs, 8):
            sums = eight_sums(columns, words, weights, c * words)
            for i in range(8):
                store(out, (c + i) * pitch + p, to_float(sums[i]) * scales[c + i] + biases[c + i])
        for c in range(CLASSES):
            byte = first + c
            value = load16(columns, 16 * (byte // 4)) >> np.int32(8 * (byte % 4)) & np.int32(255)
            store(out, (outputs + c) * pitch + p, (to_float(value) - 128.0) * step)
        store_classes(out, outputs * pitch + p, pitch, columns, p1 - p, classes, to + 8 * p)


@device_function
def eight_sums(columns, words, weights, first):
    """Return the sums of products of eight outputs at sixteen pixels."""
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


@device_function
def store_classes(logits, at, pitch, columns, count, classes, to):
    """Write the class probabilities of up to sixteen packed pixels, eight bytes each; 255 is one.

    logits: planes of `pitch`, from `at` on; columns: scratch.
    """
    a, b = factor(load16(logits, at)), factor(load16(logits, at + pitch))
    c, d = factor(load16(logits, at + 2 * pitch)), factor(load16(logits, at + 3 * pitch))
    e, f = factor(load16(logits, at + 4 * pitch)), factor(load16(logits, at + 5 * pitch))
    one, two = 255.0 / (a + b + c), 255.0 / (d + e + f)
    low = (
        byte_of(a * one)
        | byte_of(b * one) << np.int32(8)
        | byte_of(c * one) << np.int32(16)
        | byte_of(d * two) << np.int32(24)
    )
    high = byte_of(e * two) | byte_of(f * two) << np.int32(8)
    store(columns, 0, low)
    store(columns, 16, high)
    for i in range(min(16, count)):
        classes[to // 4 + 2 * i] = columns[i]
        classes[to // 4 + 2 * i + 1] = columns[16 + i]


@device_function
def mark_unknown(gathered, planes, y, p0, p1, known, classes, to):
    """Write visibility for the ghosting of packed pixels p0 to p1 of row y that have no history.

    known: scratch of sixteen words.
    """
    rest, pitch = gathered.rest, gathered.pitch
    for x in range(2 * p0, min(2 * p1, pitch), 16):
        count = load16(rest, (2 * y * pitch + x) * planes + 16 * COUNT)
        store(known, 0, select(count > 0.0, spread16(np.int32(1)), spread16(np.int32(0))))
        for i in range(min(8, p1 - x // 2)):
            if known[2 * i] == 0:
                at = to // 4 + x + 2 * i
                classes[at] = classes[at] & OF_ALIASING | VISIBILITY


@device_function
def byte_of(value):
    """Return the nearest integer."""
    return to_int(value + 0.5)


def make_finish_rows(*parts: str):
    """Return `finish_rows` of the variant with these parts."""
    variant = Variant.with_parts(*parts)
    compose_row = make_compose_row(variant)
    outputs, planes = variant.outputs, variant.rest

    def finish_rows(
        levels: EncodedLevels, layers: FinishLayers, network: NetworkInputs, gathered: Gathered,
        samples: FrameSamples, tables: ResampleTables, constants: FinishConstants, scratch: FinishScratch,
        output: Output, next_classes: Words, y0: int, y1: int, p0: int, p1: int,
    ):  # fmt: skip
        """Decode and compose packed rows y0 to y1, packed pixels p0 to p1: the image and the next history.

        next_classes: (half height, half width, 8) bytes, class probabilities.
        """
        decoder, big_h = layers.decoder, output.height
        half_w = (output.width + 1) // 2
        blend_pitch = (half_w + 15) // 16 * 16
        for y in range(y0, y1):
            concatenate_row(
                levels.level0, levels.level1, levels.level2, levels.level3, levels.pitches, y, p0, p1,
                scratch.read,
            )  # fmt: skip
            pointwise_row(
                scratch.read_words, 8 * p0, 8, 8, decoder.weights, 1, decoder.scale, decoder.bias,
                scratch.decoded, 32 * p0, 32, p1 - p0,
            )  # fmt: skip
            pointwise_row_of_two(
                network.records, (y * network.row + p0) * RECORD_WORDS, RECORD_WORDS, INPUT_PLANES,
                scratch.decoded_words, 8 * p0, 8, 8, layers.hidden, scratch.hidden, 4 * WIDE * p0,
                4 * WIDE, p1 - p0,
            )  # fmt: skip
            blend_row(
                scratch.hidden_words, layers, outputs, p0, p1, blend_pitch, scratch.columns,
                scratch.blend, next_classes, 8 * y * half_w,
            )  # fmt: skip
            mark_unknown(gathered, planes, y, p0, p1, scratch.columns, next_classes, 8 * y * half_w)
            for row in range(2 * y, min(2 * y + 2, big_h)):
                compose_row(
                    row, scratch.blend, blend_pitch, gathered, samples, tables, constants, output,
                    scratch.out, 2 * p0, min(2 * p1, output.pitch),
                )  # fmt: skip

    return finish_rows
