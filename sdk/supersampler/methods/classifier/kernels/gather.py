"""Gather of `classifier`; same as `Classifier.gather` and its network inputs, in one pass.

A vector holds one channel of sixteen pixels. Where positions differ from pixel to pixel (warps), it holds the
channels of one pixel. Rows are padded to a multiple of sixteen pixels.
"""

import numpy as np

from supersampler.backends.cpu.kernels.colors import (
    clamped,
    from_ycocg,
    largest,
    luminance,
    root,
    sanitize,
    toned,
    without_glare,
)
from supersampler.backends.cpu.kernels.filters import filter_all_across, filter_all_down
from supersampler.backends.cpu.kernels.frame import or_fill, repeat_ends, sample_indices
from supersampler.backends.cpu.kernels.warp import (
    linear_taps,
    occlusion,
    on_screen,
    prepare_own_warp,
    prepare_warp,
    previous_position,
    warp,
)
from supersampler.backends.cpu.layout import HISTORY_PLANES, INPUT_PLANES, PAD, RECORD_WORDS
from supersampler.backends.cpu.simd.shuffles import gather4, load_columns
from supersampler.backends.cpu.simd.vector import (
    absolute,
    all_lanes,
    device_function,
    floor,
    load16,
    maximum,
    minimum,
    ramp16,
    select,
    spread16,
    square_root,
    store,
    stream,
    sum_of_lanes,
    to_float,
)
from supersampler.backends.cpu.structs import Floats, FrameSamples, ResampleTables
from supersampler.methods.classifier.kernels import network_inputs as words
from supersampler.methods.classifier.kernels.guided import (
    edge_at,
    guide_pixels,
    kept_reflectance,
    lit,
    reflectance,
    relit,
    surface_at,
    warp_reflectance,
)
from supersampler.methods.classifier.kernels.network_inputs import complete_row, store_input, warp_classes
from supersampler.methods.classifier.spec import CLASSIFIER, CONTRAST, HALF_COUNT, RISE, WHITE
from supersampler.methods.classifier.structs import (
    ClassifierHistoryInput,
    Gathered,
    GatherScratch,
    Guide,
    NetworkInputs,
    Variant,
)
from supersampler.methods.constants import CONFIRMED, GLARE, MAX_TONED, MIN_CUBIC_WEIGHT, MIN_WEIGHT
from supersampler.methods.spec import constant_indices

FRAME, SAMPLE, CONFIDENCE, DETAIL, SURFACE, COUNT, MIN_LUMA, MAX_LUMA = 0, 3, 6, 7, 10, 11, 12, 13
"""First planes of `Gathered.rest`; `Variant` gives those after them."""
C = constant_indices(CLASSIFIER)
EXPOSURE, W, H, BIG_W, BIG_H, OLD_W, OLD_H, JITTER_X, JITTER_Y, GLARES = range(len(C), len(C) + 10)
"""Indices into `numbers`, after the constants of `classifier`.

Sizes: W, H of this frame, BIG of the display, OLD of the previous frame. JITTER: of the previous frame.
GLARES: 1 where this frame or the history may have light over GLARE_EXPOSED, else 0.
"""


@device_function
def toned_at(numbers, r, g, b):
    """Return linear colours of the history, exposed and toned."""
    e = numbers[EXPOSURE]
    return toned(sanitize(r) * e, sanitize(g) * e, sanitize(b) * e)


@device_function
def select3(where, values):
    """Return three vectors where `where` is set, 0 elsewhere."""
    return select(where, values[0], 0.0), select(where, values[1], 0.0), select(where, values[2], 0.0)


@device_function
def store_planes(planes, at, values):
    """Store vectors one after the other, past the caches."""
    for c, value in enumerate(values):
        stream(planes, at + 16 * c, value)


