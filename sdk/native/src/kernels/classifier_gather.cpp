// Gather of the classifiers; the same as `Classifier.gather` and its network inputs, in one pass.
//
// A vector holds one channel of W pixels. Where positions differ from pixel to pixel (warps), it holds the channels of
// one pixel.
#include "guided.h"

namespace ss::SS_ISA {

static F3 toned_at(const ClassifierWork& w, F r, F g, F b) { return tone(sanitize(F3{r, g, b}) * w.samples.exposure); }
static F3 where(I mask, F3 v) { return {select(mask, v.r, 0.0f), select(mask, v.g, 0.0f), select(mask, v.b, 0.0f)}; }
static F3 roots(F3 c) { return {root(c.r), root(c.g), root(c.b)}; }
static F max_difference(F3 a, F3 b) { return largest(absolute(a.r - b.r), absolute(a.g - b.g), absolute(a.b - b.b)); }

// The surface's previous visibility, [0, 1], and the depth difference, [-1, 1] (equation 10).
static F gather_surface(const ClassifierWork& w, F depth, const Reprojected& shown, F& difference) {
    const PreviousFrame& p = w.previous;
    const Previous at = previous_of(p, shown.x, shown.y, {w.target.width, w.target.height});
    LinearTaps taps(at.x, at.y, p.width, p.height, p.pitch);
    F upper[4], lower[4];  // depth and occluding depth of the left sample, then of the right one
    gather4(p.plane, taps.upper, 2, upper);
    gather4(p.plane, taps.lower, 2, lower);
    const F occluding[4] = {upper[1], upper[3], lower[1], lower[3]};
    F occluded = occlusion(depth, occluding, taps.weight, w.config.depth_margin, w.config.depth_ramp);
    I right = at.x - floor(at.x) >= 0.5f, low = at.y - floor(at.y) >= 0.5f;
    F before = select(low, select(right, lower[2], lower[0]), select(right, upper[2], upper[0]));
    before = select(shown.on, before, 0.0f);
    difference = (before - depth) / maximum(maximum(before, depth), 1e-12f);
    difference = select(depth >= 0.0f, clamped(difference, -1.0f, 1.0f), 0.0f);
    return select(shown.on, maximum(1.0f - occluded * 2.0f, 0.0f), 0.0f);
}

// Same as `CurrentFrame` of the torch module; extents: half sides of the variance box, YCoCg.
struct CurrentFrame {
    F3 frame, sample;
    F confidence;
    F3 mean, extents;
    F variance;  // the largest of three channels
    I found;
};
enum Line { OF_SAMPLE, OF_CUBIC = 4, OF_MEAN = 8, OF_MEAN_USABLE = 14 };

static void filter_all_down(const ClassifierWork& w, int y, Span span, float* lines, bool cubic) {
    const Samples& s = w.samples;
    auto down = [&](int filter, int plane, int count, int line) __attribute__((always_inline)) {
        filter_down(Rows(w.tables.y, filter, y, sample_rows(s)), span, plane, count, s.pitch, lines + line * s.pitch);
    };
    down(BY_SAMPLE, TONED, 4, OF_SAMPLE);
    if (cubic) down(BY_CUBIC, TONED, 4, OF_CUBIC);
    down(BY_MEAN, LUMA, 6, OF_MEAN);
    down(BY_MEAN, USABLE, 1, OF_MEAN_USABLE);
}

template <bool guided>
static CurrentFrame current_frame(const ClassifierWork& w, const float* lines, int x) {
    const Places places(w.tables.x.start, x);
    const int pitch = w.samples.pitch;
    auto across = [&](int line, int filter) __attribute__((always_inline)) {
        return filter_across(lines + line * pitch, places, w.tables.x, filter, x);
    };
    auto rgb = [&](int line, int filter) __attribute__((always_inline)) {
        return F3{across(line, filter), across(line + 1, filter), across(line + 2, filter)};
    };
    CurrentFrame c;
    F near = across(OF_SAMPLE + 3, BY_SAMPLE);
    c.confidence = minimum(near, 1.0f);
    c.sample = clamped(rgb(OF_SAMPLE, BY_SAMPLE) * (1.0f / maximum(near, 1e-6f)), 0.0f, MAX_TONED);
    F usable = across(OF_MEAN_USABLE, BY_MEAN), scale = 1.0f / maximum(usable, 1e-6f);
    c.found = usable > MIN_WEIGHT;
    c.mean = rgb(OF_MEAN, BY_MEAN) * scale;
    F3 square = rgb(OF_MEAN + 3, BY_MEAN) * scale;
    F3 variance = select(c.found, square, F3{spread(1.0f), spread(1.0f), spread(1.0f)}) -
                  F3{c.mean.r * c.mean.r, c.mean.g * c.mean.g, c.mean.b * c.mean.b};
    c.variance = largest(variance);
    auto extent = [&](F v) { return square_root(maximum(v, 0.0f)) * w.config.gamma; };
    c.extents = {extent(variance.r), extent(variance.g), extent(variance.b)};
    c.frame = from_ycocg(c.mean);
    if (!guided) {
        F weight = across(OF_CUBIC + 3, BY_CUBIC);
        c.frame = select(weight > MIN_CUBIC_WEIGHT, rgb(OF_CUBIC, BY_CUBIC) * (1.0f / maximum(weight, 1e-6f)), c.frame);
    }
    c.frame = clamped(c.frame, 0.0f, MAX_TONED);
    return c;
}

// Consecutive frames with glare nearby, this one included; CONFIRMED at once without history. luma: of the sample; over
// WHITE it counts as glare in the frame after a first glaring one.
static F confirmed_glare(F glare, F warped, F count, F luma) {
    I still_bright = (luma > WHITE) & (warped > 0.0f) & (warped < CONFIRMED - 1.0f);
    F counts = select((count > 0.0f) | (warped > 0.0f), warped, CONFIRMED);
    return select(still_bright, 1.0f, glare) * minimum(counts + 1.0f, CONFIRMED);
}

// Resamples HISTORY_VALUES of W pixels to 12 or 16 each: all linearly; RGB and count by the cubic, and by their own
// motion.
template <bool own_motion>
SS_INLINE void warp8(const float* h, bool same_motion, WarpScratch& s) {
    typedef float F8 __attribute__((vector_size(32)));
    auto low = [](F8 v) __attribute__((always_inline)) { return __builtin_shufflevector(v, v, 0, 1, 2, 3); };
    for (int i = 0; i < W; i++) {
        const int a = s.offsets[0][i], b = s.offsets[1][i], c = s.offsets[2][i], d = s.offsets[3][i];
        const float *j = h + s.offsets[4][i], *k = h + s.offsets[5][i], *m = h + s.offsets[6][i],
                    *n = h + s.offsets[7][i];
        prefetch(n + d + 15 * HISTORY_VALUES);  // the lower right sample of a pixel of the next step
        const float x0 = s.weights[0][i], x1 = s.weights[1][i], x2 = s.weights[2][i], x3 = s.weights[3][i];
        const F8 kb = load_as<F8>(k + b), kc = load_as<F8>(k + c), mb = load_as<F8>(m + b), mc = load_as<F8>(m + c);
        F4 top = load4(j + b) * x1 + load4(j + c) * x2, bottom = load4(n + b) * x1 + load4(n + c) * x2;
        F4 upper = load4(k + a) * x0 + low(kb) * x1 + low(kc) * x2 + load4(k + d) * x3;
        F4 lower = load4(m + a) * x0 + low(mb) * x1 + low(mc) * x2 + load4(m + d) * x3;
        F4 sharp = top * s.weights[4][i] + upper * s.weights[5][i] + lower * s.weights[6][i] + bottom * s.weights[7][i];
        const float t = s.weights[8][i], u = s.weights[9][i];
        F8 upper8 = kb * (1.0f - t) + kc * t, lower8 = mb * (1.0f - t) + mc * t;
        const F8 linear = upper8 * (1.0f - u) + lower8 * u;
        store4(four_at(s.pixels, 0, i), low(linear));
        store4(four_at(s.pixels, 1, i), __builtin_shufflevector(linear, linear, 4, 5, 6, 7));
        F4 own = sharp;
        if (own_motion && !same_motion) {
            const float *up = h + s.offsets[10][i], *down = h + s.offsets[11][i];
            const int left = s.offsets[8][i], right = s.offsets[9][i];
            own = linear4(load4(up + left), load4(up + right), load4(down + left), load4(down + right),
                          s.weights[10][i], s.weights[11][i]);
        }
        store4(four_at(s.pixels, 2, i), sharp);
        if (own_motion) store4(four_at(s.pixels, 3, i), own);
    }
}

// Resamples class probabilities at packed pixels p0 to p1 of a row, and writes them to their records.
static void warp_classes(const ClassifierWork& w, const float* places, int p0, int p1, int y, WarpScratch& s) {
    typedef uint8_t B8 __attribute__((vector_size(8)));
    typedef float F8 __attribute__((vector_size(32)));
    const Size display = {w.target.width, w.target.height}, half = w.network->half;
    int32_t* records = w.network->records_at(y) + INPUT_PLANES;
    for (int x = p0; x < p1; x += W) {
        const float *at = places + 2 * x, *below = at + w.gathered.pitch;
        F px = evens(load(at), load(at + W)), py = evens(load(below), load(below + W));
        store(s.weights[0], store_offsets(px * 0.5f, 0, 1, half.width, 8, s.offsets));
        store(s.weights[1], store_offsets(py * 0.5f, 0, 1, half.height, 8 * half.width, s.offsets + 2));
        store(s.offsets[4], on_screen(px, py, display));
        for (int i = 0; i < min(W, p1 - x); i++) {
            auto bytes = [&](int row, int column) __attribute__((always_inline)) {
                return __builtin_convertvector(load_as<B8>(w.classes + s.offsets[2 + row][i] + s.offsets[column][i]),
                                               F8);
            };
            const float t = s.weights[0][i], u = s.weights[1][i];
            F8 a = bytes(0, 0), c = bytes(1, 0), upper = a + (bytes(0, 1) - a) * t, lower = c + (bytes(1, 1) - c) * t;
            F8 value = upper + (lower - upper) * u + 0.5f;
            const int64_t on = s.offsets[4][i];
            store_as(records + (x + i) * RECORD_WORDS,
                     reinterpret_cast<int64_t>(__builtin_convertvector(value, B8)) & on);
        }
    }
}

// Writes two rows of inputs to records p0 to p1.
static void pack_rows(const uint8_t* upper, const uint8_t* lower, int width, int p0, int p1, int32_t* records) {
    for (int x = p0; x < p1; x += W) {
        F planes[INPUT_PLANES];
        for (int c = 0; c < INPUT_PLANES; c++)
            planes[c] = float_of(packed_words(upper + c * width + 2 * x, lower + c * width + 2 * x));
        to_pixels(planes);
        constexpr int PARTS = INPUT_PLANES / W;
        for (int k = 0; k < INPUT_PLANES; k++)
            store(records + RECORD_WORDS * (x + k / PARTS) + k % PARTS * W, bits_of(planes[k]));
    }
}

// Writes the means over four pixels of the difference of history and frame, and of its absolute value.
static void pack_means(const Network& n, const float* upper, const float* lower, int p0, int p1, int y) {
    float* means = n.means_at(y, 0) + PAD;
    for (int x = p0; x < p1; x += W) {
        F a = load(upper + 2 * x), b = load(upper + 2 * x + W), c = load(lower + 2 * x), d = load(lower + 2 * x + W);
        F i = evens(a, b), j = odds(a, b), k = evens(c, d), m = odds(c, d);
        store(means + x, (i + j + k + m) * 0.25f);
        store(means + n.means_pitch + x, (absolute(i) + absolute(j) + absolute(k) + absolute(m)) * 0.25f);
    }
    repeat_ends(means + p0, p1 - p0);
    repeat_ends(means + n.means_pitch + p0, p1 - p0);
}

// Packs the inputs of columns x0 to x1 of rows y - 1 and y, or of the last row alone, except those that need neighbours.
static void pack_inputs(const ClassifierWork& w, const ClassifierScratch& s, int y, int x0, int x1) {
    const int width = w.gathered.pitch, big_w = w.target.width;
    auto inputs = [&](int row) { return s.inputs + row % 2 * INPUT_PLANES * width; };
    auto differences = [&](int row) { return s.differences + row % 2 * width; };
    const int first = y - y % 2, p0 = x0 / 2, p1 = (min(x1, big_w) + 1) / 2;
    for (int row = first; row <= y && big_w % 2; row++) {
        for (int c = 0; c < INPUT_PLANES; c++) inputs(row)[c * width + big_w] = inputs(row)[c * width + big_w - 1];
        differences(row)[big_w] = differences(row)[big_w - 1];
    }
    pack_rows(inputs(first), inputs(y), width, p0, p1, w.network->records_at(y / 2));
    pack_means(*w.network, differences(first), differences(y), p0, p1, y / 2);
}

// A row of the gather: what it reads, and where it writes.
struct GatherRow {
    int y;
    float scale_x, scale_y;               // display size / render size
    const float *dilated, *nearest;       // surfaces of samples, see `prepare`: dilated, and nearest to the pixels
    const float *base_color, *normals;    // of the variant `guided`
    float *luma, *history, *differences;  // differences: luma of the history minus that of the frame
    uint16_t* rest;
    uint8_t *samples, *inputs;
};

template <Variant variant>
static GatherRow row_of(const ClassifierWork& w, int y, int thread) {
    const Samples& s = w.samples;
    const Gathered& g = w.gathered;
    const ClassifierScratch& scratch = w.scratch[thread];
    const Size display = {w.target.width, w.target.height};
    GatherRow row = {};
    row.y = y;
    row.scale_x = static_cast<float>(display.width) / static_cast<float>(s.width);
    row.scale_y = static_cast<float>(display.height) / static_cast<float>(s.height);
    row.dilated = fours_row(s, s.dilated, w.tables.y.clamped(w.tables.y.start[y]));
    row.nearest = fours_row(s, s.own, w.tables.y.nearest[y]);
    row.luma = g.luma + g.padded(y), row.history = g.history + 3 * g.place(y);
    row.rest = g.rest + variant.planes() * g.place(y), row.samples = g.samples + g.place(y);
    row.inputs = scratch.inputs + y % 2 * INPUT_PLANES * g.pitch;
    row.differences = scratch.differences + y % 2 * g.pitch;
    if constexpr (variant.guided) {
        float* room = w.guide.scratch + thread * w.guide.scratch_pitch;
        row.base_color = packed_row(w.guide.display_base_color, 3, y, display.width, room);
        row.normals = packed_row(w.guide.display_normal, 3, y, display.width, room + 3 * display.width);
    }
    return row;
}

// Surfaces at W pixels; motion in display pixels.
struct Surfaces {
    F depth, edge;                               // edge: relative range of depth around
    F dilated_x, dilated_y, motion_x, motion_y;  // motion, dilated and the pixel's own
    F glare;                                     // 1 where this frame has light over GLARE_EXPOSED nearby
    Guided guided;                               // of the variant `guided`
    F3 reflectance;
};

template <Variant variant>
SS_INLINE Surfaces surfaces_at(const ClassifierWork& w, const GatherRow& row, int x, WarpScratch& warps) {
    const Axis& ax = w.tables.x;
    F dilated[4], own[4];
    load_dilated(row.dilated, ax, w.samples.width, x, warps, dilated);
    gather4(row.nearest, ax.nearest + x, 4, own);
    Surfaces s = {};
    s.depth = dilated[0], s.edge = own[2], s.glare = own[3];
    F motion_x = own[0], motion_y = own[1];
    if constexpr (variant.guided) {
        const Surface surface = surface_at(row.base_color, row.normals, x, w.target.width);
        s.depth = load(depth_row(w, row.y) + x);
        s.edge = edge_at(w, row.y, x);
        s.guided = guide_pixels(w, row.y, x, surface, s.depth);
        motion_x = s.guided.motion_x, motion_y = s.guided.motion_y;
        s.reflectance = reflectance(surface, w.guide.min_reflectance);
    }
    s.dilated_x = dilated[1] * row.scale_x, s.dilated_y = dilated[2] * row.scale_y;
    s.motion_x = motion_x * row.scale_x, s.motion_y = motion_y * row.scale_y;
    return s;
}

// The history at W pixels: toned colours by the cubic, linearly, and by the pixels' own motion; samples; range of luma.
struct WarpedHistory {
    F3 color, linear, by_own;
    F count, low, high;
    F glare;  // consecutive frames with glare nearby
};

template <Variant variant>
SS_INLINE WarpedHistory warp_history(const ClassifierWork& w, const GatherRow& row, int x, const Surfaces& here,
                                     const Reprojected& at, const Reprojected& own, WarpScratch& warps) {
    const Size display = {w.target.width, w.target.height};
    prepare_warp(at.x, at.y, display, HISTORY_VALUES, w.config.history_sharpness, warps);
    const bool same_motion = !variant.own_motion || (!variant.guided && all((own.x == at.x) & (own.y == at.y)));
    if (!same_motion) {
        store(warps.weights[10], store_offsets(own.x, 0, 1, display.width, HISTORY_VALUES, warps.offsets + 8));
        store(warps.weights[11],
              store_offsets(own.y, 0, 1, display.height, HISTORY_VALUES * display.width, warps.offsets + 10));
    }
    warp8<variant.own_motion>(w.history, same_motion, warps);
    F sharp[4], first[4], second[4], by_own[4];
    load_four(warps.pixels, 0, first);
    load_four(warps.pixels, 1, second);
    load_four(warps.pixels, 2, sharp);
    if (variant.own_motion) load_four(warps.pixels, 3, by_own);
    WarpedHistory past;
    past.color = where(at.on, toned_at(w, sharp[0], sharp[1], sharp[2]));
    past.linear = where(at.on, toned_at(w, first[0], first[1], first[2]));
    past.count = select(at.on, first[3], 0.0f);
    past.low = select(at.on, second[0], 0.0f), past.high = select(at.on, second[1], 0.0f);
    past.glare = w.glares ? without_glare(past.high) : F{};
    past.by_own = past.linear;
    if constexpr (variant.guided) {
        const F3 before = warp_reflectance(w.guide.before, warps);
        const ptrdiff_t pixel = static_cast<ptrdiff_t>(row.y) * display.width + x;
        const F3 kept = keep_reflectance(here.reflectance, w.guide.next + 4 * pixel, display.width - x);
        const F3 light = relit(F3{by_own[0], by_own[1], by_own[2]}, before, kept, w.guide.min_reflectance);
        past.by_own = where(own.on, toned_at(w, light.r, light.g, light.b));
    } else if (!same_motion) past.by_own = toned_at(w, by_own[0], by_own[1], by_own[2]);
    return past;
}

// Writes the guided colour of W pixels.
static void keep_guided(const ClassifierWork& w, int y, int x, F3 frame) {
    uint16_t* image = guided_row(w, y) + x;
    const int pitch = w.gathered.pitch + 2 * PAD;
    store_as(image, to_half(near_one(frame.r)));
    store_as(image + pitch, to_half(near_one(frame.g)));
    store_as(image + 2 * pitch, to_half(near_one(frame.b)));
}

// Writes what the compositor reads of W pixels. high: of the luma range, with the count of glaring frames.
template <Variant variant>
SS_INLINE void stream_gathered(const GatherRow& row, int x, const Surfaces& here, const WarpedHistory& past, F surface,
                               F high, const CurrentFrame& now) {
    float* history = row.history + 3 * x;
    stream(history, past.color.r);
    stream(history + W, past.color.g);
    stream(history + 2 * W, past.color.b);
    uint16_t* planes = row.rest + variant.planes() * x;
    stream_toned3(planes + W * FRAME, now.frame);
    stream_toned3(planes + W * SAMPLE, now.sample);
    stream_half(planes + W * CONFIDENCE, now.confidence);
    stream_half3(planes + W * DETAIL, past.color - past.linear);
    stream_half(planes + W * SURFACE, surface);
    stream_half(planes + W * COUNT, past.count);
    stream_half(planes + W * MIN_LUMA, past.low);
    stream_half(planes + W * MAX_LUMA, high);
    if (variant.rectified) {
        stream_half3(planes + W * variant.mean(), {near_one(now.mean.r), now.mean.g, now.mean.b});
        stream_half3(planes + W * (variant.mean() + 3), now.extents);
    }
    if (variant.own_motion) stream_toned3(planes + W * variant.own(), past.by_own);
    if (variant.guided) stream_half(planes + W * variant.sampled(), here.guided.sampled);
}

// Writes the network's inputs of W pixels, but for those that need neighbours. difference: of depth, see `gather_surface`.
template <Variant variant>
SS_INLINE void store_inputs(const GatherRow& row, int width, int x, const Surfaces& here, const WarpedHistory& past,
                            F surface, F difference, const CurrentFrame& now) {
    const F3 color = roots(past.color), frame = roots(now.frame), sample = roots(now.sample);
    const F luma = luminance(color), frame_luma = luminance(frame);
    store(row.luma + x, luma);
    store(row.differences + x, luma - frame_luma);
    auto input = [&](InputWord word, F value)
                     __attribute__((always_inline)) { store_input(row.inputs + word * width + x, value); };
    input(IN_FRAME, frame_luma);
    input(IN_SAMPLE, luminance(sample));
    store(row.samples + x, load(row.inputs + IN_SAMPLE * width + x));
    input(IN_HISTORY, luma);
    input(IN_HISTORY_TO_SAMPLE, max_difference(color, sample));
    input(IN_HISTORY_TO_FRAME, max_difference(color, frame));
    input(IN_CONTRAST, root(root(now.variance)));
    input(IN_MIN_LUMA, variant.guided ? max_difference(roots(past.by_own), frame) : root(past.low));
    input(IN_MAX_LUMA, variant.guided ? here.guided.agreement : root(past.high));
    input(IN_DETAIL, root(max_difference(past.color, past.linear)));
    input(IN_CONFIDENCE, now.confidence);
    input(IN_COUNT, past.count / (past.count + HALF_COUNT));
    input(IN_DEPTH_DIFFERENCE, difference * 0.5f + 0.5f);
    input(IN_SURFACE, surface);
    input(IN_EDGE, here.edge);
}

// Gathers W pixels; returns 1 where light rises at one that counts towards FLASH_FRACTION.
template <Variant variant>
SS_INLINE F gather_pixels(const ClassifierWork& w, const GatherRow& row, int x, const ClassifierScratch& scratch,
                          WarpScratch& warps) {
    const Surfaces here = surfaces_at<variant>(w, row, x, warps);
    const Size display = {w.target.width, w.target.height};
    const Reprojected at = reproject(x, row.y, here.dilated_x, here.dilated_y, display);
    const Reprojected own = reproject(x, row.y, here.motion_x, here.motion_y, display);
    store(scratch.places + x, at.x);
    store(scratch.places + w.gathered.pitch + x, at.y);
    const WarpedHistory past = warp_history<variant>(w, row, x, here, at, own, warps);
    F difference, surface = gather_surface(w, here.depth, variant.guided ? own : at, difference);
    CurrentFrame now = current_frame<variant.guided>(w, scratch.lines, x);
    if constexpr (variant.guided) {
        now.frame = lit(here.guided.light, here.reflectance);
        keep_guided(w, row.y, x, now.frame);
    } else now.frame = or_fill(now.found, now.frame, w.samples, w.tables, row.y, x);
    const F luma = luminance(now.sample);
    F high = past.high;
    if (w.glares) high += confirmed_glare(here.glare, past.glare, past.count, luma) * GLARE;
    stream_gathered<variant>(row, x, here, past, surface, high, now);
    store_inputs<variant>(row, w.gathered.pitch, x, here, past, surface, difference, now);
    const I sparse = (luma > now.mean.r + CONTRAST) & (ramp() + x < w.target.width);
    return select(sparse & light_rises(luma, past.high, past.count, surface), 1.0f, F{});
}

// Computes `gathered` and the network inputs of a rectangle, whose first row is even.
template <Variant variant>
static void gather_rows(const ClassifierWork& w, Rect rect, int thread) {
    const ClassifierScratch& scratch = w.scratch[thread];
    WarpScratch& warps = w.warps[thread];
    const int width = w.gathered.pitch, end = min(rect.x1, w.target.width);
    const Span span(w.tables.x, rect.x0, end);
    for (int y = rect.y0; y < rect.y1; y++) {
        const GatherRow row = row_of<variant>(w, y, thread);
        filter_all_down(w, y, span, scratch.lines, !variant.guided);
        F rising = F{};
        for (int x = rect.x0; x < rect.x1; x += W) rising += gather_pixels<variant>(w, row, x, scratch, warps);
        w.gathered.rising[(static_cast<ptrdiff_t>(y) * width + rect.x0) / LANES] = sum_of_lanes(rising);
        for (int c = 0; variant.guided && c < 3; c++) {  // the pixels beside the image
            uint16_t* image = guided_row(w, y) + c * (width + 2 * PAD);
            if (rect.x0 == 0) image[-1] = image[0];
            if (end == w.target.width) image[end] = image[end - 1];
        }
        if (y % 2 == 0) warp_classes(w, scratch.places, rect.x0 / 2, (end + 1) / 2, y / 2, warps);
        repeat_ends(row.luma + rect.x0, end - rect.x0);
        if (y % 2 || y + 1 == rect.y1) pack_inputs(w, scratch, y, rect.x0, rect.x1);
    }
    end_streams();
}

// Writes the depth for disocclusion tests of the next frame: unchanged, and occluding.
void keep_depth(const ClassifierWork& w, int y0, int y1) {
    const Samples& s = w.samples;
    for (int y = y0; y < y1; y++) {
        const ptrdiff_t here = static_cast<ptrdiff_t>(y) * s.pitch + PAD;
        float* to = w.next_depth + 2 * here;
        for (int x = 0; x < s.width; x += W) {
            F depth = load(s.depth + here + x), occluding = occluding_at(s, y, x);
            store(to + 2 * x, low_zip(depth, occluding));
            store(to + 2 * x + W, high_zip(depth, occluding));
        }
        for (int x = 1; x <= PAD; x++) {
            memcpy(to - 2 * x, to, 2 * sizeof(float));
            memcpy(to + 2 * (s.width - 1 + x), to + 2 * (s.width - 1), 2 * sizeof(float));
        }
    }
}

extern void (*const GATHER[])(const ClassifierWork&, Rect, int thread) = SS_VARIANTS(gather_rows);

}  // namespace ss::SS_ISA
