// AOVs at display size, blended by the weights of the colour.
#include "step.h"

namespace ss {

static ss_status check(const ss_aovs& v, ss_error* error) {
    if (ss_status status = check_size(v.width, v.height, "the frame", error)) return status;
    if (ss_status status = check_size(v.display_width, v.display_height, "the display", error)) return status;
    if (v.channels < 1 || v.channels > MAX_CHANNELS)
        return fail(error, SS_BAD_ARGUMENT, "channels is %d; want 1 to %d", v.channels, MAX_CHANNELS);
    if (!v.aovs || !v.depth || !v.motion || !v.image)
        return fail(error, SS_BAD_ARGUMENT, "an array is NULL; only previous and weight may be");
    return check_jitter(v.jitter, error);
}

// Checks that a view writes to no array that it reads or that another one, if it is another, uses.
static ss_status check_apart(const ss_aovs& v, const ss_aovs& other, ss_error* error) {
    if (v.image == other.previous)
        return fail(error, SS_BAD_ARGUMENT, "image is that of the previous frame; want other memory");
    const bool same = &v == &other;
    return check_memory({{"image", v.image}},
                        {{"image", same ? nullptr : other.image},
                         {"aovs", other.aovs},
                         {"depth", other.depth},
                         {"motion", other.motion},
                         {"weight", other.weight}},
                        error, same ? "" : " of another view");
}

// Runs after the checks. Returns false where there is no memory.
static bool blend(Model& model, const ss_aovs* views, int count) {
    Arena arena(model.arena.allocator());
    AovWork* works = arena.take<AovWork>(count);
    size_t line_pitch = 0;
    for (int k = 0; k < count && works; k++) {
        const ss_aovs& v = views[k];
        works[k].view = &v;
        works[k].tables.add({GAUSSIAN, aovs::SIGMA});
        take_axes(arena, works[k].tables, {v.width, v.height}, {v.display_width, v.display_height});
        if (arena.failed()) return false;
        model.kernels->make_tables(works[k].tables, v.jitter[0], v.jitter[1]);
        line_pitch = max(line_pitch, AovWork::line_values(v));
    }
    const int threads = model.pool.threads();
    float* lines = arena.take<float>(3 * line_pitch * threads);
    WarpScratch* scratch = arena.take<WarpScratch>(threads);
    if (arena.failed()) return false;
    for (int k = 0; k < count; k++)
        works[k].lines = lines, works[k].line_pitch = line_pitch, works[k].scratch = scratch;
    run_views(&model, views, count,
              [&](int view, int y0, int y1, int thread) { model.kernels->blend_aovs(works[view], y0, y1, thread); });
    return true;
}

}  // namespace ss

using namespace ss;

ss_status ss_blend_aovs(ss_model* model, const ss_aovs* views, int count, ss_error* error) {
    if (ss_status status = check_given({{"model", model}}, error)) return status;
    if (ss_status status = check_views(views, count, check, check_apart, error)) return status;
    const IeeeArithmetic arithmetic;
    if (!blend(*reinterpret_cast<Model*>(model), views, count)) return fail(error, SS_NO_MEMORY, "no memory for AOVs");
    return succeed(error);
}
