// Finds static blocks and frozen tiles, and shows the mean of static pixels; the same as supersampler_model.ops.at_rest.
#include "step.h"

#include <math.h>

namespace ss {

// Histories ---------------------------------------------------------------------------------------------------------

void RestHistory::take(Arena& arena, Size of_display, Size of_render) {
    display = of_display, render = of_render, blocks = blocks_of(render);
    phase_count = phases_of(display, render);
    ages = arena.take<float>(count());
    tests = arena.take<float>(static_cast<size_t>(3) * count());
    phases = arena.take<float[4]>(phase_count);
    signatures = arena.take<Signature*>(phase_count);
    mean = nullptr;
    generations = arena.take<int64_t>(static_cast<size_t>(tiles_of(display).width) * tiles_of(display).height);
}

Signature* new_signature(const Allocator& allocator, int blocks) {
    const size_t bytes = sizeof(Signature) + sizeof(float) * 4 * blocks;
    Signature* made = static_cast<Signature*>(allocator.take(bytes));
    if (made) *made = {1, bytes};
    return made;
}

static void release(const Allocator& allocator, Signature* signature) {
    if (signature && __atomic_sub_fetch(&signature->references, 1, __ATOMIC_ACQ_REL) == 0)
        allocator.give_back(signature, signature->bytes);
}

static void share(const Allocator& allocator, Signature*& to, Signature* signature) {
    if (signature) __atomic_add_fetch(&signature->references, 1, __ATOMIC_RELAXED);
    release(allocator, to);
    to = signature;
}

void RestHistory::release(const Allocator& allocator) {
    for (int k = 0; signatures && k < phase_count; k++) {
        ss::release(allocator, signatures[k]);
        signatures[k] = nullptr;
    }
}

// Work buffers ------------------------------------------------------------------------------------------------------

// Takes the block of each of the pixels of an axis; after them is room for `spare` more.
static const int32_t* take_blocks(Arena& arena, int pixels, int samples, int spare = 0) {
    int32_t* const blocks = arena.take<int32_t>(pixels + spare);
    for (int x = 0; blocks && x < pixels; x++) blocks[x] = block_of(x, pixels, samples);
    return blocks;
}

// Takes the pixel nearest to each of the samples of an axis; after them is room for `spare` more.
static const int32_t* take_nearest(Arena& arena, int pixels, int samples, int spare = 0) {
    int32_t* const nearest = arena.take<int32_t>(samples + spare);
    for (int x = 0; nearest && x < samples; x++)
        nearest[x] =
            static_cast<int32_t>(min<int64_t>((2 * int64_t{x} + 1) * pixels / (2 * int64_t{samples}), pixels - 1));
    return nearest;
}

// Takes the weights of a block's values in the last of a signature, (BLOCK, 3, LANES): rows of blocks side by side.
static const float* take_order_weights(Arena& arena) {
    float* const weights = arena.take<float>(BLOCK * 3 * LANES);
    for (int k = 0; weights && k < 3 * BLOCK * BLOCK; k++) {  // of channel, row and column of a block
        const float place = static_cast<float>(ORDER_FACTOR * k * k * k % ORDER_PRIME);
        const float weight = (2.0f * place / (ORDER_PRIME - 1) - 1.0f) / (BLOCK * BLOCK);
        const int c = k / (BLOCK * BLOCK), row = k / BLOCK % BLOCK, column = k % BLOCK;
        for (int x = column; x < LANES; x += BLOCK) weights[(row * 3 + c) * LANES + x] = weight;
    }
    return weights;
}

static void take_block_values(Arena& arena, StaticBlocks& s, int phases) {
    const size_t count = static_cast<size_t>(s.count());
    uint8_t** masks[] = {&s.moving, &s.known, &s.changed, &s.restarts, &s.moves, &s.is_static, &s.verifies,
                         &s.adds,   &s.stays, &s.freezes, &s.selected, &s.spare, &s.modes};
    for (uint8_t** mask : masks) *mask = arena.take<uint8_t>(count);
    s.ages = arena.take<float>(count), s.shares = arena.take<float>(count), s.complete = arena.take<float>(count);
    s.tests = arena.take<float>(3 * count), s.signature = arena.take<float>(4 * count);
    s.sums = arena.take<float>(SUMS * count), s.windows = arena.take<float>(10 * count);
    s.phases = arena.take<float[4]>(phases);
}

bool make_rest(StepBuffers& buffers, RestWork& w) {
    const Size render = buffers.render, display = buffers.image_size, own = buffers.display;
    const int phases = phases_of(display, render);
    Arena& arena = buffers.arena;
    w.display = display;
    w.blocks.size = blocks_of(render);
    take_block_values(arena, w.blocks, phases);
    w.row_blocks = take_blocks(arena, display.height, render.height);
    w.column_blocks = take_blocks(arena, display.width, render.width, LANES);
    w.own_row_blocks = take_blocks(arena, own.height, render.height);
    w.own_column_blocks = take_blocks(arena, own.width, render.width);
    w.nearest_rows = take_nearest(arena, display.height, render.height);
    w.nearest_columns = take_nearest(arena, display.width, render.width, LANES);
    w.order_weights = take_order_weights(arena);
    const auto integers = [&](int n) { return arena.take<int32_t>(n); };
    const auto floats = [&](size_t n) { return arena.take<float>(n); };
    w.pixel_rows = integers(2 * render.height), w.pixel_columns = integers(2 * render.width);
    w.pixel_row_weights = floats(2 * render.height), w.pixel_column_weights = floats(2 * render.width);
    w.sample_rows = integers(2 * display.height), w.sample_columns = integers(2 * display.width);
    w.sample_row_weights = floats(2 * display.height), w.sample_column_weights = floats(2 * display.width);
    w.row_pitch = up_to(display.height, LANES), w.column_pitch = up_to(display.width, LANES);
    w.row_moments = floats(static_cast<size_t>(2) * phases * w.row_pitch);
    w.column_moments = floats(static_cast<size_t>(2) * phases * w.column_pitch);
    const size_t tiles = static_cast<size_t>(tiles_of(own).width) * tiles_of(own).height;
    uint8_t** tile_masks[] = {&w.tiles, &w.computed, &w.gathered, &w.resting, &w.stale};
    for (uint8_t** mask : tile_masks) *mask = arena.take<uint8_t>(tiles);
    Runs* const all_runs[] = {&w.runs, &w.halo_runs, &w.copy_runs};
    for (Runs* runs : all_runs) runs->rects = arena.take<Rect>(tiles + 1);
    w.scaled = arena.take<Rect>(tiles + 1);
    return !arena.failed();
}

// Samples around pixels ---------------------------------------------------------------------------------------------

// The two samples around a pixel along an axis, their weights, and their offsets from the pixel in display pixels.
static void samples_around(int pixel, int render, int display, float jitter, int32_t (&sample)[2], float (&weight)[2],
                           float (&offset)[2]) {
    const float scale = static_cast<float>(static_cast<double>(display) / render);
    const float place =
        (static_cast<float>(pixel) + 0.5f) * static_cast<float>(render) / static_cast<float>(display) - 0.5f - jitter;
    for (int k = 0; k < 2; k++) {
        const float at = floorf(place) + static_cast<float>(k);
        offset[k] = (at - place) * scale;
        const bool inside = at >= 0.0f && at <= static_cast<float>(render - 1);
        weight[k] = inside ? clamp((OUTER - fabsf(offset[k])) / (OUTER - INNER), 0.0f, 1.0f) : 0.0f;
        sample[k] = clamp(static_cast<int32_t>(at), 0, render - 1);
    }
}

static void make_sample_tables(RestWork& w, const float (&jitter)[2]) {
    const int render[] = {w.samples.width, w.samples.height}, display[] = {w.display.width, w.display.height};
    int32_t* const samples[] = {w.sample_columns, w.sample_rows};
    float* const weights[] = {w.sample_column_weights, w.sample_row_weights};
    for (int axis = 0; axis < 2; axis++)
        for (int x = 0; x < display[axis]; x++) {
            int32_t sample[2];
            float weight[2], offset[2];
            samples_around(x, render[axis], display[axis], jitter[axis], sample, weight, offset);
            memcpy(samples[axis] + 2 * x, sample, sizeof sample);
            memcpy(weights[axis] + 2 * x, weight, sizeof weight);
        }
}

static void make_pixel_tables(RestWork& w, const float (&jitter)[2]) {
    const int render[] = {w.samples.width, w.samples.height}, display[] = {w.display.width, w.display.height};
    int32_t* const pixels[] = {w.pixel_columns, w.pixel_rows};
    float* const weights[] = {w.pixel_column_weights, w.pixel_row_weights};
    for (int axis = 0; axis < 2; axis++)
        for (int x = 0; x < render[axis]; x++) {
            const float position = (static_cast<float>(x) + 0.5f + jitter[axis]) * static_cast<float>(display[axis]) /
                                       static_cast<float>(render[axis]) -
                                   0.5f;
            const float first = floorf(position);
            for (int k = 0; k < 2; k++)
                pixels[axis][2 * x + k] = clamp(static_cast<int32_t>(first) + k, 0, display[axis] - 1);
            weights[axis][2 * x] = 1.0f - (position - first);
            weights[axis][2 * x + 1] = position - first;
        }
}

// Weights of the samples near pixels in each phase of the cycle, and weights times offsets.
static void make_moments(RestWork& w) {
    const StaticBlocks& s = w.blocks;
    const int render[] = {w.samples.width, w.samples.height}, display[] = {w.display.width, w.display.height};
    w.phases = 0;
    for (int k = 0; k < phases_of(w.display, {render[0], render[1]}); k++) {
        if (!(s.phases[k][2] > 0.0f && s.phases[k][2] <= s.cycle.period)) continue;
        for (int axis = 0; axis < 2; axis++) {
            const int pitch = axis ? w.row_pitch : w.column_pitch;
            float* moments = (axis ? w.row_moments : w.column_moments) + static_cast<ptrdiff_t>(2) * w.phases * pitch;
            for (int x = 0; x < display[axis]; x++) {
                int32_t sample[2];
                float weight[2], offset[2];
                samples_around(x, render[axis], display[axis], s.phases[k][axis], sample, weight, offset);
                moments[x] = weight[0] + weight[1];
                moments[pitch + x] = weight[0] * offset[0] + weight[1] * offset[1];
            }
        }
        w.phases++;
    }
}

// Masks -------------------------------------------------------------------------------------------------------------

static bool any(const uint8_t* mask, int count) { return memchr(mask, 1, static_cast<size_t>(count)) != nullptr; }
static bool every(const uint8_t* mask, int count) { return memchr(mask, 0, static_cast<size_t>(count)) == nullptr; }

// Replaces each value of a plane by the largest within `reach` rows and columns; `spare` has the size of the plane.
template <class T>
static void dilate(T* plane, T* spare, Size size, int reach) {
    for (int y = 0; y < size.height; y++)
        for (int x = 0; x < size.width; x++) {
            T found = plane[y * size.width + x];
            for (int k = max(x - reach, 0); k <= min(x + reach, size.width - 1); k++)
                found = max(found, plane[y * size.width + k]);
            spare[y * size.width + x] = found;
        }
    for (int y = 0; y < size.height; y++)
        for (int x = 0; x < size.width; x++) {
            T found = spare[y * size.width + x];
            for (int k = max(y - reach, 0); k <= min(y + reach, size.height - 1); k++)
                found = max(found, spare[k * size.width + x]);
            plane[y * size.width + x] = found;
        }
}

static void dilate_mask(uint8_t* mask, uint8_t* spare, Size size, int reach) {
    if (any(mask, size.width * size.height)) dilate(mask, spare, size, reach);
}

// Marks the tiles of an image with a pixel of a marked block; row_blocks and column_blocks: block of each row and column.
static void any_in_tiles(const uint8_t* blocks, int across, Size image, const int32_t* row_blocks,
                         const int32_t* column_blocks, uint8_t* tiles) {
    const Size size = tiles_of(image);
    for (int ty = 0; ty < size.height; ty++)
        for (int tx = 0; tx < size.width; tx++) {
            uint8_t found = 0;
            const int top = row_blocks[ty * TILE], bottom = row_blocks[min(ty * TILE + TILE, image.height) - 1];
            const int left = column_blocks[tx * TILE], right = column_blocks[min(tx * TILE + TILE, image.width) - 1];
            for (int y = top; y <= bottom && !found; y++) found = any(blocks + y * across + left, right - left + 1);
            tiles[ty * size.width + tx] = found;
        }
}
static void any_in_tiles(const RestWork& w, const uint8_t* blocks, uint8_t* tiles) {
    any_in_tiles(blocks, w.blocks.size.width, w.display, w.row_blocks, w.column_blocks, tiles);
}

void make_runs(uint8_t* mask, Size tiles, int gap, Runs& runs) {
    runs.count = 0;
    int first_of_rows = 0;  // runs that end at the row before
    for (int y = 0; y < tiles.height; y++) {
        uint8_t* row = mask + y * tiles.width;
        for (int x = 0, last = -1; x < tiles.width; x++) {
            if (!row[x]) continue;
            if (last >= 0 && x - last - 1 < gap) memset(row + last, 1, static_cast<size_t>(x - last));
            last = x;
        }
        if (y && memcmp(row, row - tiles.width, static_cast<size_t>(tiles.width)) == 0) {
            for (int k = first_of_rows; k < runs.count; k++) runs.rects[k].y1 = y + 1;
            continue;
        }
        first_of_rows = runs.count;
        for (int x = 0; x < tiles.width; x++) {
            if (!row[x]) continue;
            int end = x;
            while (end < tiles.width && row[end]) end++;
            runs.rects[runs.count++] = {y, y + 1, x, end};
            x = end;
        }
    }
}

// Comparison --------------------------------------------------------------------------------------------------------

// Finds a jitter in the table of phases: see `follow_jitter` of the torch module.
static Cycle follow_jitter(const float (&jitter)[2], const float (*phases)[4], int count, bool sampled, bool noisy,
                           float (*next)[4]) {
    Cycle cycle = {};
    float best = -4.0f * OLDEST, last_period = 0.0f;
    bool found = false;
    for (int k = 0; k < count; k++) {
        const bool seen = phases[k][2] > 0.0f;
        const bool same = seen && fabsf(phases[k][0] - jitter[0]) + fabsf(phases[k][1] - jitter[1]) < 1e-6f;
        const float rank = (same ? 4.0f * OLDEST : seen ? phases[k][2] : 2.0f * OLDEST) - static_cast<float>(k);
        if (rank > best) best = rank, cycle.slot = k, found = same;
        if (phases[k][2] == 1.0f) last_period += phases[k][3];
    }
    cycle.age = found ? phases[cycle.slot][2] : 0.0f;
    cycle.counts = sampled && (cycle.age != 1.0f || noisy);
    cycle.period = cycle.age > 0.0f && cycle.counts ? cycle.age : last_period;
    memcpy(next, phases, sizeof(float[4]) * static_cast<size_t>(count));
    if (cycle.counts) {
        for (int k = 0; k < count; k++)
            if (next[k][2] > 0.0f) next[k][2] = min(next[k][2] + 1.0f, OLDEST);
        const float seen[4] = {jitter[0], jitter[1], 1.0f, cycle.period};
        memcpy(next[cycle.slot], seen, sizeof seen);
    }
    return cycle;
}

static bool differs(const float* a, const float* b, int count, int block, float dark_root) {
    float level = dark_root, apart = 0.0f;
    for (int c = 0; c < 4; c++) {
        const float x = a[c * count + block], y = b[c * count + block];
        if (c < 3) level = max(level, max(x, y));
        apart = max(apart, fabsf(x - y));
    }
    return apart > TOLERANCE * level;
}

// Moments over a window of blocks of the sums of residuals: see `Windows` of the torch module.
struct Window {
    float samples, level, residuals[3], square, variance, contrast;
};

// Returns the moments of the window of `side` blocks that a block is in. At the edges, blocks are repeated.
static Window window_at(const StaticBlocks& s, int side, int by, int bx) {
    const int across = s.size.width, down = s.size.height, count = s.count();
    float sums[SUMS] = {};
    for (int y = by / side * side; y < by / side * side + side; y++)
        for (int x = bx / side * side; x < bx / side * side + side; x++)
            for (int k = 0; k < SUMS; k++)
                sums[k] += s.sums[k * count + min(y, down - 1) * across + min(x, across - 1)];
    Window w = {};
    const float share = 1.0f / max(sums[0], 1e-6f);
    w.samples = sums[0];
    float colors = 0.0f;
    for (int c = 0; c < 3; c++) {
        w.residuals[c] = sums[1 + c] * share;
        w.square += w.residuals[c] * w.residuals[c];
        colors += sums[4 + c] * share * (sums[4 + c] * share);
        w.level = c ? max(w.level, sums[7 + c] * share) : sums[7] * share;
    }
    w.variance = max(sums[10] * share - w.square, 0.0f);
    w.contrast = max(sums[11] * share - colors, 0.0f);
    return w;
}

static float excess(float square, float variance, float ratio, const Window& w, float dark) {
    const float level = (w.level + dark) * (w.level + dark);
    return clamp((square - ratio * variance) / level - FLICKER * FLICKER, -OLDEST, OLDEST);
}

static void sum_residuals(Step& step, RestWork& w, const RestHistory& before) {
    StaticBlocks& s = w.blocks;
    if (!before.mean) {
        memset(s.sums, 0, sizeof(float) * SUMS * static_cast<size_t>(s.count()));
        return;
    }
    make_pixel_tables(w, step.frame.jitter);
    w.mean = before.mean, w.ages = before.ages;
    step.workers().run_rows(s.size.height, [&](int y0, int y1, int) { step.kernels().sum_blocks(w, y0, y1); });
}

// Adds the excess of residuals over the limits to the tests of blocks that verify their mean; see `steadiness` in torch.
static void test_steadiness(Step& step, RestWork& w, const RestHistory& before, float dark) {
    StaticBlocks& s = w.blocks;
    const int count = s.count(), across = s.size.width;
    // large windows that contain a small one that is read
    memcpy(s.selected, s.verifies, static_cast<size_t>(count));
    dilate_mask(s.selected, s.spare, s.size, SMALL_WINDOW);
    for (int wy = 0; wy < s.size.height; wy += LARGE_WINDOW)
        for (int wx = 0; wx < across; wx += LARGE_WINDOW) {
            const int rows = min(LARGE_WINDOW, s.size.height - wy), columns = min(LARGE_WINDOW, across - wx);
            bool read = false;
            for (int y = 0; y < rows; y++) read |= any(s.selected + (wy + y) * across + wx, columns);
            for (int y = 0; y < rows; y++)
                for (int x = 0; x < columns; x++) {
                    const int block = (wy + y) * across + wx + x;
                    s.selected[block] = read && before.ages[block] != 0.0f;
                }
        }
    sum_residuals(step, w, before);
    float *uniform = s.windows, *contrast = s.windows + count, *spare = s.windows + 2 * count;
    for (int by = 0; by < s.size.height; by += SMALL_WINDOW)
        for (int bx = 0; bx < across; bx += SMALL_WINDOW) {
            const Window small = window_at(s, SMALL_WINDOW, by, bx);
            const float over = excess(small.square, small.variance, UNIFORM, small, dark);
            for (int k = 0; k < SMALL_WINDOW * SMALL_WINDOW; k++) {
                const int y = by + k / SMALL_WINDOW, x = bx + k % SMALL_WINDOW;
                if (y >= s.size.height || x >= across) continue;
                uniform[y * across + x] = over;
                contrast[y * across + x] = small.contrast;
            }
        }
    dilate(uniform, spare, s.size, SMALL_WINDOW);
    dilate(contrast, spare, s.size, SMALL_WINDOW);
    Window large = {};
    int last = -1;  // large window whose moments these are
    const int windows_across = divided_up(across, LARGE_WINDOW);
    for (int block = 0; block < count; block++) {
        if (!s.verifies[block]) continue;
        const int by = block / across, bx = block % across,
                  window = by / LARGE_WINDOW * windows_across + bx / LARGE_WINDOW;
        if (window != last) large = window_at(s, LARGE_WINDOW, by, bx), last = window;
        const Window small = window_at(s, SMALL_WINDOW, by, bx);
        const float partial = excess(small.square, small.variance, PARTIAL, small, dark);
        const float sparkling = max(small.contrast - SPARKLING * small.level * small.level, 0.0f);
        const float explained = small.contrast + BESIDE * contrast[block] + (1.0f / UNRESOLVED - 1.0f) * sparkling;
        s.tests[block] = before.tests[block] + min(uniform[block], partial);
        s.tests[count + block] =
            before.tests[count + block] + excess(large.square, large.variance, COMMON, large, dark);
        s.tests[2 * count + block] =
            before.tests[2 * count + block] + excess(small.variance, explained, UNRESOLVED, small, dark);
    }
}

// Marks noisy blocks whose running mean of relative residuals is more than noise; writes that mean to `tests`.
static void follow_noise(Step& step, RestWork& w, const RestHistory& before, float dark) {
    StaticBlocks& s = w.blocks;
    const int count = s.count();
    memset(s.selected, 1, static_cast<size_t>(count));
    sum_residuals(step, w, before);
    const float frames = NOISE_RATE / (2.0f - NOISE_RATE);
    for (int block = 0; block < count; block++) {
        const Window window = window_at(s, SMALL_WINDOW, block / s.size.width, block % s.size.width);
        float drift = 0.0f;
        for (int c = 0; c < 3; c++) {
            const float old = before.tests[c * count + block], relative = window.residuals[c] / (window.level + dark);
            const float now = window.samples > 0.0f ? old + NOISE_RATE * (relative - old) : 0.0f;
            s.tests[c * count + block] = now;
            drift = max(drift, fabsf(now));
        }
        const float noise = sqrtf(window.variance * frames / max(window.samples, 1.0f)) / (window.level + dark);
        s.changed[block] = drift > NOISE_FLICKER + NOISE_SIGMAS * noise;
    }
}

// Whether the pixels nearest to the samples of a block have enough samples.
static bool has_enough(const RestWork& w, const float* mean, int by, int bx) {
    for (int y = by * BLOCK; y < min(by * BLOCK + BLOCK, w.samples.height); y++)
        for (int x = bx * BLOCK; x < min(bx * BLOCK + BLOCK, w.samples.width); x++)
            if (!(mean[4 * (static_cast<ptrdiff_t>(w.nearest_rows[y]) * w.display.width + w.nearest_columns[x]) + 3] >=
                  LEAST_WEIGHT))
                return false;
    return true;
}

// Decides which blocks are shown and frozen, and writes the next history except for its mean.
static bool decide(const Step& step, RestWork& w, const RestHistory& before, RestHistory& after) {
    StaticBlocks& s = w.blocks;
    const Cycle& cycle = s.cycle;
    const int count = s.count();
    const Allocator& allocator = step.model.arena.allocator();
    s.shows = s.is_active = s.any_freezes = false;
    bool all_kept = true;
    for (int block = 0; block < count; block++) {
        const float periods = cycle.period > 0.0f ? s.ages[block] / max(cycle.period, 1.0f) : 0.0f;
        const bool steady =
            max(max(s.tests[block], s.tests[count + block]), s.tests[2 * count + block]) <= 0.0f && s.is_static[block];
        const float fade =
            steady && !s.adds[block] ? clamp((periods - SHOWN_FROM) / (SHOWN - SHOWN_FROM), 0.0f, 1.0f) : 0.0f;
        s.shares[block] = s.noisy ? (s.ages[block] > 0.0f ? -1.0f : 0.0f) : s.stays[block] ? 2.0f : fade;
        const bool due = s.verifies[block] && periods >= 2.0f;
        const bool freezes =
            due && steady && (!before.mean || has_enough(w, before.mean, block / s.size.width, block % s.size.width));
        s.freezes[block] = freezes;
        const float age = due && !freezes ? cycle.period : s.ages[block];
        after.ages[block] = s.stays[block] || freezes ? 0.0f - age : age;
        for (int c = 0; c < 3; c++) after.tests[c * count + block] = due ? 0.0f : s.tests[c * count + block];
        s.complete[block] = (s.stays[block] || periods >= 1.0f) && !s.noisy ? 1.0f : 0.0f;
        s.shows |= s.shares[block] != 0.0f;
        s.is_active |= s.ages[block] != 0.0f;
        s.any_freezes |= freezes;
        all_kept &= (s.known[block] && s.is_static[block]) || s.moves[block];
    }
    memcpy(after.phases, s.phases, sizeof(float[4]) * static_cast<size_t>(after.phase_count));
    for (int k = 0; k < after.phase_count; k++) share(allocator, after.signatures[k], before.signatures[k]);
    if (!cycle.counts || all_kept) return true;
    Signature* made = new_signature(allocator, count);
    if (!made) return false;
    Signature* reference = before.signatures[cycle.slot];
    for (int block = 0; block < count; block++) {
        const bool kept = reference && s.known[block] && s.is_static[block];
        for (int c = 0; c < 4; c++)
            made->values()[c * count + block] = (kept ? reference->values() : s.signature)[c * count + block];
    }
    release(allocator, after.signatures[cycle.slot]);
    after.signatures[cycle.slot] = made;
    return true;
}

bool compare_with_rest(Step& step, RestWork& w, const RestHistory& before, RestHistory& after) {
    StaticBlocks& s = w.blocks;
    const int count = s.count();
    const float dark = DARK / w.samples.exposure;
    const bool sampled = step.frame.adds_samples >= 1.0f;
    s.noisy = step.frame.adds_samples >= NOISY;
    s.cycle = follow_jitter(step.frame.jitter, before.phases, before.phase_count, sampled, s.noisy, s.phases);
    step.workers().run_rows(s.size.height, [&](int y0, int y1, int) { step.kernels().sign_blocks(w, y0, y1); });
    bool has_mean = false;
    for (int block = 0; block < count; block++) {
        const float age = fabsf(before.ages[block]);
        s.known[block] = age >= s.cycle.age && s.cycle.age > 0.0f && sampled && !s.noisy;
        s.changed[block] = 0;
        has_mean |= before.ages[block] != 0.0f;
    }
    memcpy(s.tests, before.tests, sizeof(float) * 3 * static_cast<size_t>(count));
    Signature* reference = before.signatures[s.cycle.slot];
    if (s.noisy && has_mean) follow_noise(step, w, before, dark);
    else if (!s.noisy && reference && s.cycle.age > 0.0f && sampled) {
        const float dark_root = static_cast<float>(pow(dark, 0.25));
        for (int block = 0; block < count; block++)
            s.changed[block] = s.known[block] && !s.moving[block] &&
                               differs(s.signature, reference->values(), count, block, dark_root);
    }
    for (int block = 0; block < count && sampled; block++)
        s.changed[block] |= before.ages[block] < 0.0f && !s.known[block];
    memcpy(s.restarts, s.changed, static_cast<size_t>(count));
    memcpy(s.moves, s.moving, static_cast<size_t>(count));
    dilate_mask(s.restarts, s.spare, s.size, 1);
    dilate_mask(s.moves, s.spare, s.size, 1);
    bool verifies = false;
    for (int block = 0; block < count; block++) {
        const bool frozen = before.ages[block] < 0.0f, is_static = !s.moves[block] && !s.restarts[block];
        s.is_static[block] = is_static;
        s.verifies[block] = s.known[block] && is_static && !frozen && s.cycle.counts;
        s.adds[block] = !s.moves[block] && (s.restarts[block] || !s.known[block]) && s.cycle.counts;
        s.stays[block] = frozen && is_static;
        const float age = (is_static ? fabsf(before.ages[block]) : 0.0f) + (s.cycle.counts ? 1.0f : 0.0f);
        s.ages[block] = s.moves[block] ? 0.0f : min(age, OLDEST);
        verifies |= s.verifies[block];
        const bool keeps = is_static && (s.noisy || !s.cycle.counts);  // where the frame confirms no mean
        for (int c = 0; c < 3 && !keeps; c++) s.tests[c * count + block] = 0.0f;
    }
    if (verifies && !s.noisy) test_steadiness(step, w, before, dark);
    return decide(step, w, before, after);
}

bool plan_tiles(const Step& step, RestWork& w, bool compute_all) {
    const Size tiles = tiles_of(step.buffers.display);
    const size_t count = static_cast<size_t>(tiles.width) * tiles.height;
    StaticBlocks& s = w.blocks;
    for (int block = 0; block < s.count(); block++) s.spare[block] = !s.stays[block];
    any_in_tiles(s.spare, s.size.width, step.buffers.display, w.own_row_blocks, w.own_column_blocks, w.tiles);
    for (size_t k = 0; k < count; k++) {
        w.resting[k] = !w.tiles[k];
        w.computed[k] = compute_all || w.tiles[k];
    }
    make_runs(w.computed, tiles, 3, w.runs);
    memcpy(w.gathered, w.computed, count);
    if (w.runs.count && !every(w.gathered, static_cast<int>(count))) dilate_mask(w.gathered, w.stale, tiles, 2);
    make_runs(w.gathered, tiles, 3, w.halo_runs);
    return w.runs.count > 0;
}

bool show_rest(Step& step, RestWork& w, const RestHistory& before, RestHistory& after, int64_t generation) {
    StaticBlocks& s = w.blocks;
    const Size tiles = tiles_of(w.display);
    const int count = tiles.width * tiles.height;
    if (!s.is_active) return true;
    const bool same = before.render == after.render;
    bool adds = false, differ = false;
    for (int block = 0; block < s.count(); block++) {
        const bool had = same && before.ages[block] != 0.0f;
        s.modes[block] = s.adds[block]          ? (s.is_static[block] && had ? ADDS : RESTARTS)
                         : s.ages[block] > 0.0f ? KEEPS
                                                : NO_MEAN;
        s.spare[block] = s.adds[block] | s.freezes[block];
        adds |= s.spare[block] != 0;
    }
    for (int k = 0; k < count; k++) differ |= after.generations[k] != before.generations[k];
    Arena& arena = step.after.arena;
    if (!after.mean) after.mean = arena.take<float>(static_cast<size_t>(4) * w.display.width * w.display.height);
    if (!after.mean) return false;
    w.next_mean = after.mean;
    w.mean = before.mean ? before.mean : after.mean;  // where no block has a mean, nothing of it is read
    if (adds || differ) {
        make_sample_tables(w, step.frame.jitter);
        any_in_tiles(w, s.spare, w.tiles);
        for (int block = 0; block < s.count(); block++) s.selected[block] = s.modes[block] != NO_MEAN;
        any_in_tiles(w, s.selected, w.stale);
        for (int k = 0; k < count; k++) {
            const bool stale = w.stale[k] && after.generations[k] != before.generations[k];
            if (w.tiles[k]) after.generations[k] = generation;
            else if (stale) after.generations[k] = before.generations[k];
            w.stale[k] = w.tiles[k] || stale;
        }
        make_runs(w.stale, tiles, 1, w.copy_runs);
        run_tiles(step, w.copy_runs, TILE, w.display, [&](Rect rect, int) { step.kernels().add_samples(w, rect); });
    }
    if (!s.shows) return true;
    bool fades = false;
    for (int block = 0; block < s.count(); block++) {
        s.spare[block] = s.shares[block] != 0.0f;
        fades |= s.shares[block] > 0.0f && s.shares[block] <= 1.0f;
    }
    w.phases = 0;
    if (fades) make_moments(w);
    any_in_tiles(w, s.spare, w.tiles);
    make_runs(w.tiles, tiles, 1, w.copy_runs);
    run_tiles(step, w.copy_runs, TILE, w.display, [&](Rect rect, int) { step.kernels().show_mean(w, rect); });
    if (!s.any_freezes) return true;
    any_in_tiles(w, s.freezes, w.tiles);
    make_runs(w.tiles, tiles, 1, w.copy_runs);
    run_tiles(step, w.copy_runs, TILE, w.display, [&](Rect rect, int) { step.kernels().freeze_mean(w, rect); });
    return true;
}

}  // namespace ss
