// Colours, a vector per channel; the same as supersampler_model.ops.color.
#pragma once

#include "../work.h"
#include "simd.h"

namespace ss::SS_ISA {

SS_INLINE I is_number(F c) { return c == c; }
SS_INLINE I usable(F3 c) { return is_number(c.r) & is_number(c.g) & is_number(c.b); }
SS_INLINE F sanitize(F c) { return minimum(select(c > 0.0f, c, 0.0f), MAX_HALF); }
SS_INLINE F3 sanitize(F3 c) { return {sanitize(c.r), sanitize(c.g), sanitize(c.b)}; }
SS_INLINE F largest(F a, F b, F c) { return maximum(maximum(a, b), c); }
SS_INLINE F largest(F3 c) { return largest(c.r, c.g, c.b); }
SS_INLINE F smallest(F a, F b, F c) { return minimum(minimum(a, b), c); }

SS_INLINE F3 operator*(F3 c, F scale) { return {c.r * scale, c.g * scale, c.b * scale}; }
SS_INLINE F3 operator*(F3 c, float scale) { return {c.r * scale, c.g * scale, c.b * scale}; }
SS_INLINE F3 operator+(F3 a, F3 b) { return {a.r + b.r, a.g + b.g, a.b + b.b}; }
SS_INLINE F3 operator-(F3 a, F3 b) { return {a.r - b.r, a.g - b.g, a.b - b.b}; }
SS_INLINE F3 select(I mask, F3 a, F3 b) {
    return {select(mask, a.r, b.r), select(mask, a.g, b.g), select(mask, a.b, b.b)};
}
SS_INLINE F3 clamped(F3 c, float low, float high) {
    return {clamped(c.r, low, high), clamped(c.g, low, high), clamped(c.b, low, high)};
}
SS_INLINE F3 maximum3(F3 c, float low) { return {maximum(c.r, low), maximum(c.g, low), maximum(c.b, low)}; }
SS_INLINE F lerp(F a, F b, F weight) { return a + weight * (b - a); }
SS_INLINE F3 lerp(F3 a, F3 b, F weight) {
    return {lerp(a.r, b.r, weight), lerp(a.g, b.g, weight), lerp(a.b, b.b, weight)};
}

SS_INLINE F3 tone(F3 exposed) { return exposed * (1.0f / (largest(exposed) + 1.0f)); }
SS_INLINE F3 ycocg(F3 c) {
    c = {rounded(c.r), rounded(c.g), rounded(c.b)};  // grey has no chroma
    F half = (c.r + c.b) * 0.25f;
    return {half + c.g * 0.5f, (c.r - c.b) * 0.5f, c.g * 0.5f - half};
}
SS_INLINE F3 from_ycocg(F3 c) { return {c.r + c.g - c.b, c.r + c.b, c.r - c.g - c.b}; }
SS_INLINE F luminance(F3 c) { return c.r * BT709_WEIGHTS[0] + c.g * BT709_WEIGHTS[1] + c.b * BT709_WEIGHTS[2]; }
SS_INLINE F root(F c) { return square_root(maximum(c, 1e-6f)); }  // with a bounded slope at 0

SS_INLINE F bounded(F c) {
    c = minimum(c, MAX_HALF);
    return select(c >= DARKNESS, c, 0.0f);
}
SS_INLINE F3 bounded(F3 c) { return {bounded(c.r), bounded(c.g), bounded(c.b)}; }

// Linear RGB of toned colours: `bounded(inverse_tone(...) / exposure)`.
SS_INLINE F3 linear_of(F3 toned, float exposure) {
    return bounded(toned * (1.0f / (maximum(1.0f - largest(toned), 1.0f / MAX_HALF) * exposure)));
}

// The factor that limits the largest channel of a toned colour to `limit`.
SS_INLINE F dimming(F3 toned, F limit) { return limit / maximum(largest(toned), limit); }

// e^x for x <= 0, with a relative error of 3e-7; 0 for x < -87.
SS_INLINE F exponential(F x) {
    F y = maximum(x, -87.0f) * 1.4426950408889634f;
    F exponent = floor(y + 0.5f);
    F f = y - exponent;
    F p = ((f * 1.5403530e-4f + 1.3333558e-3f) * f + 9.6181291e-3f) * f + 5.5504109e-2f;
    p = ((p * f + 2.4022651e-1f) * f + 6.9314718e-1f) * f + 1.0f;
    return select(x < -87.0f, 0.0f, p * float_of((to_int(exponent) + 127) << 23));
}

// Natural logarithm of normal numbers above 0, with an error of 2e-7, relative or absolute.
SS_INLINE F logarithm(F x) {
    I bits = bits_of(x) - 0x3F3504F3;  // mantissa in [sqrt(1/2), sqrt(2))
    F exponent = to_float(bits >> 23);
    F m = float_of((bits & 0x7FFFFF) + 0x3F3504F3) - 1.0f;
    F p = ((m * 7.0376836292e-2f - 1.1514610310e-1f) * m + 1.1676998740e-1f) * m - 1.2420140846e-1f;
    p = (((p * m + 1.4249322787e-1f) * m - 1.6668057665e-1f) * m + 2.0000714765e-1f) * m - 2.4999993993e-1f;
    p = (p * m + 3.3333331174e-1f) * m * m * m;
    return exponent * 0.693359375f + (m + (p - m * m * 0.5f - exponent * 2.12194440e-4f));
}

// Splits a history plane into values in [0, 1] and the number of glaring frames.
SS_INLINE F without_glare(F& values) {
    F frames = floor(values * (1.0f / GLARE) + 0.5f);
    values = maximum(values - frames * GLARE, 0.0f);
    return frames;
}

}  // namespace ss::SS_ISA
