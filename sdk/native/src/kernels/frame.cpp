// Frame preprocessing: sanitized and toned samples, dilated motion, resampling tables.
#include "frame.h"

#include "images.h"

namespace ss::SS_ISA {

static F sanitized_motion(F motion) {
    return select(absolute(motion) <= FINITE_MOTION, clamped(motion, -MAX_MOTION, MAX_MOTION), 0.0f);
}

void read_frame(const FrameImages& frame, const Samples& s, int y0, int y1, int thread) {
    float* scratch = frame.scratch + thread * frame.scratch_pitch;
    float rgb_tail[3 * W], xy_tail[2 * W], tail[W];
    for (int y = y0; y < y1; y++) {
        const float* color = packed_row(frame.color, 3, y, s.width, scratch);
        float* linear = s.linear + static_cast<ptrdiff_t>(y) * 3 * s.stride;
        F logs = F{}, lit = F{}, count = F{}, brightest = F{};
        for (int x = 0; x < s.stride; x += W) {  // beyond the row its last sample is repeated
            F3 c = load_rgb(whole_vector<3>(color, x, s.width, rgb_tail));
            if (frame.pre_exposure != 1.0f)
                c = {c.r / frame.pre_exposure, c.g / frame.pre_exposure, c.b / frame.pre_exposure};
            I good = usable(c), inside = ramp() + x < s.width;
            c = sanitize(c);
            F light = luminance(c), one = select(good & inside & (light > DARKEST), 1.0f, F{});
            logs += logarithm(maximum(light, DARKEST)) * one;
            lit += one;
            count += select(good & inside, 1.0f, F{});
            F missing = spread(__builtin_nanf(""));
            brightest = maximum(brightest, select(good, largest(c), F{}));
            c = select(good, c, F3{missing, missing, missing});
            store(linear + x, c.r);
            store(linear + s.stride + x, c.g);
            store(linear + 2 * s.stride + x, c.b);
        }
        RowFacts& row = s.rows[y];
        row = {sum_of_lanes(logs), sum_of_lanes(lit), largest_of_lanes(brightest), false, false};
        row.misses = sum_of_lanes(count) < static_cast<float>(s.width);
        if (frame.reactive) {
            const float* mask = packed_row(frame.reactive, 1, y, s.width, scratch);
            float* reactive = s.reactive + static_cast<ptrdiff_t>(y) * s.stride;
            for (int x = 0; x < s.width; x += W) {
                F value = load(whole_vector<1>(mask, x, s.width, tail));
                value = select(value > 0.0f, minimum(value, 1.0f), 0.0f);
                row.reacts |= !all(value <= 0.0f);
                store(reactive + x, select(is_number(load(linear + x)), value, 0.0f - value));
            }
        }
        const ptrdiff_t to = static_cast<ptrdiff_t>(y) * s.pitch + PAD;
        if (frame.depth) {
            const float* depth = packed_row(frame.depth, 1, y, s.width, scratch);
            for (int x = 0; x < s.width; x += W) {
                F d = load(whole_vector<1>(depth, x, s.width, tail));
                store(s.depth + to + x, select((d >= 0.0f) & (d <= MAX_DEPTH), d, UNKNOWN_DEPTH));
            }
            repeat_ends(s.depth + to, s.width);
        }
        if (frame.motion) {
            const float* motion = packed_row(frame.motion, 2, y, s.width, scratch);
            for (int x = 0; x < s.width; x += W) {
                const float* from = whole_vector<2>(motion, x, s.width, xy_tail);
                F a = load(from), b = load(from + W);
                store(s.motion_x + to + x, sanitized_motion(evens(a, b)));
                store(s.motion_y + to + x, sanitized_motion(odds(a, b)));
            }
            repeat_ends(s.motion_x + to, s.width);
            repeat_ends(s.motion_y + to, s.width);
        }
    }
}

// Same as `filled` of the torch module, for rows of windows.
void fill_windows(const Samples& s, int y0, int y1) {
    const float grey = GREY_SHARE * __builtin_sqrtf(static_cast<float>(EXPOSURE_KEY) / s.exposure);
    constexpr float share = 1.0f / (FILL_WINDOW * FILL_WINDOW);
    for (int wy = y0; wy < y1; wy++)
        for (int wx = 0; wx < s.fill_across; wx++) {
            F3 sums = {F{}, F{}, F{}};
            F count = F{};
            for (int k = 0; k < FILL_WINDOW; k++) {
                const float* row = linear_row(s, min(wy * FILL_WINDOW + k, s.height - 1));
                for (int x = wx * FILL_WINDOW; x < (wx + 1) * FILL_WINDOW; x += W) {
                    auto plane = [&](int c) {  // beyond the row its last sample is repeated
                        const float* of = row + c * s.stride;
                        return x < s.stride ? load(of + x) : spread(of[s.width - 1]);
                    };
                    F3 c = {plane(0), plane(1), plane(2)};
                    I good = is_number(c.r);
                    sums = sums +
                           select(good, F3{square_root(c.r), square_root(c.g), square_root(c.b)}, F3{F{}, F{}, F{}});
                    count += select(good, 1.0f, F{});
                }
            }
            float* fill = s.fill + 6 * (wy * s.fill_across + wx);
            float number = sum_of_lanes(count) * share + GREY_SHARE, brightest = 0.0f;
            float roots[3] = {sum_of_lanes(sums.r), sum_of_lanes(sums.g), sum_of_lanes(sums.b)};
            for (int c = 0; c < 3; c++) {
                float value = (roots[c] * share + grey) / number;
                fill[c] = value * value;
                brightest = max(brightest, fill[c] * s.exposure);
            }
            for (int c = 0; c < 3; c++) fill[3 + c] = fill[c] * s.exposure / (1.0f + brightest);
        }
}

void prepare(const Samples& s, int y0, int y1) {
    for (int y = y0; y < y1; y++) {
        const float* linear = linear_row(s, y);
        float* color = const_cast<float*>(sample_row(s, y, TONED));
        for (int x = 0; x < s.width; x += W) {
            F3 c = {load(linear + x), load(linear + s.stride + x), load(linear + 2 * s.stride + x)};
            I good = is_number(c.r);
            c = select(good, c, F3{F{}, F{}, F{}});
            c = tone(c * s.exposure);
            F3 k = ycocg(c);
            const F planes[SAMPLE_PLANES] = {c.r,       c.g,       c.b,      select(good, 1.0f, F{}), k.r, k.g, k.b,
                                             k.r * k.r, k.g * k.g, k.b * k.b};
            for (int p = 0; p < SAMPLE_PLANES; p++) store(color + p * s.pitch + x, planes[p]);
        }
        for (int p = 0; p < SAMPLE_PLANES; p++) repeat_ends(color + p * s.pitch, s.width);
    }
}

// Returns 1 where a sample of 3x3 is over GLARE_TONED, else 0.
static F glare_near(const Samples& s, int y, int x) {
    F brightest = F{};
    for (int row = max(y - 1, 0); row <= min(y + 1, s.height - 1); row++)
        for (int k = -1; k <= 1; k++) {
            const float* at = linear_row(s, row);
            I column = clamped(ramp() + (x + k), 0, s.width - 1);
            F light = largest(gather(at, column), gather(at + s.stride, column), gather(at + 2 * s.stride, column));
            brightest = maximum(light, brightest);  // a missing one is NaN
        }
    brightest *= s.exposure;
    return select(brightest * (1.0f / (brightest + 1.0f)) > GLARE_TONED, 1.0f, F{});
}

void dilate(const Samples& s, int y0, int y1) {
    for (int y = y0; y < y1; y++) {
        const int above = max(y - 1, 0), below = min(y + 1, s.height - 1);
        const ptrdiff_t rows[] = {static_cast<ptrdiff_t>(above) * s.pitch + PAD,
                                  static_cast<ptrdiff_t>(y) * s.pitch + PAD,
                                  static_cast<ptrdiff_t>(below) * s.pitch + PAD};
        const bool glares = s.may_glare(y - 1, y + 1);
        float *eroded = s.eroded_depth + s.place(y) * s.pitch + PAD, *owns = fours_row(s, s.own, y),
              *dilations = fours_row(s, s.dilated, y);
        for (int x = 0; x < s.width; x += W) {
            F closest = load(s.depth + rows[1] + x), farthest = closest;
            for (ptrdiff_t row : rows)
                for (int k = -1; k <= 1; k++) {
                    F d = load(s.depth + row + x + k);
                    closest = maximum(d, closest);
                    farthest = minimum(d, farthest);
                }
            store(eroded + x, farthest);
            F d = load(s.depth + rows[1] + x), mx = load(s.motion_x + rows[1] + x), my = load(s.motion_y + rows[1] + x);
            F edge = clamped((closest - maximum(farthest, 0.0f)) / maximum(closest, 1e-12f), 0.0f, 1.0f);
            F own[4] = {mx, my, edge, glares ? glare_near(s, y, x) : F{}};
            store_pixels(owns + 4 * x, own);
            const ptrdiff_t others[] = {rows[1] + x + 1, rows[2] + x, rows[2] + x + 1};
            for (ptrdiff_t at : others) {
                F other = load(s.depth + at);
                I closer = other > d;
                d = select(closer, other, d);
                mx = select(closer, load(s.motion_x + at), mx);
                my = select(closer, load(s.motion_y + at), my);
            }
            F dilated[4] = {d, mx, my, F{}};
            store_pixels(dilations + 4 * x, dilated);
        }
        repeat_ends(eroded, s.width);
    }
}

// Weights of a filter for samples at signed distances.
static void filter_weights(const Filter& filter, const F (&distance)[4], F (&w)[4]) {
    const F scale = spread(-0.5f / (filter.sigma * filter.sigma));
    for (int k = 0; k < 4; k++) {
        F d = absolute(distance[k]);
        if (filter.kind == LINEAR) {
            w[k] = maximum(1.0f - d, 0.0f);
        } else if (filter.kind == CUBIC) {
            F near = (1.5f * d - 2.5f) * d * d + 1.0f, far = ((-0.5f * d + 2.5f) * d - 4.0f) * d + 2.0f;
            w[k] = select(d < 1.0f, near, select(d < 2.0f, far, 0.0f));
        } else if (filter.kind == DISTANCE) {
            w[k] = distance[k];
        } else {
            w[k] = exponential(d * d * scale);
        }
    }
    if (filter.kind <= GAUSSIAN) return;
    // a line fitted to samples under a Gaussian: its mean, its slope, and its shift
    F total = 1.0f / (w[0] + w[1] + w[2] + w[3]), mean = F{}, square = F{};
    for (int k = 0; k < 4; k++) {
        w[k] *= total;
        mean += distance[k] * w[k];
        square += distance[k] * distance[k] * w[k];
    }
    F deviation = square_root(square - mean * mean);
    for (int k = 0; k < 4 && filter.kind != LINE_MEAN; k++)
        w[k] = filter.kind == LINE_SLOPE ? (distance[k] - mean) * w[k] / deviation : mean / deviation;
}

// Limits the sample of each pixel so that W neighbouring pixels read from W neighbouring samples. Only rounding at a
// ratio of one can violate it, and then either of two samples is right.
static void limit_to_vectors(int32_t* samples, int count) {
    for (int lanes = 16; lanes >= 4; lanes /= 2)
        for (int x = 0; x < count; x++) samples[x] = min(samples[x], samples[x / lanes * lanes] + x % lanes);
}

static void make_axis(const Axis& a, const Tables& tables, float jitter) {
    const float pixels = static_cast<float>(a.pixels), samples = static_cast<float>(a.samples);
    auto position_of = [&](int x) { return (to_float(ramp() + x) + 0.5f) * samples / pixels - 0.5f - jitter; };
    for (int x = 0; x < a.pitch; x += W) {
        F position = position_of(x);
        store(a.start + x, to_int(floor(position)));
        store(a.nearest + x, to_int(floor(position + 0.5f)));
    }
    int32_t* const both[] = {a.start, a.nearest};
    for (int32_t* of : both) {
        limit_to_vectors(of, a.pitch);
        for (int x = a.pixels; x < a.pitch; x++) of[x] = of[a.pixels - 1];
    }
    for (int x = 0; x < a.pitch; x++) a.nearest[x] = a.clamped(a.nearest[x]);
    for (int x = 0; x < a.pitch; x += W) {
        F position = position_of(x), first = to_float(load(a.start + x)), near = to_float(load(a.nearest + x));
        for (int f = 0; f < tables.filter_count; f++) {
            const Filter& filter = tables.filters[f];
            F distance[4], weights[4];
            for (int k = 0; k < 4; k++)
                distance[k] =
                    (first + static_cast<float>(k - 1) - position) * (filter.scaled ? pixels / samples : 1.0f);
            filter_weights(filter, distance, weights);
            for (int k = 0; k < 4; k++) store(a.weights + (4 * f + k) * a.pitch + x, weights[k]);
        }
        for (int k = 0; k < 3 && a.windows; k++) {
            F d = near + static_cast<float>(k - 1) - position;
            store(a.windows + k * a.pitch + x,
                  exponential(d * d * (-0.5f / (tables.window_sigma * tables.window_sigma))));
        }
    }
}

void make_tables(const Tables& tables, float jitter_x, float jitter_y) {
    make_axis(tables.x, tables, jitter_x);
    make_axis(tables.y, tables, jitter_y);
}

}  // namespace ss::SS_ISA
