"""Kernels of static blocks; same as `supersampler_model.ops.at_rest`.

Blocks are numbered row by row. A pixel's mean is four floats: linear RGB, and the sum of the weights.
"""

import numpy as np

from supersampler.backends.cpu.layout import LANES
from supersampler.backends.cpu.simd.shuffles import first_third, last_third, load_columns4, second_third
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    device_function,
    gather,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    spread16,
    square_root,
    store,
)
from supersampler.backends.cpu.structs import (
    KEEPS,
    RESTARTS,
    SUMS,
    AddedSamples,
    BlockSums,
    Bytes,
    Floats,
    RestSamples,
    ShownMean,
)
from supersampler.io.display import MAX_HALF
from supersampler.methods.at_rest import BLOCK, LEAST_WEIGHT, MAX_STATIC_MOTION
from supersampler.methods.constants import DARKNESS, FINITE_MOTION, FULL_WEIGHT

RGB = 3 * LANES
"""Values of the samples that are read together: LANES // BLOCK blocks."""
SLOW = np.float32(0.7 * MAX_STATIC_MOTION)
"""On both axes a sample that moves no more than this stands."""
LEAST = np.float32(LEAST_WEIGHT)


@device_function
def within_half(value):
    """Clamp a number to [0, MAX_HALF]; NaN becomes 0."""
    return min(max(value, np.float32(0.0)), np.float32(MAX_HALF)) if value == value else np.float32(0.0)


@device_function
def is_missing(color, at):
    """Return whether a channel of a sample is NaN."""
    return color[at] != color[at] or color[at + 1] != color[at + 1] or color[at + 2] != color[at + 2]


@device_function
def moves(samples, y, x):
    """Return whether a sample moves, or is reactive."""
    at = y * samples.width + x
    mx, my = samples.motion[2 * at], samples.motion[2 * at + 1]
    mx = mx if abs(mx) <= np.float32(FINITE_MOTION) else np.float32(0.0)
    my = my if abs(my) <= np.float32(FINITE_MOTION) else np.float32(0.0)
    if mx * mx + my * my > np.float32(MAX_STATIC_MOTION * MAX_STATIC_MOTION):
        return True
    return samples.has_reactive != 0 and samples.reactive[at] > np.float32(0.0)


@device_function
def all_stand(samples, y, x):
    """Return True only where none of sixteen samples moves or is reactive; False says nothing."""
    at = y * samples.width + x
    stand = x + LANES <= samples.width
    if stand:
        for part in range(0, 2 * LANES, LANES):
            stand = stand and all_lanes(absolute(load16(samples.motion, 2 * at + part)) <= SLOW)
        if samples.has_reactive != 0:
            stand = stand and all_lanes(load16(samples.reactive, at) <= np.float32(0.0))
    return stand


@device_function
def block_moves(samples, by, bx):
    """Return whether a sample of a block moves."""
    for y in range(by * BLOCK, min(by * BLOCK + BLOCK, samples.height)):
        for x in range(bx * BLOCK, min(bx * BLOCK + BLOCK, samples.width)):
            if moves(samples, y, x):
                return True
    return False


@device_function
def read_samples(samples, y, x, scratch):
    """Return whether sixteen samples can be read in place; else write them to scratch, sanitized."""
    at, inside = 3 * (y * samples.width + x), x + LANES <= samples.width
    if inside:
        for part in range(0, RGB, LANES):
            values = load16(samples.color, at + part)
            inside = inside and all_lanes(values <= np.float32(MAX_HALF))  # no NaN
    if inside:
        return True
    for i in range(LANES):
        sample = 3 * (y * samples.width + min(x + i, samples.width - 1))
        missing = is_missing(samples.color, sample)
        for c in range(3):
            value = np.float32(0.0) if missing else within_half(samples.color[sample + c])
            scratch[3 * i + c] = value
    return False


@device_function
def add_roots(samples, from_scratch, at, row, scratch):
    """Add the fourth roots of sixteen samples to RGB sums, and weighted to RGB more."""
    for part in range(0, RGB, LANES):
        values = load16(scratch, part) if from_scratch else load16(samples.color, at + part)
        roots = square_root(square_root(maximum(values, spread16(np.float32(0.0)))))
        store(scratch, RGB + part, load16(scratch, RGB + part) + roots)
        weighted = roots * load16(samples.weights, row * RGB + part)
        store(scratch, 2 * RGB + part, load16(scratch, 2 * RGB + part) + weighted)


@device_function
def write_signature(scratch, block, samples, to):
    """Write the signature of one of the blocks whose sums are in scratch."""
    order, count = np.float32(0.0), samples.across * samples.down
    for c in range(3):
        total = np.float32(0.0)
        for x in range(BLOCK):
            at = 3 * (BLOCK * block + x) + c
            total += scratch[RGB + at]
            order += scratch[2 * RGB + at]
        samples.signatures[c * count + to] = total * np.float32(1.0 / (BLOCK * BLOCK))
    samples.signatures[3 * count + to] = order


