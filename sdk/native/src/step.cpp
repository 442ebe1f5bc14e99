// A step: checks of a frame, its exposure, the method, and convergence.
#include "step.h"

#include <math.h>

namespace ss {

View view_of(const ss_image& image, int width, int channels) {
    if (!image.data) return {};  // the rest of it may not be initialised
    ptrdiff_t size = image.type == SS_FLOAT32 ? 4 : image.type == SS_FLOAT16 ? 2 : 1;
    ptrdiff_t channel = image.channel_stride ? image.channel_stride : size;
    ptrdiff_t pixel = image.pixel_stride ? image.pixel_stride : channels * size;
    ptrdiff_t row = image.row_stride ? image.row_stride : width * pixel;
    return {static_cast<const char*>(image.data), image.type, row, pixel, channel};
}

static bool is_finite(float value) { return fabsf(value) <= 3.4028235e38f; }

ss_status check_size(int width, int height, const char* name, ss_error* error) {
    if (width >= 1 && height >= 1 && width <= MAX_SIDE && height <= MAX_SIDE && int64_t{width} * height <= MAX_PIXELS)
        return SS_OK;
    return fail(error, SS_BAD_ARGUMENT, "%s is %d x %d; want sides from 1 to %d, %d pixels at most", name, width,
                height, MAX_SIDE, MAX_PIXELS);
}

ss_status check_jitter(const float (&jitter)[2], ss_error* error) {
    for (float offset : jitter)
        if (!(fabsf(offset) <= 0.5f))
            return fail(error, SS_BAD_FRAME, "jitter is %g; want render pixels in [-0.5, 0.5]", offset);
    return SS_OK;
}

ss_status check_pre_exposure(float pre_exposure, ss_error* error) {
    if (pre_exposure == 0.0f || (pre_exposure >= MIN_EXPOSURE && pre_exposure <= MAX_EXPOSURE)) return SS_OK;
    return fail(error, SS_BAD_FRAME, "pre_exposure is %g; want a number from 2^-24 to 2^24, or 0 for 1", pre_exposure);
}

// Checks that no two values of an image share memory, as they do where strides are in pixels instead of bytes.
static ss_status check_strides(const char* name, const ss_image& image, Size size, int channels, ss_status status,
                               ss_error* error) {
    const View view = view_of(image, size.width, channels);
    // In double precision no stride is too large.
    const double strides[] = {fabs(static_cast<double>(view.row)), fabs(static_cast<double>(view.pixel)),
                              fabs(static_cast<double>(view.channel))};
    const int counts[] = {size.height, size.width, channels};
    for (int axis = 0; axis < 3; axis++) {
        double extent = image.type == SS_FLOAT32 ? 4 : image.type == SS_FLOAT16 ? 2 : 1;  // of the axes within
        for (int other = 0; other < 3; other++)
            if (other != axis && counts[other] > 1 && strides[other] <= strides[axis])
                extent += strides[other] * (counts[other] - 1);
        if (counts[axis] > 1 && strides[axis] < extent)
            return fail(error, status,
                        "%s overlaps itself: its strides are %.0f, %.0f, %.0f; want bytes, or 0 if packed", name,
                        strides[0], strides[1], strides[2]);
    }
    return SS_OK;
}

ss_status check_output(const char* name, const ss_image& image, Size size, int channels, ss_error* error) {
    if (!image.data) return SS_OK;
    const int type = type_of(image);
    if (type != SS_FLOAT32 && type != SS_FLOAT16 && type != SS_UNORM8)
        return fail(error, SS_BAD_ARGUMENT, "%s has the type %d; want SS_FLOAT32, SS_FLOAT16 or SS_UNORM8", name, type);
    return check_strides(name, image, size, channels, SS_BAD_ARGUMENT, error);
}

ss_status check_input(const char* name, const ss_image& image, Size size, int channels, bool needed, ss_error* error) {
    if (!image.data) return needed ? fail(error, SS_BAD_FRAME, "%s is missing; the method reads it", name) : SS_OK;
    const int type = type_of(image);
    if (type != SS_FLOAT32 && type != SS_FLOAT16)
        return fail(error, SS_BAD_FRAME, "%s has the type %d; want SS_FLOAT32 or SS_FLOAT16", name, type);
    return check_strides(name, image, size, channels, SS_BAD_FRAME, error);
}

ss_status check_ratio(const Method& method, Size render, Size display, ss_error* error) {
    const int of_display[] = {display.width, display.height}, of_frame[] = {render.width, render.height};
    for (int axis = 0; axis < 2; axis++) {  // either size may have been rounded to whole pixels, from 1 on
        const float most = static_cast<float>(of_display[axis] + 1) / max(of_frame[axis] - 1, 1);
        const float least = static_cast<float>(of_display[axis] - 1) / (of_frame[axis] + 1);
        if (least > method.ratios[1] || (most < method.ratios[0] && of_frame[axis] > 1) ||
            of_frame[axis] > of_display[axis])
            return fail(error, SS_BAD_FRAME, "%s is %d for a display of %d; %s takes a ratio from %g to %g",
                        axis ? "height" : "width", of_frame[axis], of_display[axis], method.name, method.ratios[0],
                        method.ratios[1]);
    }
    return SS_OK;
}

static ss_status check_frame(const Method& method, const ss_frame& f, Size display, ss_error* error) {
    if (check_size(f.width, f.height, "the frame", error)) return SS_BAD_FRAME;
    const Size render = {f.width, f.height};
    if (ss_status status = check_ratio(method, render, display, error)) return status;
    const struct {
        const char* name;
        const ss_image& image;
        Size size;
        int channels;
        bool read;
    } inputs[] = {{"color", f.color, render, 3, true},
                  {"depth", f.depth, render, 1, method.reads_surfaces},
                  {"motion", f.motion, render, 2, method.reads_motion},
                  {"reactive", f.reactive, render, 1, true},
                  {"base_color", f.base_color, render, 3, method.reads_gbuffers},
                  {"normal", f.normal, render, 3, method.reads_gbuffers},
                  {"display_base_color", f.display_base_color, display, 3, method.reads_gbuffers},
                  {"display_normal", f.display_normal, display, 3, method.reads_gbuffers},
                  {"display_depth", f.display_depth, display, 1, method.reads_gbuffers}};
    for (const auto& input : inputs) {
        const bool needed = &input.image != &f.reactive;
        if (!input.read) continue;  // an engine may pass it all the same, of any size
        if (ss_status status = check_input(input.name, input.image, input.size, input.channels, needed, error))
            return status;
    }
    if (ss_status status = check_jitter(f.jitter, error)) return status;
    if (!(f.exposure >= 0.0f && is_finite(f.exposure)))
        return fail(error, SS_BAD_FRAME, "exposure is %g; want a number > 0, or 0 to measure it", f.exposure);
    if (ss_status status = check_pre_exposure(f.pre_exposure, error)) return status;
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
    return pow(known, 1.0 - EXPOSURE_ADAPTATION) * pow(target, EXPOSURE_ADAPTATION);
}

static float exposure_of(const ss_frame& frame, const Samples& samples, float before) {
    const bool given = frame.exposure >= MIN_EXPOSURE && frame.exposure <= MAX_EXPOSURE;
    double logs = 0.0, lit = 0.0;
    for (int y = 0; y < samples.height && !given; y++) {
        logs += samples.rows[y].logs;
        lit += samples.rows[y].lit;
    }
    return static_cast<float>(
        followed_exposure(given ? frame.exposure : 0.0, lit > 0.0 ? EXPOSURE_KEY * exp(-logs / lit) : 0.0, before));
}

// Reads the arrays of a frame to samples.
static void read_samples(Step& step) {
    const ss_frame& f = step.frame;
    Samples& s = step.samples();
    FrameImages images = {view_of(f.color, f.width, 3),
                          view_of(f.depth, f.width, 1),
                          view_of(f.motion, f.width, 2),
                          view_of(f.reactive, f.width, 1),
                          step.target.pre_exposure,
                          step.buffers.scratch,
                          static_cast<size_t>(up_to(3 * f.width, LANES))};
    if (!step.model.method->reads_surfaces) images.depth.data = nullptr;
    if (!step.model.method->reads_motion) images.motion.data = nullptr;
    step.workers().run_rows(s.height,
                            [&](int y0, int y1, int thread) { step.kernels().read_frame(images, s, y0, y1, thread); });
    bool missing = false;
    s.has_reactive = false;
    for (int y = 0; y < s.height; y++) {
        missing |= s.rows[y].misses;
        s.has_reactive |= s.rows[y].reacts;
    }
    s.fill_across = missing ? divided_up(s.width, FILL_WINDOW) : 0;
}

void fill_missing(Step& step) {
    const Samples& s = step.samples();
    if (s.fill_across)
        step.workers().run_rows(divided_up(s.height, FILL_WINDOW),
                                [&](int y0, int y1, int) { step.kernels().fill_windows(s, y0, y1); });
}

void make_tables(const Step& step) {
    step.kernels().make_tables(step.buffers.tables, step.frame.jitter[0], step.frame.jitter[1]);
}

void resample(Step& step) {
    const Samples& s = step.samples();
    fill_missing(step);
    run_rows_with_neighbours(
        step.workers(), s.height, [&](int y0, int y1) { step.kernels().prepare(s, y0, y1); },
        [&](int y0, int y1) { step.kernels().dilate(s, y0, y1); });
}

bool may_glare(const Step& step) {
    return step.buffers.samples.may_glare(0, step.buffers.samples.height - 1) ||
           (step.before.glares && rests_anywhere(step));
}

PreviousFrame previous_frame(const History& history, int plane) {
    return {history.plane(plane),
            history.render.width,
            history.render.height,
            history.pitch(),
            {history.jitter[0], history.jitter[1]}};
}

// Makes the tiles of the next history that rest equal to those of the history.
static void keep_tiles(Step& step, int64_t generation, bool computes) {
    const History& before = step.before;
    History& after = step.after;
    RestWork& w = step.buffers.rest;
    const Size tiles = tiles_of(step.buffers.display);
    const int count = tiles.width * tiles.height;
    // tiles of which this step has written a plane: the reflectance is written where the history is gathered
    const uint8_t* const written = step.model.method->reads_gbuffers ? w.gathered : w.computed;
    bool any_stale = false;
    for (int k = 0; k < count; k++) {
        w.stale[k] = w.resting[k] && (written[k] || after.generations[k] != before.generations[k]);
        any_stale |= w.stale[k] != 0;
        after.generations[k] = w.resting[k] ? before.generations[k] : generation;
    }
    const Layout& layout = step.model.method->layout;
    if (any_stale) {
        make_runs(w.stale, tiles, 1, w.copy_runs);
        for (int k = 0; k < layout.planes; k++) {
            const PlaneSpec& plane = layout.plane[k];
            if (plane.extent == Extent::SAMPLES) continue;
            const bool half = plane.extent == Extent::HALF;
            const Size size = half ? half_of(step.buffers.display) : step.buffers.display;
            const size_t pixel = static_cast<size_t>(plane.channels) * (plane.bytes ? 1 : sizeof(float));
            run_tiles(step, w.copy_runs, half ? TILE / 2 : TILE, size, [&](Rect rect, int) {
                for (int y = rect.y0; y < rect.y1; y++) {
                    const size_t at = (static_cast<size_t>(y) * size.width + rect.x0) * pixel;
                    memcpy(static_cast<char*>(after.planes[k]) + at, static_cast<const char*>(before.planes[k]) + at,
                           static_cast<size_t>(rect.x1 - rect.x0) * pixel);
                }
            });
        }
    }
    for (int k = 0; k < count; k++)
        if (!w.resting[k]) {
            after.frame_generation = generation;
            return;
        }
    // nothing of this frame counts
    memcpy(after.jitter, before.jitter, sizeof after.jitter);
    memcpy(after.values, before.values, sizeof after.values);
    after.exposure = before.exposure, after.glares = before.glares;
    for (int k = 0; k < layout.planes; k++)
        if (layout.plane[k].extent == Extent::SAMPLES &&
            (computes || after.frame_generation != before.frame_generation))
            memcpy(after.planes[k], before.planes[k],
                   sizeof(float) * plane_values(layout.plane[k], step.buffers.display, before.render));
    after.frame_generation = before.frame_generation;
}

// Copies an image of packed floats to that of the caller.
static void copy_image(Step& step, const View& from, const View& to, float factor) {
    step.workers().run_rows(step.target.height, [&](int y0, int y1, int) {
        step.kernels().copy_image(from, to, step.target.width, y0, y1, factor);
    });
}

// Computes the method's image, and filters a larger one to the display.
static ss_status compute(Step& step) {
    if (!step.model.method->larger) return step.model.method->compute(step);
    const Target shown = step.target;
    const Size large = step.buffers.display;
    DownsampleWork& w = step.buffers.downsampling;
    ss_image image = {}, plane = {};
    image.data = const_cast<float*>(w.image);
    plane.data = shown.weight ? step.buffers.weight : nullptr;
    step.target = {view_of(image, large.width, 3), view_of(plane, large.width, 1), large.width, large.height, 1.0f};
    ss_status status = step.model.method->compute(step);
    step.target = shown;
    if (status != SS_OK) return status;
    w.exposure = step.samples().exposure;
    w.target = shown;
    step.workers().run_rows(shown.height, [&](int y0, int y1, int thread) {
        step.kernels().downsample_rows(w, y0, y1, thread);
        if (shown.weight)
            step.kernels().pick_pixels(step.buffers.weight, large, shown.weight, {shown.width, shown.height}, y0, y1);
    });
    return SS_OK;
}

// Gives the step an image of packed floats, as the mean at rest is blended with it, unless that of the caller is one.
static bool take_readable_image(Step& step) {
    Target& to = step.target;
    if (to.image.type == SS_FLOAT32 && to.image.is_packed<float>(3) && to.pre_exposure == 1.0f) return true;
    float*& image = step.buffers.image;
    if (!image) image = step.buffers.arena.take<float>(static_cast<size_t>(3) * to.width * to.height);
    if (!image) return false;
    ss_image packed = {};
    packed.data = image;
    to.image = view_of(packed, to.width, 3);
    to.pre_exposure = 1.0f;
    return true;
}

// Finds static blocks and the tiles to compute. `before` is the history's, or an empty one of this render size.
static bool plan_rest(Step& step, const RestHistory& before, bool compute_all, bool& computes) {
    RestWork& w = step.buffers.rest;
    if (!compare_with_rest(step, w, before, step.after.rest)) return false;
    step.rest = &w;
    computes = plan_tiles(step, w, compute_all);
    if (w.blocks.is_active && !take_readable_image(step)) return false;
    w.image = step.target.image;
    return true;
}

// Writes 0 to an image of one channel; no image is nothing to do.
static void write_zeros(const Step& step, const View& image) {
    const size_t bytes = image.type == SS_FLOAT32 ? 4 : image.type == SS_FLOAT16 ? 2 : 1;
    for (int y = 0; y < step.target.height && image; y++)
        for (int x = 0; x < step.target.width; x++)
            memset(const_cast<char*>(image.data) + y * image.row + x * image.pixel, 0, bytes);
}

// Makes every tile one to compute.
static void plan_whole(Step& step) {
    RestWork& w = step.buffers.rest;
    const Size tiles = tiles_of(step.buffers.display);
    const size_t count = static_cast<size_t>(tiles.width) * tiles.height;
    memset(w.computed, 1, count);
    memset(w.resting, 0, count);
    make_runs(w.computed, tiles, 1, w.runs);
    make_runs(w.computed, tiles, 1, w.halo_runs);
}

// The method's image and next history, of the tiles to compute.
static ss_status compute_tiles(Step& step) {
    memcpy(step.after.jitter, step.frame.jitter, sizeof step.after.jitter);
    step.after.exposure = step.exposure;
    step.clock.enter(SS_PREPROCESS);
    return compute(step);
}

static ss_status run_stages(Step& step, const ss_outputs& outputs) {
    RestWork& w = step.buffers.rest;
    const Target own = step.target;
    const bool rests = step.model.method->layout.rests;
    read_samples(step);
    step.exposure = exposure_of(step.frame, step.samples(), step.before.exposure);
    step.samples().exposure = fabsf(step.exposure);
    w.samples = step.samples();
    const int64_t generation = __atomic_add_fetch(&step.model.generation, 1, __ATOMIC_RELAXED);
    RestHistory& after = step.after.rest;
    const RestHistory* before = &step.before.rest;
    Arena room(step.model.arena.allocator());
    RestHistory forgotten = {};  // of another render size; its arrays are in `room`
    bool computes = true;
    if (rests) {
        step.clock.enter(SS_REST);
        if (!(before->render == after.render)) {
            forgotten.take(room, after.display, after.render);
            if (room.failed()) return SS_NO_MEMORY;
            forgotten.mean = before->mean, forgotten.generations = before->generations;
            before = &forgotten;
        }
        if (!plan_rest(step, *before, outputs.compute_all || outputs.weight.data, computes)) return SS_NO_MEMORY;
    } else plan_whole(step);
    if (computes)
        if (ss_status status = compute_tiles(step)) return status;
    step.clock.enter(SS_REST);
    keep_tiles(step, generation, computes);
    step.after.render = {step.frame.width, step.frame.height};
    const View converged = view_of(outputs.converged, own.width, 1);
    if (!step.model.method->layout.planes) write_zeros(step, own.weight);  // without a history
    if (!rests) {
        write_zeros(step, converged);
        return SS_OK;
    }
    if (!show_rest(step, w, *before, after, generation)) return SS_NO_MEMORY;
    if (step.target.image.data != own.image.data) copy_image(step, step.target.image, own.image, own.pre_exposure);
    if (converged)
        step.workers().run_rows(own.height,
                                [&](int y0, int y1, int) { step.kernels().write_converged(w, converged, y0, y1); });
    return SS_OK;
}

ss_status check_step(const Model& model, const StepCall& call, ss_error* error) {
    const auto& [frame, before, after, outputs] = call;
    const Size render = {frame.width, frame.height}, display = before.image;
    if (&before.model != &model || &after.model != &model)
        return fail(error, SS_BAD_ARGUMENT, "%s is of another model; want histories of this one",
                    &before.model != &model ? "history" : "next_history");
    if (ss_status status = check_frame(*model.method, frame, display, error)) return status;
    if (!(after.image == display) || &before == &after)
        return fail(error, SS_BAD_ARGUMENT, "next_history is %s; want another history of the same display size",
                    &before == &after ? "the history itself" : "of another display size");
    if (!after.fits(render))
        return fail(error, SS_BAD_ARGUMENT, "next_history is for frames of %d x %d; want %d x %d", after.render.width,
                    after.render.height, render.width, render.height);
    if (!outputs.image.data) return fail(error, SS_BAD_ARGUMENT, "image has no data; want an image to write to");
    if (ss_status status = check_output("image", outputs.image, display, 3, error)) return status;
    if (ss_status status = check_output("weight", outputs.weight, display, 1, error)) return status;
    if (ss_status status = check_output("converged", outputs.converged, display, 1, error)) return status;
    return check_apart(call, call, error);
}

ss_status check_apart(const StepCall& call, const StepCall& other, ss_error* error) {
    const ss_outputs &own = call.outputs, &outputs = other.outputs;
    const ss_frame& f = other.frame;
    const Given written[] = {{"image", own.image.data}, {"weight", own.weight.data}, {"converged", own.converged.data}};
    const Given read[] = {{"color", f.color.data},
                          {"depth", f.depth.data},
                          {"motion", f.motion.data},
                          {"reactive", f.reactive.data},
                          {"base_color", f.base_color.data},
                          {"normal", f.normal.data},
                          {"display_base_color", f.display_base_color.data},
                          {"display_normal", f.display_normal.data},
                          {"display_depth", f.display_depth.data}};
    if (&call == &other) return check_memory(written, read, error);
    const char* const whose = " of another view";
    const Given theirs[] = {
        {"image", outputs.image.data}, {"weight", outputs.weight.data}, {"converged", outputs.converged.data}};
    if (ss_status status = check_memory(written, theirs, error, whose)) return status;
    return check_memory(written, read, error, whose);
}

ss_status run_step(Model& model, const StepCall& call, Canceller& canceller, bool alone) {
    const auto& [frame, before, after, outputs] = call;
    const Size display = before.image;
    StepBuffers* buffers = model.borrow({frame.width, frame.height}, display);
    if (!buffers) return SS_NO_MEMORY;
    const float pre_exposure = frame.pre_exposure > 0.0f ? frame.pre_exposure : 1.0f;
    Target target = {view_of(outputs.image, display.width, 3), view_of(outputs.weight, display.width, 1), display.width,
                     display.height, pre_exposure};
    const IeeeArithmetic arithmetic;
    Step step = {model, frame, *buffers, before, after, target, {model.pool, canceller, alone}};
    const ss_status status = run_stages(step, outputs);
    if (outputs.seconds) step.clock.read(outputs.seconds);
    model.give_back(buffers);
    return status;
}

ss_status fail_in_view(int view, ss_status status, ss_error* error) {
    if (!error) return status;
    const ss_error plain = *error;
    return fail(error, status, "view %d: %s", view, plain.message);
}

}  // namespace ss
