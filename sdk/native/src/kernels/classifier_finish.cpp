// Finish of the classifiers: the last layers of the network, then the compositor; the same as `Classifier.finish`.
#include "edges.h"
#include "guided.h"

namespace ss::SS_ISA {

// e^x for x clamped to [-16, 16], with a relative error of 1e-5.
SS_INLINE F factor(F value) {
    constexpr float ROUNDS = 12582912.0f;  // 1.5 * 2^23: the sum has the rounded number in its last bits
    F x = clamped(value, -MAX_LOG_FACTOR, MAX_LOG_FACTOR) * 1.4426950408889634f;
    F rounded = x + ROUNDS;
    F f = x - (rounded - ROUNDS);
    F p = (((f * 9.58285e-3f + 5.590642e-2f) * f + 2.4024099e-1f) * f + 6.9312419e-1f) * f + 1.0f;
    return float_of(bits_of(p) + (bits_of(rounded) << 23));
}

// Gathers the input of the decoder from the levels: KEPT bytes of each. A pixel of a lower level holds the bytes of all
// pixels that it covers, one after the other.
static void concatenate_row(const Network& n, int y, int p0, int p1, uint8_t* out) {
    const uint8_t* rows[LEVELS];
    for (int k = 0; k < LEVELS; k++) rows[k] = n.level[k].out_at(y >> k) + (KEPT[k] << k) * (y & ((1 << k) - 1));
    for (int p = p0; p < p1; p++) {
        prefetch(rows[3] + ((p + 16) >> 3) * n.level[3].out_pitch);
        uint8_t* to = out + 32 * p;
        memcpy(to, rows[0] + p * n.level[0].out_pitch, 16);
        memcpy(to + 16, rows[1] + (p >> 1) * n.level[1].out_pitch + 8 * (p & 1), 8);
        memcpy(to + 24, rows[2] + (p >> 2) * n.level[2].out_pitch + 4 * (p & 3), 4);
        memcpy(to + 28, rows[3] + (p >> 3) * n.level[3].out_pitch + 4 * (p & 7), 4);
    }
}

static I byte_of(F value) { return to_int(value + 0.5f); }

// Writes the class probabilities of up to W packed pixels, eight bytes each; 255 is one. logits: planes, `pitch` apart.
static void store_classes(const float* logits, int pitch, int count, uint8_t* classes) {
    F e[classifier::CLASSES];
    for (int c = 0; c < CLASSES; c++) e[c] = factor(load(logits + c * pitch));
    F one = 255.0f / (e[0] + e[1] + e[2]), two = 255.0f / (e[3] + e[4] + e[5]);
    I low = byte_of(e[0] * one) | byte_of(e[1] * one) << 8 | byte_of(e[2] * one) << 16 | byte_of(e[3] * two) << 24;
    I high = byte_of(e[4] * two) | byte_of(e[5] * two) << 8;
    int32_t words[2 * W];
    store(words, low_zip(low, high));
    store(words + W, high_zip(low, high));
    memcpy(classes, words, 8 * min(W, count));
}

// Computes blend parameters, (outputs, pitch), and after them class logits, of packed pixels p0 to p1, and class
// probabilities. `hidden` has W pixels side by side, their bytes word by word.
static void blend_row(const Network& n, const uint8_t* hidden, int outputs, int p0, int p1, int pitch, float* out,
                      uint8_t* classes) {
    constexpr int AT_ONCE = 8;
    const Layer& layer = n.blend;
    for (int p = p0; p < p1; p += W) {
        F columns[WIDE];
        load_channels(reinterpret_cast<const float*>(hidden + 4 * WIDE * p), columns);
        for (int c = 0; c < outputs; c += AT_ONCE) {
            I sums[AT_ONCE] = {};
            for (int k = 0; k < layer.words; k++)
                for (int i = 0; i < AT_ONCE; i++)
                    sums[i] = dot4(sums[i], bits_of(columns[k]),
                                   spread(load_as<int32_t>(layer.weights + 4 * ((c + i) * layer.words + k))));
            for (int i = 0; i < AT_ONCE; i++)
                store(out + (c + i) * pitch + p, to_float(sums[i]) * layer.scale[c + i] + layer.bias[c + i]);
        }
        for (int c = 0; c < CLASSES; c++) {
            const int byte = n.logits + c;
            I value = bits_of(columns[byte / 4]) >> 8 * (byte % 4) & 255;
            store(out + (outputs + c) * pitch + p, (to_float(value) - 128.0f) * n.logits_scale);
        }
        store_classes(out + outputs * pitch + p, pitch, p1 - p, classes + 8 * p);
    }
}

// Sets the ghosting of those of the packed pixels p0 to p1 of row y that have no history to `visibility`.
static void mark_unknown(const Gathered& g, int planes, int y, int p0, int p1, uint8_t* classes) {
    for (int x = 2 * p0; x < min(2 * p1, g.pitch); x += W) {
        const uint32_t known = mask_bits(is_positive(load_half(g.rest + (g.place(2 * y) + x) * planes + W * COUNT)));
        if (known == (1u << W) - 1) continue;
        for (int i = 0; i < min(W / 2, p1 - x / 2); i++)
            if (!(known >> 2 * i & 1)) {
                uint8_t* to = classes + 8 * (x / 2 + i);
                to[0] = to[2] = 0;
                to[1] = 255;
            }
    }
}

// A sum of weighted colours, and of their weights.
struct Sum {
    F3 color = {F{}, F{}, F{}};
    F weight = F{};
    void add(F3 c, F w) {
        color = color + c * w;
        weight += w;
    }
};

// Clips RGB towards the centre of a variance box in YCoCg; returns RGB.
SS_INLINE F3 clip_to_center(F3 color, F3 mean, F3 extents) {
    F3 apart = ycocg(color) - mean;
    F overshoot = largest(absolute(apart.r) / maximum(extents.r, 1e-5f), absolute(apart.g) / maximum(extents.g, 1e-5f),
                          absolute(apart.b) / maximum(extents.b, 1e-5f));
    return clamped(from_ycocg(mean + apart * (1.0f / maximum(overshoot, 1.0f))), 0.0f, MAX_TONED);
}

// The network's image of one frame, its luma averaged with that upsampled along edges.
SS_INLINE F3 along_edges(const ClassifierWork& w, int y, int x, F3 color) {
    const Places around(w.tables.x.start, x);
    F luma = upsample_along_edges(w.samples, w.tables, BY_DISTANCE, around, y, x);
    F more = 0.5f * (luma - ycocg(color).r);
    color = {color.r + more, color.g + more, color.b + more};
    return clamped(color * dimming_to_samples(w.samples, w.tables, y, x, color), 0.0f, MAX_TONED);
}

// Writes up to W pixels of the next history.
SS_INLINE void write_history(float* to, int count, F3 color, F samples, F low, F high) {
    F v[HISTORY_VALUES] = {color.r, color.g, color.b, samples, low, high};
    to_pixels(v);
    if (count >= W) {
        const bool streams = is_aligned(to);
        for (int k = 0; k < HISTORY_VALUES; k++) streams ? stream(to + k * W, v[k]) : store(to + k * W, v[k]);
        return;
    }
    float pixels[HISTORY_VALUES * W];
    for (int k = 0; k < HISTORY_VALUES; k++) store(pixels + k * W, v[k]);
    memcpy(to, pixels, sizeof(float) * HISTORY_VALUES * count);
}

// A row of the compositor: what it reads.
struct ComposeRow {
    int y;
    const uint16_t* rest;  // see `Gathered`
    const float* history;
    const float* samples[3];    // toned, of the rows around
    const uint16_t* guided[3];  // guided colour of the rows around; of the variant `guided`
    const float* blend;         // parameters of the left pixels of packed pixels, then of the right ones
    int pitch;
};

template <Variant variant>
static ComposeRow row_of(const ClassifierWork& w, const float* blend, int y) {
    const Gathered& g = w.gathered;
    ComposeRow row = {};
    row.y = y;
    row.rest = g.rest + variant.planes() * g.place(y), row.history = g.history + 3 * g.place(y);
    row.pitch = up_to(w.network->half.width, LANES);
    row.blend = blend + 2 * variant.parameters() * (y % 2) * row.pitch;
    for (int i = 0; i < 3; i++) {
        row.samples[i] = sample_row(w.samples, w.tables.y.clamped(w.tables.y.nearest[y] + i - 1), TONED) - PAD;
        if constexpr (variant.guided) row.guided[i] = guided_row(w, clamp(y + i - 1, 0, w.target.height - 1));
    }
    return row;
}

// Returns a blend parameter of W pixels.
template <Variant variant>
SS_INLINE F parameter(const ComposeRow& row, int x, int index) {
    const float *left = row.blend + index * row.pitch + x / 2, *right = left + variant.parameters() * row.pitch;
    return low_zip(load(left), load(right));
}

// The network's kernel on the 3x3 samples, or guided pixels, around W pixels.
template <Variant variant>
SS_INLINE Sum filter_window(const ClassifierWork& w, const ComposeRow& row, int x) {
    const Axis &ax = w.tables.x, &ay = w.tables.y;
    auto kernel = [&](int k) __attribute__((always_inline)) {
        return factor(parameter<variant>(row, x, variant.kernel_weights() + k));
    };
    Sum window;
    const Places places(ax.nearest, x);
    if constexpr (variant.guided)
        unrolled<9>([&](auto index) __attribute__((always_inline)) {
            constexpr int k = index.k;
            const uint16_t* at = row.guided[k / 3] + x + k % 3 - 1;
            const int pitch = w.gathered.pitch + 2 * PAD;
            window.add(F3{load_toned(at), load_toned(at + pitch), load_toned(at + 2 * pitch)},
                       NEIGHBOUR_WEIGHTS[k] * kernel(k));
        });
    else
        unrolled<9>([&](auto index) __attribute__((always_inline)) {
            constexpr int k = index.k, i = k / 3, j = k % 3;
            const F weight = load(ax.windows + j * ax.pitch + x) * ay.windows[i * ay.pitch + row.y] + MIN_KERNEL_WEIGHT;
            auto plane = [&](int c) __attribute__((always_inline)) {
                return places.at(row.samples[i] + c * w.samples.pitch, j - 1);
            };
            window.add(F3{plane(0), plane(1), plane(2)}, weight * kernel(k) * plane(USABLE));
        });
    return window;
}

// The colours of this frame at W pixels, by the network's weights.
struct CurrentColors {
    Sum sum;
    F3 frame, sample;
    F confidence;
    I sampled;  // whether a sample around is usable
    F prior;    // sum of the weights without the network's
};

template <Variant variant>
SS_INLINE CurrentColors current_colors(const ClassifierWork& w, const ComposeRow& row, int x) {
    const uint16_t* rest = row.rest + variant.planes() * x;
    const Sum window = filter_window<variant>(w, row, x);
    CurrentColors c;
    c.frame = load_toned3(rest + W * FRAME), c.sample = load_toned3(rest + W * SAMPLE);
    c.confidence = load_half(rest + W * CONFIDENCE);
    F3 filtered = select(window.weight > 1e-9f, window.color * (1.0f / maximum(window.weight, 1e-12f)), c.frame);
    const F here = variant.guided ? load_half(rest + W * variant.sampled()) : select(window.weight > 0.0f, 1.0f, F{});
    c.sampled = here > 0.0f;
    const F sample_weight = here * (c.confidence + MIN_PRIOR), frame_weight = here * FRAME_PRIOR;
    constexpr int first = variant.history_colors();
    c.sum.add(c.sample, sample_weight * factor(parameter<variant>(row, x, first)));
    c.sum.add(c.frame, frame_weight * factor(parameter<variant>(row, x, first + 1)));
    c.sum.add(filtered, frame_weight * factor(parameter<variant>(row, x, first + 2)));
    c.prior = sample_weight + frame_weight + frame_weight;
    return c;
}

// The colours of the history at W pixels, by the network's weights; the number of its samples.
struct PastColors {
    Sum sum;
    F count, surface;
    I known;
};

template <Variant variant>
SS_INLINE PastColors past_colors(const ClassifierWork& w, const ComposeRow& row, int x, F current_weight) {
    const uint16_t* rest = row.rest + variant.planes() * x;
    const float* history = row.history + 3 * x;
    PastColors past;
    past.count = load_half(rest + W * COUNT), past.surface = load_half(rest + W * SURFACE);
    const F visible = past.count * past.surface;
    past.known = is_positive(visible);
    F first = select(past.known, visible + MIN_PRIOR, 0.0f) * factor(parameter<variant>(row, x, 0));
    F other = select(past.known, past.count * OTHER_PRIOR + MIN_PRIOR, 0.0f), second = F{}, third = F{};
    if (variant.rectified) second = other * factor(parameter<variant>(row, x, 1));
    if (variant.own_motion) third = other * factor(parameter<variant>(row, x, variant.history_colors() - 1));
    F weight = first + second + third;
    if (w.samples.has_reactive) {
        F reactive = reactive_at(w.samples, w.tables, row.y, x), now = maximum(current_weight, 1e-12f);
        F kept = (1.0f - reactive) * (now / (now + reactive * weight));
        first *= kept;
        second *= kept;
        third *= kept;
        weight *= kept;
    }
    F strength = clamped(parameter<variant>(row, x, variant.sharpness()), 0.0f, MAX_SHARPNESS);
    F3 color = F3{load(history), load(history + W), load(history + 2 * W)} + load_half3(rest + W * DETAIL) * strength;
    color = clamped(color, 0.0f, MAX_TONED);
    past.sum.add(color, first);
    if (variant.rectified) {
        F3 mean = load_half3(rest + W * variant.mean()), extents = load_half3(rest + W * (variant.mean() + 3));
        mean.r = load_toned(rest + W * variant.mean());
        past.sum.add(clip_to_center(color, mean, extents), second);
    }
    if (variant.own_motion) past.sum.add(load_toned3(rest + W * variant.own()), third);
    past.sum.weight = weight;
    return past;
}

// Writes the next history of W pixels up to column `end`. share: of the history in the image, [0, 1].
template <Variant variant>
SS_INLINE void write_next(const ClassifierWork& w, const ComposeRow& row, int x, int end, F3 image, F share,
                          const PastColors& past, const CurrentColors& now) {
    const uint16_t* rest = row.rest + variant.planes() * x;
    const F count = past.count;
    F odds = past.sum.weight / maximum(now.sum.weight, 1e-12f) * now.prior;
    odds = select(now.sampled, odds, share * count);  // all that is known
    F next_count = minimum(minimum(odds, count), w.config.samples) + now.confidence;
    const F luma = luminance(now.sample);
    const F trust = select(past.known, minimum(odds * HALF_COUNT / maximum(count, 1e-6f), 1.0f), 0.0f);
    const F rate = now.confidence * w.config.contraction;
    F low = load_half(rest + W * MIN_LUMA), high = load_half(rest + W * MAX_LUMA), warped_glare = F{};
    if (w.glares) {
        warped_glare = without_glare(high);
        if (!all(warped_glare <= 0.0f)) __atomic_store_n(w.next_glares, true, __ATOMIC_RELAXED);
        next_count = select((warped_glare > 0.0f) & (warped_glare < CONFIRMED), 0.0f, next_count);
    }
    const I rises = light_rises(luma, high, count, past.surface) & (warped_glare == 0.0f);
    const ptrdiff_t group = (static_cast<ptrdiff_t>(row.y) * w.gathered.pitch + x) / 4;
    w.gathered.rises[group] = static_cast<uint16_t>(mask_bits(rises));
    if (w.flash) next_count = F{};
    low = select(now.sampled, minimum(low, luma), low) + rate * maximum(luma - low, 0.0f);
    high = maximum(high, luma) - rate * maximum(high - luma, 0.0f);
    low = luma + trust * (low - luma);
    high = luma + trust * (high - luma) + warped_glare * GLARE;
    const ptrdiff_t pixel = static_cast<ptrdiff_t>(row.y) * w.target.width + x;
    write_history(w.next_history + HISTORY_VALUES * pixel, end - x, image, next_count, low, high);
}

// Computes the image, linear RGB, and the next history of columns x0 to x1 of row y.
template <Variant variant>
SS_INLINE void compose_row(const ClassifierWork& w, const float* blend, int y, int x0, int x1) {
    const ComposeRow row = row_of<variant>(w, blend, y);
    const int end = min(x1, w.target.width);
    for (int x = x0; x < end; x += W) {
        for (int line = 0; line < W * variant.planes(); line += LINE / 2)
            prefetch(row.rest + variant.planes() * (x + 2 * W) + line);
        for (int line = 0; line < 3 * W; line += LINE / 4) prefetch(row.history + 3 * (x + 2 * W) + line);
        const CurrentColors now = current_colors<variant>(w, row, x);
        const PastColors past = past_colors<variant>(w, row, x, now.sum.weight);
        const F total = past.sum.weight + now.sum.weight, scale = 1.0f / maximum(total, 1e-12f);
        F3 toned = select(total > 0.0f, (past.sum.color + now.sum.color) * scale, now.frame);
        if (!variant.guided && !all(past.known)) toned = select(past.known, toned, along_edges(w, y, x, toned));
        const F3 image = linear_of(toned, w.samples.exposure);
        const F share = past.sum.weight * scale;
        if (w.target.weight) write_plane(w.target.weight, y, x, end, share);
        write_image(w.target, y, x, end, image);
        write_next<variant>(w, row, x, end, image, share, past, now);
    }
}

// Makes light that rises in a rectangle of the next history unconfirmed, as in a first glaring frame.
void confirm_none(const ClassifierWork& w, Rect rect) {
    for (int y = rect.y0; y < rect.y1; y++)
        for (int x = rect.x0; x < rect.x1; x += W) {
            const uint32_t rises = w.gathered.rises[(static_cast<ptrdiff_t>(y) * w.gathered.pitch + x) / 4];
            for (int k = 0; k < min(W, rect.x1 - x) && rises; k++) {
                if (!(rises >> k & 1)) continue;
                float* pixel = w.next_history + HISTORY_VALUES * (static_cast<ptrdiff_t>(y) * w.target.width + x + k);
                pixel[3] = 0.0f;
                pixel[5] += GLARE;
            }
        }
}

// Runs the layers after the encoder on packed pixels p0 to p1 of row y: blend parameters and logits, see `blend_row`.
static void infer_row(const Network& n, const ClassifierScratch& s, int outputs, int y, int p0, int p1,
                      uint8_t* classes) {
    concatenate_row(n, y, p0, p1, s.read);
    pointwise_row(Input{s.read + 32 * p0, 32, 8}, n.decoder, s.decoded + 32 * p0, 32, p1 - p0);
    const int32_t* records = n.records_at(y) + p0 * RECORD_WORDS;
    pointwise_row(Input{reinterpret_cast<const uint8_t*>(records), 4 * RECORD_WORDS, INPUT_PLANES},
                  Input{s.decoded + 32 * p0, 32, 8}, n.hidden, s.hidden + 4 * WIDE * p0, 4 * WIDE, p1 - p0);
    blend_row(n, s.hidden, outputs, p0, p1, up_to(n.half.width, LANES), s.blend, classes);
}

// Writes the blend parameters of rows of packed pixels, (4 * parameters, height, width), and after them the logits.
void infer_rows(const ClassifierWork& w, int parameters, float* out, int y0, int y1) {
    const Size half = w.network->half;
    const int outputs = up_to(4 * parameters, 8), pitch = up_to(half.width, LANES);
    const float* blend = w.scratch->blend;
    for (int y = y0; y < y1; y++) {
        infer_row(*w.network, *w.scratch, outputs, y, 0, half.width, w.next_classes);
        for (int c = 0; c < 4 * parameters + CLASSES; c++) {
            const int from = c < 4 * parameters ? c % 4 * parameters + c / 4 : outputs + c - 4 * parameters;
            memcpy(out + (static_cast<ptrdiff_t>(c) * half.height + y) * half.width, blend + from * pitch,
                   sizeof(float) * half.width);
        }
    }
}

// Decodes and composes a rectangle of packed pixels: the image and the next history.
template <Variant variant>
static void finish_rows(const ClassifierWork& w, Rect rect, int thread) {
    const Network& n = *w.network;
    const ClassifierScratch& s = w.scratch[thread];
    for (int y = rect.y0; y < rect.y1; y++) {
        uint8_t* classes = w.next_classes + 8 * static_cast<ptrdiff_t>(y) * n.half.width;
        infer_row(n, s, variant.outputs(), y, rect.x0, rect.x1, classes);
        mark_unknown(w.gathered, variant.planes(), y, rect.x0, rect.x1, classes);
        for (int row = 2 * y; row < min(2 * y + 2, w.target.height); row++)
            compose_row<variant>(w, s.blend, row, 2 * rect.x0, 2 * rect.x1);
    }
    end_streams();
}

extern void (*const FINISH[])(const ClassifierWork&, Rect, int thread) = SS_VARIANTS(finish_rows);

}  // namespace ss::SS_ISA
