// Functions that gather and finish of the classifiers share.
#pragma once

#include "disocclusion.h"
#include "halves.h"
#include "images.h"
#include "int8.h"

namespace ss::SS_ISA {

using namespace classifier;

// First planes of `Gathered.rest`; `Variant` gives those after them.
enum Rest { FRAME, SAMPLE = 3, CONFIDENCE = 6, DETAIL, SURFACE = 10, COUNT, MIN_LUMA, MAX_LUMA };

// Filters of the tables, in the order of methods/classifier.cpp.
enum OfFilter { BY_SAMPLE, BY_CUBIC, BY_MEAN, BY_DISTANCE };

// A kernel of each variant, in the order of `kernel_of` in methods/classifier.cpp.
#define SS_VARIANTS(kernel)                                                                                          \
    {kernel<Variant{false, false, false}>, kernel<Variant{false, true, false}>, kernel<Variant{true, false, false}>, \
     kernel<Variant{true, true, false}>,   kernel<Variant{false, true, true}>,  kernel<Variant{true, true, true}>}

// Words of a record of network inputs, by the names of `pixel_inputs`. `guided` has RELIT_TO_FRAME and AGREEMENT in
// the places of MIN_LUMA and MAX_LUMA.
enum InputWord {
    IN_FRAME,
    IN_SAMPLE,
    IN_HISTORY,
    IN_HISTORY_TO_SAMPLE,
    IN_HISTORY_TO_FRAME,
    IN_CONTRAST,
    IN_HISTORY_CONTRAST,
    IN_BEYOND_RANGE,
    IN_MIN_LUMA,
    IN_MAX_LUMA,
    IN_DETAIL,
    IN_CONFIDENCE,
    IN_COUNT,
    IN_DEPTH_DIFFERENCE,
    IN_SURFACE,
    IN_EDGE,
};

// Stores inputs in [0, 1] as bytes; 255 is one.
SS_INLINE void store_input(uint8_t* to, F value) { store(to, to_int(clamped(value, 0.0f, 1.0f) * 255.0f + 0.5f)); }

// Packed pixels of a plane, two bytes of each row in a word.
SS_INLINE I packed_words(const uint8_t* upper, const uint8_t* lower) {
    I a = load(upper), b = load(upper + W), c = load(lower), d = load(lower + W);
    return evens(a, b) | odds(a, b) << 8 | evens(c, d) << 16 | odds(c, d) << 24;
}

// Toned light in half floats. What they would round towards 1, which is infinite light, is kept as its distance from 1,
// which is negative, and never 0.
SS_INLINE F near_one(F toned) { return select(toned > 0x1.ff8p-1f, minimum(toned - 1.0f, -0x1p-16f), toned); }
SS_INLINE F load_toned(const uint16_t* from) {
    F v = load_half(from);
    return select(is_positive(-v), v + 1.0f, v);
}
SS_INLINE F3 load_toned3(const uint16_t* from) {
    return {load_toned(from), load_toned(from + W), load_toned(from + 2 * W)};
}
SS_INLINE F3 load_half3(const uint16_t* from) {
    return {load_half(from), load_half(from + W), load_half(from + 2 * W)};
}
SS_INLINE void stream_half3(uint16_t* to, F3 v) {
    stream_half(to, v.r);
    stream_half(to + W, v.g);
    stream_half(to + 2 * W, v.b);
}

SS_INLINE void stream_toned3(uint16_t* to, F3 v) { stream_half3(to, {near_one(v.r), near_one(v.g), near_one(v.b)}); }

// A row of the guided colour; its planes are pitch + 2 * PAD apart.
SS_INLINE uint16_t* guided_row(const ClassifierWork& w, int y) {
    return w.gathered.image + 3 * w.gathered.padded(y) - 2 * PAD;
}

// Where light over white rises over all samples of the history; same as `unexplained_light`.
SS_INLINE I light_rises(F luma, F high, F count, F surface) {
    return (luma > WHITE) & (luma > high + RISE) & (count * surface > 0.0f);
}

}  // namespace ss::SS_ISA