def sign_blocks(samples: RestSamples, scratch: Floats, y0: int, y1: int):
    """Write which blocks of rows y0 to y1 move, and the signatures of all others; scratch: 3 * RGB."""
    for by in range(y0, y1):
        for first in range(0, samples.across, LANES // BLOCK):
            end, stands, still = min(first + LANES // BLOCK, samples.across), False, True
            for y in range(by * BLOCK, min(by * BLOCK + BLOCK, samples.height)):
                still = still and all_stand(samples, y, BLOCK * first)
            for bx in range(first, end):
                block_is_moving = not still and block_moves(samples, by, bx)
                samples.moving[by * samples.across + bx] = 1 if block_is_moving else 0
                stands = stands or not block_is_moving
            if not stands:
                continue
            for at in range(RGB, 3 * RGB, LANES):
                store(scratch, at, spread16(np.float32(0.0)))
            for row in range(BLOCK):
                y = min(by * BLOCK + row, samples.height - 1)
                in_place = read_samples(samples, y, BLOCK * first, scratch)
                add_roots(samples, not in_place, 3 * (y * samples.width + BLOCK * first), row, scratch)
            for bx in range(first, end):
                write_signature(scratch, bx - first, samples, by * samples.across + bx)


@device_function
def tap(sums, row, column, weight, total):
    """Add a pixel of the mean to RGB and the share of pixels with enough samples."""
    known = sums.ages[sums.row_blocks[row] * sums.across + sums.column_blocks[column]] > np.float32(0.0)
    at = 4 * (row * sums.display_width + column)
    enough = weight if known and sums.mean[at + 3] >= LEAST else np.float32(0.0)
    if not known:
        return total
    r, g, b = sums.mean[at], sums.mean[at + 1], sums.mean[at + 2]
    return total[0] + r * weight, total[1] + g * weight, total[2] + b * weight, total[3] + enough


@device_function
def mean_at(sums, y, x):
    """Read the mean bilinearly at a sample; see `tap`."""
    zero = np.float32(0.0)
    total = zero, zero, zero, zero
    for i in range(2):
        for j in range(2):
            weight = sums.row_weights[2 * y + i] * sums.column_weights[2 * x + j]
            total = tap(sums, sums.rows[2 * y + i], sums.columns[2 * x + j], weight, total)
    return total


def sum_blocks(sums: BlockSums, y0: int, y1: int):
    """Write the SUMS of the wanted blocks of rows y0 to y1."""
    count = sums.across * sums.down
    for by in range(y0, y1):
        for bx in range(sums.across):
            block = by * sums.across + bx
            if sums.wanted[block] == 0:
                continue
            for i in range(SUMS):
                sums.sums[i * count + block] = np.float32(0.0)
            for row in range(BLOCK):
                y = min(by * BLOCK + row, sums.height - 1)
                for column in range(BLOCK):
                    x = min(bx * BLOCK + column, sums.width - 1)
                    add_residual(sums, y, x, block, count)


@device_function
def add_residual(sums, y, x, block, count):
    """Add a sample to the sums of its block, where it counts."""
    at = 3 * (y * sums.width + x)
    if is_missing(sums.color, at):
        return
    expected = mean_at(sums, y, x)
    if not expected[3] > np.float32(FULL_WEIGHT):
        return
    squares, color_squares = np.float32(0.0), np.float32(0.0)
    r, g, b = within_half(sums.color[at]), within_half(sums.color[at + 1]), within_half(sums.color[at + 2])
    add_channel(sums, r, expected[0], 0, block, count)
    add_channel(sums, g, expected[1], 1, block, count)
    add_channel(sums, b, expected[2], 2, block, count)
    squares = (r - expected[0]) * (r - expected[0]) + (g - expected[1]) * (g - expected[1])
    squares += (b - expected[2]) * (b - expected[2])
    color_squares = r * r + g * g + b * b
    sums.sums[block] += np.float32(1.0)
    sums.sums[10 * count + block] += squares
    sums.sums[11 * count + block] += color_squares


@device_function
def add_channel(sums, value, expected, c, block, count):
    """Add one channel of a sample."""
    sums.sums[(1 + c) * count + block] += value - expected
    sums.sums[(4 + c) * count + block] += value
    sums.sums[(7 + c) * count + block] += expected


def add_samples(added: AddedSamples, y0: int, y1: int, x0: int, x1: int):
    """Write the next mean of rows y0 to y1 and columns x0 to x1: see KEEPS."""
    for y in range(y0, y1):
        blocks = added.row_blocks[y] * added.across
        for x in range(x0, x1):
            mode = added.modes[blocks + added.column_blocks[x]]
            if mode == 0:
                continue
            at = 4 * (y * added.width + x)
            zero = np.float32(0.0)
            r, g, b, weight = zero, zero, zero, zero
            if mode != RESTARTS:
                r, g, b, weight = (
                    added.before[at],
                    added.before[at + 1],
                    added.before[at + 2],
                    added.before[at + 3],
                )
            if mode != KEEPS:
                r, g, b, weight = with_samples(added, y, x, (r, g, b, weight))
            added.after[at] = r
            added.after[at + 1] = g
            added.after[at + 2] = b
            added.after[at + 3] = weight


@device_function
def with_samples(added, y, x, mean):
    """Return a mean with the samples near a pixel."""
    zero = np.float32(0.0)
    r, g, b, near = zero, zero, zero, zero
    for i in range(2):
        down, row = added.row_weights[2 * y + i], added.rows[2 * y + i]
        for j in range(2):
            weight = down * added.column_weights[2 * x + j]
            at = 3 * (row * added.samples_across + added.columns[2 * x + j])
            if weight > zero and not is_missing(added.color, at):
                r += weight * within_half(added.color[at])
                g += weight * within_half(added.color[at + 1])
                b += weight * within_half(added.color[at + 2])
                near += weight
    if not near > zero:
        return mean
    total = mean[3] + near
    share, weight = np.float32(1.0) / max(total, np.float32(1e-6)), mean[3]
    r, g, b = mean[0] * weight + r, mean[1] * weight + g, mean[2] * weight + b
    return r * share, g * share, b * share, total


@device_function
def slope(before, here, after, known):
    """Return the slope of a mean at a pixel; see `at_centres` of the torch module."""
    below, above = here - before, after - here
    most = min(abs(below), abs(above)) * np.float32(2.0) * known
    return max(min(np.float32(0.5) * (below + above), most), -most)


@device_function
def is_complete(shown, y, x):
    """Return 1 where a pixel has the samples of a whole period, else 0."""
    block = shown.row_blocks[y] * shown.across + shown.column_blocks[x]
    enough = shown.complete[block] > 0.0 and shown.mean[4 * (y * shown.width + x) + 3] >= LEAST
    return np.float32(1.0) if enough else np.float32(0.0)


@device_function
def write_offsets(shown, y, x, scratch):
    """Write the mean offsets of a period's samples from sixteen pixels' centres: x, then y."""
    zero = spread16(np.float32(0.0))
    weight, across, down = zero, zero, zero
    for phase in range(shown.phases):
        at, row = 2 * phase * shown.pitch + x, 2 * (phase * shown.height + y)
        gx, gy = load16(shown.column_moments, at), shown.row_moments[row]
        weight = weight + gx * gy
        across = across + load16(shown.column_moments, at + shown.pitch) * gy
        down = down + gx * shown.row_moments[row + 1]
    weight = maximum(weight, spread16(np.float32(1e-6)))
    store(scratch, 0, across / weight)
    store(scratch, LANES, down / weight)


@device_function
def fades(shown, blocks, x, end):
    """Return whether a pixel of a row from x to end fades to a mean that is moved to its centre."""
    for i in range(x, end):
        share = shown.shares[blocks + shown.column_blocks[i]]
        if share > np.float32(0.0) and share < np.float32(1.5):
            return True
    return False


@device_function
def show_pixel(shown, y, x, share, dx, dy):
    """Fade a pixel to its mean, which is moved by an offset along its slope."""
    mean, four = shown.mean, 4 * shown.width
    at, to = 4 * (y * shown.width + x), 3 * (y * shown.width + x)
    left, right = at - (4 if x > 0 else 0), at + (4 if x < shown.width - 1 else 0)
    above, under = at - (four if y > 0 else 0), at + (four if y < shown.height - 1 else 0)
    known_x = known_y = np.float32(0.0)
    if dx != np.float32(0.0) or dy != np.float32(0.0):
        known_x = is_complete(shown, y, max(x - 1, 0)) * is_complete(shown, y, min(x + 1, shown.width - 1))
        known_y = is_complete(shown, max(y - 1, 0), x) * is_complete(shown, min(y + 1, shown.height - 1), x)
    for c in range(3):
        here = mean[at + c]
        moved = slope(mean[left + c], here, mean[right + c], known_x) * dx
        moved += slope(mean[above + c], here, mean[under + c], known_y) * dy
        own = shown.image[to + c]
        value = min(own + share * (max(here - moved, np.float32(0.0)) - own), np.float32(MAX_HALF))
        shown.image[to + c] = value if value >= np.float32(DARKNESS) else np.float32(0.0)


@device_function
def slopes(before, here, after, known):
    """Return `slope` of sixteen pixels."""
    below, above = here - before, after - here
    most = minimum(absolute(below), absolute(above)) * known * np.float32(2.0)
    return maximum(minimum((below + above) * np.float32(0.5), most), most * np.float32(-1.0))


@device_function
def are_complete(shown, y, x, weights):
    """Return `is_complete` of sixteen pixels of these weights."""
    blocks = load16(shown.column_blocks, x) + np.int32(shown.row_blocks[y] * shown.across)
    return select(weights >= LEAST, gather(shown.complete, blocks), 0.0)


@device_function
def show_sixteen(shown, y, x, shares, scratch):
    """Show sixteen pixels that have neighbours on either side; see `show_pixel`."""
    above, under = max(y - 1, 0), min(y + 1, shown.height - 1)
    at, image, mean = 4 * (y * shown.width + x), shown.image, shown.mean
    here, left, right = load_columns4(mean, at), load_columns4(mean, at - 4), load_columns4(mean, at + 4)
    over = load_columns4(mean, 4 * (above * shown.width + x))
    below = load_columns4(mean, 4 * (under * shown.width + x))
    known_x = are_complete(shown, y, x - 1, left[3]) * are_complete(shown, y, x + 1, right[3])
    known_y = are_complete(shown, above, x, over[3]) * are_complete(shown, under, x, below[3])
    share, dx, dy = select(here[3] >= LEAST, shares, 0.0), load16(scratch, 0), load16(scratch, LANES)
    to = 3 * (y * shown.width + x)
    index = ramp16() * np.int32(3) + np.int32(to)
    for c in range(3):
        moved = slopes(left[c], here[c], right[c], known_x) * dx
        moved = moved + slopes(over[c], here[c], below[c], known_y) * dy
        own = gather(image, index + np.int32(c))
        value = minimum(own + share * (maximum(here[c] - moved, 0.0) - own), np.float32(MAX_HALF))
        value = select(value >= DARKNESS, value, 0.0)
        store(scratch, (2 + c) * LANES, value)
    r, g, b = (load16(scratch, 2 * LANES), load16(scratch, 3 * LANES), load16(scratch, 4 * LANES))
    store(image, to, first_third(r, g, b))
    store(image, to + LANES, second_third(r, g, b))
    store(image, to + 2 * LANES, last_third(r, g, b))


def show_mean(shown: ShownMean, scratch: Floats, y0: int, y1: int, x0: int, x1: int):
    """Fade the image to the mean in rows y0 to y1 and columns x0 to x1.

    shares: of each block: 0 nothing, up to 1 the share of the mean, 2 the mean as it is, -1 by its weight.
    scratch: 5 * LANES.
    """
    for y in range(y0, y1):
        blocks = shown.row_blocks[y] * shown.across
        for first in range(x0, x1, LANES):
            end = min(first + LANES, x1)
            if fades(shown, blocks, first, end):
                write_offsets(shown, y, first, scratch)
                if end - first == LANES and first > 0 and end < shown.width:
                    shares = gather(shown.shares, load16(shown.column_blocks, first) + np.int32(blocks))
                    if all_lanes((shares > 0.0) & (shares < 1.5)):
                        show_sixteen(shown, y, first, shares, scratch)
                        continue
            for x in range(first, end):
                share = shown.shares[blocks + shown.column_blocks[x]]
                at, to = 4 * (y * shown.width + x), 3 * (y * shown.width + x)
                if share == np.float32(0.0):
                    continue
                weight, dx, dy = shown.mean[at + 3], scratch[x - first], scratch[LANES + x - first]
                if share > np.float32(1.5):
                    for c in range(3):
                        shown.image[to + c] = shown.mean[at + c]
                elif share < np.float32(0.0):
                    part = max(weight / shown.noise_weight - np.float32(1.0), np.float32(0.0))
                    show_pixel(shown, y, x, min(part, np.float32(1.0)), np.float32(0.0), np.float32(0.0))
                elif weight >= LEAST:
                    show_pixel(shown, y, x, share, dx, dy)
                else:
                    show_pixel(shown, y, x, np.float32(0.0), np.float32(0.0), np.float32(0.0))


def freeze_mean(shown: ShownMean, frozen: Bytes, y0: int, y1: int, x0: int, x1: int):
    """Write the image to the mean in the marked blocks."""
    for y in range(y0, y1):
        blocks = shown.row_blocks[y] * shown.across
        for x in range(x0, x1):
            if frozen[blocks + shown.column_blocks[x]] != 0:
                at, to = 4 * (y * shown.width + x), 3 * (y * shown.width + x)
                for c in range(3):
                    shown.mean[at + c] = shown.image[to + c]
