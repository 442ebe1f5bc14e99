// `taa` (Salvi 2016), for its default options.
#include "../step.h"

namespace ss {

static void add_filters(const Model&, Tables& tables) { tables.add({LINEAR}); }

static bool make_buffers(const Model&, StepBuffers& buffers) {
    TaaWork* work = buffers.arena.take<TaaWork>(1);
    if (!work) return false;
    work->planes = buffers.rows_of_samples(TAA_PLANES, buffers.samples.pitch);
    work->boxes = buffers.rows_of_samples(TAA_BOX, buffers.samples.stride);
    buffers.own = work;
    return true;
}

static ss_status compute(Step& step) {
    TaaWork& work = *static_cast<TaaWork*>(step.buffers.own);
    const taa::Config& config = step.model.config_of<taa::Config>();
    fill_missing(step);
    make_tables(step);
    work.samples = step.samples(), work.tables = step.buffers.tables, work.target = step.target;
    work.history = step.before.plane(0), work.next_history = step.after.plane(0);
    work.alpha = step.before.exposure != 0.0f ? config.alpha : 1.0f;
    work.gamma = config.gamma;
    work.scratch = step.buffers.warps;
    run_rows_with_neighbours(
        step.workers(), step.frame.height, [&](int y0, int y1) { step.kernels().taa_read(work, y0, y1); },
        [&](int y0, int y1) { step.kernels().taa_boxes(work, y0, y1); });
    step.clock.enter(SS_FINISH);
    run_tiles(step, computed_tiles(step), TILE, step.buffers.display,
              [&](Rect rect, int thread) { step.kernels().taa_rows(work, rect, thread); });
    return SS_OK;
}

static constexpr Layout LAYOUT = {
    .planes = 1,
    .tensors = 2,
    .plane = {{Extent::DISPLAY, 3, false}},
    .tensor = {{"color", 3, 0, 0}, {"exposure", 1, OF_EXPOSURE, 0}},
    .rests = false,
    .glare = nullptr,
};
extern const Method TAA = {.name = "taa",
                           .ratios = {1, 4},
                           .reads_motion = true,
                           .layout = LAYOUT,
                           .constants = taa::CONSTANTS,
                           .constant_count = sizeof taa::CONSTANTS / sizeof(Constant),
                           .add_filters = add_filters,
                           .make_buffers = make_buffers,
                           .compute = compute};

}  // namespace ss
