// `taau`, temporal upsampling without a network; the same as supersampler_model.methods.taau, in one pass over the image.
#include "disocclusion.h"
#include "edges.h"
#include "images.h"

namespace ss::SS_ISA {

using namespace taau;

// Lines of filtered samples, by filter (see methods/taau.cpp): YCoCg with its squares and usable, the slope of luma down,
// RGB and usable.
enum Line { OF_MEAN, OF_MEAN_USABLE = 6, OF_SLOPE = 7, OF_SAMPLE = 8 };
enum OfFilter { BY_MEAN, BY_SAMPLE, BY_SLOPE, BY_SHIFT, BY_DISTANCE };

// Whether 3x3 samples are on a plane, [0, 1]. across: sum of the samples to the right less that of those to the left.
static F fit_of(F across, F down, F deviation) {
    F fraction = (across * across + down * down) * (6.0f / 9.0f / 36.0f) / maximum(deviation * deviation, 1e-7f);
    return clamped((fraction - UNFIT) * (1.0f / (FIT - UNFIT)), 0.0f, 1.0f);
}

SS_INLINE F sum3(const float* at) { return load(at - 1) + load(at) + load(at + 1); }

// Writes occluding depths, which the next frame reads, and `TaauWork::shades`; same as `shade_of` and `fit_of`.
void taau_shade(const TaauWork& w, int y0, int y1, int thread) {
    const Samples& s = w.samples;
    float* lines = w.lines + static_cast<ptrdiff_t>(thread) * w.line_pitch + PAD;
    for (int y = y0; y < y1; y++) {
        const int above = max(y - 1, 0), below = min(y + 1, s.height - 1);
        const int rows[] = {above, y, below};
        for (int x = 0; x < s.width; x += W) {
            F luma = F{}, square = F{}, usable = F{};
            for (int row : rows) {
                luma += load(sample_row(s, row, LUMA) + x);
                square += load(sample_row(s, row, SQUARES) + x);
                usable += load(sample_row(s, row, USABLE) + x);
            }
            store(lines + x, luma);
            store(lines + s.pitch + x, square);
            store(lines + 2 * s.pitch + x, usable);
            store(lines + 3 * s.pitch + x, load(sample_row(s, below, LUMA) + x) - load(sample_row(s, above, LUMA) + x));
        }
        for (int c = 0; c < 4; c++) {
            float* line = lines + c * s.pitch;
            line[-1] = line[0];
            line[s.width] = line[s.width - 1];
        }
        const bool glares = s.may_glare(y - 1, y + 1);
        float* surface = w.surface + static_cast<ptrdiff_t>(y) * s.pitch + PAD;
        float* shades = w.shades + 4 * static_cast<ptrdiff_t>(y) * s.stride;
        F means = F{}, squares = F{};
        for (int x = 0; x < s.width; x += W) {
            F usable = sum3(lines + 2 * s.pitch + x), scale = 1.0f / maximum(usable, 9e-6f);
            F mean = sum3(lines + x) * scale;
            F deviation = square_root(maximum(sum3(lines + s.pitch + x) * scale - mean * mean, 0.0f));
            deviation = select(usable > 9.0f * MIN_WEIGHT, deviation, 1.0f);
            F glare = F{};
            if (glares) {
                F own[4];
                load_channels(fours_row(s, s.own, y) + 4 * x, own);
                glare = own[3];
            }
            F fit = fit_of(load(lines + x + 1) - load(lines + x - 1), sum3(lines + 3 * s.pitch + x), deviation);
            fit = select(usable > 9.0f * FULL_WEIGHT, fit, 0.0f);
            F values[4] = {mean, deviation, fit, glare};
            store_pixels(shades + 4 * x, values);
            store(surface + x, occluding_at(s, y, x));
            I inside = ramp() + x < s.width;
            means += select(inside, mean, F{});
            squares += select(inside, deviation * deviation, F{});
        }
        w.sums[2 * y] = sum_of_lanes(means);
        w.sums[2 * y + 1] = sum_of_lanes(squares);
        repeat_ends(surface, s.width);
    }
}

// Change of light by cell of 2x2 samples; same as `Taau.change_of_light` of the torch module. It is computed just before
// pixels read the same rows of the history, which then are in the cache.
class Changes {
   public:
    Changes(const TaauWork& w, Rect rect, int thread)
        : w_(w), rows_(w.cells + static_cast<ptrdiff_t>(thread) * CELL_ROWS * w.cells_pitch + PAD) {
        const int top = max(floor_of(down_at(rect.y0)), 0);
        first_ = max(floor_of(across_at(rect.x0)) - 1, 0) / W * W;
        last_ = min(floor_of(across_at(rect.x1 - 1)) + 3, w.cells_across);
        summed_ = max(top - 1, 0), changed_ = top;
    }

