// Functions for images alone: no model, no state.
#include <math.h>
#include <stdlib.h>

#include "step.h"

using namespace ss;

ss_status ss_camera_motion(const ss_image* depth, int width, int height, const double to_previous[16], double far_depth,
                           const float jitter[2], const ss_image* motion, ss_error* error) {
    if (ss_status status = check_given(
            {{"depth", depth}, {"to_previous", to_previous}, {"jitter", jitter}, {"motion", motion}}, error))
        return status;
    if (!motion->data) return fail(error, SS_BAD_ARGUMENT, "motion has no data; want an image to write to");
    if (ss_status status = check_memory({{"motion", motion->data}}, {{"depth", depth->data}}, error)) return status;
    if (ss_status status = check_size(width, height, "the frame", error)) return status;
    if (ss_status status = check_input("depth", *depth, {width, height}, 1, true, error)) return status;
    for (int k = 0; k < 16; k++)
        if (!(fabs(to_previous[k]) < HUGE_VAL))
            return fail(error, SS_BAD_ARGUMENT, "to_previous is %g at [%d]; want finite numbers", to_previous[k], k);
    if (!(fabs(far_depth) < HUGE_VAL && fabsf(jitter[0]) < HUGE_VALF && fabsf(jitter[1]) < HUGE_VALF))
        return fail(error, SS_BAD_ARGUMENT, "far_depth is %g, jitter %g, %g; want finite numbers", far_depth, jitter[0],
                    jitter[1]);
    if (type_of(*motion) != SS_FLOAT32)
        return fail(error, SS_BAD_ARGUMENT, "motion has the type %d; want SS_FLOAT32", type_of(*motion));
    if (ss_status status = check_output("motion", *motion, {width, height}, 2, error)) return status;
    const Kernels& kernels = *find_kernels(nullptr);
    const IeeeArithmetic arithmetic;
    const double* m = to_previous;
    // With (X, Y, Z, W) = m * (x, y, depth, 1), the motion is X / W - x = (X - x W) / W. Where the camera hardly moves,
    // X / W and x are nearly equal, and their difference in single precision is noise; X - x W takes its
    // differences in the coefficients, in double precision.
    float columns[5 * CameraMotion::BLOCK], rows[5 * CameraMotion::ROWS];
    CameraMotion work = {view_of(*depth, width, 1),
                         view_of(*motion, width, 2),
                         {width, height},
                         columns,
                         rows,
                         static_cast<float>(m[14]),
                         static_cast<float>(far_depth),
                         0,
                         0};
    for (int y0 = 0; y0 < height; y0 += CameraMotion::ROWS) {
        const int y1 = min(y0 + CameraMotion::ROWS, height);
        for (int row = y0; row < y1; row++) {
            const double y = 1.0 - (row + 0.5 + jitter[1]) * 2.0 / height, scale = -0.5 * height;
            const double values[] = {y, (m[6] - m[14] * y) * scale, (m[4] - m[12] * y) * scale,
                                     ((m[5] - m[15] - m[13] * y) * y + m[7]) * scale, m[13] * y + m[15]};
            for (int k = 0; k < 5; k++) rows[5 * (row - y0) + k] = static_cast<float>(values[k]);
        }
        for (work.x0 = 0; work.x0 < width; work.x0 = work.x1) {
            work.x1 = min(work.x0 + CameraMotion::BLOCK, width);
            for (int column = work.x0; column < work.x1; column++) {
                const double x = (column + 0.5 + jitter[0]) * 2.0 / width - 1.0, scale = 0.5 * width;
                const double values[] = {(m[2] - m[14] * x) * scale, (m[1] - m[13] * x) * scale,
                                         ((m[0] - m[15] - m[12] * x) * x + m[3]) * scale, x, m[12] * x};
                for (int k = 0; k < 5; k++)
                    columns[k * CameraMotion::BLOCK + column - work.x0] = static_cast<float>(values[k]);
            }
            kernels.camera_motion_rows(work, y0, y1);
        }
    }
    return succeed(error);
}

ss_status ss_encode_rgba(const ss_image* image, int width, int height, void* pixels, ptrdiff_t row_stride,
                         ss_error* error) {
    if (ss_status status = check_given({{"image", image}, {"pixels", pixels}}, error)) return status;
    if (ss_status status = check_size(width, height, "the image", error)) return status;
    if (ss_status status = check_input("image", *image, {width, height}, 3, true, error)) return status;
    if (ss_status status = check_memory({{"pixels", pixels}}, {{"image", image->data}}, error)) return status;
    const ss_image bytes = {pixels, SS_UNORM8, row_stride, 0, 0};
    if (ss_status status = check_output("pixels", bytes, {width, height}, 4, error)) return status;
    const Kernels& kernels = *find_kernels(nullptr);
    const IeeeArithmetic arithmetic;
    constexpr int BLOCK = 1024;  // columns, whose scratch is on the stack
    float scratch[3 * BLOCK];
    for (int x = 0; x < width; x += BLOCK) {
        View part = view_of(*image, width, 3);
        part.data += x * part.pixel;
        kernels.rgba_rows(part, static_cast<uint8_t*>(pixels) + 4 * x, row_stride ? row_stride : 4 * ptrdiff_t{width},
                          min(BLOCK, width - x), 0, height, scratch);
    }
    return succeed(error);
}

