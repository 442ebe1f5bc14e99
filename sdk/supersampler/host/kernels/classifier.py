"""Gather of `classifier` on a processor: what `Classifier.gather` and `Classifier.planes` do, in a few passes.

Rows of vectors of sixteen pixels; where a pixel's channels are read at places of their own (filters, warps), a
vector holds one pixel's channels instead. Rows end in padding up to a multiple of sixteen.
"""

from typing import Any

import numpy as np
from numba import njit

from supersampler.host.kernels.colors import (
    clamped,
    largest,
    luminance,
    quarantined,
    rgb,
    root,
    toned,
    usable,
    ycocg,
)
from supersampler.host.vector import (
    absolute,
    evens,
    floor,
    gather,
    joined,
    load4,
    load8,
    load16,
    load_columns,
    maximum,
    minimum,
    odds,
    packed,
    ramp16,
    select,
    spread16,
    square_root,
    store,
    store_pairs,
    to_float,
    to_int,
    transposed,
    zipped,
)

TONED = 1.0 - 1e-4
PAD = 16  # columns before and after a plane that 3x3 neighbourhoods reach into


def prepare(color, depth, motion, exposure, w, stride, y0, y1, samples, depths, across, down):
    """Tone the samples; depth and motion as usable planes."""
    zero = spread16(np.float32(0.0))
    wide = stride + 2 * PAD
    for y in range(y0, y1):
        for x in range(0, w, 16):
            at = minimum(ramp16() + np.int32(x), np.int32(w - 1)) + np.int32(y * w)
            r, g, b = gather(color, at * 3), gather(color, at * 3 + 1), gather(color, at * 3 + 2)
            good = select(usable(r, g, b), 1.0, zero)
            e = exposure
            r, g, b = toned(quarantined(r) * e, quarantined(g) * e, quarantined(b) * e)
            r, g, b = r * good, g * good, b * good
            luma, orange, green = ycocg(r, g, b)
            rows = transposed((
                r, g, b, good, r, g, b, good, luma, orange, green,
                luma * luma, orange * orange, green * green, good, zero,
            ))  # fmt: skip
            to = (y * stride + x) * 16
            for i in range(16):
                store(samples, to + 16 * i, rows[i])
            d, mx, my = gather(depth, at), gather(motion, at * 2), gather(motion, at * 2 + 1)
            to = y * wide + PAD + x
            store(depths, to, select((d >= 0.0) & (d <= 1e30), d, -1.0))
            store(across, to, select(absolute(mx) <= 1e6, mx, 0.0))
            store(down, to, select(absolute(my) <= 1e6, my, 0.0))
        first, last = y * wide + PAD, y * wide + PAD + w - 1
        for x in range(PAD):
            for plane in (depths, across, down):
                plane[first - 1 - x] = plane[first]
                plane[last + 1 + x] = plane[last]


def closest(depths, across, down, w, h, stride, y0, y1, nearest, edges, eroded):
    """The closest of four samples and its motion, the range of depth in 3x3, and the farthest."""
    wide = stride + 2 * PAD
    for y in range(y0, y1):
        above, here, below = max(y - 1, 0) * wide + PAD, y * wide + PAD, min(y + 1, h - 1) * wide + PAD
        for x in range(0, w, 16):
            near = far = load16(depths, here + x)
            for row in (above, here, below):
                for column in range(-1, 2):
                    d = load16(depths, row + x + column)
                    near, far = maximum(d, near), minimum(d, far)
            edge = (near - maximum(far, 0.0)) / maximum(near, 1e-12)
            store(edges, y * stride + x, clamped(edge, 0.0, 1.0))
            store(eroded, here + x, far)
            d, mx, my = load16(depths, here + x), load16(across, here + x), load16(down, here + x)
            for at in (here + x + 1, below + x, below + x + 1):
                other = load16(depths, at)
                closer = other > d
                d = select(closer, other, d)
                mx, my = select(closer, load16(across, at), mx), select(closer, load16(down, at), my)
            to = (y * 3) * stride + x
            store(nearest, to, d)
            store(nearest, to + stride, mx)
            store(nearest, to + 2 * stride, my)
        first, last = here, here + w - 1
        for x in range(PAD):
            eroded[first - 1 - x] = eroded[first]
            eroded[last + 1 + x] = eroded[last]


