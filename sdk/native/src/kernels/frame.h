// Access of kernels to a preprocessed frame.
#pragma once

#include "filters.h"

namespace ss::SS_ISA {

SS_INLINE const float* linear_row(const Samples& s, int y) {
    return s.linear + static_cast<ptrdiff_t>(y) * 3 * s.stride;
}

// Fills the padding before and after `count` values with the first and the last.
SS_INLINE void repeat_ends(float* first, int count) {
    for (int x = 0; x < PAD; x++) {
        first[-1 - x] = first[0];
        first[count + x] = first[count - 1];
    }
}

// Returns the first sample of a row of a plane; padding surrounds it.
SS_INLINE const float* sample_row(const Samples& s, int y, int plane) {
    return s.color + (s.place(y) * SAMPLE_PLANES + plane) * s.pitch + PAD;
}

// Returns a row of the planes of samples, with its padding.
SS_INLINE auto sample_rows(const Samples& s) {
    return [&s](int y) __attribute__((always_inline)) { return sample_row(s, y, TONED) - PAD; };
}

// The four values of each sample of a row of `dilated` or `own`.
SS_INLINE float* fours_row(const Samples& s, float* image, int y) { return image + 4 * s.place(y) * s.stride; }

SS_INLINE void store_pixels(float* to, F (&v)[4]) {
    to_pixels(v);
    for (int k = 0; k < 4; k++) store(to + k * W, v[k]);
}

// Returns the values that fill missing samples of row y from x on, linear or toned.
SS_INLINE F3 fill_at(const Samples& s, int y, I x, bool toned) {
    I at = (x / FILL_WINDOW + y / FILL_WINDOW * s.fill_across) * 6 + (toned ? 3 : 0);
    return {gather(s.fill, at), gather(s.fill, at + 1), gather(s.fill, at + 2)};
}

// Linear RGB of W samples of row y from x on, missing ones filled; `good`: which are usable.
SS_INLINE F3 filled_at(const Samples& s, int y, int x, I& good) {
    const float* row = linear_row(s, y) + x;
    F3 c = {load(row), load(row + s.stride), load(row + 2 * s.stride)};
    good = is_number(c.r);
    if (s.fill_across) c = select(good, c, fill_at(s, y, minimum(ramp() + x, s.width - 1), false));
    return c;
}

// Toned RGB of W pixels from x on, or what fills missing samples where none was found.
SS_INLINE F3 or_fill(I found, F3 color, const Samples& s, const Tables& t, int y, int x) {
    return s.fill_across ? select(found, color, fill_at(s, t.y.nearest[y], load(t.x.nearest + x), true)) : color;
}

// The reactive mask at the samples nearest to W pixels; 0 where these are missing.
SS_INLINE F reactive_at(const Samples& s, const Tables& t, int y, int x) {
    return maximum(gather(s.reactive + static_cast<ptrdiff_t>(t.y.nearest[y]) * s.stride, load(t.x.nearest + x)), 0.0f);
}

}  // namespace ss::SS_ISA
