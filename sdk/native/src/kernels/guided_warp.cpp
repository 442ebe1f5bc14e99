// `guided-warp`: the colour of an unshaded frame; the same as supersampler_model.methods.guided_warp.
//
// Each pixel takes the light of the four samples of the shaded frame whose surfaces and positions are nearest.
#include "frame.h"
#include "images.h"

namespace ss::SS_ISA {

using namespace guided_warp;

constexpr int GUIDES = WARP_PLANES - 3;
constexpr float MISSING = __builtin_nanf("");  // red light of a missing sample

static I is_usable(F v) { return absolute(v) <= MAX_HALF; }
static I are_usable(F3 c) { return is_usable(c.r) & is_usable(c.g) & is_usable(c.b); }

// Unusable values become 0, others are clamped to [low, 1].
static F sanitized(F v, float low) { return select(is_usable(v), clamped(v, low, 1.0f), 0.0f); }
static F3 sanitized(F3 c, float low) { return {sanitized(c.r, low), sanitized(c.g, low), sanitized(c.b, low)}; }
static F sanitized_motion(F v) {
    return select(absolute(v) <= FINITE_MOTION, clamped(v, -MAX_MOTION, MAX_MOTION), 0.0f);
}

// A surface: what others are compared with it by, in standard deviations, and its reflectance, 1 at the sky.
struct Surface {
    F guides[GUIDES];
    F3 reflectance;
};

static Surface surface_of(const Config& config, F3 base, F3 normal, F depth, I valid) {
    valid = valid & are_usable(base) & are_usable(normal) & (depth >= 0.0f) & (depth <= MAX_DEPTH);
    const F3 b = sanitized(base, 0.0f), n = sanitized(normal, -1.0f);
    const float scale = 1.0f / config.surface_sigma;
    const F log_depth =
        select(valid, logarithm(maximum(depth, SKY_DEPTH)) * (1.0f / config.depth_sigma), INVALID_DEPTH);
    const I sky = n.r * n.r + n.g * n.g + n.b * n.b < MIN_NORMAL;
    auto reflected = [&](F c) { return select(sky, 1.0f, c + config.least); };
    return {{b.r * scale, b.g * scale, b.b * scale, n.r * scale, n.g * scale, n.b * scale, log_depth},
            {reflected(b.r), reflected(b.g), reflected(b.b)}};
}

// The arrays of a row of a frame, packed.
struct Row {
    const float *base, *normal, *depth;
    int width;
    Row(const View& b, const View& n, const View& d, int y, int width, float* scratch)
        : base(packed_row(b, 3, y, width, scratch)),
          normal(packed_row(n, 3, y, width, scratch + 3 * width)),
          depth(packed_row(d, 1, y, width, scratch + 6 * width)),
          width(width) {}
    Surface surface(const Config& config, int x, I valid) const {
        float tail[3 * W], base_tail[3 * W], depth_tail[W];
        return surface_of(config, load_rgb(whole_vector<3>(base, x, width, base_tail)),
                          load_rgb(whole_vector<3>(normal, x, width, tail)),
                          load(whole_vector<1>(depth, x, width, depth_tail)), valid);
    }
};

void warp_read_shaded(const WarpWork& w, int y0, int y1, int thread) {
    float* scratch = w.scratch + thread * w.scratch_pitch;
    const ptrdiff_t plane = static_cast<ptrdiff_t>(w.shaded.height) * w.stride;
    for (int y = y0; y < y1; y++) {
        const Row row(w.shaded_base_color, w.shaded_normal, w.shaded_depth, y, w.shaded.width, scratch);
        const float* color = packed_row(w.shaded_color, 3, y, w.shaded.width, scratch + 7 * w.shaded.width);
        float* to = w.samples + static_cast<ptrdiff_t>(y) * w.stride;
        float tail[3 * W];
        I known = I{};
        for (int x = 0; x < w.shaded.width; x += W) {
            const F3 c = load_rgb(whole_vector<3>(color, x, w.shaded.width, tail)) * (1.0f / w.shaded_pre_exposure);
            const I is_there = usable(c);
            const Surface s = row.surface(w.config, x, is_there);
            known = known | (s.guides[GUIDES - 1] != INVALID_DEPTH);
            for (int k = 0; k < GUIDES; k++) store(to + k * plane + x, s.guides[k]);
            store(to + GUIDES * plane + x, select(is_there, sanitize(c.r) / s.reflectance.r, MISSING));
            store(to + (GUIDES + 1) * plane + x, sanitize(c.g) / s.reflectance.g);
            store(to + (GUIDES + 2) * plane + x, sanitize(c.b) / s.reflectance.b);
        }
        w.rows[y] = mask_bits(known) ? 1.0f : 0.0f;
    }
}

void warp_read_motion(const WarpWork& w, int y0, int y1, int thread) {
    const int width = w.previous.width;
    for (int y = y0; y < y1; y++) {
        const float* motion = packed_row(w.previous_motion, 2, y, width, w.scratch + thread * w.scratch_pitch);
        float* to = w.motion + static_cast<ptrdiff_t>(y) * w.previous_stride;
        float tail[2 * W];
        I moves = I{};
        for (int x = 0; x < width; x += W) {
            const float* from = whole_vector<2>(motion, x, width, tail);
            const F a = load(from), b = load(from + W), mx = evens(a, b), my = odds(a, b);
            moves = moves | ~((mx == 0.0f) & (my == 0.0f));
            store(to + x, sanitized_motion(mx));
            store(to + static_cast<ptrdiff_t>(w.previous.height) * w.previous_stride + x, sanitized_motion(my));
        }
        w.previous_rows[y] = mask_bits(moves) ? 1.0f : 0.0f;
    }
}

// Converts a position to samples of another frame; 0 is the first sample.
static F reproject(F position, float jitter, float other_jitter, int size, int other_size) {
    return (position + (jitter + 0.5f)) * static_cast<float>(other_size) / static_cast<float>(size) -
           (other_jitter + 0.5f);
}

// Adds the motion of the previous frame, interpolated linearly where motion leads.
static void add_previous_motion(const WarpWork& w, F column, F row, F& mx, F& my) {
    const Size size = w.previous;
    const F x = clamped(reproject(column + mx, w.jitter[0], w.previous_jitter[0], w.frame.width, size.width), 0.0f,
                        static_cast<float>(size.width - 1));
    const F y = clamped(reproject(row + my, w.jitter[1], w.previous_jitter[1], w.frame.height, size.height), 0.0f,
                        static_cast<float>(size.height - 1));
    const F left = floor(x), top = floor(y), s = x - left, t = y - top;
    const I l = to_int(left), r = minimum(l + 1, size.width - 1);
    const I upper = to_int(top) * w.previous_stride,
            lower = minimum(to_int(top) + 1, size.height - 1) * w.previous_stride;
    auto read = [&](const float* plane) {
        const F above = lerp(gather(plane, upper + l), gather(plane, upper + r), s);
        return lerp(above, lerp(gather(plane, lower + l), gather(plane, lower + r), s), t);
    };
    const float* second = w.motion + static_cast<ptrdiff_t>(size.height) * w.previous_stride;
    mx += read(w.motion) * static_cast<float>(w.frame.width) / static_cast<float>(size.width);
    my += read(second) * static_cast<float>(w.frame.height) / static_cast<float>(size.height);
    mx = clamped(mx, -MAX_MOTION, MAX_MOTION), my = clamped(my, -MAX_MOTION, MAX_MOTION);
}

// A sample: what orders it, its distance (-log of the weight), its place.
struct Candidate {
    F key, distance;
    I index;
};
SS_INLINE void sort(Candidate& first, Candidate& second) {
    const I swap = second.key < first.key;
    const Candidate before = first;
    first = {select(swap, second.key, first.key), select(swap, second.distance, first.distance),
             select(swap, second.index, first.index)};
    second = {select(swap, before.key, second.key), select(swap, before.distance, second.distance),
              select(swap, before.index, second.index)};
}

SS_INLINE F squared(F v) { return v * v; }

// Finds the four samples around W positions whose surfaces and positions are nearest. Rings that are too far away for any
// surface are left out.
static void find_nearest(const WarpWork& w, const Surface& surface, F x, F y, Candidate (&nearest)[4]) {
    const int stride = w.stride, width = w.shaded.width, height = w.shaded.height;
    const ptrdiff_t plane = static_cast<ptrdiff_t>(height) * stride;
    const F left = floor(x + 0.5f), top = floor(y + 0.5f);
    const I center = to_int(top) * stride + to_int(left);
    const int first = center[0], row = first / stride, column = first % stride, reach = w.strides[w.rings - 1];
    const bool adjacent = all(center == ramp() + first) && row >= reach && row < height - reach && column >= reach &&
                          column + W - 1 < width - reach;  // one load reads the samples of all pixels
    const float scale = 1.0f / w.config.distance_sigma;
    const F to_center = maximum(absolute(left - x), absolute(top - y));
    for (Candidate& candidate : nearest) candidate = {spread(FINITE_MOTION), spread(FINITE_MOTION), center};
    for (int ring = 0; ring < w.rings; ring++) {
        if (ring) {
            const F gap = (static_cast<float>(w.strides[ring]) - to_center) * scale;
            const F least = floor(squared(gap) * (0.5f * RING_MARGIN * KEY_STEPS)) * KEY_INDICES;
            if (all(least >= nearest[3].key)) break;
        }
        for (int k = ring ? 8 * ring + 1 : 0; k < 8 * ring + 9; k++) {
            const float dx = w.across[k], dy = w.down[k];
            F u = left + dx, v = top + dy, distance = F{};
            const int step = static_cast<int>(dy) * stride + static_cast<int>(dx);
            const I index = adjacent ? center + step
                                     : to_int(clamped(v, 0.0f, static_cast<float>(height - 1))) * stride +
                                           to_int(clamped(u, 0.0f, static_cast<float>(width - 1)));
            for (int g = 0; g < GUIDES; g++) {
                const float* of = w.samples + g * plane;
                distance += squared(surface.guides[g] - (adjacent ? load(of + first + step) : gather(of, index)));
            }
            u = (u - x) * scale, v = (v - y) * scale;
            distance = (distance + (u * u + v * v)) * 0.5f;
            const F steps = floor(distance * KEY_STEPS);
            Candidate candidate = {minimum(steps, MAX_KEY) * KEY_INDICES + static_cast<float>(k), distance, index};
            for (Candidate& other : nearest) sort(other, candidate);
        }
    }
}

// The weighted mean light of four samples; where all are missing, MISSING.
static F3 mean_light(const WarpWork& w, const Candidate (&nearest)[4]) {
    const ptrdiff_t plane = static_cast<ptrdiff_t>(w.shaded.height) * w.stride;
    F least = nearest[0].distance, total = F{};
    for (const Candidate& candidate : nearest) least = minimum(candidate.distance, least);
    F3 sum = {F{}, F{}, F{}};
    for (const Candidate& candidate : nearest) {
        auto light = [&](int c) { return gather(w.samples + (GUIDES + c) * plane, candidate.index); };
        const F red = light(0);
        const I is_there = red == red;
        const F weight = select(is_there, exponential(least - candidate.distance), 0.0f);
        sum = sum + F3{select(is_there, red, 0.0f), light(1), light(2)} * weight;
        total += weight;
    }
    const F3 mean = sum * (1.0f / maximum(total, MIN_LIGHT_WEIGHT));
    return {select(total >= MIN_LIGHT_WEIGHT, mean.r, MISSING), mean.g, mean.b};
}

void warp_rows(const WarpWork& w, int y0, int y1, int thread) {
    float* scratch = w.scratch + thread * w.scratch_pitch;
    const int width = w.frame.width;
    const View second = {w.next_motion.data ? w.next_motion.data + w.next_motion.channel : nullptr, w.next_motion.type,
                         w.next_motion.row, w.next_motion.pixel, w.next_motion.channel};
    for (int y = y0; y < y1; y++) {
        const Row row(w.base_color, w.normal, w.depth, y, width, scratch);
        const float* motion = packed_row(w.own_motion, 2, y, width, scratch + 7 * width);
        for (int x = 0; x < width; x += W) {
            float tail[2 * W];
            const float* from = whole_vector<2>(motion, x, width, tail);
            const F a = load(from), b = load(from + W);
            const F column = to_float(minimum(ramp() + x, width - 1)), line = spread(static_cast<float>(y));
            F mx = sanitized_motion(evens(a, b)), my = sanitized_motion(odds(a, b));
            if (w.moved) add_previous_motion(w, column, line, mx, my);
            const F px = reproject(column + mx, w.jitter[0], w.shaded_jitter[0], width, w.shaded.width);
            const F py = reproject(line + my, w.jitter[1], w.shaded_jitter[1], w.frame.height, w.shaded.height);
            const Surface surface = row.surface(w.config, x, spread(w.has_depth ? -1 : 0));
            Candidate nearest[4];
            find_nearest(w, surface, clamped(px, 0.0f, static_cast<float>(w.shaded.width - 1)),
                         clamped(py, 0.0f, static_cast<float>(w.shaded.height - 1)), nearest);
            const F3 light = mean_light(w, nearest), r = surface.reflectance;
            const F3 bound = bounded(F3{light.r * r.r, light.g * r.g, light.b * r.b});
            const I known = light.r == light.r;
            const F3 color = {select(known, bound.r, MISSING), select(known, bound.g, MISSING),
                              select(known, bound.b, MISSING)};
            write_rgb(w.color, y, x, width, w.pre_exposure == 1.0f ? color : color * w.pre_exposure);
            if (!w.next_motion.data) continue;
            write_plane(w.next_motion, y, x, width, mx);
            write_plane(second, y, x, width, my);
        }
    }
    end_streams();
}

}  // namespace ss::SS_ISA