@device_function
def gather_surface(depth, of_surface, depths, padded_width, places, numbers):
    """Return the surface's previous visibility, [0, 1], and the depth difference, [-1, 1] (equation 10).

    of_surface: its previous position, x and y in display pixels, and whether it is on screen; depths (h',
    padded_width, 2): of the history, as `keep_depth` writes it; places: scratch.
    """
    px, py, on = of_surface
    old_w, old_h = np.int64(numbers[OLD_W]), np.int64(numbers[OLD_H])
    x = (px + 0.5) * numbers[OLD_W] / numbers[BIG_W] - 0.5 - numbers[JITTER_X]
    y = (py + 0.5) * numbers[OLD_H] / numbers[BIG_H] - 0.5 - numbers[JITTER_Y]
    weights = linear_taps(x, y, old_w, old_h, padded_width, places)
    a, b, c, d = gather4(depths, places, 0, 2, 0)
    e, f, g, h = gather4(depths, places, 16, 2, 0)
    occluded = occlusion(depth, weights, (b, d, f, h), numbers[C.depth_margin], numbers[C.depth_ramp])
    surface = select(on, maximum(1.0 - occluded * 2.0, 0.0), 0.0)
    right, low = x - floor(x) >= 0.5, y - floor(y) >= 0.5
    depth_before = select(low, select(right, g, e), select(right, c, a))
    depth_before = select(on, depth_before, 0.0)
    difference = (depth_before - depth) / maximum(maximum(depth_before, depth), 1e-12)
    return surface, select(depth >= 0.0, clamped(difference, -1.0, 1.0), 0.0)


@device_function
def current_frame(sums, gamma):
    """Return `CurrentFrame` of sixteen pixels: frame, sample, confidence, mean, extents, variance.

    sums: sixteen vectors by `filter_all_across`; extents: half sides of the variance box, YCoCg; variance:
    the largest of three channels.
    """
    scale = 1.0 / maximum(sums[3], 1e-6)
    sample = (
        clamped(sums[0] * scale, 0.0, MAX_TONED),
        clamped(sums[1] * scale, 0.0, MAX_TONED),
        clamped(sums[2] * scale, 0.0, MAX_TONED),
    )
    scale, known = 1.0 / maximum(sums[14], 1e-6), sums[14] > MIN_WEIGHT
    mean = sums[8] * scale, sums[9] * scale, sums[10] * scale
    variances = (
        select(known, sums[11] * scale, 1.0) - mean[0] * mean[0],
        select(known, sums[12] * scale, 1.0) - mean[1] * mean[1],
        select(known, sums[13] * scale, 1.0) - mean[2] * mean[2],
    )
    r, g, b = from_ycocg(mean[0], mean[1], mean[2])
    whole, scale = sums[7] > MIN_CUBIC_WEIGHT, 1.0 / maximum(sums[7], 1e-6)
    frame = (
        clamped(select(whole, sums[4] * scale, r), 0.0, MAX_TONED),
        clamped(select(whole, sums[5] * scale, g), 0.0, MAX_TONED),
        clamped(select(whole, sums[6] * scale, b), 0.0, MAX_TONED),
    )
    extents = (
        square_root(maximum(variances[0], 0.0)) * gamma,
        square_root(maximum(variances[1], 0.0)) * gamma,
        square_root(maximum(variances[2], 0.0)) * gamma,
    )
    variance = largest(variances[0], variances[1], variances[2])
    return frame, sample, minimum(sums[3], 1.0), mean, extents, variance


@device_function
def confirmed_glare(glare, warped_glare, count, luma):
    """Return consecutive frames with glare nearby, this one included; CONFIRMED at once without history.

    luma: of the sample; over WHITE it counts as glare in the frame after a first glaring one.
    """
    still_bright = (luma > WHITE) & (warped_glare > 0.0) & (warped_glare < CONFIRMED - 1.0)
    counts = select((count > 0.0) | (warped_glare > 0.0), warped_glare, CONFIRMED)
    return select(still_bright, 1.0, glare) * minimum(counts + 1.0, CONFIRMED)


@device_function
def light_rises(luma, high, count, surface):
    """Return where light over white rises over all samples of the history; same as `unexplained_light`."""
    return (luma > WHITE) & (luma > high + RISE) & (count * surface > 0.0)


@device_function
def roots(color):
    """Return the square root of each channel."""
    return root(color[0]), root(color[1]), root(color[2])


@device_function
def luma_of(color):
    """Return the luminance of three channels."""
    return luminance(color[0], color[1], color[2])


@device_function
def max_difference(a, b):
    """Return the largest absolute difference of three channels."""
    return largest(absolute(a[0] - b[0]), absolute(a[1] - b[1]), absolute(a[2] - b[2]))


@device_function
def repeat_borders(image, row, pitch, width, x0, x_end):
    """Repeat the first and last pixel of a row of three planes, if it has been computed to there."""
    for c in range(3):
        if x0 == 0:
            image[row + c * pitch - 1] = image[row + c * pitch]
        if x_end == width:
            image[row + c * pitch + width] = image[row + c * pitch + width - 1]