def surfaces(depths, eroded, w, h, stride, y0, y1, left):
    """Depth as it is, and without thin things: what the next frame looks back on."""
    wide = stride + 2 * PAD
    for y in range(y0, y1):
        above, here, below = max(y - 1, 0) * wide + PAD, y * wide + PAD, min(y + 1, h - 1) * wide + PAD
        for x in range(0, w, 16):
            opened = load16(eroded, here + x)
            for row in (above, here, below):
                for column in range(-1, 2):
                    opened = maximum(load16(eroded, row + x + column), opened)
            store(left, y * stride + x, load16(depths, here + x))
            store(left, (h + y) * stride + x, opened)


@njit
def filter_row(samples, rows, down, columns, across, line, stride, width, y, out):
    """Three separable filters of the samples around each display pixel, a vector of channels at a time.

    rows (H, 4) and columns (W, 4) say which samples, down (H, 4, 16) and across (W, 4, 16) with what weight
    for each channel; line (stride, 16) is scratch; out (width, 16).
    """
    a, b, c, d = rows[4 * y], rows[4 * y + 1], rows[4 * y + 2], rows[4 * y + 3]
    pitch = stride * 16
    wa, wb = load16(down, y * 64), load16(down, y * 64 + 16)
    wc, wd = load16(down, y * 64 + 32), load16(down, y * 64 + 48)
    for x in range(0, pitch, 16):
        upper = load16(samples, a * pitch + x) * wa + load16(samples, b * pitch + x) * wb
        lower = load16(samples, c * pitch + x) * wc + load16(samples, d * pitch + x) * wd
        store(line, x, upper + lower)
    for x in range(width):
        i, j, k, m = columns[4 * x], columns[4 * x + 1], columns[4 * x + 2], columns[4 * x + 3]
        w = 64 * x
        near = load16(line, 16 * i) * load16(across, w) + load16(line, 16 * j) * load16(across, w + 16)
        far = load16(line, 16 * k) * load16(across, w + 32) + load16(line, 16 * m) * load16(across, w + 48)
        store(out, 16 * x, near + far)


@njit
def cubic(t, sharpness):
    """Weights of the four samples around a place between the middle two."""
    s = 1.0 - t
    before, after = t * s * s * -sharpness, s * t * t * -sharpness
    second = ((t * (sharpness - 2.0) + (3.0 - 2.0 * sharpness)) * t + sharpness) * t
    return before, 1.0 - before - after - second, second, after


@njit
def place(position, first, last, count, pitch, at, slot):
    """Put the offsets of the samples `first` to `last` beside floor(position) into slots; return the rest."""
    whole = floor(position)
    i = to_int(whole)
    for k in range(first, last + 1):
        inside = minimum(maximum(i + np.int32(k), np.int32(0)), np.int32(count - 1))
        store(at, 16 * (slot + k - first), inside * np.int32(pitch))
    return position - whole


@njit
def aim(px, py, ox, oy, width, height, sharpness, at, weights):
    """Offsets and weights of sixteen warps: slots of sixteen, read back pixel by pixel by `warp`."""
    tx = place(px, -1, 2, width, 8, at, 0)
    ty = place(py, -1, 2, height, 8 * width, at, 4)
    sx = place(ox, 0, 1, width, 8, at, 8)
    sy = place(oy, 0, 1, height, 8 * width, at, 10)
    x0, x1, x2, x3 = cubic(tx, sharpness)
    y0, y1, y2, y3 = cubic(ty, sharpness)
    middle, sides = x1 + x2, y1 + y2
    scale = 1.0 / (middle * sides + (x0 + x3) * sides + middle * (y0 + y3))  # without the corners
    for slot, weight in enumerate((x0, x1, x2, x3, y0 * scale, y1 * scale, y2 * scale, y3 * scale, tx, ty, sx, sy)):
        store(weights, 16 * slot, weight)


