// `taa` (Salvi 2016, with his defaults); the same as supersampler_model.methods.taa.
//
// The samples are toned, a variance box is computed around each, then the image is computed in one pass.
#include "frame.h"
#include "images.h"
#include "warp.h"

namespace ss::SS_ISA {

enum Plane { COLOR, MOTION = 3, GOOD = 5 };
enum Box { LOW, HIGH = 3, LONGEST = 6 };
constexpr float NOT_USABLE = 2.0f;  // low luma of a box, in place of one up to 1, where a sample around is missing

static const float* plane_row(const TaaWork& w, int y, int plane) {
    return w.planes + (static_cast<ptrdiff_t>(y) * TAA_PLANES + plane) * w.samples.pitch + PAD;
}

void taa_read(const TaaWork& w, int y0, int y1) {
    const Samples& s = w.samples;
    for (int y = y0; y < y1; y++) {
        float* to = const_cast<float*>(plane_row(w, y, 0));
        const ptrdiff_t at = static_cast<ptrdiff_t>(y) * s.pitch + PAD;
        for (int x = 0; x < s.width; x += W) {
            I good;
            F3 c = ycocg(tone(filled_at(s, y, x, good) * s.exposure));
            const F planes[] = {
                c.r, c.g, c.b, load(s.motion_x + at + x), load(s.motion_y + at + x), select(good, 1.0f, F{})};
            for (int p = 0; p < TAA_PLANES; p++) store(to + p * s.pitch + x, planes[p]);
        }
        for (int p = 0; p < TAA_PLANES; p++) repeat_ends(to + p * s.pitch, s.width);
    }
}

void taa_boxes(const TaaWork& w, int y0, int y1) {
    const Samples& s = w.samples;
    for (int y = y0; y < y1; y++) {
        const int rows[] = {max(y - 1, 0), y, min(y + 1, s.height - 1)};
        float* box = w.boxes + static_cast<ptrdiff_t>(y) * TAA_BOX * s.stride;
        for (int x = 0; x < s.width; x += W) {
            F good = spread(1.0f), length = F{} - 1.0f, mx = F{}, my = F{};
            auto consider = [&](int row, int k) __attribute__((always_inline)) {
                const float* at = plane_row(w, row, MOTION) + x + k;
                F u = load(at), v = load(at + s.pitch), other = u * u + v * v;
                I longer = other > length;
                length = select(longer, other, length);
                mx = select(longer, u, mx);
                my = select(longer, v, my);
                good = minimum(load(at + 2 * s.pitch), good);
            };
            consider(y, 0);  // of equally long ones, the sample's own
            for (int row : rows)
                for (int k = -1; k <= 1; k++) consider(row, k);
            for (int c = 0; c < 3; c++) {
                F low = load(plane_row(w, y, c) + x), high = low, first = F{}, second = F{};
                for (int row : rows)
                    for (int k = -1; k <= 1; k++) {
                        F v = load(plane_row(w, row, c) + x + k);
                        low = minimum(v, low);
                        high = maximum(v, high);
                        first += v;
                        second += v * v;
                    }
                F mean = first * (1.0f / 9.0f);
                F extent = square_root(maximum(second * (1.0f / 9.0f) - mean * mean, 0.0f)) * w.gamma;
                low = maximum(mean - extent, low);
                store(box + (LOW + c) * s.stride + x, c == 0 ? select(good > 0.0f, low, NOT_USABLE) : low);
                store(box + (HIGH + c) * s.stride + x, minimum(mean + extent, high));
            }
            store(box + LONGEST * s.stride + x, mx);
            store(box + (LONGEST + 1) * s.stride + x, my);
        }
    }
}

// Positions, from 0 at `color` to 1 at `sample`, at which the segment enters and leaves a slab.
static void segment_in_slab(F color, F sample, F low, F high, F& enter, F& leave) {
    F step = sample - color;
    step = select(absolute(step) < 1e-6f, 1e-6f, step);
    F first = (low - color) / step, second = (high - color) / step;
    enter = minimum(first, second);
    leave = maximum(first, second);
}

static F overshoot_of(F value, F center, F low, F high) {
    return absolute(value - center) / maximum((high - low) * 0.5f, 1e-5f);
}

// Clips the history where the segment to the sample enters the box; without an intersection towards the box's centre.
static F3 clip_to_sample(F3 history, F3 sample, F3 low, F3 high) {
    F3 enter, leave;
    segment_in_slab(history.r, sample.r, low.r, high.r, enter.r, leave.r);
    segment_in_slab(history.g, sample.g, low.g, high.g, enter.g, leave.g);
    segment_in_slab(history.b, sample.b, low.b, high.b, enter.b, leave.b);
    F first = largest(enter), last = smallest(leave.r, leave.g, leave.b);
    I meets = (first <= last) & (first <= 1.0f) & (last >= 0.0f);
    F3 center = (low + high) * 0.5f;
    F overshoot =
        largest(overshoot_of(history.r, center.r, low.r, high.r), overshoot_of(history.g, center.g, low.g, high.g),
                overshoot_of(history.b, center.b, low.b, high.b));
    return select(meets, lerp(history, sample, clamped(first, 0.0f, 1.0f)),
                  lerp(center, history, 1.0f / maximum(overshoot, 1.0f)));
}

void taa_rows(const TaaWork& w, Rect rect, int thread) {
    const Samples& s = w.samples;
    const Axis &ax = w.tables.x, &ay = w.tables.y;
    const Size display = {w.target.width, w.target.height};
    const float scale_x = static_cast<float>(display.width) / static_cast<float>(s.width);
    const float scale_y = static_cast<float>(display.height) / static_cast<float>(s.height);
    const float kept = w.alpha < 1.0f ? 0.0f : 1.0f;  // weight of the frame where samples are missing
    WarpScratch& scratch = w.scratch[thread];
    for (int y = rect.y0; y < rect.y1; y++) {
        const int upper = ay.clamped(ay.start[y]), lower = ay.clamped(ay.start[y] + 1);
        const float up = ay.tap(0, 1)[y], down = ay.tap(0, 2)[y];
        const float* boxes = w.boxes + static_cast<ptrdiff_t>(ay.nearest[y]) * TAA_BOX * s.stride;
        for (int x = rect.x0; x < rect.x1; x += W) {
            Places nearest(ax.nearest, x), first(ax.start, x);
            auto box_at = [&](int plane) __attribute__((always_inline)) {
                return permuted(load(boxes + plane * s.stride + nearest.first), nearest.index);
            };
            F px = previous_position(to_float(ramp() + x), box_at(LONGEST) * scale_x, display.width);
            F py = previous_position(spread(static_cast<float>(y)), box_at(LONGEST + 1) * scale_y, display.height);
            prepare_warp(px, py, display, 3, CATMULL_ROM, scratch);
            for (int k = 0; k < W; k++) store4(four_at(scratch.pixels, 0, k), cubic4(w.history, scratch, k));
            F q[4];
            load_four(scratch.pixels, 0, q);
            F3 history = ycocg(tone(sanitize(F3{q[0], q[1], q[2]}) * s.exposure));
            F left = load(ax.tap(0, 1) + x), right = load(ax.tap(0, 2) + x);
            auto sampled = [&](int c) __attribute__((always_inline)) {
                const float *a = plane_row(w, upper, c) - PAD, *b = plane_row(w, lower, c) - PAD;
                return (first.at(a, 0) * left + first.at(a, 1) * right) * up +
                       (first.at(b, 0) * left + first.at(b, 1) * right) * down;
            };
            F3 sample = {sampled(0), sampled(1), sampled(2)};
            F3 low = {box_at(LOW), box_at(LOW + 1), box_at(LOW + 2)},
               high = {box_at(HIGH), box_at(HIGH + 1), box_at(HIGH + 2)};
            I good = low.r < NOT_USABLE;
            history = select(good, clip_to_sample(history, sample, low, high), history);
            F weight = select(on_screen(px, py, display), select(good, w.alpha, spread(kept)), 1.0f);
            if (s.has_reactive) weight += (1.0f - weight) * select(good, reactive_at(s, w.tables, y, x), 0.0f);
            F3 color = linear_of(maximum3(from_ycocg(lerp(history, sample, weight)), 0.0f), s.exposure);
            if (w.target.weight) write_plane(w.target.weight, y, x, rect.x1, 1.0f - weight);
            write_image(w.target, y, x, rect.x1, color);
            write_pixels3(w.next_history, display.width, y, x, rect.x1, color);
        }
    }
    end_streams();
}

}  // namespace ss::SS_ISA
