// Reprojection: resamples the history at the previous positions of pixels.
#pragma once

#include "colors.h"

namespace ss::SS_ISA {

// Weights of four samples of a cubic; t: distance from the second sample, [0, 1).
SS_INLINE void cubic(F t, float sharpness, F (&w)[4]) {
    F s = 1.0f - t;
    w[0] = t * s * s * -sharpness;
    w[3] = s * t * t * -sharpness;
    w[2] = ((t * (sharpness - 2.0f) + (3.0f - 2.0f * sharpness)) * t + sharpness) * t;
    w[1] = 1.0f - w[0] - w[3] - w[2];
}

// Stores the offsets of samples floor(position) + first to floor(position) + last, which are `pitch` apart; returns the
// fraction.
SS_INLINE F store_offsets(F position, int first, int last, int count, int pitch, int32_t (*offsets)[LANES]) {
    F whole = floor(position);
    I i = to_int(whole);
    for (int k = first; k <= last; k++) store(offsets[k - first], clamped(i + k, 0, count - 1) * pitch);
    return position - whole;
}

// Stores the offsets (four columns, four rows) and weights with which W pixels of `pitch` values resample the history:
// of a cubic without corners, columns then rows; then fractions for a linear filter.
SS_INLINE void prepare_warp(F px, F py, Size display, int pitch, float sharpness, WarpScratch& s) {
    F x[4], y[4];
    F tx = store_offsets(px, -1, 2, display.width, pitch, s.offsets);
    F ty = store_offsets(py, -1, 2, display.height, pitch * display.width, s.offsets + 4);
    cubic(tx, sharpness, x);
    cubic(ty, sharpness, y);
    F middle = x[1] + x[2], sides = y[1] + y[2];
    F scale = 1.0f / (middle * sides + (x[0] + x[3]) * sides + middle * (y[0] + y[3]));  // without the corners
    for (int k = 0; k < 4; k++) {
        store(s.weights[k], x[k]);
        store(s.weights[4 + k], y[k] * scale);
    }
    store(s.weights[8], tx);
    store(s.weights[9], ty);
}

// Resamples four values of pixel `i` with the cubic.
SS_INLINE F4 cubic4(const float* h, const WarpScratch& s, int i) {
    auto at = [&](int row, int column)
                  __attribute__((always_inline)) { return load4(h + s.offsets[4 + row][i] + s.offsets[column][i]); };
    float x0 = s.weights[0][i], x1 = s.weights[1][i], x2 = s.weights[2][i], x3 = s.weights[3][i];
    F4 top = at(0, 1) * x1 + at(0, 2) * x2;
    F4 upper = at(1, 0) * x0 + at(1, 1) * x1 + at(1, 2) * x2 + at(1, 3) * x3;
    F4 lower = at(2, 0) * x0 + at(2, 1) * x1 + at(2, 2) * x2 + at(2, 3) * x3;
    F4 bottom = at(3, 1) * x1 + at(3, 2) * x2;
    return top * s.weights[4][i] + upper * s.weights[5][i] + lower * s.weights[6][i] + bottom * s.weights[7][i];
}

SS_INLINE F4 clamped4(F4 v, F4 low, F4 high) {
    v = v < low ? low : v;
    return v > high ? high : v;
}

// Clamps four values to the smallest and the largest of the four pixels around.
SS_INLINE F4 within_corners(F4 v, const F4 (&corners)[4]) {
    F4 low = corners[0], high = corners[0];
    for (int k = 1; k < 4; k++) {
        low = corners[k] < low ? corners[k] : low;
        high = corners[k] > high ? corners[k] : high;
    }
    return clamped4(v, low, high);
}

// Interpolates four values linearly between four places, by fractions to the right and down.
SS_INLINE F4 linear4(F4 a, F4 b, F4 c, F4 d, float t, float u) {
    F4 upper = a * (1.0f - t) + b * t, lower = c * (1.0f - t) + d * t;
    return upper * (1.0f - u) + lower * u;
}

SS_INLINE I on_screen(F px, F py, Size display) {
    return (px > -0.5f) & (px < static_cast<float>(display.width) - 0.5f) & (py > -0.5f) &
           (py < static_cast<float>(display.height) - 0.5f);
}

// Previous position on an axis, clamped to two pixels around the screen.
SS_INLINE F previous_position(F pixel, F motion, int extent) {
    return clamped(pixel + motion, -2.0f, static_cast<float>(extent + 1));
}

// Positions of W pixels in the previous frame, display pixels, and whether they are on the screen.
struct Reprojected {
    F x, y;
    I on;
};
// Reprojects pixels x to x + W - 1 of row y by their motion, display pixels.
SS_INLINE Reprojected reproject(int x, int y, F motion_x, F motion_y, Size display) {
    const F px = previous_position(to_float(ramp() + x), motion_x, display.width);
    const F py = previous_position(spread(static_cast<float>(y)), motion_y, display.height);
    return {px, py, on_screen(px, py, display)};
}

// The four samples around positions in the previous frame, and their weights.
struct LinearTaps {
    alignas(LINE) int32_t upper[LANES], lower[LANES];  // left samples in a padded plane
    F weight[4];
    LinearTaps(F x, F y, int width, int height, int pitch) {
        F fx = floor(x), fy = floor(y), tx = x - fx, ty = y - fy, sx = 1.0f - tx, sy = 1.0f - ty;
        I left = clamped(to_int(fx), 1 - PAD, width + PAD - 2) + PAD, top = to_int(fy);
        store(upper, clamped(top, 0, height - 1) * pitch + left);
        store(lower, clamped(top + 1, 0, height - 1) * pitch + left);
        weight[0] = sx * sy;
        weight[1] = tx * sy;
        weight[2] = sx * ty;
        weight[3] = tx * ty;
    }
};

SS_INLINE F mean_of(const F (&values)[4], const F (&weights)[4]) {
    return values[0] * weights[0] + values[1] * weights[1] + (values[2] * weights[2] + values[3] * weights[3]);
}

// Weight, [0, 1], of the previous samples that were closer than `depth`; any of them that left counts fully. Same as
// `occlusion` of the torch module; `occluders`: four values of `occluding_at`.
SS_INLINE F occlusion(F depth, const F (&occluders)[4], const F (&weights)[4], float margin, float ramp) {
    F occluded = F{}, left = F{};
    for (int k = 0; k < 4; k++) {
        F before = absolute(occluders[k]), closer = (before - depth) / maximum(maximum(before, depth), 1e-12f);
        closer = clamped((closer - margin) * (1.0f / ramp), 0.0f, 1.0f);
        occluded += weights[k] * closer;
        left = select(occluders[k] < 0.0f, maximum(left, closer), left);
    }
    return select(depth >= 0.0f, maximum(occluded, left), 0.0f);
}

// Loads four values at each of W places, `scale` values apart, as a vector for each.
SS_INLINE void gather4(const float* from, const int32_t* places, int scale, F (&v)[4]) {
    for (int k = 0; k < 4; k++)
        v[k] = concatenated([&](int four) __attribute__((always_inline)) {
            return load4(from + static_cast<ptrdiff_t>(scale) * places[4 * four + k]);
        });
    transpose_fours(v);
}

// Loads depth and motion, render pixels, of the closest surface near W pixels, from a row that `dilate` wrote.
SS_INLINE void load_dilated(const float* row, const Axis& ax, int width, int x, WarpScratch& scratch, F (&v)[4]) {
    store(scratch.offsets[0], clamped(load(ax.start + x), 0, width - 1));
    gather4(row, scratch.offsets[0], 4, v);
}

}  // namespace ss::SS_ISA