@njit
def warp(history, at, weights, out):
    """Sixteen pixels of the past, (16, 16): colour by a cubic; colour and state, linear; colour by own motion."""
    h = history
    for i in range(16):
        a, b, c, d = at[i], at[16 + i], at[32 + i], at[48 + i]
        j, k, m, n = at[64 + i], at[80 + i], at[96 + i], at[112 + i]
        x0, x1, x2, x3 = weights[i], weights[16 + i], weights[32 + i], weights[48 + i]
        top = load4(h, j + b) * x1 + load4(h, j + c) * x2
        upper = load4(h, k + a) * x0 + load4(h, k + b) * x1 + load4(h, k + c) * x2 + load4(h, k + d) * x3
        lower = load4(h, m + a) * x0 + load4(h, m + b) * x1 + load4(h, m + c) * x2 + load4(h, m + d) * x3
        bottom = load4(h, n + b) * x1 + load4(h, n + c) * x2
        sharp = top * weights[64 + i] + upper * weights[80 + i] + lower * weights[96 + i]
        store(out, 16 * i, sharp + bottom * weights[112 + i])
        t, u = weights[128 + i], weights[144 + i]
        upper8 = load8(h, k + b) * (np.float32(1.0) - t) + load8(h, k + c) * t
        lower8 = load8(h, m + b) * (np.float32(1.0) - t) + load8(h, m + c) * t
        store(out, 16 * i + 4, upper8 * (np.float32(1.0) - u) + lower8 * u)
        a, b, j, k = at[128 + i], at[144 + i], at[160 + i], at[176 + i]
        t, u = weights[160 + i], weights[176 + i]
        upper = load4(h, j + a) * (np.float32(1.0) - t) + load4(h, j + b) * t
        lower = load4(h, k + a) * (np.float32(1.0) - t) + load4(h, k + b) * t
        store(out, 16 * i + 12, upper * (np.float32(1.0) - u) + lower * u)


PLANES = 26  # of a gathered row: see `gather_rows`
(
    FRAME, SAMPLE, PAST, TO_SAMPLE, TO_FRAME, CONTRAST, PAST_CONTRAST, BEYOND, LEAST, MOST, DETAIL, CONFIDENCE,
    COUNT, DIFFERENCE, SURFACE, SPEED, BLUR, EDGE,
) = range(18)  # fmt: skip


@njit
def hidden(depth, left, top, tx, ty, history_depth, stride, w, h, margin, ramp):
    """Share of the four samples around a place in the past that were closer than `depth`; see `covered`."""
    x0 = minimum(maximum(left, np.int32(0)), np.int32(w - 1))
    x1 = minimum(maximum(left + np.int32(1), np.int32(0)), np.int32(w - 1))
    y0 = minimum(maximum(top, np.int32(0)), np.int32(h - 1)) * np.int32(stride)
    y1 = minimum(maximum(top + np.int32(1), np.int32(0)), np.int32(h - 1)) * np.int32(stride)
    share = depth * 0.0
    for at, weight in (
        (y0 + x0, (1.0 - tx) * (1.0 - ty)),
        (y0 + x1, tx * (1.0 - ty)),
        (y1 + x0, (1.0 - tx) * ty),
        (y1 + x1, tx * ty),
    ):
        before = gather(history_depth, at)
        closer = (before - depth) / maximum(maximum(before, depth), 1e-12)
        share = share + weight * clamped((closer - margin) / ramp, 0.0, 1.0)
    return select(depth >= 0.0, share, 0.0)


@njit
def put(seen, at, value):
    """What the network sees, as a byte."""
    store(seen, at, to_int(clamped(value, 0.0, 1.0) * 255.0 + 0.5))


@njit
def contrast_row(ring, above, here, below, wide, seen, seen_row, width):
    """How much the past differs around each pixel, and how far this frame's sample is outside of that."""
    for x in range(0, width, 16):
        low = high = load16(ring, here * wide + PAD + x)
        for line in (above, here, below):
            for column in range(-1, 2):
                other = load16(ring, line * wide + PAD + x + column)
                low, high = minimum(other, low), maximum(other, high)
        luma = to_float(load16(seen, SAMPLE * width + seen_row + x)) * (1.0 / 255.0)
        put(seen, PAST_CONTRAST * width + seen_row + x, high - low)
        put(seen, BEYOND * width + seen_row + x, maximum(maximum(low - luma, luma - high), 0.0))


