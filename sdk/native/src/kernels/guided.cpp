// Surfaces of a frame, prepared for the variant `guided`.
#include "guided.h"

namespace ss::SS_ISA {

void prepare_surfaces(const ClassifierWork& w, int y0, int y1, int thread) {
    const Samples& s = w.samples;
    const Guide& g = w.guide;
    float* scratch = g.scratch + thread * g.scratch_pitch;
    for (int y = y0; y < y1; y++) {
        const float* color = packed_row(g.base_color, 3, y, s.width, scratch);
        const float* normal = packed_row(g.normal, 3, y, s.width, scratch + 3 * s.width);
        float* to = const_cast<float*>(surface_row(w, y)) + PAD;
        for (int x = 0; x < s.width; x += W) {
            I good;
            F3 c = filled_at(s, y, x, good) * s.exposure;
            Surface surface = surface_at(color, normal, x, s.width);
            F3 r = reflectance(surface, g.min_reflectance);
            F3 light = tone(F3{c.r / r.r, c.g / r.g, c.b / r.b});
            F3 n = surface.normal * g.normal_scale, b = surface.color * g.color_scale;
            const F planes[SURFACE_PLANES] = {light.r, light.g, light.b, n.r, n.g, n.b, b.r, b.g, b.b};
            for (int p = 0; p < SURFACE_PLANES; p++) store(to + p * s.pitch + x, planes[p]);
        }
        for (int p = 0; p < SURFACE_PLANES; p++) repeat_ends(to + p * s.pitch, s.width);
    }
}

// Writes rows of sanitized depth of display size.
void prepare_depth(const ClassifierWork& w, int y0, int y1, int thread) {
    const Guide& g = w.guide;
    const int width = w.target.width;
    float tail[W];
    for (int y = y0; y < y1; y++) {
        const float* row = packed_row(g.display_depth, 1, y, width, g.scratch + thread * g.scratch_pitch);
        float* to = const_cast<float*>(depth_row(w, y));
        for (int x = 0; x < width; x += W) {
            F d = load(whole_vector<1>(row, x, width, tail));
            store(to + x, select((d >= 0.0f) & (d <= MAX_DEPTH), d, UNKNOWN_DEPTH));
        }
        repeat_ends(to, width);
    }
}

}  // namespace ss::SS_ISA