ss_status ss_merge_images(float* image, const float* other, const float* weight, const float* other_weight, int width,
                          int height, float exposure, ss_error* error) {
    if (ss_status status = check_given(
            {{"image", image}, {"other", other}, {"weight", weight}, {"other_weight", other_weight}}, error))
        return status;
    if (ss_status status = check_size(width, height, "the image", error)) return status;
    if (!(exposure > 0.0f)) return fail(error, SS_BAD_ARGUMENT, "exposure is %g; want more than 0", exposure);
    const Kernels& kernels = *find_kernels(nullptr);
    const IeeeArithmetic arithmetic;
    for (ptrdiff_t y = 0; y < height; y++)
        kernels.merge_row(image + 3 * y * width, other + 3 * y * width, weight + y * width, other_weight + y * width,
                          width, exposure);
    return succeed(error);
}

// Returns whether one of the arrays is NULL.
template <class Array>
static bool lacks_aovs(const Array* arrays, int groups) {
    for (int group = 0; group < groups; group++)
        if (!arrays || !arrays[group]) return true;
    return false;
}

ss_status ss_filter_temporal(const ss_temporal* t, ss_error* error) {
    if (ss_status status = check_given({{"filter", t}}, error)) return status;
    if (ss_status status = check_given({{"frames", t->frames}, {"image", t->image}}, error)) return status;
    if (lacks_aovs(t->aovs, t->aov_groups)) return fail(error, SS_BAD_ARGUMENT, "an array of aovs is NULL");
    if (ss_status status = check_size(t->width, t->height, "the image", error)) return status;
    if (t->previous < 0 || t->following < 0 || t->aov_groups < 0 || t->first_row < 0 || t->end_row > t->height)
        return fail(error, SS_BAD_ARGUMENT,
                    "counts are %d, %d, %d, rows %d to %d; want counts from 0 on, and rows of the image", t->previous,
                    t->following, t->aov_groups, t->first_row, t->end_row);
    if (!(t->samples > 0.0f && t->exposure > 0.0f))
        return fail(error, SS_BAD_ARGUMENT, "samples is %g, exposure %g; want more than 0",
                    static_cast<double>(t->samples), static_cast<double>(t->exposure));
    for (int k = 0; k <= t->previous + t->following; k++) {
        const ss_temporal_frame& frame = t->frames[k];
        if (!frame.color || !frame.guides || lacks_aovs(frame.aovs, t->aov_groups) ||
            (t->frames[0].noisy && !frame.noisy))
            return fail(error, SS_BAD_ARGUMENT, "frame %d of the window lacks color, noisy, guides or aovs", k);
        if (t->image == frame.color || t->image == frame.noisy)
            return fail(error, SS_BAD_ARGUMENT, "image is in the memory of frame %d of the window; want other memory",
                        k);
    }
    float* scratch = static_cast<float*>(malloc(sizeof(float) * TemporalFilter::SCRATCH));
    if (!scratch) return fail(error, SS_NO_MEMORY, "no memory for the temporal filter");
    const IeeeArithmetic arithmetic;
    const TemporalFilter work = {t->frames,  t->previous,           t->following, t->aov_groups, t->exposure,
                                 t->samples, {t->width, t->height}, t->image,     t->aovs,       scratch};
    memset(scratch, 0, sizeof(float) * TemporalFilter::SCRATCH);
    find_kernels(nullptr)->temporal_rows(work, t->first_row, t->end_row);
    free(scratch);
    return succeed(error);
}

ss_status ss_nearest_motion(const float* depth, const float* motion, int width, int height, float* to,
                            ss_error* error) {
    if (ss_status status = check_given({{"depth", depth}, {"motion", motion}, {"to", to}}, error)) return status;
    if (ss_status status = check_memory({{"to", to}}, {{"depth", depth}, {"motion", motion}}, error)) return status;
    if (ss_status status = check_size(width, height, "the image", error)) return status;
    const IeeeArithmetic arithmetic;
    find_kernels(nullptr)->nearest_motion_rows(depth, motion, to, {width, height}, 0, height);
    return succeed(error);
}

