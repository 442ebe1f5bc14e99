// `taau`, temporal upsampling without a network.
#include "../step.h"

#include <math.h>

namespace ss {

using namespace taau;

constexpr int LINES = 12;

static void add_filters(const Model& model, Tables& tables) {
    const Config& c = model.config_of<Config>();
    tables.add({LINE_MEAN, c.moment_sigma});
    tables.add({GAUSSIAN, c.sample_sigma, true});
    tables.add({LINE_SLOPE, c.moment_sigma});
    tables.add({LINE_SHIFT, c.moment_sigma});
    tables.add({DISTANCE});
}

static bool make_buffers(const Model& model, StepBuffers& buffers) {
    TaauWork* work = buffers.arena.take<TaauWork>(1);
    if (!work) return false;
    work->sums = buffers.rows_of_samples(1, 2);
    work->shades = buffers.rows_of_samples(4, buffers.samples.stride);
    work->cells_across = divided_up(buffers.render.width, 2), work->cells_down = divided_up(buffers.render.height, 2);
    work->cells_pitch = up_to(work->cells_across, LANES) + 2 * PAD;
    work->cells = buffers.arena.take<float>(static_cast<size_t>(CELL_ROWS) * work->cells_pitch * model.pool.threads());
    work->line_pitch = static_cast<size_t>(LINES) * buffers.samples.pitch + LANES;
    work->lines = buffers.arena.take<float>(work->line_pitch * model.pool.threads());
    const Size blocks = blocks_of(buffers.render);
    work->blocks_across = blocks.width, work->blocks_down = blocks.height,
    work->blocks_pitch = up_to(blocks.width, LANES);
    work->block_sums = buffers.arena.take<float>(static_cast<size_t>(6) * blocks.height * work->blocks_pitch);
    work->kept_pitch = up_to(buffers.display.width, LANES);
    work->kept_room = buffers.arena.take<float>(static_cast<size_t>(blocks.height) * work->kept_pitch);
    buffers.own = work;
    return true;
}

// Writes `history.light`; same as `light_after` of the torch module.
static void write_light(const Step& step, const TaauWork& work) {
    const float* before = step.before.values;
    float* light = step.after.values;
    const double mean = before[0], flashes = before[3], change = work.change;
    const double slope = change / ((1.0 + (change - 1.0) * mean) * (1.0 + (change - 1.0) * mean));
    const double last = slope * slope * before[1], older = slope * slope * before[2];
    double sums[2] = {};
    for (int y = 0; y < step.frame.height; y++)
        for (int k = 0; k < 2; k++) sums[k] += work.sums[2 * y + k];
    for (int k = 0; k < 2; k++)
        light[k] = static_cast<float>(sums[k] / (double{1} * step.frame.width * step.frame.height));
    const double known = flashes > 0.0 ? older : max(last, older);
    const bool flash = known > NO_CONTRAST && flashes < 2.0 && light[1] > FLASH * known + LEAST_FLASH;
    light[2] = static_cast<float>(max(last, FLASH_MEMORY * older));
    light[3] = static_cast<float>(flash * (flashes + 1.0));
}

// Returns the number of samples of the history that a window of blocks keeps; MOST_SAMPLES where it keeps all.
static float kept_of(const TaauWork& work, const StaticBlocks& blocks, int wy, int wx) {
    constexpr float share = 1.0f / ((BLOCK / LAG_STEP) * (BLOCK / LAG_STEP));
    const ptrdiff_t plane = static_cast<ptrdiff_t>(work.blocks_down) * work.blocks_pitch;
    float difference[3] = {}, square[3] = {}, level[3] = {}, count = 0.0f;
    for (int y = wy; y < min(wy + LARGE_WINDOW, blocks.size.height); y++)
        for (int x = wx; x < min(wx + LARGE_WINDOW, blocks.size.width); x++) {
            if (!blocks.selected[y * blocks.size.width + x]) continue;
            const float* sums = work.block_sums + y * work.blocks_pitch + x;
            for (int c = 0; c < 3; c++) {
                const float apart = sums[c * plane] * share;
                difference[c] += apart;
                square[c] += apart * apart;
                level[c] += sums[(3 + c) * plane] * share;
            }
            count += 1.0f;
        }
    if (count < LEAST_BLOCKS * LARGE_WINDOW * LARGE_WINDOW) return MOST_SAMPLES;
    float lag = -MOST_SAMPLES, brightest = 0.0f;
    for (int c = 0; c < 3; c++) {
        const float mean = difference[c] / count, variance = max(square[c] / count - mean * mean, 0.0f);
        const float error = sqrtf(variance / max(count - 1.0f, 1.0f));
        lag = max(lag, fabsf(mean) - work.config.lag_deviations * error);
        brightest = max(brightest, level[c] / count);
    }
    const float excess = lag / (brightest + DARK) - work.config.lag, least = work.config.lag_samples / MOST_SAMPLES;
    return excess > least ? work.config.lag_samples / excess : MOST_SAMPLES;
}

// Compares blocks that stand but are not frozen with the history: where it lags behind, it keeps few samples.
static void limit_samples(Step& step, TaauWork& work) {
    const RestWork& rest = *step.rest;
    const StaticBlocks& blocks = rest.blocks;
    const int across = blocks.size.width, down = blocks.size.height;
    work.kept = nullptr;
    bool any = false;
    for (int block = 0; block < blocks.count(); block++) {
        blocks.selected[block] = !blocks.moves[block] && !blocks.stays[block];
        any |= blocks.selected[block] != 0;
    }
    if (!any) return;
    work.nearest_rows = rest.nearest_rows, work.nearest_columns = rest.nearest_columns,
    work.kept_rows = rest.row_blocks;
    step.workers().run_rows(down, [&](int y0, int y1, int) { step.kernels().taau_compare(work, y0, y1); });
    bool limits = false;
    float* const kept = blocks.windows;
    for (int wy = 0; wy < down; wy += LARGE_WINDOW)
        for (int wx = 0; wx < across; wx += LARGE_WINDOW) {
            const float number = kept_of(work, blocks, wy, wx);
            limits |= number < MOST_SAMPLES;
            for (int y = wy; y < min(wy + LARGE_WINDOW, down); y++)
                for (int x = wx; x < min(wx + LARGE_WINDOW, across); x++)
                    kept[y * across + x] = blocks.selected[y * across + x] ? number : MOST_SAMPLES;
        }
    if (!limits) return;
    work.kept = work.kept_room;
    for (int y = 0; y < down; y++)
        for (int x = 0; x < step.target.width; x++)
            work.kept_room[static_cast<size_t>(y) * work.kept_pitch + x] = kept[y * across + rest.column_blocks[x]];
}

static ss_status compute(Step& step) {
    TaauWork& work = *static_cast<TaauWork*>(step.buffers.own);
    const Kernels& kernels = step.kernels();
    make_tables(step);
    resample(step);
    step.after.glares = may_glare(step);
    const Samples& s = work.samples = step.samples();
    work.tables = step.buffers.tables, work.target = step.target, work.config = step.model.config_of<Config>();
    work.history = step.before.plane(0), work.next_history = step.after.plane(0);
    work.previous = previous_frame(step.before, 1);
    work.surface = step.after.plane(1);
    memcpy(work.jitter, step.frame.jitter, sizeof work.jitter);
    work.scratch = step.buffers.warps;
    work.change = step.before.exposure != 0.0f
                      ? s.exposure / (step.before.exposure < 0.0f ? -step.before.exposure : step.before.exposure)
                      : 1.0f;
    step.workers().run_rows(s.height, [&](int y0, int y1, int thread) { kernels.taau_shade(work, y0, y1, thread); });
    write_light(step, work);
    work.unconfirmed = step.after.values[3] > 0.0f;
    if (work.unconfirmed) step.after.glares |= step.before.glares;  // pixels keep their counts
    work.glares = work.unconfirmed || step.after.glares || step.before.glares;
    limit_samples(step, work);
    step.clock.enter(SS_FINISH);
    run_tiles(step, computed_tiles(step), TILE, step.buffers.display,
              [&](Rect rect, int thread) { step.kernels().taau_rows(work, rect, thread); });
    return SS_OK;
}

static constexpr Layout LAYOUT = {
    .planes = 2,
    .tensors = 10,
    .plane = {{Extent::DISPLAY, 5, false}, {Extent::SAMPLES, 1, false}},
    .tensor = {{"color", 3, 0, 0},
               {"samples", 2, 0, 3},
               {"surface", 1, 1, 0},
               {"jitter", 2, OF_JITTER, 0},
               {"exposure", 1, OF_EXPOSURE, 0},
               {"light", 4, OF_VALUES, 0},
               SS_REST_TENSORS},
    .rests = true,
    .glare = "samples",
};
extern const Method TAAU = {.name = "taau",
                            .ratios = {1, 4},
                            .reads_surfaces = true,
                            .reads_motion = true,
                            .layout = LAYOUT,
                            .constants = CONSTANTS,
                            .constant_count = sizeof CONSTANTS / sizeof(Constant),
                            .add_filters = add_filters,
                            .make_buffers = make_buffers,
                            .compute = compute};

}  // namespace ss
