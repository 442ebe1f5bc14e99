// Images of the caller, converted: motion of a camera, RGBA bytes, the mean of two images.
#include "images.h"

namespace ss::SS_ISA {

// Writes the motion of a block of columns: see `CameraMotion`.
void camera_motion_rows(const CameraMotion& m, int y0, int y1) {
    const float out[] = {-2.0f * static_cast<float>(m.size.width), -2.0f * static_cast<float>(m.size.height)};
    const int count = m.x1 - m.x0;
    float scratch[CameraMotion::BLOCK], tail[W];
    for (int y = y0; y < y1; y++) {
        View depth = m.depth;
        depth.data += m.x0 * depth.pixel;
        const float* row = packed_row(depth, 1, y, count, scratch);
        const float* of = m.rows + 5 * (y - y0);
        char* to = const_cast<char*>(m.motion.data) + y * m.motion.row;
        for (int x = 0; x < count; x += W) {
            auto column = [&](int k) { return load(m.columns + k * CameraMotion::BLOCK + x); };
            F d = load(whole_vector<1>(row, x, count, tail)) - m.far_depth;
            F w = d * m.depth_w + column(4) + of[4];
            const I behind = w < CAMERA_BEHIND;
            w = select(behind, 1.0f, w);
            const F mx = (column(0) * d + column(1) * of[0] + column(2)) / w,
                    my = (d * of[1] + column(3) * of[2] + of[3]) / w;
            float values[2][W];
            store(values[0], select(behind, out[0], mx));
            store(values[1], select(behind, out[1], my));
            for (int k = 0; k < min(W, count - x); k++)
                for (int c = 0; c < 2; c++)
                    store_as(to + (m.x0 + x + k) * m.motion.pixel + c * m.motion.channel, values[c][k]);
        }
    }
}

void rgba_rows(const View& image, uint8_t* const to, ptrdiff_t row, int width, int y0, int y1, float* scratch) {
    float tail[3 * W];
    for (int y = y0; y < y1; y++) {
        const float* from = packed_row(image, 3, y, width, scratch);
        uint8_t* pixels = to + y * row;
        for (int x = 0; x < width; x += W) {
            const F3 c = load_rgb(whole_vector<3>(from, x, width, tail));
            auto byte = [](F v) { return to_int(clamped(select(v == v, v, 0.0f), 0.0f, 1.0f) * 255.0f + 0.5f); };
            int32_t words[W];
            store(words, byte(c.r) | byte(c.g) << 8 | byte(c.b) << 16 | static_cast<int32_t>(0xFF000000u));
            memcpy(pixels + 4 * x, words, 4 * static_cast<size_t>(min(W, width - x)));
        }
    }
}

// Writes the mean of two rows of images, weighted after the tone curve c / (1 + max(c)), to the first.
void merge_row(float* image, const float* other, const float* weight, const float* other_weight, int width,
               float exposure) {
    for (int x = 0; x < width; x += W) {
        float a_tail[3 * W], b_tail[3 * W], weight_tail[W], other_tail[W];
        const F3 a = load_rgb(whole_vector<3>(image, x, width, a_tail)),
                 b = load_rgb(whole_vector<3>(other, x, width, b_tail));
        const F wa = load(whole_vector<1>(weight, x, width, weight_tail)) / (largest(a) * exposure + 1.0f);
        const F wb = load(whole_vector<1>(other_weight, x, width, other_tail)) / (largest(b) * exposure + 1.0f);
        const F3 mean = lerp(a, b, wb / maximum(wa + wb, 1e-30f));
        float values[3 * W];
        store_rgb(values, mean);
        memcpy(image + 3 * x, values, sizeof(float) * 3 * static_cast<size_t>(min(W, width - x)));
    }
}

}  // namespace ss::SS_ISA
