// What gather and finish of the classifiers share.
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

SS_INLINE F3 load_half3(const uint16_t* from) { return {load_half(from), load_half(from + W), load_half(from + 2 * W)}; }
SS_INLINE void stream_half3(uint16_t* to, F3 v) {
    stream_half(to, v.r);
    stream_half(to + W, v.g);
    stream_half(to + 2 * W, v.b);
}

// A row of the guided colour; its planes are pitch + 2 * PAD apart.
SS_INLINE uint16_t* guided_row(const ClassifierWork& w, int y) {
    return w.gathered.image + 3 * static_cast<ptrdiff_t>(y) * (w.gathered.pitch + 2 * PAD) + PAD;
}

// Where light over white rises over all samples of the history; same as `unexplained_light`.
SS_INLINE I light_rises(F luma, F high, F count, F surface) {
    return (luma > WHITE) & (luma > high + RISE) & (count * surface > 0.0f);
}

}  // namespace ss::SS_ISA
