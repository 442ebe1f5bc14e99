// AOVs at display size; the same as supersampler_model.methods.aovs.
//
// The channels of a pixel lie next to each other, so its position, offsets and weights serve all of them, four at a time.
#include "warp.h"

namespace ss::SS_ISA {

using namespace aovs;

SS_INLINE F load_row(const float* row, int at, int count) {
    if (at + W <= count) return load(row + at);
    float part[W] = {};
    memcpy(part, row + at, sizeof(float) * (count - at));
    return load(part);
}

// Filters the samples around a display row vertically, to a line of their values and one of the weights of those that are
// not missing.
static void filter_down(const AovWork& w, int y, float* values, float* known) {
    const ss_aovs& v = *w.view;
    const int channels = v.channels, count = v.width * channels, border = AovWork::BORDER * channels;
    const float* rows[4];
    float weights[4];
    for (int k = 0; k < 4; k++) {
        rows[k] = v.aovs + static_cast<ptrdiff_t>(w.tables.y.clamped(w.tables.y.start[y] - 1 + k)) * count;
        weights[k] = w.tables.y.tap(0, k)[y];
    }
    for (int at = 0; at < count; at += W) {
        F sum = F{}, total = F{};
        for (int k = 0; k < 4; k++) {
            const F value = load_row(rows[k], at, count);
            const I number = is_number(value);
            sum += clamped(select(number, value, 0.0f), -MAX_HALF, MAX_HALF) * weights[k];
            total += select(number, weights[k], F{});
        }
        store(values + border + at, sum);
        store(known + border + at, total);
    }
    float* const lines[] = {values, known};
    for (float* line : lines)
        for (int k = 0; k < border; k++) {
            line[k] = line[border + k % channels];
            line[border + count + k] = line[border + count - channels + k % channels];
        }
}

// Writes the motion, display pixels, of the closest of each sample of a row and its right, lower and lower right neighbours.
static void dilate_row(const ss_aovs& v, int y, float* motion) {
    const float scale_x = static_cast<float>(v.display_width) / static_cast<float>(v.width);
    const float scale_y = static_cast<float>(v.display_height) / static_cast<float>(v.height);
    const ptrdiff_t upper = static_cast<ptrdiff_t>(y) * v.width, lower = y + 1 < v.height ? upper + v.width : upper;
    for (int x = 0; x < v.width; x++) {
        const int right = min(x + 1, v.width - 1);
        ptrdiff_t closest = upper + x;
        float depth = usable_depth(v.depth[closest]);
        const ptrdiff_t others[] = {upper + right, lower + x, lower + right};
        for (ptrdiff_t at : others) {
            const float other = usable_depth(v.depth[at]);
            if (other > depth) closest = at, depth = other;
        }
        motion[2 * x] = usable_motion(v.motion[2 * closest]) * scale_x;
        motion[2 * x + 1] = usable_motion(v.motion[2 * closest + 1]) * scale_y;
    }
}

// Loads and stores up to four channels.
template <int count>
SS_INLINE F4 load_channels(const float* from) {
    if constexpr (count == 4) return load4(from);
    return F4{from[0], count > 1 ? from[1] : 0.0f, count > 2 ? from[2] : 0.0f, 0.0f};
}
template <int count>
SS_INLINE void store_channels(float* to, F4 v) {
    if constexpr (count == 4) return store4(to, v);
    for (int k = 0; k < count; k++) to[k] = v[k];
}

// What the channels of a display pixel share.
struct Pixel {
    const float* before;  // the history, null without one
    // offsets of the samples of the history's cubic, and of the right and lower of the four pixels that bound it
    ptrdiff_t rows[4], columns[4], lower, right;
    float across[4], down[4];  // weights of the cubic
    float taps[4];             // weights of the filtered samples
    float kept = 0.0f;         // weight of the history

    Pixel(const AovWork& w, int x, int y, int lane, const Reprojected& at, const WarpScratch& warp)
        : before(w.view->previous) {
        const ss_aovs& v = *w.view;
        for (int k = 0; k < 4; k++) taps[k] = w.tables.x.tap(0, k)[x];
        if (!before) return;
        for (int k = 0; k < 4; k++) {
            columns[k] = static_cast<ptrdiff_t>(v.channels) * warp.offsets[k][lane];
            rows[k] = static_cast<ptrdiff_t>(v.channels) * warp.offsets[4 + k][lane];
            across[k] = warp.weights[k][lane], down[k] = warp.weights[4 + k][lane];
        }
        right = columns[at.x[lane] < 0.0f ? 3 : 2], lower = rows[at.y[lane] < 0.0f ? 3 : 2];
        const float weight = v.weight ? v.weight[static_cast<ptrdiff_t>(y) * v.display_width + x] : 0.0f;
        kept = weight > 0.0f ? min(weight, 1.0f) : 0.0f;
    }

