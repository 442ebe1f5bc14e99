// Tables of the filter from a larger image to the display.
#include <math.h>

#include "step.h"

namespace ss {

using namespace classifier_large;

// Lanczos filter of two lobes, as a polynomial.
static float lanczos(float distance) {
    const float squared = min(distance * distance, 4.0f);
    const float base = LANCZOS_SLOPE * squared - 1.0f, window = 0.25f * squared - 1.0f;
    return (LANCZOS_SCALE * base * base - (LANCZOS_SCALE - 1.0f)) * window * window;
}

static void make_axis(int display, int large, int pitch, int32_t* pixels, float* weights) {
    const float scale = static_cast<float>(static_cast<double>(SHARPNESS) * display / large);
    for (int x = 0; x < display; x++) {
        const float position =
            (static_cast<float>(x) + 0.5f) * static_cast<float>(large) / static_cast<float>(display) - 0.5f;
        float total = 0.0f;
        for (int tap = 0; tap < TAPS; tap++) {
            const float at = floorf(position) + static_cast<float>(tap + 1 - REACH);
            pixels[tap * pitch + x] = clamp(static_cast<int32_t>(at), 0, large - 1);
            total += weights[tap * pitch + x] = lanczos((at - position) * scale);
        }
        for (int tap = 0; tap < TAPS; tap++) weights[tap * pitch + x] /= total;
    }
}

bool make_downsampling(const Model& model, StepBuffers& buffers) {
    DownsampleWork& w = buffers.downsampling;
    const Size display = buffers.image_size, large = buffers.display;
    w.size = large;
    w.row_pitch = up_to(display.height, LANES), w.column_pitch = up_to(display.width, LANES);
    float* image = buffers.arena.take<float>(static_cast<size_t>(3) * large.width * large.height);
    w.image = image;
    w.rows = buffers.arena.take<int32_t>(TAPS * w.row_pitch),
    w.columns = buffers.arena.take<int32_t>(TAPS * w.column_pitch);
    w.row_weights = buffers.arena.take<float>(TAPS * w.row_pitch),
    w.column_weights = buffers.arena.take<float>(TAPS * w.column_pitch);
    w.scratch_pitch = static_cast<size_t>(RING + 1) * 4 * up_to(large.width, LANES) + 4 * LANES;
    w.scratch = buffers.arena.take<float>(w.scratch_pitch * model.pool.threads());
    buffers.weight = buffers.arena.take<float>(static_cast<size_t>(large.width) * large.height);
    if (buffers.arena.failed()) return false;
    make_axis(display.height, large.height, w.row_pitch, w.rows, w.row_weights);
    make_axis(display.width, large.width, w.column_pitch, w.columns, w.column_weights);
    return true;
}

}  // namespace ss
