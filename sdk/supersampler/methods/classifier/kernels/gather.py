"""Gather of `classifier`: the twin of `Classifier.gather` and of its network inputs, in one pass.

Rows of vectors of sixteen pixels; where a pixel's channels are read at places of their own (filters, warps),
a vector holds one pixel's channels instead. Rows end in padding up to a multiple of sixteen.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    CONFIRMED,
    GLARE,
    clamped,
    largest,
    luminance,
    quarantined,
    rgb,
    root,
    toned,
    without_glare,
)
from supersampler.backends.cpu.kernels.filters import filter_all_across, filter_all_down
from supersampler.backends.cpu.kernels.frame import repeat_ends
from supersampler.backends.cpu.kernels.warp import (
    aim,
    aim_own,
    around,
    disoccluded,
    followed,
    on_screen,
    warp,
)
from supersampler.backends.cpu.layout import PAD, PAST, RECORD, SEEN
from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.shuffles import gather4, load_columns
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    floor,
    maximum,
    minimum,
    ramp16,
    select,
    square_root,
    store,
    stream,
    to_float,
)
from supersampler.backends.cpu.structs import Floats, FrameSamples, ResampleTables
from supersampler.methods.classifier.kernels import network_inputs as see
from supersampler.methods.classifier.kernels.network_inputs import complete, put, recall
from supersampler.methods.classifier.spec import CLASSIFIER
from supersampler.methods.classifier.structs import (
    ClassifierHistoryInput,
    Gathered,
    GatherScratch,
    NetworkInputs,
)
from supersampler.methods.classifier.variant import Variant
from supersampler.methods.spec import constant_indices

TONED = 1.0 - 1e-4
FRAME, SAMPLE, CONFIDENCE, DETAIL, SURFACE, COUNT, LEAST, MOST = 0, 3, 6, 7, 10, 11, 12, 13
"""Of `rest`; more in `Variant`."""
C = constant_indices(CLASSIFIER)
EXPOSURE, W, H, BIG_W, BIG_H, OLD_W, OLD_H, JITTER_X, JITTER_Y, GLARES = range(len(C), len(C) + 10)
"""Of `numbers`, after the constants of `classifier`: exposure; sizes of this frame, the display and the
previous frame, and its jitter; whether this frame or the history may have light over GLARING."""


@device_function
def toned_at(numbers, r, g, b):
    """Linear colours of the past, exposed and toned."""
    e = numbers[EXPOSURE]
    return toned(quarantined(r) * e, quarantined(g) * e, quarantined(b) * e)


@device_function
def only(where, values):
    """Three vectors; 0 elsewhere."""
    return select(where, values[0], 0.0), select(where, values[1], 0.0), select(where, values[2], 0.0)


@device_function
def put_all(planes, at, values):
    """Store vectors one after the other."""
    for c, value in enumerate(values):
        stream(planes, at + 16 * c, value)


@device_function
def look_back(depth, px, py, on, surfaces, wide, places, numbers):
    """Whether the past shows what is there now, and how depth differs (equation 10)."""
    old_w, old_h = np.int64(numbers[OLD_W]), np.int64(numbers[OLD_H])
    x = (px + 0.5) * numbers[OLD_W] / numbers[BIG_W] - 0.5 - numbers[JITTER_X]
    y = (py + 0.5) * numbers[OLD_H] / numbers[BIG_H] - 0.5 - numbers[JITTER_Y]
    weights = around(x, y, old_w, old_h, wide, places)
    a, b, c, d = gather4(surfaces, places, 0, 2, 0)
    e, f, g, h = gather4(surfaces, places, 16, 2, 0)
    cover = disoccluded(depth, weights, (b, d, f, h), numbers[C.depth_margin], numbers[C.depth_ramp])
    surface = select(on, maximum(1.0 - cover * 2.0, 0.0), 0.0)
    right, low = x - floor(x) >= 0.5, y - floor(y) >= 0.5
    there = select(low, select(right, g, e), select(right, c, a))
    there = select(on, there, 0.0)
    apart = (there - depth) / maximum(maximum(there, depth), 1e-12)
    return surface, select(depth >= 0.0, clamped(apart, -1.0, 1.0), 0.0)


@device_function
def present_of(p, gamma):
    """This frame at sixteen pixels, from sums of samples: see `Present`."""
    scale = 1.0 / maximum(p[3], 1e-6)
    sample = (
        clamped(p[0] * scale, 0.0, TONED),
        clamped(p[1] * scale, 0.0, TONED),
        clamped(p[2] * scale, 0.0, TONED),
    )
    scale, known = 1.0 / maximum(p[14], 1e-6), p[14] > 1e-3
    mean = p[8] * scale, p[9] * scale, p[10] * scale
    varies = (
        select(known, p[11] * scale, 1.0) - mean[0] * mean[0],
        select(known, p[12] * scale, 1.0) - mean[1] * mean[1],
        select(known, p[13] * scale, 1.0) - mean[2] * mean[2],
    )
    r, g, b = rgb(mean[0], mean[1], mean[2])
    whole, scale = p[7] > 0.9, 1.0 / maximum(p[7], 1e-6)
    frame = (
        clamped(select(whole, p[4] * scale, r), 0.0, TONED),
        clamped(select(whole, p[5] * scale, g), 0.0, TONED),
        clamped(select(whole, p[6] * scale, b), 0.0, TONED),
    )
    reach = (
        square_root(maximum(varies[0], 0.0)) * gamma,
        square_root(maximum(varies[1], 0.0)) * gamma,
        square_root(maximum(varies[2], 0.0)) * gamma,
    )
    return frame, sample, minimum(p[3], 1.0), mean, reach, largest(varies[0], varies[1], varies[2])


@device_function
def glared_now(glare, glared, count):
    """Frames in a row that have had glare near, with this one; a pixel without a past has nothing to lose."""
    counts = select((count > 0.0) | (glared > 0.0), glared, CONFIRMED)
    return glare * minimum(counts + 1.0, CONFIRMED)


@device_function
def roots(color):
    return root(color[0]), root(color[1]), root(color[2])


@device_function
def luma_of(color):
    return luminance(color[0], color[1], color[2])


@device_function
def apart_of(a, b):
    """The channel that differs most."""
    return largest(absolute(a[0] - b[0]), absolute(a[1] - b[1]), absolute(a[2] - b[2]))


def make_gather_rows(*parts: str):
    """Return `gather_rows` of the variant with these parts."""
    _, rectified, own_motion = variant = Variant.with_parts(*parts)
    planes, mean_plane, own_plane = variant.rest, variant.mean, variant.own

    def gather_rows(
        read: FrameSamples, history: ClassifierHistoryInput, tables: ResampleTables, numbers: Floats,
        line: Floats, scratch: GatherScratch, gathered: Gathered, network: NetworkInputs, y0: int, y1: int,
        x0: int, x1: int,
    ):  # fmt: skip
        """Compute `gathered` and the network inputs of rows y0 to y1, columns x0 to x1.

        y0 is even; x0 and x1 are where tiles begin, or x1 is `gathered.pitch`. line: scratch for filters.
        """
        samples, stride = read.color, read.stride
        rows, down = tables.row_samples, tables.row_weights
        starts, across = tables.column_start, tables.column_weights
        ring, slots, weights, warped = scratch.ring, scratch.slots, scratch.weights, scratch.warped
        places, seen, apart = scratch.places, scratch.inputs, scratch.differences
        past_planes, rest = gathered.history, gathered.rest
        big_w, big_h, width = gathered.width, gathered.height, gathered.pitch
        w_big, h_big = numbers[BIG_W], numbers[BIG_H]
        scale_x, scale_y = w_big / numbers[W], h_big / numbers[H]
        wide, x_end = width + 2 * PAD, min(x1, big_w)
        for y in range(max(y0 - 1, 0), min(y1 + 1, big_h)):
            inside = y0 <= y < y1
            ring_row = (y % 4) * SEEN * width
            if inside:
                filter_all_down(samples, rows, down, big_h, y, starts, x0, x_end, stride + 2 * PAD, line)
            for x in range(x0, x1, 16):
                lane = to_float(ramp16() + np.int32(x))
                depth, mx, my, _ = gather4(
                    read.dilated, tables.first_column, x, 4, 4 * tables.first_row[y] * stride
                )
                mx, my = mx * scale_x, my * scale_y
                px, py = followed(lane, y, mx, my, w_big, h_big)
                on = on_screen(px, py, w_big, h_big)
                own_x, own_y, edge, glare = gather4(
                    read.own, tables.nearest_column, x, 4, 4 * tables.nearest_row[y] * stride
                )
                store(places, x, px)
                store(places, width + x, py)
                aim(px, py, big_w, big_h, 8, numbers[C.history_sharpness], slots, weights)
                alone = True
                if own_motion:
                    ox, oy = followed(lane, y, own_x * scale_x, own_y * scale_y, w_big, h_big)
                    alone = all_lanes((ox == px) & (oy == py))
                    if not alone:
                        aim_own(ox, oy, big_w, big_h, 8, slots, weights)
                warp(history.pixels, slots, weights, alone, warped)
                q = load_columns(warped, 0)
                past = only(on, toned_at(numbers, q[8], q[9], q[10]))
                past_root = roots(past)
                luma = luma_of(past_root)
                store(ring, (y % 3) * wide + PAD + x, luma)
                if not inside:
                    continue
                soft = only(on, toned_at(numbers, q[0], q[1], q[2]))
                detail = past[0] - soft[0], past[1] - soft[1], past[2] - soft[2]
                count, least, most = only(on, (q[3], q[4], q[5]))
                if numbers[GLARES] > 0.0:
                    most, glared = without_glare(most)
                    glared = glared_now(glare, glared, count) * GLARE
                else:
                    glared = most * 0.0
                put_all(past_planes, (y * width + x) * PAST, past)
                surface, difference = look_back(
                    depth, px, py, on, history.depth, history.pitch, slots, numbers
                )
                sums = filter_all_across(line, stride + 2 * PAD, starts, across, width, x)
                frame, sample, confidence, mean, reach, varies = present_of(sums, numbers[C.gamma])
                to = (y * width + x) * planes
                known = (*frame, *sample, confidence, *detail, surface, count, least, most + glared)
                put_all(rest, to, known)
                if rectified:
                    put_all(rest, to + 16 * mean_plane, (*mean, *reach))
                if own_motion:
                    moved = soft
                    if not alone:
                        moved = toned_at(numbers, q[12], q[13], q[14])
                    put_all(rest, to + 16 * own_plane, moved)

                frame_root, sample_root = roots(frame), roots(sample)
                frame_luma = luma_of(frame_root)
                store(apart, (y % 4) * width + x, luma - frame_luma)
                to = ring_row + x
                put(seen, see.FRAME * width + to, frame_luma)
                put(seen, see.SAMPLE * width + to, luma_of(sample_root))
                put(seen, see.PAST * width + to, luma)
                put(seen, see.TO_SAMPLE * width + to, apart_of(past_root, sample_root))
                put(seen, see.TO_FRAME * width + to, apart_of(past_root, frame_root))
                put(seen, see.CONTRAST * width + to, root(root(varies)))
                put(seen, see.LEAST * width + to, root(least))
                put(seen, see.MOST * width + to, root(most))
                put(seen, see.DETAIL * width + to, root(apart_of(past, soft)))
                put(seen, see.CONFIDENCE * width + to, confidence)
                put(seen, see.COUNT * width + to, count / (count + 4.0))
                put(seen, see.DIFFERENCE * width + to, difference * 0.5 + 0.5)
                put(seen, see.SURFACE * width + to, surface)
                put(seen, see.EDGE * width + to, edge)
            if inside and y % 2 == 0:
                to = y // 2 * network.row * RECORD
                recall(
                    history.classes, places, slots, weights, width, big_w, big_h, x0 // 2, (x_end + 1) // 2,
                    network.records, to,
                )  # fmt: skip
            repeat_ends(ring, (y % 3) * wide + PAD + x0, x_end - x0)
            if y - 1 >= y0:
                complete(scratch, gathered, network, y - 1, y, x0, x1)
        if y1 == big_h:
            last = big_h - 1
            complete(scratch, gathered, network, last, last, x0, x1)

    return gather_rows