@njit
def words_of(seen, upper, lower):
    """Sixteen packed pixels: two of each row in the bytes of a word."""
    a, b = load16(seen, upper), load16(seen, upper + 16)
    c, d = load16(seen, lower), load16(seen, lower + 16)
    return evens(a, b) | odds(a, b) << np.int32(8) | evens(c, d) << np.int32(16) | odds(c, d) << np.int32(24)


@njit
def pack_rows(seen, upper, lower, width, half_width, records, to):
    """Pack two rows of bytes into records of 28 words, of which these are the first 18."""
    for x in range(0, half_width, 16):
        u, v = upper + 2 * x, lower + 2 * x
        rows = transposed((
            words_of(seen, u, v), words_of(seen, u + width, v + width),
            words_of(seen, u + 2 * width, v + 2 * width), words_of(seen, u + 3 * width, v + 3 * width),
            words_of(seen, u + 4 * width, v + 4 * width), words_of(seen, u + 5 * width, v + 5 * width),
            words_of(seen, u + 6 * width, v + 6 * width), words_of(seen, u + 7 * width, v + 7 * width),
            words_of(seen, u + 8 * width, v + 8 * width), words_of(seen, u + 9 * width, v + 9 * width),
            words_of(seen, u + 10 * width, v + 10 * width), words_of(seen, u + 11 * width, v + 11 * width),
            words_of(seen, u + 12 * width, v + 12 * width), words_of(seen, u + 13 * width, v + 13 * width),
            words_of(seen, u + 14 * width, v + 14 * width), words_of(seen, u + 15 * width, v + 15 * width),
        ))  # fmt: skip
        pairs = zipped(
            words_of(seen, u + 16 * width, v + 16 * width), words_of(seen, u + 17 * width, v + 17 * width)
        )
        for i in range(16):
            store(records, to + 28 * (x + i), rows[i])
        store_pairs(records, to + 28 * x + 16, 28, pairs)


@njit
def recall(classes, followed, width, half_w, half_h, records, to):
    """What a row of packed pixels was held for, (half_h, half_w, 8) bytes, as two words of each record."""
    half = np.float32(0.5)
    for x in range(half_w):
        px, py = half * followed[2 * x], half * followed[width + 2 * x]
        left, top = np.int64(np.floor(px)), np.int64(np.floor(py))
        t, u = px - np.float32(left), py - np.float32(top)
        x0, x1 = min(max(left, 0), half_w - 1), min(max(left + 1, 0), half_w - 1)
        y0, y1 = min(max(top, 0), half_h - 1) * half_w, min(max(top + 1, 0), half_h - 1) * half_w
        a, b = to_float(load8(classes, 8 * (y0 + x0))), to_float(load8(classes, 8 * (y0 + x1)))
        c, d = to_float(load8(classes, 8 * (y1 + x0))), to_float(load8(classes, 8 * (y1 + x1)))
        upper, lower = a + (b - a) * t, c + (d - c) * t
        value = to_int(upper + (lower - upper) * u + 0.5)
        records[to + 28 * x + 18] = packed(value, 0)
        records[to + 28 * x + 19] = packed(value, 4)


