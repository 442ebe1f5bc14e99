// The filter from a larger image to the display.
#include "frame.h"
#include "images.h"
#include "warp.h"

namespace ss::SS_ISA {

// Writes a row of the image, toned, and its largest channel: four values per pixel.
static void tone_row(const DownsampleWork& w, int y, float* to) {
    const float* row = w.image + 3 * static_cast<ptrdiff_t>(y) * w.size.width;
    float tail[3 * W];
    for (int x = 0; x < w.size.width; x += W) {
        F3 c = tone(load_rgb(whole_vector<3>(row, x, w.size.width, tail)) * w.exposure);
        F pixels[4] = {c.r, c.g, c.b, largest(c)};
        store_pixels(to + 4 * x, pixels);
    }
}

// Filters the image to rows y0 to y1 of the display.
void downsample_rows(const DownsampleWork& w, int y0, int y1, int thread) {
    float* ring = w.scratch + thread * w.scratch_pitch;
    const int pitch = 4 * up_to(w.size.width, LANES);
    float* line = ring + RING * pitch;
    const I is_color = (ramp() & 3) < 3;
    int ready = w.rows[y0];
    for (int y = y0; y < y1; y++) {
        auto row = [&](int tap) { return w.rows[tap * w.row_pitch + y]; };
        for (; ready <= row(TAPS - 1); ready++) tone_row(w, ready, ring + ready % RING * pitch);
        for (int x = 0; x < 4 * w.size.width; x += W) {
            F total = F{};
            for (int tap = 0; tap < TAPS; tap++)
                total += load(ring + row(tap) % RING * pitch + x) * w.row_weights[tap * w.row_pitch + y];
            auto above = [&](int tap) { return load(ring + row(tap) % RING * pitch + x); };
            store(line + x, select(is_color, total, maximum(above(TAPS / 2 - 1), above(TAPS / 2))));
        }
        for (int x = 0; x < w.target.width; x += W) {
            F3 sum = {F{}, F{}, F{}};
            F limit = spread(HIGHLIGHT_TONED);
            for (int tap = 0; tap < TAPS; tap++) {
                F pixel[4];
                gather4(line, w.columns + tap * w.column_pitch + x, 4, pixel);
                sum = sum + F3{pixel[0], pixel[1], pixel[2]} * load(w.column_weights + tap * w.column_pitch + x);
                if (tap == TAPS / 2 - 1 || tap == TAPS / 2) limit = maximum(limit, pixel[3]);
            }
            sum = clamped(sum * dimming(sum, limit), 0.0f, MAX_TONED);
            write_image(w.target, y, x, w.target.width, linear_of(sum, w.exposure));
        }
    }
    end_streams();
}

}  // namespace ss::SS_ISA