    // Interpolates to a row of pixels, below the last one.
    void enter(int y) {
        const float down = down_at(y);
        const int top = floor_of(down), last = w_.cells_down - 1, below = min(top + 1, last);
        for (; changed_ <= below; changed_++) {
            for (; summed_ <= min(changed_ + 1, last); summed_++) sum(summed_);
            change(changed_);
        }
        const float *upper = row(CHANGE, max(top, 0)), *lower = row(CHANGE, below);
        for (int x = first_; x < last_; x += W)
            store(row(LINE, 0) + x, lerp(load(upper + x), load(lower + x), spread(down - static_cast<float>(top))));
        repeat_ends(row(LINE, 0), w_.cells_across);
    }

    // The change at W pixels from x on.
    F at(int x) const {
        const F across = (to_float(ramp() + x) + 0.5f) * step(0) - shift(0), whole = floor(across);
        const I cell = to_int(whole);
        const float* left = row(LINE, 0) + cell[0];
        const I places = cell - cell[0];
        return lerp(permuted(load(left), places), permuted(load(left + 1), places), across - whole);
    }

   private:
    // Rows of cells. Of the two compared samples: the sum of differences from the history; of their squares, with the mean
    // squares of earlier frames; and their number. Then the change, and the change interpolated between rows.
    enum Plane { DIFFERENCE, SQUARE, COUNT, CHANGE, LINE };
    float* row(int plane, int y) const { return rows_ + (3 * plane + y % 3) * w_.cells_pitch; }

    static int floor_of(float position) { return static_cast<int>(position + 1.0f) - 1; }  // of positions over -1
    float step(int axis) const {
        const Axis& a = axis ? w_.tables.y : w_.tables.x;
        return 0.5f * static_cast<float>(a.samples) / static_cast<float>(a.pixels);
    }
    float shift(int axis) const { return 0.5f * (1.0f + w_.jitter[axis]); }
    float across_at(int x) const { return (static_cast<float>(x) + 0.5f) * step(0) - shift(0); }
    float down_at(int y) const { return (static_cast<float>(y) + 0.5f) * step(1) - shift(1); }

    void sum(int y) const {
        for (int x = first_; x < last_; x += W) {
            F sums[COUNT + 1] = {};
            for (int k = 0; k < 2; k++) compare(2 * x, min(2 * y + k, w_.samples.height - 1), k, sums);
            for (int plane = DIFFERENCE; plane <= COUNT; plane++) store(row(plane, y) + x, sums[plane]);
        }
        for (int plane = DIFFERENCE; plane <= COUNT; plane++) repeat_ends(row(plane, y), w_.cells_across);
    }

    // Compares every second sample of a row, from x + k on, with the nearest pixel of the history where it was.
    void compare(int x, int y, int k, F (&sums)[COUNT + 1]) const {
        const Samples& s = w_.samples;
        const Size display = {w_.target.width, w_.target.height};
        const I column = minimum(ramp() * 2 + (x + k), s.width - 1);
        alignas(ss::LINE) int32_t places[LANES];
        F dilated[4], before[4];
        store(places, column);
        gather4(fours_row(s, s.dilated, y), places, 4, dilated);
        const F px = (to_float(column) + (0.5f + w_.jitter[0]) + dilated[1]) * (0.5f / step(0)) - 0.5f;
        const F py = (dilated[2] + (static_cast<float>(y) + 0.5f + w_.jitter[1])) * (0.5f / step(1)) - 0.5f;
        const I across = clamped(to_int(floor(px + ROUNDING)), 0, display.width - 1);
        const I down = clamped(to_int(floor(py + ROUNDING)), 0, display.height - 1);
        const I place = down * display.width + across;
        store(places, place);
        gather4(w_.history, places, 5, before);
        F power = gather(w_.history + 4, place * 5);
        if (w_.glares) without_glare(power);
        auto own = [&](int plane) __attribute__((always_inline)) {
            const float* at = sample_row(s, y, plane) + x;
            return k ? odds(load(at), load(at + W)) : evens(load(at), load(at + W));
        };
        const F counts = select(on_screen(px, py, display), own(USABLE), 0.0f);
        const F luma = ycocg(tone(F3{before[0], before[1], before[2]} * s.exposure)).r;
        const F difference = (own(LUMA) - luma) * counts;
        sums[DIFFERENCE] += difference;
        sums[SQUARE] += difference * difference + w_.config.change_spread * power * counts;
        sums[COUNT] += counts;
    }