constexpr float HIDDEN = 1e30f;       // mismatch of a pixel that no sample reached
constexpr float SAME_SURFACE = 0.1f;  // largest relative difference of two depths of a surface in neighbouring frames
constexpr int REACH = 4;              // pixels to each side that are searched for a surface's motion
constexpr int OTHER_SURFACE = 2 * REACH * REACH + 1;  // squared distance that is added for another surface

// |a - b| / max(a, b), 0 where both are 0; HIDDEN where one is not finite.
static float mismatch_of(float a, float b) {
    const float difference = fabsf(a - b) / max(max(fabsf(a), fabsf(b)), 1e-30f);
    return difference < HIDDEN ? difference : HIDDEN;
}

ss_status ss_scatter_motion(const ss_scatter* s, float* motion, float* mismatch, ss_error* error) {
    if (ss_status status = check_given({{"frames", s}, {"motion", motion}, {"mismatch", mismatch}}, error))
        return status;
    if (ss_status status =
            check_given({{"depth", s->depth}, {"next_depth", s->next_depth}, {"next_motion", s->next_motion}}, error))
        return status;
    if (ss_status status =
            check_memory({{"motion", motion}, {"mismatch", mismatch}},
                         {{"depth", s->depth}, {"next_depth", s->next_depth}, {"next_motion", s->next_motion}}, error))
        return status;
    if (ss_status status = check_size(s->width, s->height, "the frame", error)) return status;
    if (ss_status status = check_size(s->next_width, s->next_height, "the next frame", error)) return status;
    if (ss_status status = check_jitter(s->jitter, error)) return status;
    if (ss_status status = check_jitter(s->next_jitter, error)) return status;
    const IeeeArithmetic arithmetic;
    const int width = s->width, height = s->height;
    const ptrdiff_t pixels = static_cast<ptrdiff_t>(width) * height;
    const double scales[] = {static_cast<double>(width) / s->next_width, static_cast<double>(height) / s->next_height};
    const float scale[] = {static_cast<float>(scales[0]), static_cast<float>(scales[1])};
    float shift[2];
    for (int axis = 0; axis < 2; axis++)
        shift[axis] = static_cast<float>((0.5 + s->next_jitter[axis]) * scales[axis] - (0.5 + s->jitter[axis]));
    for (ptrdiff_t pixel = 0; pixel < pixels; pixel++)
        mismatch[pixel] = HIDDEN, motion[2 * pixel] = motion[2 * pixel + 1] = 0.0f;
    for (int row = 0; row < s->next_height; row++)
        for (int column = 0; column < s->next_width; column++) {
            const ptrdiff_t sample = static_cast<ptrdiff_t>(row) * s->next_width + column;
            const float along = s->next_motion[2 * sample], down = s->next_motion[2 * sample + 1];
            const float x = (static_cast<float>(column) + along) * scale[0] + shift[0] + 0.5f,
                        y = (static_cast<float>(row) + down) * scale[1] + shift[1] + 0.5f;
            if (!(x >= 0.0f && x < static_cast<float>(width) && y >= 0.0f && y < static_cast<float>(height))) continue;
            const ptrdiff_t to = static_cast<ptrdiff_t>(y) * width + static_cast<ptrdiff_t>(x);
            const float fit = mismatch_of(s->depth[to], s->next_depth[sample]);
            if (!(fit <= SAME_SURFACE && fit <= mismatch[to])) continue;
            mismatch[to] = fit;
            motion[2 * to] = -along * scale[0], motion[2 * to + 1] = -down * scale[1];
        }
    for (int row = 0; row < height; row++)
        for (int column = 0; column < width; column++) {
            const ptrdiff_t pixel = static_cast<ptrdiff_t>(row) * width + column;
            if (mismatch[pixel] < HIDDEN) continue;
            int best = 4 * OTHER_SURFACE;
            ptrdiff_t source = -1;
            // Ring by ring: later rings are farther away.
            for (int reach = 1; reach <= REACH && best >= reach * reach; reach++)
                for (int y = max(row - reach, 0); y < min(row + reach + 1, height); y++) {
                    // Of the rows between the first and the last, both ends.
                    const int away = y < row ? row - y : y - row, step = away == reach ? 1 : 2 * reach;
                    for (int x = column - reach; x <= column + reach; x += step) {
                        const ptrdiff_t other = static_cast<ptrdiff_t>(y) * width + x;
                        if (x < 0 || x >= width || !(mismatch[other] < HIDDEN)) continue;
                        int cost = away * away + (x - column) * (x - column);
                        if (mismatch_of(s->depth[pixel], s->depth[other]) > SAME_SURFACE) cost += OTHER_SURFACE;
                        if (cost < best) best = cost, source = other;
                    }
                }
            if (source >= 0) motion[2 * pixel] = motion[2 * source], motion[2 * pixel + 1] = motion[2 * source + 1];
        }
    return succeed(error);
}