    // The history by Catmull-Rom without its corners, bounded by the known ones of the four pixels around; `is_known`: where
    // one of these is.
    template <int count>
    F4 history(int channel, I4& is_known) const {
        const float* from = before + channel;
        auto at = [&](int row, int column) __attribute__((always_inline)) {
            return load_channels<count>(from + rows[row] + columns[column]);
        };
        auto across_of = [&](int row, int first, int last) __attribute__((always_inline)) {
            F4 sum = at(row, first) * across[first];
            for (int k = first + 1; k <= last; k++) sum += at(row, k) * across[k];
            return sum * down[row];
        };
        const F4 cubic = across_of(0, 1, 2) + across_of(1, 0, 3) + across_of(2, 0, 3) + across_of(3, 1, 2);
        const F4 corners[] = {
            at(1, 1),
            load_channels<count>(from + rows[1] + right),
            load_channels<count>(from + lower + columns[1]),
            load_channels<count>(from + lower + right),
        };
        F4 low = F4{} + 2.0f * MAX_HALF, high = F4{} - 2.0f * MAX_HALF;
        for (const F4& corner : corners) {
            const I4 known = corner != UNKNOWN;
            low = known & (corner < low) ? corner : low;
            high = known & (corner > high) ? corner : high;
        }
        is_known = low <= high;
        return clamped4(cubic, low, high);
    }

    F4 sum(const float* line, int channels) const {
        return load4(line) * taps[0] + load4(line + channels) * taps[1] + load4(line + 2 * channels) * taps[2] +
               load4(line + 3 * channels) * taps[3];
    }
};

// Blends the channels of a pixel. `values`: what it reads of the filtered samples; `known`: of their weights.
template <int count>
SS_INLINE void blend_pixel(const Pixel& pixel, const float* values, const float* known, int channels, float* to) {
    for (int next = 0; next < channels; next += 4) {
        const int channel = min(next, channels - count);  // the last four overlap others
        const F4 certainty = pixel.sum(known + channel, channels);
        const I4 found = certainty > MIN_CERTAINTY;
        const F4 least = F4{} + 1e-6f;
        const F4 current = pixel.sum(values + channel, channels) / (certainty > least ? certainty : least);
        F4 blend = current;
        I4 is_known = {};
        if (pixel.before) {
            const F4 before = pixel.history<count>(channel, is_known);
            const F4 kept = found ? F4{} + pixel.kept : F4{} + 1.0f;
            blend = is_known ? current + kept * (before - current) : current;
        }
        blend = clamped4(blend, F4{} - MAX_HALF, F4{} + MAX_HALF);
        store_channels<count>(to + channel, found | is_known ? blend : F4{} + UNKNOWN);
    }
}

template <int count>
static void blend_rows(const AovWork& w, int y0, int y1, int thread) {
    const ss_aovs& v = *w.view;
    const Axis &ax = w.tables.x, &ay = w.tables.y;
    const Size display = {v.display_width, v.display_height};
    float *values = w.lines + 3 * w.line_pitch * thread, *known = values + w.line_pitch, *motion = known + w.line_pitch;
    WarpScratch& warp = w.scratch[thread];
    int dilated = -1;
    for (int y = y0; y < y1; y++) {
        filter_down(w, y, values, known);
        const int first = ay.clamped(ay.start[y]);
        if (v.previous && first != dilated) dilate_row(v, dilated = first, motion);
        float* row = v.image + static_cast<ptrdiff_t>(y) * v.display_width * v.channels;
        for (int x = 0; x < v.display_width; x += W) {
            Reprojected at = {};
            if (v.previous) {
                const I sample = 2 * clamped(load(ax.start + x), 0, v.width - 1);
                at = reproject(x, y, gather(motion, sample), gather(motion + 1, sample), display);
                prepare_warp(at.x, at.y, display, 1, CATMULL_ROM, warp);
            }
            for (int lane = 0; lane < min(W, v.display_width - x); lane++) {
                const Pixel pixel(w, x + lane, y, lane, at, warp);
                const ptrdiff_t from = static_cast<ptrdiff_t>(ax.start[x + lane] - 1 + AovWork::BORDER) * v.channels;
                blend_pixel<count>(pixel, values + from, known + from, v.channels,
                                   row + static_cast<ptrdiff_t>(x + lane) * v.channels);
            }
        }
    }
}

void blend_aovs(const AovWork& w, int y0, int y1, int thread) {
    constexpr void (*VARIANTS[])(const AovWork&, int, int, int) = {blend_rows<1>, blend_rows<2>, blend_rows<3>,
                                                                   blend_rows<4>};
    VARIANTS[min(w.view->channels, 4) - 1](w, y0, y1, thread);
}

}  // namespace ss::SS_ISA
