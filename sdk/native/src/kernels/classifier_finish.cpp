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

// Computes the image, linear RGB, and the next history of columns x0 to x1 of row y.
template <bool rectified, bool own_motion, bool guided>
SS_INLINE void compose_row(const ClassifierWork& w, const float* blend, int blend_pitch, int y, int x0, int x1) {
    constexpr Variant variant = {rectified, own_motion, guided};
    constexpr int parameters = variant.parameters();
    const Samples& s = w.samples;
    const Axis &ax = w.tables.x, &ay = w.tables.y;
    const int width = w.gathered.pitch, end = w.target.width, near = ay.nearest[y];
    blend += 2 * parameters * (y % 2) * blend_pitch;
    const uint16_t* gathered = w.gathered.rest + variant.planes() * w.gathered.place(y);
    const float *histories = w.gathered.history + 3 * w.gathered.place(y), *rows[3];
    const uint16_t* images[3] = {};
    for (int i = 0; i < 3; i++) {
        rows[i] = sample_row(s, ay.clamped(near + i - 1), TONED) - PAD;
        if constexpr (guided) images[i] = guided_row(w, clamp(y + i - 1, 0, w.target.height - 1));
    }
    for (int x = x0; x < min(x1, end); x += W) {
        const uint16_t* rest = gathered + variant.planes() * x;
        const float* history = histories + 3 * x;
        for (int line = 0; line < W * variant.planes(); line += LINE / 2)
            prefetch(rest + 2 * W * variant.planes() + line);
        for (int line = 0; line < 3 * W; line += LINE / 4) prefetch(history + 2 * 3 * W + line);
        // Of the left and right pixel of packed pixels.
        auto parameter = [&](int index) __attribute__((always_inline)) {
            const float *left = blend + index * blend_pitch + x / 2, *right = left + parameters * blend_pitch;
            return low_zip(load(left), load(right));
        };
        Sum window;
        const Places places(ax.nearest, x);
        if constexpr (guided)
            unrolled<9>([&](auto index) __attribute__((always_inline)) {
                constexpr int k = index.k;
                const uint16_t* at = images[k / 3] + x + k % 3 - 1;
                const int pitch = width + 2 * PAD;
                window.add(F3{load_toned(at), load_toned(at + pitch), load_toned(at + 2 * pitch)},
                           NEIGHBOUR_WEIGHTS[k] * factor(parameter(variant.kernel_weights() + k)));
            });
        else
            unrolled<3>([&](auto row_index) __attribute__((always_inline)) {
                constexpr int i = row_index.k;
                const float down = ay.windows[i * ay.pitch + y];
                unrolled<3>([&](auto column_index) __attribute__((always_inline)) {
                    constexpr int j = column_index.k;
                    F weight = load(ax.windows + j * ax.pitch + x) * down + MIN_KERNEL_WEIGHT;
                    weight *= factor(parameter(variant.kernel_weights() + 3 * i + j));
                    auto plane = [&](int c)
                                     __attribute__((always_inline)) { return places.at(rows[i] + c * s.pitch, j - 1); };
                    window.add(F3{plane(0), plane(1), plane(2)}, weight * plane(USABLE));
                });
            });
        F3 frame = load_toned3(rest + W * FRAME), sample = load_toned3(rest + W * SAMPLE);
        F3 filtered = select(window.weight > 1e-9f, window.color * (1.0f / maximum(window.weight, 1e-12f)), frame);
        F confidence = load_half(rest + W * CONFIDENCE);
        F here = select(window.weight > 0.0f, 1.0f, F{});  // whether a sample around is usable
        if (guided) here = load_half(rest + W * variant.sampled());
        F sampled = here * (confidence + MIN_PRIOR), frame_weight = here * FRAME_PRIOR;
        constexpr int of_sample = variant.history_colors();
        Sum current;
        current.add(sample, sampled * factor(parameter(of_sample)));
        current.add(frame, frame_weight * factor(parameter(of_sample + 1)));
        current.add(filtered, frame_weight * factor(parameter(of_sample + 2)));
        // history colours
        F count = load_half(rest + W * COUNT), surface = load_half(rest + W * SURFACE), visible = count * surface;
        I known = is_positive(visible);
        F first = select(known, visible + MIN_PRIOR, 0.0f) * factor(parameter(0));
        F other = select(known, count * OTHER_PRIOR + MIN_PRIOR, 0.0f), second = F{}, third = F{};
        if (rectified) second = other * factor(parameter(1));
        if (own_motion) third = other * factor(parameter(variant.history_colors() - 1));
        F history_weight = first + second + third;
        F strength = clamped(parameter(variant.sharpness()), 0.0f, MAX_SHARPNESS);
        F3 detail = load_half3(rest + W * DETAIL);
        F3 color =
            clamped(F3{load(history), load(history + W), load(history + 2 * W)} + detail * strength, 0.0f, MAX_TONED);
        if (s.has_reactive) {
            F reactive = reactive_at(s, w.tables, y, x), now = maximum(current.weight, 1e-12f);
            F kept = (1.0f - reactive) * (now / (now + reactive * history_weight));
            first *= kept;
            second *= kept;
            third *= kept;
            history_weight *= kept;
        }
        Sum past;
        past.add(color, first);
        if (rectified) {
            F3 mean = load_half3(rest + W * variant.mean()), extents = load_half3(rest + W * (variant.mean() + 3));
            mean.r = load_toned(rest + W * variant.mean());
            past.add(clip_to_center(color, mean, extents), second);
        }
        if (own_motion) past.add(load_toned3(rest + W * variant.own()), third);
        F total = history_weight + current.weight, scale = 1.0f / maximum(total, 1e-12f);
        F3 toned = select(total > 0.0f, (past.color + current.color) * scale, frame);
        if (!guided && !all(known)) toned = select(known, toned, along_edges(w, y, x, toned));
        F3 image = linear_of(toned, s.exposure);
        if (w.target.weight) write_plane(w.target.weight, y, x, min(x1, end), history_weight * scale);
        write_image(w.target, y, x, min(x1, end), image);
        // next history
        F odds = history_weight / maximum(current.weight, 1e-12f) * (sampled + frame_weight + frame_weight);
        const I unsampled = here <= 0.0f;
        odds = select(unsampled, history_weight * scale * count, odds);  // all that is known
        F next_count = minimum(minimum(odds, count), w.config.samples) + confidence;
        F luma = luminance(sample),
          trust = select(known, minimum(odds * HALF_COUNT / maximum(count, 1e-6f), 1.0f), 0.0f);
        F rate = confidence * w.config.contraction, low = load_half(rest + W * MIN_LUMA),
          high = load_half(rest + W * MAX_LUMA);
        F warped_glare = F{};
        if (w.glares) {
            warped_glare = without_glare(high);
            if (!all(warped_glare <= 0.0f)) __atomic_store_n(w.next_glares, true, __ATOMIC_RELAXED);
            next_count = select((warped_glare > 0.0f) & (warped_glare < CONFIRMED), 0.0f, next_count);
        }
        I rises = light_rises(luma, high, count, surface) & (warped_glare == 0.0f);
        w.gathered.rises[(static_cast<ptrdiff_t>(y) * width + x) / 4] = static_cast<uint16_t>(mask_bits(rises));
        if (w.flash) next_count = F{};
        low = select(unsampled, low, minimum(low, luma)) + rate * maximum(luma - low, 0.0f);
        high = maximum(high, luma) - rate * maximum(high - luma, 0.0f);
        low = luma + trust * (low - luma);
        high = luma + trust * (high - luma) + warped_glare * GLARE;
        write_history(w.next_history + HISTORY_VALUES * (static_cast<ptrdiff_t>(y) * end + x), min(x1, end) - x, image,
                      next_count, low, high);
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
template <bool rectified, bool own_motion, bool guided>
static void finish_rows(const ClassifierWork& w, Rect rect, int thread) {
    constexpr Variant variant = {rectified, own_motion, guided};
    const Network& n = *w.network;
    const ClassifierScratch& s = w.scratch[thread];
    const int pitch = up_to(n.half.width, LANES), p0 = rect.x0;
    for (int y = rect.y0; y < rect.y1; y++) {
        uint8_t* classes = w.next_classes + 8 * static_cast<ptrdiff_t>(y) * n.half.width;
        infer_row(n, s, variant.outputs(), y, p0, rect.x1, classes);
        mark_unknown(w.gathered, variant.planes(), y, p0, rect.x1, classes);
        for (int row = 2 * y; row < min(2 * y + 2, w.target.height); row++)
            compose_row<rectified, own_motion, guided>(w, s.blend, pitch, row, 2 * p0, 2 * rect.x1);
    }
    end_streams();
}

extern void (*const FINISH[])(const ClassifierWork&, Rect, int thread) = {
    finish_rows<false, false, false>, finish_rows<false, true, false>, finish_rows<true, false, false>,
    finish_rows<true, true, false>,   finish_rows<false, true, true>,  finish_rows<true, true, true>};

}  // namespace ss::SS_ISA