def make_gather_rows(*parts: str):
    """Return `gather_rows` of the variant with these parts."""
    rectified, own_motion, guided = variant = Variant.with_parts(*parts)
    planes, mean_plane, own_plane, sampled_plane = variant.rest, variant.mean, variant.own, variant.sampled

    def gather_rows(
        samples: FrameSamples, history: ClassifierHistoryInput, tables: ResampleTables, numbers: Floats,
        line: Floats, scratch: GatherScratch, guide: Guide, gathered: Gathered, network: NetworkInputs,
        y0: int, y1: int, x0: int, x1: int,
    ):  # fmt: skip
        """Compute `gathered` and the network inputs of rows y0 to y1, columns x0 to x1.

        y0 is even; x0 and x1 are where tiles begin, or x1 is `gathered.pitch`. line: scratch for filters.
        """
        colors, stride = samples.color, samples.stride
        rows, down = tables.row_samples, tables.row_weights
        starts, across = tables.column_start, tables.column_weights
        ring, slots, weights, warped = scratch.ring, scratch.slots, scratch.weights, scratch.warped
        places, inputs, differences = scratch.places, scratch.inputs, scratch.differences
        warped_planes, rest = gathered.history, gathered.rest
        big_w, big_h, width = gathered.width, gathered.height, gathered.pitch
        w_big, h_big = numbers[BIG_W], numbers[BIG_H]
        scale_x, scale_y = w_big / numbers[W], h_big / numbers[H]
        padded_width, x_end = width + 2 * PAD, min(x1, big_w)
        for y in range(max(y0 - 1, 0), min(y1 + 1, big_h)):
            inside = y0 <= y < y1
            ring_row = (y % 4) * INPUT_PLANES * width
            if inside:
                filter_all_down(
                    colors, rows, down, big_h, y, starts, x0, x_end, stride + 2 * PAD, line, not guided
                )
            rising = spread16(np.float32(0.0))
            for x in range(x0, x1, 16):
                lane = to_float(ramp16() + np.int32(x))
                depth, mx, my, _ = gather4(
                    samples.dilated, tables.first_column, x, 4, 4 * tables.first_row[y] * stride
                )
                mx, my = mx * scale_x, my * scale_y
                px, py = previous_position(lane, y, mx, my, w_big, h_big)
                on = on_screen(px, py, w_big, h_big)
                own_x, own_y, edge, glare = gather4(
                    samples.own, tables.nearest_column, x, 4, 4 * tables.nearest_row[y] * stride
                )
                of_surface = px, py, on
                if guided and inside:
                    base, facing = surface_at(guide.base_color, guide.normal, sample_indices(x, y, big_w))
                    depth = load16(guide.depth, y * padded_width + PAD + x)
                    light, agreement, sampled, own_x, own_y = guide_pixels(
                        samples, guide, tables, y, x, width, base, facing, depth
                    )
                    edge = edge_at(guide.depth, y, x, big_h, padded_width)
                store(places, x, px)
                store(places, width + x, py)
                prepare_warp(px, py, big_w, big_h, 8, numbers[C.history_sharpness], slots, weights)
                same_motion = True
                if own_motion:
                    ox, oy = previous_position(lane, y, own_x * scale_x, own_y * scale_y, w_big, h_big)
                    same_motion = all_lanes((ox == px) & (oy == py))
                    if guided:
                        of_surface, same_motion = (ox, oy, on_screen(ox, oy, w_big, h_big)), False
                    if not same_motion:
                        prepare_own_warp(ox, oy, big_w, big_h, 8, slots, weights)
                warp(history.pixels, slots, weights, same_motion, warped)
                q = load_columns(warped, 0)
                color = select3(on, toned_at(numbers, q[8], q[9], q[10]))
                color_root = roots(color)
                luma = luma_of(color_root)
                store(ring, (y % 3) * padded_width + PAD + x, luma)
                if not inside:
                    continue
                linear = select3(on, toned_at(numbers, q[0], q[1], q[2]))
                detail = color[0] - linear[0], color[1] - linear[1], color[2] - linear[2]
                count, low, high = select3(on, (q[3], q[4], q[5]))
                store_planes(warped_planes, (y * width + x) * HISTORY_PLANES, color)
                own = linear
                if guided:
                    least = guide.min_reflectance
                    reflected = reflectance(base, facing, least)
                    before = warp_reflectance(guide.before, slots, weights, scratch.reflectance)
                    now = kept_reflectance(reflected, guide.next, y * big_w + x, big_w - x, slots)
                    own = relit((q[12], q[13], q[14]), before, now, least)
                    own = select3(of_surface[2], toned_at(numbers, own[0], own[1], own[2]))
                elif own_motion and not same_motion:
                    own = toned_at(numbers, q[12], q[13], q[14])
                surface, difference = gather_surface(
                    depth, of_surface, history.depth, history.pitch, slots, numbers
                )
                sums = filter_all_across(line, stride + 2 * PAD, starts, across, width, x, not guided)
                frame, sample, confidence, mean, extents, variance = current_frame(sums, numbers[C.gamma])
                if samples.fill_pitch > 0:
                    frame = or_fill(sums[14] > MIN_WEIGHT, frame, samples, tables, x, y)
                if guided:
                    frame = lit(light, reflected)
                    image_row = 3 * y * padded_width + PAD
                    for c, value in enumerate(frame):
                        store(gathered.image, image_row + c * padded_width + x, value)
                sample_luma = luma_of(sample)
                glares = high * 0.0
                if numbers[GLARES] > 0.0:
                    high, warped_glare = without_glare(high)
                    glares = confirmed_glare(glare, warped_glare, count, sample_luma) * GLARE
                sparse = (sample_luma > mean[0] + CONTRAST) & (lane < w_big)
                sparse = sparse & light_rises(sample_luma, high, count, surface)
                rising = rising + select(sparse, 1.0, lane * 0.0)
                to = (y * width + x) * planes
                range_ = low, high + glares
                store_planes(rest, to, (*frame, *sample, confidence, *detail, surface, count, *range_))
                if rectified:
                    store_planes(rest, to + 16 * mean_plane, (*mean, *extents))
                if own_motion:
                    store_planes(rest, to + 16 * own_plane, own)
                if guided:
                    stream(rest, to + 16 * sampled_plane, sampled)

                frame_root, sample_root = roots(frame), roots(sample)
                frame_luma = luma_of(frame_root)
                store(differences, (y % 4) * width + x, luma - frame_luma)
                to = ring_row + x
                store_input(inputs, words.FRAME * width + to, frame_luma)
                store_input(inputs, words.SAMPLE * width + to, luma_of(sample_root))
                store_input(inputs, words.HISTORY * width + to, luma)
                store_input(
                    inputs, words.HISTORY_TO_SAMPLE * width + to, max_difference(color_root, sample_root)
                )
                store_input(
                    inputs, words.HISTORY_TO_FRAME * width + to, max_difference(color_root, frame_root)
                )
                store_input(inputs, words.CONTRAST * width + to, root(root(variance)))
                if guided:
                    apart = max_difference(roots(own), frame_root)
                    store_input(inputs, words.RELIT_TO_FRAME * width + to, apart)
                    store_input(inputs, words.AGREEMENT * width + to, agreement)
                else:
                    store_input(inputs, words.MIN_LUMA * width + to, root(low))
                    store_input(inputs, words.MAX_LUMA * width + to, root(high))
                store_input(inputs, words.DETAIL * width + to, root(max_difference(color, linear)))
                store_input(inputs, words.CONFIDENCE * width + to, confidence)
                store_input(inputs, words.COUNT * width + to, count / (count + HALF_COUNT))
                store_input(inputs, words.DEPTH_DIFFERENCE * width + to, difference * 0.5 + 0.5)
                store_input(inputs, words.SURFACE * width + to, surface)
                store_input(inputs, words.EDGE * width + to, edge)
            if guided and inside:
                repeat_borders(gathered.image, 3 * y * padded_width + PAD, padded_width, big_w, x0, x_end)
            if inside:
                gathered.rising[(y * width + x0) // 16] = sum_of_lanes(rising)
            if inside and y % 2 == 0:
                to = y // 2 * network.row * RECORD_WORDS
                warp_classes(
                    history.classes, places, slots, weights, width, big_w, big_h, x0 // 2, (x_end + 1) // 2,
                    network.records, to,
                )  # fmt: skip
            repeat_ends(ring, (y % 3) * padded_width + PAD + x0, x_end - x0)
            if y - 1 >= y0:
                complete_row(scratch, gathered, network, y - 1, y, x0, x1)
        if y1 == big_h:
            last = big_h - 1
            complete_row(scratch, gathered, network, last, last, x0, x1)

    return gather_rows
