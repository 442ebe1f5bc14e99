// Upsampling of one frame along its edges, for pixels without history; the same as supersampler_model.ops.edges.
#pragma once

#include "frame.h"

namespace ss::SS_ISA {

// Quadratic form xx x^2 + xy x y + yy y^2 of a distance (x, y) in samples.
struct Form {
    F xx, xy, yy;
};

// The form whose negative half is the exponent of the Gaussian, from the structure tensor.
SS_INLINE Form steering_form(Form tensor) {
    F difference = tensor.xx - tensor.yy;
    F contrast = square_root(difference * difference + 4.0f * tensor.xy * tensor.xy + 1e-12f);
    F coherence = contrast / (tensor.xx + tensor.yy + EDGE_CONTRAST);
    constexpr float scale = 1.0f / (EDGE_SIGMA * EDGE_SIGMA);
    F across = scale / exponential(2.0f * ACROSS * coherence);  // 1 / variance; `exponential` takes no positive numbers
    F along = scale * exponential(-2.0f * ALONG * coherence);
    F mean = 0.5f * (across + along), turn = 0.5f * (across - along) / contrast;
    return {mean + turn * difference, 4.0f * turn * tensor.xy, mean - turn * difference};
}

// Luma of the 4x4 samples around W pixels, filled where they are missing.
[[maybe_unused]] static void load_luma(const Samples& s, const Tables& t, const Places& places, int y, int x, F (&luma)[4][4]) {
    for (int j = 0; j < 4; j++) {
        const int row = t.y.clamped(t.y.start[y] - 1 + j);
        for (int i = 0; i < 4; i++) {
            luma[j][i] = places.at(sample_row(s, row, LUMA) - PAD, i - 1);
            if (!s.fill_across) continue;
            F3 fill = fill_at(s, row, clamped(load(t.x.start + x) + (i - 1), 0, s.width - 1), true);
            luma[j][i] = select(places.at(sample_row(s, row, USABLE) - PAD, i - 1) > 0.0f, luma[j][i], ycocg(fill).r);
        }
    }
}

// The products of the gradients at the four samples around W pixels, interpolated; dx, dy: distances of the 4x4 samples.
SS_INLINE Form structure_tensor(const F (&luma)[4][4], const F (&dx)[4], const float (&dy)[4]) {
    Form tensor = {F{}, F{}, F{}};
    for (int j = 1; j < 3; j++)
        for (int i = 1; i < 3; i++) {
            F near = (1.0f - absolute(dx[i])) * (1.0f - (dy[j] < 0.0f ? -dy[j] : dy[j]));
            auto right = [&](int row) { return luma[row][i + 1] - luma[row][i - 1]; };
            auto below = [&](int column) { return luma[j + 1][column] - luma[j - 1][column]; };
            F x = 0.125f * (right(j - 1) + 2.0f * right(j) + right(j + 1));
            F y = 0.125f * (below(i - 1) + 2.0f * below(i) + below(i + 1));
            tensor = {tensor.xx + near * x * x, tensor.xy + near * x * y, tensor.yy + near * y * y};
        }
    return tensor;
}

// YCoCg of this frame alone at W pixels. `distance`: the filter of the tables that has the distances of the samples.
[[maybe_unused]] static F3 upsample_along_edges(const Samples& s, const Tables& t, int distance, const Places& places, int y, int x) {
    F luma[4][4];
    load_luma(s, t, places, y, x, luma);
    F dx[4];
    float dy[4];
    for (int k = 0; k < 4; k++) dx[k] = load(t.x.tap(distance, k) + x), dy[k] = t.y.tap(distance, k)[y];
    const Form form = steering_form(structure_tensor(luma, dx, dy));
    F3 total = {F{}, F{}, F{}};
    F weights = F{};
    for (int j = 0; j < 4; j++) {
        const int row = t.y.clamped(t.y.start[y] - 1 + j);
        for (int i = 0; i < 4; i++) {
            auto plane = [&](int of) { return places.at(sample_row(s, row, of) - PAD, i - 1); };
            F exponent = -0.5f * (form.xx * dx[i] * dx[i] + form.xy * dx[i] * dy[j] + form.yy * (dy[j] * dy[j]));
            F window = (1.0f - 0.25f * dx[i] * dx[i]) * (1.0f - 0.25f * dy[j] * dy[j]);  // 0 where samples come and go
            F weight = exponential(minimum(exponent, 0.0f)) * window * plane(USABLE);
            total = total + F3{plane(LUMA), plane(LUMA + 1), plane(LUMA + 2)} * weight;
            weights += weight;
        }
    }
    I found = weights > MIN_WEIGHT;
    F3 color = total * (1.0f / maximum(weights, MIN_WEIGHT));
    return s.fill_across ? select(found, color, ycocg(fill_at(s, t.y.nearest[y], load(t.x.nearest + x), true))) : color;
}

}  // namespace ss::SS_ISA