@njit
def complete(ring, seen, records, y, below, wide, width, big_w, big_h, half_row):
    """Finish row y, whose rows around are known now; pack it with the one above where it is the second."""
    row = (y % 4) * 18 * width
    contrast_row(ring, max(y - 1, 0) % 3, y % 3, below % 3, wide, seen, row, width)
    if big_w % 2:
        for c in range(18):
            seen[row + c * width + big_w] = seen[row + c * width + big_w - 1]
    if y % 2 or y == big_h - 1:
        upper = ((y - y % 2) % 4) * 18 * width
        pack_rows(seen, upper, row, width, (big_w + 1) // 2, records, (y // 2) * half_row * 28)


def gather_rows(
    samples, nearest, edges, across, down, stride, history, history_depth, old_stride,
    rows, row_weights, columns, column_weights, lefts, columns_near, tops, rows_near,
    opened, numbers, sizes, y0, y1, line, filtered, ring, slots, weights, warped, followed, seen, gathered, classes, records,
):  # fmt: skip
    """All that is known of rows y0 to y1 before the network speaks.

    gathered (H, PLANES, width): frame 3, sample 3, confidence, mean and reach of the box 6, past 3, detail 3,
    own 3, count, surface, range 2. records (H / 2, half_row, 28) words: what the network sees, four pixels a word.
    """
    w, old_w, old_h, big_w, big_h, width = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4], sizes[5]
    half_row = sizes[6]
    exposure, extent_x, extent_y, w_big, h_big = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    old_x, old_y, jitter_x, jitter_y = numbers[5], numbers[6], numbers[7], numbers[8]
    sharpness, gamma, margin, ramp = numbers[9], numbers[10], numbers[11], numbers[12]
    padded, wide = stride + 2 * PAD, width + 2 * PAD
    zero = spread16(np.float32(0.0))
    for y in range(max(y0 - 1, 0), min(y1 + 1, big_h)):
        inside = y0 <= y < y1
        ring_row = (y % 4) * 18 * width
        if inside:
            filter_row(
                samples, rows, row_weights, columns, column_weights, line, stride, big_w, y, filtered
            )
        for x in range(0, width, 16):
            ramp_x = to_float(ramp16() + np.int32(x))
            at = load16(lefts, x) + np.int32(tops[y] * 3 * stride)
            depth = gather(nearest, at)
            mx = gather(nearest, at + np.int32(stride)) * w_big / extent_x
            my = gather(nearest, at + np.int32(2 * stride)) * h_big / extent_y
            px, py = ramp_x + mx, my + np.float32(y)
            on = (px > -0.5) & (px < w_big - 0.5) & (py > -0.5) & (py < h_big - 0.5)
            px, py = clamped(px, -2.0, w_big + 1.0), clamped(py, -2.0, h_big + 1.0)
            near = load16(columns_near, x)
            at = near + np.int32(rows_near[y] * padded + PAD)
            ox = clamped(ramp_x + gather(across, at) * w_big / extent_x, -2.0, w_big + 1.0)
            oy = clamped(gather(down, at) * h_big / extent_y + np.float32(y), -2.0, h_big + 1.0)
            store(followed, x, px)
            store(followed, width + x, py)
            aim(px, py, ox, oy, big_w, big_h, sharpness, slots, weights)
            warp(history, slots, weights, warped)
            q = load_columns(warped, 0)
            pr, pg, pb = toned(
                quarantined(q[0]) * exposure, quarantined(q[1]) * exposure, quarantined(q[2]) * exposure
            )
            rr, rg, rb = root(pr), root(pg), root(pb)
            luma = luminance(rr, rg, rb)
            store(ring, (y % 3) * wide + PAD + x, luma)
            if not inside:
                continue
            put(seen, PAST * width + ring_row + x, luma)
            to = y * PLANES * width + x
            lr, lg, lb = toned(
                quarantined(q[4]) * exposure, quarantined(q[5]) * exposure, quarantined(q[6]) * exposure
            )
            r, g, b = toned(
                quarantined(q[12]) * exposure, quarantined(q[13]) * exposure, quarantined(q[14]) * exposure
            )
            dr, dg, db = pr - lr, pg - lg, pb - lb
            count = select(on, q[7], 0.0)
            for c, v in enumerate((pr, pg, pb, dr, dg, db, r, g, b, count)):
                store(gathered, to + (13 + c) * width, v)
            store(gathered, to + 24 * width, q[8])
            store(gathered, to + 25 * width, q[9])
            # where it was in the depth of the frame before
            sx = (px + 0.5) * old_x / w_big - 0.5 - jitter_x
            sy = (py + 0.5) * old_y / h_big - 0.5 - jitter_y
            fx, fy = floor(sx), floor(sy)
            cover = hidden(
                depth, to_int(fx), to_int(fy), sx - fx, sy - fy, opened, old_stride, old_w, old_h, margin, ramp
            )
            surface = select(on, maximum(1.0 - cover * 2.0, 0.0), 0.0)
            store(gathered, to + 23 * width, surface)
            ix = minimum(maximum(to_int(floor(sx + 0.5)), np.int32(0)), np.int32(old_w - 1))
            iy = minimum(maximum(to_int(floor(sy + 0.5)), np.int32(0)), np.int32(old_h - 1))
            there = gather(history_depth, iy * np.int32(old_stride) + ix)
            apart = (there - depth) / maximum(maximum(there, depth), 1e-12)
            apart = select(depth >= 0.0, clamped(apart, -1.0, 1.0), 0.0)
            # this frame
            p = load_columns(filtered, 16 * x)
            scale = 1.0 / maximum(p[3], 1e-6)
            sr, sg, sb = (
                clamped(p[0] * scale, 0.0, TONED), clamped(p[1] * scale, 0.0, TONED), clamped(p[2] * scale, 0.0, TONED),
            )  # fmt: skip
            confidence = minimum(p[3], 1.0)
            scale = 1.0 / maximum(p[14], 1e-6)
            luma0, orange0, green0 = p[8] * scale, p[9] * scale, p[10] * scale
            known = p[14] > 1e-3
            luma2, orange2, green2 = (
                select(known, p[11] * scale, 1.0), select(known, p[12] * scale, 1.0), select(known, p[13] * scale, 1.0),
            )  # fmt: skip
            var_y, var_o, var_g = luma2 - luma0 * luma0, orange2 - orange0 * orange0, green2 - green0 * green0
            fr, fg, fb = rgb(luma0, orange0, green0)
            whole = p[7] > 0.9
            scale = 1.0 / maximum(p[7], 1e-6)
            fr = clamped(select(whole, p[4] * scale, fr), 0.0, TONED)
            fg = clamped(select(whole, p[5] * scale, fg), 0.0, TONED)
            fb = clamped(select(whole, p[6] * scale, fb), 0.0, TONED)
            reach_y = square_root(maximum(var_y, 0.0)) * gamma
            reach_o = square_root(maximum(var_o, 0.0)) * gamma
            reach_g = square_root(maximum(var_g, 0.0)) * gamma
            for c, v in enumerate((fr, fg, fb, sr, sg, sb, confidence, luma0, orange0, green0, reach_y, reach_o, reach_g)):
                store(gathered, to + c * width, v)
            # what the network sees
            ar, ag, ab = root(sr), root(sg), root(sb)
            put(seen, SAMPLE * width + ring_row + x, luminance(ar, ag, ab))
            put(seen, TO_SAMPLE * width + ring_row + x, largest(absolute(rr - ar), absolute(rg - ag), absolute(rb - ab)))
            ar, ag, ab = root(fr), root(fg), root(fb)
            put(seen, FRAME * width + ring_row + x, luminance(ar, ag, ab))
            put(seen, TO_FRAME * width + ring_row + x, largest(absolute(rr - ar), absolute(rg - ag), absolute(rb - ab)))
            put(seen, CONTRAST * width + ring_row + x, root(root(largest(var_y, var_o, var_g))))
            put(seen, LEAST * width + ring_row + x, root(q[8]))
            put(seen, MOST * width + ring_row + x, root(q[9]))
            put(seen, DETAIL * width + ring_row + x, root(largest(absolute(dr), absolute(dg), absolute(db))))
            put(seen, CONFIDENCE * width + ring_row + x, confidence)
            put(seen, COUNT * width + ring_row + x, count / (count + 4.0))
            put(seen, DIFFERENCE * width + ring_row + x, apart * 0.5 + 0.5)
            put(seen, SURFACE * width + ring_row + x, surface)
            speed = square_root(mx * mx + my * my)
            put(seen, SPEED * width + ring_row + x, speed / (speed + 4.0))
            tx, ty = px - floor(px), py - floor(py)
            put(seen, BLUR * width + ring_row + x, (tx * (1.0 - tx) + ty * (1.0 - ty)) * 2.0)
            put(seen, EDGE * width + ring_row + x, gather(edges, near + np.int32(rows_near[y] * stride)))
        if inside and y % 2 == 0:
            recall(classes, followed, width, (big_w + 1) // 2, (big_h + 1) // 2, records, y // 2 * half_row * 28)
        first, last = (y % 3) * wide + PAD, (y % 3) * wide + PAD + big_w - 1
        for x in range(PAD):
            ring[first - 1 - x] = ring[first]
            ring[last + 1 + x] = ring[last]
        if y - 1 >= y0:
            complete(ring, seen, records, y - 1, y, wide, width, big_w, big_h, half_row)
    if y1 == big_h:
        complete(ring, seen, records, big_h - 1, big_h - 1, wide, width, big_w, big_h, half_row)