    void change(int y) const {
        const int rows[] = {max(y - 1, 0), y, min(y + 1, w_.cells_down - 1)};
        for (int x = first_; x < last_; x += W) {
            auto sum = [&](int plane) __attribute__((always_inline)) {
                F total = F{};
                for (int near : rows) total += sum3(row(plane, near) + x);
                return total;
            };
            const F count = sum(COUNT), scale = 1.0f / maximum(count, 1.8e-5f), mean = sum(DIFFERENCE) * scale;
            const F deviation = square_root(maximum(sum(SQUARE) * scale - mean * mean, 0.0f));
            const F noise = deviation * w_.config.change_deviation + w_.config.least_change;
            const F found = clamped(absolute(mean) / noise - 1.0f, 0.0f, 1.0f);
            store(row(CHANGE, y) + x, select(count > 18.0f * MIN_WINDOW_WEIGHT, found, 0.0f));
        }
    }

    const TaauWork& w_;
    float* rows_;
    int first_, last_;      // columns of cells
    int summed_, changed_;  // the next rows
};

// This frame at display pixels, toned YCoCg; same as `CurrentFrame` of the torch module.
struct CurrentFrame {
    F3 sample;
    F confidence;
    F3 center, deviations;
    I found;  // a usable sample is around
};

static CurrentFrame current_frame(const TaauWork& w, const float* lines, const Places& places, int y, int x, F fit) {
    const Axis& ax = w.tables.x;
    const int pitch = w.samples.pitch;
    auto across = [&](int line, int filter) __attribute__((always_inline)) {
        return filter_across(lines + line * pitch, places, ax, filter, x);
    };
    auto rgb = [&](int line, int filter) __attribute__((always_inline)) {
        return F3{across(line, filter), across(line + 1, filter), across(line + 2, filter)};
    };
    CurrentFrame c;
    F near = across(OF_SAMPLE + 3, BY_SAMPLE);
    c.sample = ycocg(rgb(OF_SAMPLE, BY_SAMPLE) * (1.0f / maximum(near, 1e-6f)));
    c.confidence = minimum(near, 1.0f);
    F usable = across(OF_MEAN_USABLE, BY_MEAN), scale = 1.0f / maximum(usable, 1e-6f);
    I known = usable > MIN_WINDOW_WEIGHT;
    c.found = usable > MIN_WEIGHT;
    F3 mean = rgb(OF_MEAN, BY_MEAN) * scale, square = rgb(OF_MEAN + 3, BY_MEAN) * scale;
    F slope_x = across(OF_MEAN, BY_SLOPE), slope_y = across(OF_SLOPE, BY_MEAN);
    fit = select(usable > FULL_WEIGHT, fit, 0.0f);
    F shift = slope_x * load(ax.tap(BY_SHIFT, 0) + x) + slope_y * w.tables.y.tap(BY_SHIFT, 0)[y];
    c.center = {mean.r - fit * shift, mean.g, mean.b};
    F variance = maximum(square.r - mean.r * mean.r, 0.0f) - fit * (slope_x * slope_x + slope_y * slope_y);
    auto deviation = [&](F of) { return square_root(select(known, maximum(of, 0.0f), 1.0f)); };
    c.deviations = {deviation(variance), deviation(square.g - mean.g * mean.g), deviation(square.b - mean.b * mean.b)};
    return c;
}

// The surface at W pixels; motion in display pixels. mean, fit: of luma in 3x3 samples, see `taau_shade`; glare: 1 where
// this frame has light over GLARE_EXPOSED nearby.
struct Surface {
    F depth, motion_x, motion_y, mean, fit, glare;
};

// The history at W pixels.
struct PixelHistory {
    F3 color, light;   // toned YCoCg; the same, linear RGB
    F samples, power;  // number of samples; mean square of sample - history, toned luma, which also holds the glare
    F surface;         // 0 where the surface was occluded in the previous frame, 1 where it was visible
    F unchanged;       // 1 - `Taau.change_of_light`
};

struct Blended {
    F3 color, next_color;
    F next_samples, next_power, weight;
};

// `Taau.network` and `Taau.finish`. at: where the history was read; reactive: fraction of the image that is this frame
// alone. upsampled(): YCoCg of this frame alone, for where that is shown.
template <class Upsampled>
SS_INLINE Blended blend(const TaauWork& w, const Surface& here, const Reprojected& at, const CurrentFrame& now,
                        const PixelHistory& past, F reactive, const Upsampled& upsampled) {
    const Config& n = w.config;
    const F speed = square_root(here.motion_x * here.motion_x + here.motion_y * here.motion_y);
    // of the resampling: 0 on a pixel's centre, 1 on a corner of four
    const F tx = at.x - floor(at.x), ty = at.y - floor(at.y), blur = (tx * (1.0f - tx) + ty * (1.0f - ty)) * 2.0f;
    F gamma = minimum(speed * (1.0f / n.gamma_speed), 1.0f) * (n.gamma_moving - n.gamma_still) + n.gamma_still;
    F power = past.power, warped_glare = F{};
    if (w.glares) warped_glare = without_glare(power);
    F spread_over_time = square_root(power);
    F floor = spread_over_time * past.unchanged * n.gamma_time;
    auto excess = [&](F value, F center, F deviation) {
        return absolute(value - center) / maximum(deviation * gamma + floor, 1e-5f);
    };
    F overshoot = largest(excess(past.color.r, now.center.r, now.deviations.r),
                          excess(past.color.g, now.center.g, now.deviations.g),
                          excess(past.color.b, now.center.b, now.deviations.b));
    F3 rectified = lerp(now.center, past.color, 1.0f / maximum(overshoot, 1.0f));
    F inside = 1.0f - clamped((overshoot - 1.0f) * n.forget, 0.0f, 1.0f);
    F limit = n.samples / (blur * blur * n.blur_cost + speed * n.speed_cost + 1.0f);
    F holds = past.surface * past.unchanged;
    F samples = minimum(past.samples * holds * inside, limit);
    F weight = now.confidence / maximum(samples + now.confidence, 1e-6f);
    I known = samples > MIN_SAMPLES;
    F settled = minimum(samples * (1.0f / n.settled), 1.0f);
    const bool alone = !all((settled >= 1.0f) & (reactive <= 0.0f));
    F3 frame = alone ? upsampled() : now.sample;
    F3 shown = select(known, lerp(rectified, lerp(now.sample, frame, 1.0f - settled), weight), frame);
    Blended b;
    b.weight = select(known, 1.0f - weight, 0.0f);
    if (w.samples.has_reactive) {
        shown = lerp(shown, frame, reactive);
        b.weight *= 1.0f - reactive;
        samples *= 1.0f - reactive;
    }
    b.color = linear_of(maximum3(from_ycocg(shown), 0.0f), w.samples.exposure);

    F contrast = absolute(now.sample.r - here.mean);
    contrast += here.fit * (minimum(absolute(now.sample.r - now.center.r), contrast) - contrast);
    F error = minimum(absolute(now.sample.r - past.color.r), contrast);
    error = minimum(error, spread_over_time + n.spread_step);
    F rate = now.confidence / maximum(minimum(samples, n.spread_samples) + now.confidence, 1e-6f);
    b.next_power = maximum(power + rate * (error * error - power) - DARKNESS, 0.0f);
    b.next_power = select(known, holds * b.next_power, 0.0f);
    b.next_color = b.color;
    b.next_samples = samples + now.confidence;
    if (w.glares) {
        F glares = select(warped_glare < CONFIRMED - 1.0f, here.glare, 0.0f);
        F trusted = select(glares > 0.0f, past.surface, holds);
        F kept = minimum(past.samples * trusted, limit);
        I adds_sample = w.unconfirmed ? kept <= MIN_SAMPLES : select(glares > 0.0f, kept, 0.0f) <= MIN_SAMPLES;
        b.next_color = select(adds_sample, b.color, past.light);
        b.next_power = select(adds_sample, b.next_power + here.glare * (GLARE * CONFIRMED),
                              trusted * power + minimum(warped_glare + here.glare, CONFIRMED) * GLARE);
        b.next_samples = select(adds_sample, b.next_samples, kept);
    }
    return b;
}

// Resamples W pixels of five values to eight each: the first four by the cubic, the last four linearly.
static void warp5(const float* h, WarpScratch& s) {
    for (int i = 0; i < W; i++) {
        prefetch(h + s.offsets[7][i] + s.offsets[3][i] + 31 * 5);  // the lower right sample of a pixel of a later step
        store4(four_at(s.pixels, 0, i), cubic4(h, s, i));
        const float *upper = h + s.offsets[5][i] + 1, *lower = h + s.offsets[6][i] + 1;
        const int left = s.offsets[1][i], right = s.offsets[2][i];
        store4(four_at(s.pixels, 1, i), linear4(load4(upper + left), load4(upper + right), load4(lower + left),
                                                load4(lower + right), s.weights[8][i], s.weights[9][i]));
    }
}

static void write_history(float* pixels, int width, int y, int x, int end, const Blended& b, WarpScratch& s) {
    F values[8] = {b.next_color.r, b.next_color.g, b.next_color.b, b.next_samples, b.next_power, F{}, F{}, F{}};
    to_pixels(values);
    for (int k = 0; k < 8; k++) store(s.pixels + k * W, values[k]);
    float* to = pixels + 5 * (static_cast<ptrdiff_t>(y) * width + x);
    for (int i = 0; i < min(W, end - x); i++) {
        store4(to + 5 * i, load4(s.pixels + 8 * i));
        to[5 * i + 4] = s.pixels[8 * i + 4];
    }
}

// A row of the image: what it reads.
struct TaauRow {
    int y;
    float scale_x, scale_y;         // display size / render size
    const float *dilated, *shades;  // of samples: dilated motion, and what `taau_shade` wrote
    const float* lines;             // filtered down
};

static TaauRow row_of(const TaauWork& w, Span span, int y, int thread) {
    const Samples& s = w.samples;
    const Axis& ay = w.tables.y;
    float* lines = w.lines + static_cast<ptrdiff_t>(thread) * w.line_pitch;
    auto down = [&](int filter, int plane, int count, int line) __attribute__((always_inline)) {
        filter_down(Rows(ay, filter, y, sample_rows(s)), span, plane, count, s.pitch, lines + line * s.pitch);
    };
    down(BY_MEAN, LUMA, 6, OF_MEAN);
    down(BY_MEAN, USABLE, 1, OF_MEAN_USABLE);
    down(BY_SLOPE, LUMA, 1, OF_SLOPE);
    down(BY_SAMPLE, TONED, 4, OF_SAMPLE);
    return {y,
            static_cast<float>(w.target.width) / static_cast<float>(s.width),
            static_cast<float>(w.target.height) / static_cast<float>(s.height),
            fours_row(s, s.dilated, ay.clamped(ay.start[y])),
            w.shades + 4 * static_cast<ptrdiff_t>(ay.nearest[y]) * s.stride,
            lines};
}

SS_INLINE Surface surface_at(const TaauWork& w, const TaauRow& row, int x, WarpScratch& scratch) {
    const Axis& ax = w.tables.x;
    F dilated[4], around[4];
    load_dilated(row.dilated, ax, w.samples.width, x, scratch, dilated);
    gather4(row.shades, ax.nearest + x, 4, around);
    return {dilated[0], dilated[1] * row.scale_x, dilated[2] * row.scale_y, around[0], around[2], around[3]};
}

// Visibility of the surface in the previous frame, [0, 1].
SS_INLINE F visibility(const TaauWork& w, F depth, const Reprojected& at) {
    const PreviousFrame& p = w.previous;
    const Previous previous = previous_of(p, at.x, at.y, {w.target.width, w.target.height});
    LinearTaps taps(previous.x, previous.y, p.width, p.height, p.pitch);
    F upper[4], lower[4];  // of the left sample and the right one
    gather4(p.plane, taps.upper, 1, upper);
    gather4(p.plane, taps.lower, 1, lower);
    const F depths[4] = {upper[0], upper[1], lower[0], lower[1]};
    const F occluded = occlusion(depth, depths, taps.weight, w.config.depth_margin, w.config.depth_ramp);
    return select(at.on, maximum(1.0f - occluded * 2.0f, 0.0f), 0.0f);
}

SS_INLINE PixelHistory history_at(const TaauWork& w, const Changes& changes, const Surface& here, const Reprojected& at,
                                  int y, int x, WarpScratch& scratch) {
    prepare_warp(at.x, at.y, {w.target.width, w.target.height}, 5, w.config.history_sharpness, scratch);
    warp5(w.history, scratch);
    F sharp[4], linear[4];
    load_four(scratch.pixels, 0, sharp);
    load_four(scratch.pixels, 1, linear);
    PixelHistory past;
    past.light = sanitize(F3{sharp[0], sharp[1], sharp[2]});
    past.color = ycocg(tone(past.light * w.samples.exposure));
    past.samples = linear[2];
    past.power = linear[3];
    if (w.kept)
        past.samples = minimum(past.samples, load(w.kept + w.kept_rows[y] * static_cast<ptrdiff_t>(w.kept_pitch) + x));
    past.surface = visibility(w, here.depth, at);
    past.unchanged = 1.0f - changes.at(x);
    return past;
}

void taau_rows(const TaauWork& w, Rect rect, int thread) {
    const Samples& s = w.samples;
    const Size display = {w.target.width, w.target.height};
    WarpScratch& scratch = w.scratch[thread];
    const Span span(w.tables.x, rect.x0, rect.x1);
    Changes changes(w, rect, thread);
    for (int y = rect.y0; y < rect.y1; y++) {
        changes.enter(y);
        const TaauRow row = row_of(w, span, y, thread);
        for (int x = rect.x0; x < rect.x1; x += W) {
            const Places places(w.tables.x.start, x);
            const Surface here = surface_at(w, row, x, scratch);
            const Reprojected at = reproject(x, y, here.motion_x, here.motion_y, display);
            const PixelHistory past = history_at(w, changes, here, at, y, x, scratch);
            const CurrentFrame now = current_frame(w, row.lines, places, y, x, here.fit);
            auto upsampled = [&] {
                F3 frame = now.center;
                if (s.fill_across)
                    frame = select(now.found, frame,
                                   ycocg(fill_at(s, w.tables.y.nearest[y], load(w.tables.x.nearest + x), true)));
                frame.r = upsample_along_edges(s, w.tables, BY_DISTANCE, places, y, x);
                return frame * dimming_to_samples(s, w.tables, y, x, from_ycocg(frame));
            };
            const F reactive = s.has_reactive ? reactive_at(s, w.tables, y, x) : F{};
            const Blended b = blend(w, here, at, now, past, reactive, upsampled);
            if (w.target.weight) write_plane(w.target.weight, y, x, rect.x1, b.weight);
            write_image(w.target, y, x, rect.x1, b.color);
            write_history(w.next_history, display.width, y, x, rect.x1, b, scratch);
        }
    }
    end_streams();
}

// Writes the sums of rows of blocks: of the difference of samples and history, toned, and of the history; see `lag`.
void taau_compare(const TaauWork& w, int y0, int y1) {
    const Samples& s = w.samples;
    const int last_row = (s.height - 1) / LAG_STEP * LAG_STEP, last_column = (s.width - 1) / LAG_STEP * LAG_STEP;
    const ptrdiff_t plane = static_cast<ptrdiff_t>(w.blocks_down) * w.blocks_pitch;
    constexpr int STEPS = BLOCK / LAG_STEP;
    for (int by = y0; by < y1; by++)
        for (int first = 0; first < w.blocks_across; first += W) {
            I block = minimum(ramp() + first, w.blocks_across - 1) * BLOCK;
            F3 apart = {F{}, F{}, F{}}, level = apart;
            for (int i = 0; i < STEPS * STEPS; i++) {
                const int row = min(BLOCK * by + LAG_STEP * (i / STEPS), last_row);
                I column = minimum(block + LAG_STEP * (i % STEPS), last_column);
                const float* history = w.history + 5 * static_cast<ptrdiff_t>(w.nearest_rows[row]) * w.target.width;
                I place = gather(w.nearest_columns, column) * 5;
                F3 past = tone(F3{gather(history, place), gather(history + 1, place), gather(history + 2, place)} *
                               s.exposure);
                past = past * gather(sample_row(s, row, USABLE), column);
                F3 sample = {gather(sample_row(s, row, TONED), column), gather(sample_row(s, row, TONED + 1), column),
                             gather(sample_row(s, row, TONED + 2), column)};
                level = level + past;
                apart = apart + sample - past;
            }
            const F sums[] = {apart.r, apart.g, apart.b, level.r, level.g, level.b};
            for (int c = 0; c < 6; c++) store(w.block_sums + c * plane + by * w.blocks_pitch + first, sums[c]);
        }
}

}  // namespace ss::SS_ISA
