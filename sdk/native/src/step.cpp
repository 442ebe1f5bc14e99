// A step: checks of a frame, its exposure, the method, and what stands still.
#include "step.h"

#include <math.h>

namespace ss {

View view_of(const ss_image& image, int width, int channels) {
    ptrdiff_t size = image.type == SS_FLOAT32 ? 4 : image.type == SS_FLOAT16 ? 2 : 1;
    ptrdiff_t channel = image.channel_stride ? image.channel_stride : size;
    ptrdiff_t pixel = image.pixel_stride ? image.pixel_stride : channels * size;
    ptrdiff_t row = image.row_stride ? image.row_stride : width * pixel;
    return {static_cast<const char*>(image.data), image.type, row, pixel, channel};
}

static bool is_size(int width, int height) {
    return width >= 1 && height >= 1 && width <= MAX_SIDE && height <= MAX_SIDE && int64_t{width} * height <= MAX_PIXELS;
}

static bool is_finite(float value) { return fabsf(value) <= 3.4028235e38f; }

static ss_status check_input(const char* name, const ss_image& image, bool needed, ss_error* error) {
    if (needed && !image.data) return fail(error, SS_BAD_FRAME, "%s is missing; the method reads it", name);
    if (image.data && image.type != SS_FLOAT32 && image.type != SS_FLOAT16)
        return fail(error, SS_BAD_FRAME, "%s has the type %d; want SS_FLOAT32 or SS_FLOAT16", name, image.type);
    return SS_OK;
}

static ss_status check_frame(const Method& method, const ss_frame& f, Size display, ss_error* error) {
    if (!is_size(f.width, f.height))
        return fail(error, SS_BAD_FRAME, "the frame has %d x %d samples; want sides from 1 to %d, %d pixels at most", f.width,
                    f.height, MAX_SIDE, MAX_PIXELS);
    const int of_display[] = {display.width, display.height}, of_frame[] = {f.width, f.height};
    for (int axis = 0; axis < 2; axis++) {  // either size may have been rounded to whole pixels
        const float most = static_cast<float>(of_display[axis] + 1) / max(of_frame[axis] - 1, 1);
        const float least = static_cast<float>(of_display[axis] - 1) / (of_frame[axis] + 1);
        if (least > method.ratios[1] || (most < method.ratios[0] && of_frame[axis] > 1))
            return fail(error, SS_BAD_FRAME, "%s is %d for a display of %d; %s takes a ratio from %g to %g",
                        axis ? "height" : "width", of_frame[axis], of_display[axis], method.name, method.ratios[0], method.ratios[1]);
    }
    const struct {
        const char* name;
        const ss_image& image;
        bool needed;
    } inputs[] = {{"color", f.color, true},
                  {"depth", f.depth, method.reads_surfaces},
                  {"motion", f.motion, method.reads_motion},
                  {"reactive", f.reactive, false}};
    for (const auto& input : inputs)
        if (ss_status status = check_input(input.name, input.image, input.needed, error)) return status;
    for (float offset : f.jitter)
        if (!(fabsf(offset) <= 0.5f))
            return fail(error, SS_BAD_FRAME, "jitter is %g; want render pixels in [-0.5, 0.5]", offset);
    if (!(f.exposure >= 0.0f && is_finite(f.exposure)))
        return fail(error, SS_BAD_FRAME, "exposure is %g; want a number > 0, or 0 to measure it", f.exposure);
    if (!(f.pre_exposure >= 0.0f && is_finite(f.pre_exposure)))
        return fail(error, SS_BAD_FRAME, "pre_exposure is %g; want a number > 0", f.pre_exposure);
    if (f.adds_samples != 0.0f && f.adds_samples != 1.0f && f.adds_samples != 2.0f)
        return fail(error, SS_BAD_FRAME, "adds_samples is %g; want 0, 1 or 2", f.adds_samples);
    return SS_OK;
}

// Returns the exposure of a frame, as its absolute value; see supersampler.io.display.followed_exposure.
static double followed_exposure(double given, double target, double before) {
    const double known = fabs(before);
    const double exposure = given ? given : target ? target : known ? known : EXPOSURE_KEY;
    if (!(known > 0.0)) return -exposure;
    if (!(known / EXPOSURE_OUTLIER <= exposure && exposure <= known * EXPOSURE_OUTLIER))
        return before < 0.0 ? exposure : -known;
    if (given || !target) return exposure;
    const double adaptation = 0.1;  // as a double, which EXPOSURE_ADAPTATION is not
    static_assert(EXPOSURE_ADAPTATION == 0.1f);
    return pow(known, 1.0 - adaptation) * pow(target, adaptation);
}

static float exposure_of(const ss_frame& frame, const Samples& samples, float before) {
    const bool given = frame.exposure >= MIN_EXPOSURE && frame.exposure <= MAX_EXPOSURE;
    double logs = 0.0, count = 0.0;
    for (int y = 0; y < samples.height && !given; y++) {
        logs += samples.rows[4 * y];
        count += samples.rows[4 * y + 1];
    }
    const double key = 0.18;
    static_assert(EXPOSURE_KEY == 0.18f);
    return static_cast<float>(followed_exposure(given ? frame.exposure : 0.0, count > 0.0 ? key * exp(-logs / count) : 0.0, before));
}

// Reads the arrays of a frame to samples.
static void read_samples(const Step& step) {
    const ss_frame& f = step.frame;
    Samples& s = step.samples();
    FrameImages images = {view_of(f.color, f.width, 3), view_of(f.depth, f.width, 1), view_of(f.motion, f.width, 2),
                          view_of(f.reactive, f.width, 1), step.target.pre_exposure, step.space.scratch,
                          static_cast<size_t>(up_to(3 * f.width, LANES))};
    if (!step.model.method->reads_surfaces) images.depth.data = nullptr;
    if (!step.model.method->reads_motion) images.motion.data = nullptr;
    pool_of(step).run_rows(s.height, [&](int y0, int y1, int thread) {
        step.kernels().read_frame(images, s, y0, y1, thread);
    });
    bool missing = false;
    s.has_reactive = false;
    for (int y = 0; y < s.height; y++) {
        missing |= s.rows[4 * y + 2] > 0.0f;
        s.has_reactive |= s.rows[4 * y + 3] > 0.0f;
    }
    s.fill_across = missing ? divided_up(s.width, FILL_WINDOW) : 0;
}

void fill_missing(const Step& step) {
    const Samples& s = step.samples();
    if (s.fill_across)
        pool_of(step).run_rows(divided_up(s.height, FILL_WINDOW), [&](int y0, int y1, int) { step.kernels().fill_windows(s, y0, y1); });
}

void make_tables(const Step& step) { step.kernels().make_tables(step.space.tables, step.frame.jitter[0], step.frame.jitter[1]); }

bool resample(const Step& step) {
    const Samples& s = step.samples();
    fill_missing(step);
    run_rows_with_neighbours(
        pool_of(step), s.height, [&](int y0, int y1) { step.kernels().prepare(s, y0, y1); },
        [&](int y0, int y1) { step.kernels().dilate(s, y0, y1); });
    bool glares = false;
    for (int y = 0; y < s.height; y++) glares |= s.glares[y] > 0.0f;
    return glares;
}

PreviousFrame previous_frame(const History& history, int plane) {
    return {history.plane(plane), history.render.width, history.render.height, history.pitch(), {history.jitter[0], history.jitter[1]}};
}

ss_status run_step(Model& model, const ss_frame& frame, const History& before, History& after, const ss_outputs& outputs,
                   ss_error* error) {
    const Size render = {frame.width, frame.height}, display = before.display;
    if (ss_status status = check_frame(*model.method, frame, display, error)) return status;
    if (!(after.display == display) || &before == &after)
        return fail(error, SS_BAD_ARGUMENT, "next_history is %s; want another history of the same display size",
                    &before == &after ? "the history itself" : "of another display size");
    if (!after.fits(render))
        return fail(error, SS_BAD_ARGUMENT, "next_history is for frames of %d x %d; want %d x %d", after.render.width,
                    after.render.height, render.width, render.height);
    if (!outputs.image.data) return fail(error, SS_BAD_ARGUMENT, "image has no data; want an image to write to");
    Space* space = model.borrow(render, display);
    if (!space) return fail(error, SS_NO_MEMORY, "no memory for the work buffers of a step");
    const Rect whole = {0, display.height, 0, display.width};
    const float pre_exposure = frame.pre_exposure > 0.0f ? frame.pre_exposure : 1.0f;
    Target target = {view_of(outputs.image, display.width, 3), view_of(outputs.weight, display.width, 1), display.width,
                     display.height, pre_exposure};
    Step step = {model, frame, *space, before, after, target, 0.0f, &whole, 1};
    read_samples(step);
    step.exposure = exposure_of(frame, space->samples, before.exposure);
    space->samples.exposure = fabsf(step.exposure);
    ss_status status = model.method->compute(step);
    if (status == SS_OK) {
        memcpy(after.jitter, frame.jitter, sizeof after.jitter);
        after.exposure = step.exposure;
        after.render = render;
    }
    model.give_back(space);
    return status == SS_OK ? succeed(error) : fail(error, status, "no memory for a step");
}

}  // namespace ss
