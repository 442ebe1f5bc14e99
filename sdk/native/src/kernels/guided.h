// Guided colour of the variant `guided`; the same as supersampler_model.methods.gbuffer_fast.
//
// Light of this frame is resampled at display pixels by the agreement of surfaces.
#pragma once

#include "classifier.h"

namespace ss::SS_ISA {

using gbuffer_fast::MAX_DEPTH_COST, gbuffer_fast::MIN_SIMILARITY, gbuffer_fast::NEIGHBOUR_WEIGHTS,
    gbuffer_fast::STEP_COST;

// Values in [least, 1]; others, and NaN, become 0.
SS_INLINE F in_range(F v, float least) { return select((v >= least) & (v <= 1.0f), v, 0.0f); }

// Sanitized base colour and normal of W surfaces.
struct Surface {
    F3 color, normal;
};
SS_INLINE Surface surface_at(const float* color, const float* normal, int x, int width) {
    float tail[3 * W];
    Surface s;
    F3 c = load_rgb(whole_vector<3>(color, x, width, tail)), n = load_rgb(whole_vector<3>(normal, x, width, tail));
    s.color = {in_range(c.r, 0.0f), in_range(c.g, 0.0f), in_range(c.b, 0.0f)};
    s.normal = {in_range(n.r, -1.0f), in_range(n.g, -1.0f), in_range(n.b, -1.0f)};
    return s;
}

// Reflectance of surfaces; 1 in the sky, which has no normal.
SS_INLINE F3 reflectance(const Surface& s, float least) {
    I sky = s.normal.r * s.normal.r + s.normal.g * s.normal.g + s.normal.b * s.normal.b < MIN_NORMAL;
    F3 c = s.color * (1.0f - least);
    return {select(sky, 1.0f, c.r + least), select(sky, 1.0f, c.g + least), select(sky, 1.0f, c.b + least)};
}

SS_INLINE const float* surface_row(const ClassifierWork& w, int y) {
    return w.guide.samples + w.samples.place(y) * SURFACE_PLANES * w.samples.pitch;
}
SS_INLINE const float* depth_row(const ClassifierWork& w, int y) { return w.guide.depth + w.gathered.padded(y); }

// Relative range of depth in 3x3 pixels; same as `edge_of`.
SS_INLINE F edge_at(const ClassifierWork& w, int y, int x) {
    F closest = load(depth_row(w, y) + x), farthest = closest;
    for (int row = -1; row <= 1; row++)
        for (int k = -1; k <= 1; k++) {
            F d = load(depth_row(w, clamp(y + row, 0, w.target.height - 1)) + x + k);
            closest = maximum(d, closest);
            farthest = minimum(d, farthest);
        }
    return clamped((closest - maximum(farthest, 0.0f)) / maximum(closest, 1e-12f), 0.0f, 1.0f);
}

// Light of this frame at W pixels, toned; agreement of surfaces; where a sample is usable; the surface's motion.
struct Guided {
    F3 light;
    F agreement, sampled, motion_x, motion_y;
};

SS_INLINE Guided guide_pixels(const ClassifierWork& w, int y, int x, const Surface& surface, F depth) {
    const Samples& s = w.samples;
    const Guide& g = w.guide;
    const Axis &ax = w.tables.x, &ay = w.tables.y;
    const Places places(ax.nearest, x);
    F3 normal = surface.normal * g.normal_scale, color = surface.color * g.color_scale;
    const F features[6] = {normal.r, normal.g, normal.b, color.r, color.g, color.b};
    Guided found = {{F{}, F{}, F{}}, F{}, F{}, F{}, F{}};
    F total = F{}, similar = F{}, known = F{}, least = spread(MAX_DEPTH);
    unrolled<9>([&](auto index) __attribute__((always_inline)) {
        constexpr int k = index.k, line = k / 3 - 1, column = k % 3 - 1;
        const int row = ay.clamped(ay.nearest[y] + line);
        const float* planes = surface_row(w, row);
        const ptrdiff_t at = static_cast<ptrdiff_t>(row) * s.pitch;
        F d = places.at(s.depth + at, column), apart = absolute(d - depth) / maximum(maximum(d, depth), 1e-12f);
        F exponent = minimum(apart * apart * g.depth_scale, MAX_DEPTH_COST);
        for (int f = 0; f < 6; f++) {
            F difference = places.at(planes + (3 + f) * s.pitch, column) - features[f];
            exponent += difference * difference;
        }
        F similarity = exponential(0.0f - exponent);
        F distance = load(ax.windows + k % 3 * ax.pitch + x) * ay.windows[k / 3 * ay.pitch + y] + MIN_SIMILARITY;
        distance *= places.at(sample_row(s, row, USABLE) - PAD, column);
        F weight = distance * (similarity + MIN_SIMILARITY);
        found.light = found.light + F3{places.at(planes, column), places.at(planes + s.pitch, column),
                                       places.at(planes + 2 * s.pitch, column)} *
                                        weight;
        total += weight;
        similar += distance * similarity;
        known += distance;
        F cost = apart + STEP_COST * static_cast<float>(line * line + column * column);
        I better = cost < least;
        least = select(better, cost, least);
        found.motion_x = select(better, places.at(s.motion_x + at, column), found.motion_x);
        found.motion_y = select(better, places.at(s.motion_y + at, column), found.motion_y);
    });
    const float* center = surface_row(w, ay.nearest[y]);
    F3 nearest = {places.at(center, 0), places.at(center + s.pitch, 0), places.at(center + 2 * s.pitch, 0)};
    found.light = select(total > 0.0f, found.light * (1.0f / maximum(total, 1e-9f)), nearest);
    found.sampled = select(known > 0.0f, 1.0f, F{});
    found.agreement = minimum(similar, 1.0f);
    return found;
}

// Toned light times reflectance, toned.
SS_INLINE F3 lit(F3 light, F3 reflected) {
    F3 c = {light.r * reflected.r, light.g * reflected.g, light.b * reflected.b};
    F dark = maximum(1.0f - largest(light), 1.0f / MAX_HALF);
    return clamped(c * (1.0f / (dark + largest(c))), 0.0f, MAX_TONED);
}

// Writes reflectance as bytes, 255 is one, to up to W pixels; returns it as the bytes hold it.
SS_INLINE F3 keep_reflectance(F3 reflected, uint8_t* to, int count) {
    I r = to_int(reflected.r * 255.0f + 0.5f), g = to_int(reflected.g * 255.0f + 0.5f),
      b = to_int(reflected.b * 255.0f + 0.5f);
    int32_t words[W];
    store(words, r | g << 8 | b << 16);
    memcpy(to, words, 4 * static_cast<size_t>(clamp(count, 0, W)));
    return F3{to_float(r), to_float(g), to_float(b)} * (1.0f / 255.0f);
}

// Reflectance of the history, interpolated linearly where the pixels' own motion leads.
SS_INLINE F3 warp_reflectance(const uint8_t* before, WarpScratch& s) {
    typedef uint8_t B4 __attribute__((vector_size(4)));
    for (int i = 0; i < W; i++) {
        auto bytes = [&](int row, int column) __attribute__((always_inline)) {
            return __builtin_convertvector(
                load_as<B4>(before + (s.offsets[10 + row][i] + s.offsets[8 + column][i]) / HISTORY_VALUES * 4), F4);
        };
        store4(four_at(s.pixels, 0, i),
               linear4(bytes(0, 0), bytes(0, 1), bytes(1, 0), bytes(1, 1), s.weights[10][i], s.weights[11][i]));
    }
    F v[4];
    load_four(s.pixels, 0, v);
    return F3{v[0], v[1], v[2]} * (1.0f / 255.0f);
}

// Linear colours of the history, with this frame's reflectance in place of their own.
SS_INLINE F3 relit(F3 color, F3 before, F3 now, float least) {
    auto channel = [&](F c, F was, F is) { return minimum(sanitize(c) * is / maximum(was, least * 0.5f), MAX_HALF); };
    return {channel(color.r, before.r, now.r), channel(color.g, before.g, now.g), channel(color.b, before.b, now.b)};
}

}  // namespace ss::SS_ISA
