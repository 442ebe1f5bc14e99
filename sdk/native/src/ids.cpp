// Ids at display size: each is that of one sample, of this frame or of an earlier one.
#include <math.h>

#include "step.h"

namespace ss {

// Returns the sample of this frame nearest to a pixel on one axis, and their distance in pixels.
static int nearest_sample(int pixel, float ratio, float jitter, int samples, float* distance) {
    const float at = (static_cast<float>(pixel) + 0.5f) / ratio - 0.5f - jitter;
    const int sample = clamp(static_cast<int>(floorf(at + 0.5f)), 0, samples - 1);
    *distance = fabsf(at - static_cast<float>(sample)) * ratio;
    return sample;
}

static bool same_ids(const uint32_t* a, const uint32_t* b, int channels) {
    for (int c = 0; c < channels; c++)
        if (a[c] != b[c]) return false;
    return true;
}

struct Vector {
    float x, y;
};

// Motion of a sample in display pixels.
static Vector motion_of(const ss_ids& v, ptrdiff_t sample) {
    return {usable_motion(v.motion[2 * sample]) * (static_cast<float>(v.display_width) / static_cast<float>(v.width)),
            usable_motion(v.motion[2 * sample + 1]) *
                (static_cast<float>(v.display_height) / static_cast<float>(v.height))};
}

static float larger_side(float x, float y) { return max(fabsf(x), fabsf(y)); }

// Returns the ids of the closest surface among the 3x3 samples that was at this pixel in the previous frame, too, and
// their distance from the pixel's centre; null where there is none. The distance grows by the motion relative to the
// nearest sample, as edges between surfaces move by that.
static const uint32_t* surviving_ids(const ss_ids& v, int x, int y, int sample_x, int sample_y, float* distance) {
    const Vector nearest = motion_of(v, static_cast<ptrdiff_t>(sample_y) * v.width + sample_x);
    const uint32_t* found = nullptr;
    float closest = 0.0f;
    for (int j = max(sample_y - 1, 0); j <= min(sample_y + 1, v.height - 1); j++)
        for (int i = max(sample_x - 1, 0); i <= min(sample_x + 1, v.width - 1); i++) {
            const ptrdiff_t sample = static_cast<ptrdiff_t>(j) * v.width + i;
            const Vector motion = motion_of(v, sample);
            const float at_x = static_cast<float>(x) + motion.x, at_y = static_cast<float>(y) + motion.y;
            const float near_x = floorf(at_x + 0.5f), near_y = floorf(at_y + 0.5f);
            if (!(near_x >= 0.0f && near_x < static_cast<float>(v.display_width) && near_y >= 0.0f &&
                  near_y < static_cast<float>(v.display_height)))
                continue;
            const ptrdiff_t before = static_cast<ptrdiff_t>(near_y) * v.display_width + static_cast<ptrdiff_t>(near_x);
            const uint32_t* ids = v.ids + sample * v.channels;
            if (!same_ids(ids, v.previous + before * v.channels, v.channels)) continue;
            const float apart = v.previous_distance[before] + larger_side(at_x - near_x, at_y - near_y) +
                                larger_side(motion.x - nearest.x, motion.y - nearest.y);
            const float depth = usable_depth(v.depth[sample]);
            if (found && (depth < closest || (depth == closest && apart >= *distance))) continue;
            found = ids, closest = depth, *distance = apart;
        }
    return found;
}

// Marks the samples of a row whose 3x3 neighbours all have the same ids.
static void mark_uniform(const ss_ids& v, int sample_y, uint8_t* uniform) {
    const uint32_t* rows[3];
    for (int k = 0; k < 3; k++)
        rows[k] = v.ids + static_cast<ptrdiff_t>(clamp(sample_y + k - 1, 0, v.height - 1)) * v.width * v.channels;
    for (int x = 0; x < v.width; x++) {
        bool same = true;
        for (int i = max(x - 1, 0); i <= min(x + 1, v.width - 1); i++)
            for (const uint32_t* row : rows)
                same = same && same_ids(row + i * v.channels, rows[1] + x * v.channels, v.channels);
        uniform[x] = same;
    }
}

static void resample_rows(const ss_ids& v, int y0, int y1) {
    uint8_t uniform[MAX_SIDE];
    const float ratio_x = static_cast<float>(v.display_width) / static_cast<float>(v.width);
    const float ratio_y = static_cast<float>(v.display_height) / static_cast<float>(v.height);
    int marked = -1;
    for (int y = y0; y < y1; y++) {
        float down, across;
        const int sample_y = nearest_sample(y, ratio_y, v.jitter[1], v.height, &down);
        if (v.previous && sample_y != marked) mark_uniform(v, marked = sample_y, uniform);
        for (int x = 0; x < v.display_width; x++) {
            const int sample_x = nearest_sample(x, ratio_x, v.jitter[0], v.width, &across);
            const ptrdiff_t pixel = static_cast<ptrdiff_t>(y) * v.display_width + x;
            const uint32_t* ids = v.ids + (static_cast<ptrdiff_t>(sample_y) * v.width + sample_x) * v.channels;
            float distance = max(across, down), kept = distance;
            if (v.previous && !uniform[sample_x])
                if (const uint32_t* surviving = surviving_ids(v, x, y, sample_x, sample_y, &kept))
                    if (kept < distance) ids = surviving, distance = kept;
            for (int c = 0; c < v.channels; c++) v.image[pixel * v.channels + c] = ids[c];
            v.distance[pixel] = distance;
        }
    }
}

static ss_status check(const ss_ids& v, ss_error* error) {
    if (ss_status status = check_size(v.width, v.height, "the frame", error)) return status;
    if (ss_status status = check_size(v.display_width, v.display_height, "the display", error)) return status;
    if (v.channels < 1 || v.channels > MAX_CHANNELS)
        return fail(error, SS_BAD_ARGUMENT, "channels is %d; want 1 to %d", v.channels, MAX_CHANNELS);
    if (!v.ids || !v.depth || !v.motion || !v.image || !v.distance)
        return fail(error, SS_BAD_ARGUMENT, "an array is NULL; only previous and previous_distance may be");
    if (!v.previous != !v.previous_distance)
        return fail(error, SS_BAD_ARGUMENT, "only one of previous and previous_distance is set; want both or none");
    return check_jitter(v.jitter, error);
}

// Checks that a view writes to no array that it reads or that another one, if it is another, uses.
static ss_status check_apart(const ss_ids& v, const ss_ids& other, ss_error* error) {
    if (v.image == other.previous || v.distance == other.previous_distance)
        return fail(error, SS_BAD_ARGUMENT, "image or distance is that of the previous frame; want other memory");
    const bool same = &v == &other;
    return check_memory({{"image", v.image}, {"distance", v.distance}},
                        {{"image", same ? nullptr : other.image},
                         {"distance", same ? nullptr : other.distance},
                         {"ids", other.ids},
                         {"depth", other.depth},
                         {"motion", other.motion}},
                        error, same ? "" : " of another view");
}

}  // namespace ss

using namespace ss;

ss_status ss_resample_ids(ss_model* model, const ss_ids* views, int count, ss_error* error) {
    if (ss_status status = check_views(views, count, check, check_apart, error)) return status;
    run_views(reinterpret_cast<Model*>(model), views, count,
              [&](int view, int y0, int y1, int) { resample_rows(views[view], y0, y1); });
    return succeed(error);
}
