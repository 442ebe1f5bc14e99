// Convergence of static blocks; the same as supersampler_model.ops.at_rest.
//
// Blocks of BLOCK x BLOCK samples are numbered row by row. Images are skipped by tiles of TILE x TILE display pixels.
#pragma once

#include "work.h"

namespace ss {

struct Model;
struct StepBuffers;

// of a block: samples; residuals, RGB; samples, RGB; mean there, RGB; squares of the first two
constexpr int SUMS = 12;
enum Mode : uint8_t { NO_MEAN, KEEPS, ADDS, RESTARTS };  // of a block's mean: it stays, takes samples, begins with them

// A signature of all blocks, (4, blocks), which histories share; never written again.
struct Signature {
    int references;
    size_t bytes;
    float* values() { return reinterpret_cast<float*>(this + 1); }
};

constexpr int phases_of(Size display, Size render) {
    return static_cast<int>(int64_t{PHASES_PER_SAMPLE} * display.width * display.height /
                            (int64_t{render.width} * render.height)) +
           SPARE_PHASES;
}
constexpr int block_of(int pixel, int display, int render) {
    return static_cast<int>(min<int64_t>((2 * int64_t{pixel} + 1) * render / (2 * int64_t{BLOCK} * display),
                                         divided_up(render, BLOCK) - 1));
}
// The number of pixels before a block: those p with block_of(p) < block.
constexpr int pixels_before(int block, int display, int render) {
    return static_cast<int>(
        min<int64_t>((2 * int64_t{BLOCK} * block * display + render - 1) / (2 * int64_t{render}), display));
}
constexpr Size blocks_of(Size render) { return {divided_up(render.width, BLOCK), divided_up(render.height, BLOCK)}; }
constexpr Size tiles_of(Size display) { return {divided_up(display.width, TILE), divided_up(display.height, TILE)}; }

// The part of a history that concerns static blocks.
struct RestHistory {
    Size display, render, blocks;
    int phase_count;
    float* ages;             // of blocks: frames since a block changed, negative where it is frozen
    float* tests;            // (3, blocks) sums of three tests
    float (*phases)[4];      // jitter x and y, frames since it was last seen, frames between its last two
    Signature** signatures;  // of each phase, or null
    float* mean;             // (height, width, 4) linear RGB, sum of weights; null before the first samples
    int64_t* generations;    // of tiles; in two histories equal ones mean an equal mean

    void take(Arena& arena, Size display, Size render);
    void release(const Allocator& allocator);
    int count() const { return blocks.width * blocks.height; }
};

Signature* new_signature(const Allocator& allocator, int blocks);  // null: no memory

// Rectangles of tiles that cover a mask.
struct Runs {
    Rect* rects;
    int count;
};

// The jitter of a frame: see `Cycle` of the torch module.
struct Cycle {
    int slot;
    float age, period;
    bool counts;
};

// Masks and values of each block of a frame; the same as `StaticBlocks` in ops/at_rest.py.
struct StaticBlocks {
    Size size;
    Cycle cycle;
    bool noisy;
    uint8_t *moving, *known, *changed, *restarts, *moves, *is_static, *verifies, *adds, *stays, *freezes, *selected,
        *spare;
    uint8_t* modes;
    float *ages, *tests, *shares, *complete, *signature, *sums, *windows;
    float (*phases)[4];
    bool shows, is_active, any_freezes;

    int count() const { return size.width * size.height; }
};

// Data of the at-rest kernels.
struct RestWork {
    Samples samples;
    StaticBlocks blocks;
    Size display;
    const int32_t *row_blocks, *column_blocks;          // block of each row and column of the display
    const int32_t *own_row_blocks, *own_column_blocks;  // of what the method keeps, which may be larger
    const int32_t *nearest_rows, *nearest_columns;      // pixels nearest to samples
    int32_t *pixel_rows, *pixel_columns;                // (n, 2) pixels around samples, and their weights
    float *pixel_row_weights, *pixel_column_weights;
    int32_t *sample_rows, *sample_columns;  // (n, 2) samples around pixels, and their weights
    float *sample_row_weights, *sample_column_weights;
    // (phases, 2, n) weight of the samples near each row or column in each phase of the cycle, and this times their offset
    float *row_moments, *column_moments;
    int row_pitch, column_pitch;
    int phases;
    const float* order_weights;  // (BLOCK, 3, LANES) weights of values in the last of a signature
    const float* ages;           // of the history; where 0, there is no mean
    const float* mean;
    float* next_mean;
    View image;
    uint8_t *tiles, *computed, *gathered, *resting, *stale;  // masks of tiles
    Runs runs, halo_runs, copy_runs;                         // of tiles: to compute, to gather, others
    Rect* scaled;
};

}  // namespace ss
