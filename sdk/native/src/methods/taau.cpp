// `taau`, temporal upsampling without a network.
#include "../step.h"

namespace ss {

using namespace taau;

constexpr int LINES = 20;

static const Filter* filters(const Model& model, Filter* room, int* count, float*) {
    const Config& c = model.config_of<Config>();
    const Filter made[] = {{GAUSSIAN, c.frame_sigma},         {CUBIC},
                           {LINE_MEAN, c.moment_sigma},       {GAUSSIAN, c.sample_sigma, true},
                           {LINE_SLOPE, c.moment_sigma},      {LINE_SHIFT, c.moment_sigma}};
    *count = sizeof made / sizeof *made;
    memcpy(room, made, sizeof made);
    return room;
}

static bool make_space(const Model& model, Space& space) {
    TaauWork* work = space.arena.take<TaauWork>(1);
    if (!work) return false;
    work->sums = space.rows_of_samples(1, 2);
    work->line_pitch = static_cast<size_t>(LINES) * space.samples.pitch + LANES;
    work->lines = space.arena.take<float>(work->line_pitch * model.pool.threads());
    space.own = work;
    return true;
}

// Writes `history.light`; same as `light_after` of the torch module.
static void write_light(const Step& step, const TaauWork& work) {
    const float *before = step.before.values;
    float* light = step.after.values;
    const double mean = before[0], flashes = before[3], change = work.change;
    const double slope = change / ((1.0 + (change - 1.0) * mean) * (1.0 + (change - 1.0) * mean));
    const double last = slope * slope * before[1], older = slope * slope * before[2];
    double sums[2] = {};
    for (int y = 0; y < step.frame.height; y++)
        for (int k = 0; k < 2; k++) sums[k] += work.sums[2 * y + k];
    for (int k = 0; k < 2; k++) light[k] = static_cast<float>(sums[k] / (double{1} * step.frame.width * step.frame.height));
    const double known = flashes > 0.0 ? older : max(last, older);
    const bool flash = known > 0.0 && flashes < 2.0 && light[1] > FLASH * known + LEAST_FLASH;
    light[2] = static_cast<float>(max(last, FLASH_MEMORY * older));
    light[3] = static_cast<float>(flash * (flashes + 1.0));
}

static ss_status compute(Step& step) {
    TaauWork& work = *static_cast<TaauWork*>(step.space.own);
    const Kernels& kernels = step.kernels();
    make_tables(step);
    step.after.glares = resample(step) || (step.before.glares && rests_anywhere(step));
    const Samples& s = work.samples = step.samples();
    work.tables = step.space.tables, work.target = step.target, work.config = step.model.config_of<Config>();
    work.history = step.before.plane(0), work.next_history = step.after.plane(0);
    work.previous = previous_frame(step.before, 1);
    work.surface = step.after.plane(1);
    work.scratch = step.space.warps;
    work.change = step.before.exposure != 0.0f ? s.exposure / (step.before.exposure < 0.0f ? -step.before.exposure : step.before.exposure) : 1.0f;
    pool_of(step).run_rows(s.height, [&](int y0, int y1, int thread) { kernels.taau_shade(work, y0, y1, thread); });
    write_light(step, work);
    work.unconfirmed = step.after.values[3];
    work.glares = work.unconfirmed > 0.0f || step.after.glares || step.before.glares;
    work.kept = nullptr;
    run_tiles(step, computed_tiles(step), TILE, step.space.display, [&](Rect rect, int thread) { step.kernels().taau_rows(work, rect, thread); });
    return SS_OK;
}

static constexpr Layout LAYOUT = {
    .planes = 2,
    .tensors = 10,
    .plane = {{Extent::DISPLAY, 5, false}, {Extent::SAMPLES, 4, false}},
    .tensor = {{"color", 3, 0, 0}, {"samples", 2, 0, 3}, {"surface", 3, 1, 0}, {"jitter", 2, OF_JITTER, 0},
               {"exposure", 1, OF_EXPOSURE, 0}, {"light", 4, OF_VALUES, 0}, SS_REST_TENSORS},
    .rests = true,
    .glare = "samples",
};
static constexpr Config CONFIG;
extern const Method TAAU = {"taau", {1, 4}, true, true, LAYOUT, CONSTANTS, sizeof CONSTANTS / sizeof(Constant), &CONFIG,
                            filters, make_space, compute, nullptr};

}  // namespace ss
