// The temporal filter of denoised frames; the same as supersampler_model.denoising.filter.
//
// Each pixel follows its motion from frame to frame. The pixels that it finds are averaged, weighted by their similarity.
#include "warp.h"

namespace ss::SS_ISA {

using namespace temporal_filter;

constexpr int BORDER = TemporalFilter::BORDER;
constexpr int ROWS = TemporalFilter::TILE_ROWS + 2 * BORDER;
constexpr int PITCH = TemporalFilter::TILE_COLUMNS + LANES;  // of planes; more than the tile and its border
constexpr int PLANE = ROWS * PITCH;
static_assert(LANES >= 2 * BORDER);

enum Plane {
    OWN_COLORS,
    OWN_KNOWN = 3,
    OWN_GUIDES,
    X = 10,
    Y,
    ON_SCREEN,
    COLORS,
    KNOWN = 16,
    NORMALS,
    ALBEDOS,
    PATCHES,
    SHIFTS,
    LIGHTS,
    NORMALS_3 = LIGHTS + 3,
    ALBEDOS_3,
    PATCHES_3,
    PATCHES_5,
    SHIFTS_9,
    LIGHTS_9,
    PLANES = LIGHTS_9 + 3
};
static_assert(PLANES * PLANE == TemporalFilter::SCRATCH);

// Exponent plus mantissa of positive floats: a piecewise linear logarithm to base 2.
SS_INLINE F log2(F v) { return to_float(bits_of(v)) * 0x1p-23f - 127.0f; }

// A tile with its border, and where both lie in the image; beyond an edge, its pixels are repeated.
struct Tile {
    Rect inner;
    Size size;
    float* planes;
    int columns, rows;  // with the border
    Tile(const TemporalFilter& w, Rect rect)
        : inner(rect),
          size(w.size),
          planes(w.scratch),
          columns(rect.x1 - rect.x0 + 2 * BORDER),
          rows(rect.y1 - rect.y0 + 2 * BORDER) {}
    float* row(int plane, int y) const { return planes + plane * PLANE + y * PITCH; }
    int image_row(int y) const { return clamp(inner.y0 + y - BORDER, 0, size.height - 1); }
    I image_columns(int x) const { return clamped(ramp() + (inner.x0 + x - BORDER), 0, size.width - 1); }
};

// Loads four channels of the pixels at W offsets, as a vector per channel.
SS_INLINE void load_pixels(const float* image, I offset, F (&v)[4]) {
    int32_t places[W];
    store(places, offset);
    gather4(image, places, 1, v);
}

// Mean of the values up to `reach` pixels around each pixel of the tile, without its border: `plane` to `to`.
// Sums of rows stay in registers on the way down a column.
template <int reach>
static void box(const Tile& t, int plane, int to) {
    constexpr int SIDE = 2 * reach + 1;
    constexpr float share = 1.0f / (SIDE * SIDE);
    for (int x = BORDER; x < t.columns - BORDER; x += W) {
        F rows[SIDE] = {};
        for (int y = BORDER - reach; y < t.rows - BORDER + reach; y++) {
            const float* from = t.row(plane, y) + x;
            F sum = load(from);
            for (int k = 1; k <= reach; k++) sum += load(from - k) + load(from + k);
            for (int k = 0; k < SIDE - 1; k++) rows[k] = rows[k + 1];
            rows[SIDE - 1] = sum;
            for (int k = 0; k < SIDE - 1; k++) sum += rows[k];
            if (y >= BORDER + reach) store(t.row(to, y - reach) + x, sum * share);
        }
    }
}

// Reads the frame itself: its exposed colour, where that is known, and its guides.
static void read_own(const TemporalFilter& w, const Tile& t) {
    for (int y = 0; y < t.rows; y++)
        for (int x = 0; x < t.columns; x += W) {
            const I pixel = t.image_columns(x) + t.image_row(y) * t.size.width;
            F color[4], albedo[4], normal[4];
            load_pixels(w.frames[0].color, pixel * 4, color);
            load_pixels(w.frames[0].guides, pixel * 8, albedo);
            load_pixels(w.frames[0].guides + 4, pixel * 8, normal);
            store(t.row(OWN_KNOWN, y) + x, color[3]);
            for (int c = 0; c < 3; c++) {
                store(t.row(OWN_COLORS + c, y) + x, color[c] * w.exposure + LOG_OFFSET);
                store(t.row(OWN_GUIDES + c, y) + x, albedo[c]);
                store(t.row(OWN_GUIDES + 3 + c, y) + x, normal[c]);
            }
        }
}

// Reads an image for lane i; the same as `sharp`.
SS_INLINE F4 sharp4(const float* image, const WarpScratch& s, int i) {
    F4 corners[4];
    for (int k = 0; k < 4; k++) corners[k] = load4(image + s.offsets[5 + k / 2][i] + s.offsets[1 + k % 2][i]);
    return within_corners(cubic4(image, s, i), corners);
}

// Gathers the guides of a neighbour, and compares them with those of the frame.
static void compare_guides(const Tile& t, const float* guides, const WarpScratch& s, int y, int x) {
    float albedo[4 * W], normal[4 * W];
    for (int i = 0; i < W; i++) {
        F4 corners[2][4];
        for (int k = 0; k < 4; k++) {
            const float* from = guides + 2 * (s.offsets[5 + k / 2][i] + s.offsets[1 + k % 2][i]);
            corners[0][k] = load4(from), corners[1][k] = load4(from + 4);
        }
        const float tx = s.weights[8][i], ty = s.weights[9][i];
        store4(albedo + 4 * i, linear4(corners[0][0], corners[0][1], corners[0][2], corners[0][3], tx, ty));
        store4(normal + 4 * i, linear4(corners[1][0], corners[1][1], corners[1][2], corners[1][3], tx, ty));
    }
    F a[4], n[4], of_albedo = F{}, of_normal = F{};
    load_channels(albedo, a);
    load_channels(normal, n);
    for (int k = 0; k < 3; k++) {
        const F da = a[k] - load(t.row(OWN_GUIDES + k, y) + x), dn = n[k] - load(t.row(OWN_GUIDES + 3 + k, y) + x);
        of_albedo += da * da, of_normal += dn * dn;
    }
    store(t.row(ALBEDOS, y) + x, of_albedo);
    store(t.row(NORMALS, y) + x, of_normal);
}

// Follows the motion of the last frame to `frame`, the next one, and gathers that there; in the border, only what patches
// reach.
static void gather_frame(const TemporalFilter& w, const Tile& t, const float* step, const ss_temporal_frame& frame,
                         WarpScratch& s) {
    const float right = static_cast<float>(t.size.width), bottom = static_cast<float>(t.size.height);
    for (int y = 0; y < t.rows; y++) {
        const int outside = max(BORDER - y, y - (t.rows - BORDER - 1));  // rows from the tile; > 0 in the border
        for (int x = 0; x < t.columns; x += W) {
            F px = load(t.row(X, y) + x), py = load(t.row(Y, y) + x);
            const I from = (clamped(to_int(floor(py + 0.5f)), 0, t.size.height - 1) * t.size.width +
                            clamped(to_int(floor(px + 0.5f)), 0, t.size.width - 1)) *
                           2;
            px = clamped(px + gather(step, from), -2.0f, right + 1.0f),
            py = clamped(py + gather(step, from + 1), -2.0f, bottom + 1.0f);
            const F inside = select(on_screen(px, py, t.size), load(t.row(ON_SCREEN, y) + x), 0.0f);
            store(t.row(X, y) + x, px);
            store(t.row(Y, y) + x, py);
            store(t.row(ON_SCREEN, y) + x, inside);
            prepare_warp(px, py, t.size, 4, CATMULL_ROM, s);
            float color[4 * W], complete[W];
            for (int i = 0; i < W; i++) {
                F4 corners[4];
                for (int k = 0; k < 4; k++)
                    corners[k] = load4(frame.color + s.offsets[5 + k / 2][i] + s.offsets[1 + k % 2][i]);
                store4(color + 4 * i, within_corners(cubic4(frame.color, s, i), corners));
                complete[i] =
                    linear4(corners[0], corners[1], corners[2], corners[3], s.weights[8][i], s.weights[9][i])[3];
            }
            F c[4];
            load_channels(color, c);
            const F known = select(load(complete) > KNOWN_SHARE, inside, 0.0f);
            const F both = known * load(t.row(OWN_KNOWN, y) + x);
            F of_color = F{}, shift = F{};
            for (int k = 0; k < 3; k++) {
                const F own = load(t.row(OWN_COLORS + k, y) + x), found = c[k] * w.exposure + LOG_OFFSET;
                const F dc = log2(found) - log2(own), light = 2.0f * (own - found) / (own + found);
                store(t.row(LIGHTS + k, y) + x, clamped(light, -LIGHT_LIMIT, LIGHT_LIMIT) * both);
                of_color += dc * dc, shift += dc;
            }
            store(t.row(KNOWN, y) + x, known);
            store(t.row(PATCHES, y) + x, of_color * (1.0f / 3.0f));
            store(t.row(SHIFTS, y) + x, shift * (1.0f / 3.0f));
            if (outside <= 1) compare_guides(t, frame.guides, s, y, x);
            if (outside > 0) continue;
            if (frame.noisy) {
                for (int i = 0; i < W; i++) store4(color + 4 * i, sharp4(frame.noisy, s, i));
                load_channels(color, c);
            }
            for (int k = 0; k < 3; k++) store(t.row(COLORS + k, y) + x, c[k]);
        }
    }
}

// Returns a channel of a neighbour's colour in the light of the frame; the same as `relit`.
SS_INLINE F relit(const Tile& t, int channel, int y, int x, float samples) {
    const F change = load(t.row(LIGHTS_9 + channel, y) + x), significance = change * change * samples;
    return load(t.row(COLORS + channel, y) + x) * exponential(change * significance / (significance + LIGHT_NOISE));
}

// Adds the colours and AOVs of a neighbouring frame, times their weights.
static void add_frame(const TemporalFilter& w, const Tile& t, const ss_temporal_frame& frame, int age, WarpScratch& s) {
    box<1>(t, NORMALS, NORMALS_3);
    box<1>(t, ALBEDOS, ALBEDOS_3);
    box<1>(t, PATCHES, PATCHES_3);
    box<2>(t, PATCHES, PATCHES_5);
    box<4>(t, SHIFTS, SHIFTS_9);
    for (int c = 0; c < 3; c++) box<4>(t, LIGHTS + c, LIGHTS_9 + c);
    const Weights& c = frame.noisy ? OF_NOISY : OF_DENOISED;
    const float samples = min(w.samples, static_cast<float>(MAX_SAMPLES));
    const struct {
        int plane;
        float cost;
    } distances[] = {{PATCHES, c.color},        {PATCHES_3, c.color_3x3}, {PATCHES_5, c.color_5x5}, {NORMALS, c.normal},
                     {NORMALS_3, c.normal_3x3}, {ALBEDOS, c.albedo},      {ALBEDOS_3, c.albedo_3x3}};
    const float young = c.log_weight - c.age * static_cast<float>(age);
    for (int y = BORDER; y < t.rows - BORDER; y++)
        for (int x = BORDER; x < t.columns - BORDER; x += W) {
            const F shift = load(t.row(SHIFTS_9, y) + x);
            F cost = shift * shift * c.shift_9x9;
            for (const auto& distance : distances) cost += load(t.row(distance.plane, y) + x) * distance.cost;
            const F weight = exponential(young - cost * samples) * load(t.row(KNOWN, y) + x);
            const ptrdiff_t pixel = static_cast<ptrdiff_t>(t.image_row(y)) * t.size.width + t.inner.x0 + x - BORDER;
            float added[4][W];
            for (int c = 0; c < 3; c++) store(added[c], relit(t, c, y, x, samples) * weight);
            store(added[3], weight);
            const int count = min(W, t.inner.x1 - t.inner.x0 - (x - BORDER));
            for (int i = 0; i < count; i++)
                store4(w.image + 4 * (pixel + i),
                       load4(w.image + 4 * (pixel + i)) + F4{added[0][i], added[1][i], added[2][i], added[3][i]});
            for (int group = 0; group < w.groups; group++) {
                if (group == 0) prepare_warp(load(t.row(X, y) + x), load(t.row(Y, y) + x), t.size, 4, CATMULL_ROM, s);
                for (int i = 0; i < count; i++) {
                    float* to = w.aovs[group] + 4 * (pixel + i);
                    store4(to, load4(to) + sharp4(frame.aovs[group], s, i) * added[3][i]);
                }
            }
        }
}

// Starts the paths at the pixels themselves.
static void begin_path(const Tile& t) {
    for (int y = 0; y < t.rows; y++)
        for (int x = 0; x < t.columns; x += W) {
            store(t.row(X, y) + x, to_float(t.image_columns(x)));
            store(t.row(Y, y) + x, spread(static_cast<float>(t.image_row(y))));
            store(t.row(ON_SCREEN, y) + x, spread(1.0f));
        }
}

static void filter_tile(const TemporalFilter& w, const Tile& t) {
    WarpScratch warp;
    const int width = t.inner.x1 - t.inner.x0;
    for (int y = t.inner.y0; y < t.inner.y1; y++)
        for (ptrdiff_t pixel = static_cast<ptrdiff_t>(y) * t.size.width + t.inner.x0, end = pixel + width; pixel < end;
             pixel++) {
            const F4 own = load4((w.frames[0].noisy ? w.frames[0].noisy : w.frames[0].color) + 4 * pixel);
            store4(w.image + 4 * pixel, F4{own[0], own[1], own[2], 1.0f} * own[3]);
            for (int group = 0; group < w.groups; group++)
                store4(w.aovs[group] + 4 * pixel, load4(w.frames[0].aovs[group] + 4 * pixel) * own[3]);
        }
    read_own(w, t);
    for (int direction = 0; direction < 2; direction++) {
        const int first = direction ? 1 + w.previous : 1, count = min(direction ? w.following : w.previous, REACH);
        begin_path(t);
        const ss_temporal_frame* last = w.frames;
        for (int age = 1; age <= count; age++) {
            const ss_temporal_frame& frame = w.frames[first + age - 1];
            const float* step = direction ? last->to_next : last->to_previous;
            if (!step) break;
            gather_frame(w, t, step, frame, warp);
            add_frame(w, t, frame, age, warp);
            last = &frame;
        }
    }
    for (int y = t.inner.y0; y < t.inner.y1; y++)
        for (ptrdiff_t pixel = static_cast<ptrdiff_t>(y) * t.size.width + t.inner.x0, end = pixel + width; pixel < end;
             pixel++) {
            const F4 sum = load4(w.image + 4 * pixel);
            const float share = sum[3] > 0.0f ? 1.0f / sum[3] : 1.0f;
            store4(w.image + 4 * pixel, F4{sum[0] * share, sum[1] * share, sum[2] * share, sum[3]});
            for (int group = 0; group < w.groups; group++)
                store4(w.aovs[group] + 4 * pixel, load4(w.aovs[group] + 4 * pixel) * share);
        }
}

void temporal_rows(const TemporalFilter& w, int y0, int y1) {
    for (int y = y0; y < y1; y += TemporalFilter::TILE_ROWS)
        for (int x = 0; x < w.size.width; x += TemporalFilter::TILE_COLUMNS)
            filter_tile(w, Tile(w, {y, min(y + TemporalFilter::TILE_ROWS, y1), x,
                                    min(x + TemporalFilter::TILE_COLUMNS, w.size.width)}));
}

// Writes the motion of the closest of 3x3 pixels, (height, width, 2); the same as `nearest_motion`.
void nearest_motion_rows(const float* depth, const float* motion, float* to, Size size, int y0, int y1) {
    for (int y = y0; y < y1; y++)
        for (int x = 0; x < size.width; x++) {
            ptrdiff_t best = static_cast<ptrdiff_t>(y) * size.width + x;
            for (int row = max(y - 1, 0); row < min(y + 2, size.height); row++)
                for (int column = max(x - 1, 0); column < min(x + 2, size.width); column++) {
                    const ptrdiff_t other = static_cast<ptrdiff_t>(row) * size.width + column;
                    if (depth[other] > depth[best]) best = other;
                }
            for (int axis = 0; axis < 2; axis++) {
                const float moved = motion[2 * best + axis];
                *to++ = __builtin_fabsf(moved) <= FINITE_MOTION ? clamp(moved, -MAX_MOTION, MAX_MOTION) : 0.0f;
            }
        }
}

}  // namespace ss::SS_ISA
