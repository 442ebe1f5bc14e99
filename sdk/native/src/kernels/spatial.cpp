// `bilinear` and `bicubic`: each frame by itself; the same as supersampler_model.methods.spatial.
#include "frame.h"
#include "images.h"

namespace ss::SS_ISA {

void spatial_read(const SpatialWork& w, int y0, int y1) {
    const Samples& s = w.samples;
    for (int y = y0; y < y1; y++) {
        float* to = w.planes + static_cast<ptrdiff_t>(y) * 3 * s.pitch + PAD;
        for (int x = 0; x < s.width; x += W) {
            I good;
            F3 c = filled_at(s, y, x, good);
            store(to + x, c.r);
            store(to + s.pitch + x, c.g);
            store(to + 2 * s.pitch + x, c.b);
        }
        for (int c = 0; c < 3; c++) repeat_ends(to + c * s.pitch, s.width);
    }
}

void spatial_rows(const SpatialWork& w, Rect box, int thread) {
    const Samples& s = w.samples;
    float* line = w.lines + static_cast<ptrdiff_t>(thread) * 3 * s.pitch;
    Span span(w.tables.x, box.x0, box.x1);
    for (int y = box.y0; y < box.y1; y++) {
        filter_down(
            Rows(w.tables.y, 0, y, [&](int row) { return w.planes + static_cast<ptrdiff_t>(3) * row * s.pitch; }), span,
            0, 3, s.pitch, line);
        for (int x = box.x0; x < box.x1; x += W) {
            Places places(w.tables.x.start, x);
            auto across = [&](int c) __attribute__((always_inline)) {
                return filter_across(line + c * s.pitch, places, w.tables.x, 0, x);
            };
            write_image(w.target, y, x, box.x1, bounded(F3{across(0), across(1), across(2)}));
        }
    }
    end_streams();
}

}  // namespace ss::SS_ISA
