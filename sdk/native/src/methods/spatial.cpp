// `bilinear` and `bicubic`: each frame by itself.
#include "../step.h"

namespace ss {

template <FilterKind kind>
static void add_filters(const Model&, Tables& tables) {
    tables.add({kind});
}

static bool make_buffers(const Model& model, StepBuffers& buffers) {
    SpatialWork* work = buffers.arena.take<SpatialWork>(1);
    if (!work) return false;
    work->planes = buffers.rows_of_samples(3, buffers.samples.pitch);
    work->lines = buffers.arena.take<float>(static_cast<size_t>(model.pool.threads()) * 3 * buffers.samples.pitch);
    buffers.own = work;
    return true;
}

static ss_status compute(Step& step) {
    SpatialWork& work = *static_cast<SpatialWork*>(step.buffers.own);
    step.samples().exposure = 1.0f;  // missing samples are filled with the grey of an exposure of 1
    fill_missing(step);
    make_tables(step);
    work.samples = step.samples(), work.tables = step.buffers.tables, work.target = step.target;
    step.workers().run_rows(step.frame.height, [&](int y0, int y1, int) { step.kernels().spatial_read(work, y0, y1); });
    step.clock.enter(SS_FINISH);
    run_tiles(step, computed_tiles(step), TILE, step.buffers.display,
              [&](Rect rect, int thread) { step.kernels().spatial_rows(work, rect, thread); });
    return SS_OK;
}

extern const Method BILINEAR = {.name = "bilinear",
                                .ratios = {1, 4},
                                .add_filters = add_filters<LINEAR>,
                                .make_buffers = make_buffers,
                                .compute = compute};
extern const Method BICUBIC = {.name = "bicubic",
                               .ratios = {1, 4},
                               .add_filters = add_filters<CUBIC>,
                               .make_buffers = make_buffers,
                               .compute = compute};

}  // namespace ss
