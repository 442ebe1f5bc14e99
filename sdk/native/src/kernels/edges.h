// Upsampling of one frame along its edges, for pixels without history; the same as supersampler_model.ops.edges.
#pragma once

#include "frame.h"

namespace ss::SS_ISA {

// Quadratic form xx x^2 + xy x y + yy y^2 of a distance (x, y) in samples.
struct Form {
    F xx, xy, yy;
};

// The form that is 1 at distances where the weight of a sample reaches 0, from the structure tensor.
SS_INLINE Form kernel_form(Form tensor) {
    F difference = tensor.xx - tensor.yy;
    F contrast = square_root(difference * difference + 4.0f * tensor.xy * tensor.xy + 1e-12f);
    F coherence = contrast / (tensor.xx + tensor.yy + EDGE_CONTRAST);
    F mean = ROUND + (0.5f * (ACROSS + ALONG) - ROUND) * coherence;
    F turn = 0.5f * (ACROSS - ALONG) * coherence / contrast;
    return {mean + turn * difference, 4.0f * turn * tensor.xy, mean - turn * difference};
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

// Luma of this frame alone at W pixels. `distance`: the filter of the tables that has the distances of the samples.
[[maybe_unused]] static F upsample_along_edges(const Samples& s, const Tables& t, int distance, const Places& places,
                                               int y, int x) {
    F luma[4][4], usable[4][4], dx[4];
    float dy[4];
    for (int j = 0; j < 4; j++) {
        const int row = t.y.clamped(t.y.start[y] - 1 + j);
        const float *lumas = sample_row(s, row, LUMA) - PAD, *usables = sample_row(s, row, USABLE) - PAD;
        dx[j] = load(t.x.tap(distance, j) + x), dy[j] = t.y.tap(distance, j)[y];
        for (int i = 0; i < 4; i++) {
            luma[j][i] = places.at(lumas, i - 1);
            if (!s.fill_across) continue;
            usable[j][i] = places.at(usables, i - 1);
            F3 fill = fill_at(s, row, clamped(load(t.x.start + x) + (i - 1), 0, s.width - 1), true);
            luma[j][i] = select(usable[j][i] > 0.0f, luma[j][i], ycocg(fill).r);
        }
    }
    const Form form = kernel_form(structure_tensor(luma, dx, dy));
    F total = F{}, weights = F{};
    for (int i = 0; i < 4; i++) {
        F square = 1.0f - form.xx * dx[i] * dx[i], product = form.xy * dx[i];
        for (int j = 0; j < 4; j++) {
            F near = maximum(square - (form.yy * dy[j] + product) * dy[j], 0.0f);
            near *= near;
            near *= near;
            if (s.fill_across) near *= usable[j][i];
            total += near * luma[j][i];
            weights += near;
        }
    }
    F upsampled = total * (1.0f / maximum(weights, MIN_WEIGHT));
    if (!s.fill_across) return upsampled;
    return select(weights > MIN_WEIGHT, upsampled, ycocg(fill_at(s, t.y.nearest[y], load(t.x.nearest + x), true)).r);
}

// The factor that keeps highlights of a toned colour from exceeding the 3x3 samples around; same as `ops.peak`.
[[maybe_unused]] static F dimming_to_samples(const Samples& s, const Tables& t, int y, int x, F3 color) {
    F peak = spread(HIGHLIGHT_TONED);
    if (all(largest(color) <= peak)) return spread(1.0f);
    const Places places(t.x.nearest, x);
    for (int j = -1; j < 2; j++) {
        const int row = t.y.clamped(t.y.nearest[y] + j);
        const float* samples = sample_row(s, row, TONED) - PAD;
        for (int i = -1; i < 2; i++) {
            auto plane = [&](int c) { return places.at(samples + c * s.pitch, i); };
            F3 tap = {plane(0), plane(1), plane(2)};
            if (s.fill_across)
                tap = select(plane(USABLE) > 0.0f, tap,
                             fill_at(s, row, clamped(load(t.x.nearest + x) + i, 0, s.width - 1), true));
            peak = maximum(peak, largest(tap));
        }
    }
    return dimming(color, peak);
}

}  // namespace ss::SS_ISA
