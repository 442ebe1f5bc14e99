// Separable filters of the samples around display pixels.
//
// The first pass filters rows of samples vertically to a line, plane by plane; the second filters the line
// horizontally at each pixel. Rows of `pitch` samples have PAD samples before and after, which repeat the border.
#pragma once

#include "colors.h"

namespace ss::SS_ISA {

// The columns of padded samples that pixels x0 to x1 - 1 read, in whole vectors.
struct Span {
    int first, last;
    Span(const Axis& x, int x0, int x1)
        : first((PAD + x.start[x0] - 1) / LANES * LANES), last(PAD + x.start[min(x1, x.pixels) - 1] + 3) {}
};

// The four rows of samples around a display row, and their weights. row_of(y) returns a row of samples.
struct Rows {
    const float* row[4];
    float weight[4];
    template <class RowOf>
    Rows(const Axis& y, int filter, int at, const RowOf& row_of) {
        for (int k = 0; k < 4; k++) {
            row[k] = row_of(y.clamped(y.start[at] - 1 + k));
            weight[k] = y.tap(filter, k)[at];
        }
    }
};

// Filters `count` planes of rows of samples, `pitch` apart, to lines.
SS_INLINE void filter_down(const Rows& rows, Span span, int plane, int count, int pitch, float* line) {
    for (int c = 0; c < count; c++)
        for (int x = span.first; x < span.last; x += W) {
            int at = (plane + c) * pitch + x;
            F upper = load(rows.row[0] + at) * rows.weight[0] + load(rows.row[1] + at) * rows.weight[1];
            F lower = load(rows.row[2] + at) * rows.weight[2] + load(rows.row[3] + at) * rows.weight[3];
            store(line + c * pitch + x, upper + lower);
        }
}

// The samples that W pixels from x on read: offsets from the first of them.
struct Places {
    int first;
    I index;
    Places(const int32_t* samples, int x) : first(samples[x]), index(load(samples + x) - first) {}
    F at(const float* padded_row, int step) const { return permuted(load(padded_row + PAD + first + step), index); }
};

// Filters a line at W pixels from x on.
SS_INLINE F filter_across(const float* line, const Places& places, const Axis& x, int filter, int at) {
    F total = places.at(line, -1) * load(x.tap(filter, 0) + at);
    for (int k = 1; k < 4; k++) total += places.at(line, k - 1) * load(x.tap(filter, k) + at);
    return total;
}

}  // namespace ss::SS_ISA
