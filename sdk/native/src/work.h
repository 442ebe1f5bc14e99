// Arguments of kernels: images of the caller, the samples of a frame, resampling tables, outputs.
//
// Kernels are compiled for several instruction sets (see kernels/simd.h); `Kernels` has those of one.
#pragma once

#include "core.h"

namespace ss {

// Planes of a row of samples.
enum SamplePlane { TONED, USABLE = 3, LUMA = 4, SQUARES = 7, SAMPLE_PLANES = 10 };

// An image of the caller, all strides known; in bytes.
struct View {
    const char* data;
    ss_type type;
    ptrdiff_t row, pixel, channel;

    explicit operator bool() const { return data; }
    // Whether each row is an array of T: packed, and at an address that is a multiple of its size.
    template <class T>
    bool is_packed(int channels) const {
        return channel == sizeof(T) && pixel == static_cast<ptrdiff_t>(channels * sizeof(T)) &&
               (reinterpret_cast<uintptr_t>(data) | static_cast<uintptr_t>(row)) % alignof(T) == 0;
    }
};

// Facts about a row of samples.
struct RowFacts {
    float logs, lit;      // sum of log luminance over the lit samples, and their number
    float brightest;      // largest linear value
    bool misses, reacts;  // whether a sample is missing, or reactive
};

// The samples of a frame. Rows are padded: those of `stride` values to whole vectors, those of `pitch` values are PAD +
// stride + PAD, where the padding repeats the border.
struct Samples {
    int width, height, stride, pitch;
    int kept;       // rows that the four arrays below that name them have; row y is at `place(y)`
    float* linear;  // (height, 3, stride) linear RGB without pre-exposure, in [0, MAX_HALF]; NaN where missing
    float *depth, *motion_x, *motion_y;  // (height, pitch) sanitized; depth is UNKNOWN_DEPTH where it is not usable
    float* reactive;                     // (height, stride) reactive mask; negative where the colour is missing
    RowFacts* rows;                      // (height,)
    float* color;         // (kept, SAMPLE_PLANES, pitch) toned RGB, 1 where usable, YCoCg, squares of YCoCg
    float* eroded_depth;  // (kept, pitch) the farthest of 3x3
    float* dilated;       // (kept, stride, 4) depth and motion of the closest of 2x2
    float* own;           // (kept, stride, 4) motion of the sample itself, range of depth in 3x3 samples, 1 where
                          // one of these is over GLARE_TONED
    float* fill;          // (down, across, 6) of each FILL_WINDOW: values of its missing samples, linear and toned
    int fill_across;      // windows in a row; 0 where no sample is missing
    bool has_reactive;
    float exposure;

    ptrdiff_t place(int y) const { return y % kept; }
    // Whether samples of rows first to last may be over GLARE_TONED.
    bool may_glare(int first, int last) const {
        bool found = false;
        for (int y = max(first, 0); y <= min(last, height - 1); y++)
            found |= rows[y].brightest * exposure > GLARE_EXPOSED - 1.0f;
        return found;
    }
};

// Input of `read_frame`.
struct FrameImages {
    View color, depth, motion, reactive;
    float pre_exposure;
    float* scratch;  // of each thread a row of packed values, `scratch_pitch` apart
    size_t scratch_pitch;
};

// G-buffers of a frame, prepared for the variant `guided` of the classifiers.
constexpr int SURFACE_PLANES = 9;
struct Guide {
    View base_color, normal;                  // of the frame's samples
    View display_base_color, display_normal;  // of display size, as the next
    View display_depth;
    float* samples;  // (kept rows of samples, SURFACE_PLANES, pitch) light, toned; normal and base colour, scaled
    float* depth;    // rows as `Gathered.luma`, UNKNOWN_DEPTH where it is not usable
    const uint8_t* before;  // (display height, display width, 4) reflectance of the history; 255 is one
    uint8_t* next;
    float normal_scale, color_scale;  // of features; their squared distance is an exponent
    float depth_scale;                // of the squared relative difference of depth
    float min_reflectance;
    float* scratch;  // of each thread rows of packed values, `scratch_pitch` apart
    size_t scratch_pitch;
};

// A separable filter of the four samples around a display pixel.
enum FilterKind { LINEAR, CUBIC, DISTANCE, GAUSSIAN, LINE_MEAN, LINE_SLOPE, LINE_SHIFT };
// DISTANCE is not a filter: it stores the distances of the samples.
constexpr int MAX_FILTERS = 5;
struct Filter {
    FilterKind kind;
    float sigma = 0.0f;
    bool scaled = false;  // whether distances are in display pixels, not in samples
};

// The samples that the pixels of an axis read, and their weights. Arrays are padded to `pitch`.
struct Axis {
    int pixels, samples, pitch;
    int32_t* start;    // the sample at or before a pixel's position, -1 before the first
    int32_t* nearest;  // the nearest sample
    float* weights;    // (filters, 4, pitch) of samples start - 1 to start + 2
    float* windows;    // (3, pitch) Gaussian weights of the three samples around the nearest, or null
    const float* tap(int filter, int k) const { return weights + (4 * filter + k) * pitch; }
    int clamped(int sample) const { return clamp(sample, 0, samples - 1); }
};

struct Tables {
    Axis x, y;
    Filter filters[MAX_FILTERS];
    int filter_count;
    float window_sigma;  // of `Axis.windows`; 0: there are none
    void add(Filter filter) { filters[filter_count++] = filter; }
};

// The images that a step writes.
struct Target {
    View image;   // 3 channels
    View weight;  // 1 channel, or none
    int width, height;
    float pre_exposure;
};

// Scratch of one thread for warps: 16 slots of a vector's offsets and weights, warped pixels, filtered lines.
struct WarpScratch {
    alignas(LINE) int32_t offsets[16][LANES];
    alignas(LINE) float weights[16][LANES];
    alignas(LINE) float pixels[LANES * LANES];
};

struct TaaWork {
    Samples samples;
    float* planes;  // (height, TAA_PLANES, pitch) toned YCoCg, motion in render pixels, 1 where usable
    float* boxes;   // (height, TAA_BOX, stride) low corner, high corner, longest motion
    Tables tables;
    const float* history;  // (display height, display width, 3)
    float* next_history;
    Target target;
    float alpha, gamma;
    WarpScratch* scratch;
};
constexpr int TAA_PLANES = 6, TAA_BOX = 8;

// The previous frame, whose surfaces tests compare with.
struct PreviousFrame {
    const float* plane;  // (height, pitch, channels), see the kernels that write it
    int width, height, pitch;
    float jitter[2];
};

struct TaauWork {
    Samples samples;
    Tables tables;
    const float* history;  // (display height, display width, 5) linear RGB, samples, power
    float* next_history;
    PreviousFrame previous;  // occluding depth
    float* surface;          // the same of this frame, written to
    float* shades;  // (height, stride, 4) of 3x3 samples: mean and deviation of toned luma, whether they are on a
                    // plane, [0, 1], 1 where one is over GLARE_EXPOSED
    float* cells;   // of each thread CELL_ROWS rows of cells of 2x2 samples, see `Changes`
    int cells_across, cells_down, cells_pitch;
    float jitter[2];
    float* sums;  // (height, 2) sums of each row's means and squared deviations
    Target target;
    taau::Config config;
    float change;       // exposure over the previous exposure
    bool unconfirmed;   // whether the light of this whole frame is
    bool glares;        // whether any light may be unconfirmed
    const float* kept;  // (blocks down, kept_pitch) number of samples that are kept, by column of the display; or null
    const int32_t* kept_rows;
    float* kept_room;
    int kept_pitch;
    const int32_t *nearest_rows, *nearest_columns;  // pixels nearest to samples
    float* block_sums;                              // (6, blocks_down, blocks_pitch)
    int blocks_across, blocks_down, blocks_pitch;
    WarpScratch* scratch;
    float* lines;  // of each thread, `line_pitch` apart, TAAU_LINES rows of filtered samples
    size_t line_pitch;
};
constexpr int CELL_ROWS = 15;

struct SpatialWork {
    Samples samples;
    float* planes;  // (height, 3, pitch) linear RGB, missing samples filled
    Tables tables;
    Target target;
    float* lines;  // of each thread three filtered rows
};

// The filter from a larger image to the display; the same as `downsample` of supersampler_model.ops.sampling.
struct DownsampleWork {
    const float* image;  // (height, width, 3)
    Size size;
    int32_t *rows, *columns;  // (TAPS, pitch) pixels that are read, and their weights
    float *row_weights, *column_weights;
    int row_pitch, column_pitch;
    // of each thread, `scratch_pitch` apart: RING rows of the image, and one more, of four values per pixel
    float* scratch;
    size_t scratch_pitch;
    float exposure;
    Target target;
};
constexpr int TAPS = 2 * classifier_large::REACH, RING = 8;  // a power of two, more than TAPS

// Data of `guided-warp`. `previous` is the frame before the unshaded one, shaded or not.
constexpr int WARP_PLANES = 10;
struct WarpWork {
    guided_warp::Config config;
    const float *across, *down;  // offsets of the samples among which a pixel chooses, ring by ring
    const int* strides;          // distance of each ring
    int rings;
    Size frame, shaded, previous;
    View base_color, normal, depth, own_motion;
    View shaded_color, shaded_base_color, shaded_normal, shaded_depth, previous_motion;
    float jitter[2], shaded_jitter[2], previous_jitter[2];
    float pre_exposure, shaded_pre_exposure;
    float* samples;  // (WARP_PLANES, shaded height, stride) of the shaded frame: guides of surfaces, light
    int stride;
    float* rows;    // (shaded height,) 1 where a depth of the row is usable
    float* motion;  // (2, previous height, previous_stride) from the previous frame back to the shaded one, sanitized
    int previous_stride;
    float* previous_rows;   // (previous height,) 1 where something of the row moved
    bool has_depth, moved;  // whether any row is
    View color, next_motion;
    float* scratch;  // of each thread, `scratch_pitch` apart, packed rows
    size_t scratch_pitch;
};

// A depth buffer, and the coefficients of its motion. At (x, y) with depth d, counted from far_depth, the motion is N / W with
//     N = columns[0] d + columns[1] rows[0] + columns[2] in x,
//     N = rows[1] d + rows[2] columns[3] + rows[3] in y,
//     W = depth_w d + columns[4] + rows[4].
struct CameraMotion {
    static constexpr int BLOCK = 512, ROWS = 64;  // columns and rows of which there are coefficients
    View depth, motion;
    Size size;
    const float* columns;  // (5, BLOCK) of columns x0 to x1 - 1
    const float* rows;     // (rows, 5)
    float depth_w, far_depth;
    int x0, x1;
};
constexpr float CAMERA_BEHIND = 1e-6f;  // minimum W of a point in front of the previous camera

struct ClassifierWork;
struct RestWork;

// The temporal filter: see `ss_temporal`.
struct TemporalFilter {
    // BORDER: pixels around a tile that its patches reach
    static constexpr int TILE_ROWS = 32, TILE_COLUMNS = 128, BORDER = 4;
    static constexpr int SCRATCH = 32 * (TILE_ROWS + 2 * BORDER) * (TILE_COLUMNS + LANES);  // floats
    const ss_temporal_frame* frames;
    int previous, following, groups;
    float exposure, samples;
    Size size;
    float* image;
    float* const* aovs;
    float* scratch;
};

// AOVs of one view.
struct AovWork {
    static constexpr int BORDER = 2;  // samples beyond either end of a row that pixels read
    const ss_aovs* view;
    Tables tables;
    float* lines;  // of each thread three, `line_pitch` apart: filtered samples, their weights, motion of samples
    size_t line_pitch;
    WarpScratch* scratch;

    // Values of the longest line, and of a vector that begins in it.
    static size_t line_values(const ss_aovs& view) {
        return static_cast<size_t>(view.width + 2 * BORDER) * max(view.channels, 2) + LANES;
    }
};

// Name and parameters of each kernel.
// clang-format off
#define SS_KERNELS(kernel)                                                                                            \
    kernel(read_frame, (const FrameImages&, const Samples&, int y0, int y1, int thread))                              \
    kernel(fill_windows, (const Samples&, int y0, int y1))                                                            \
    kernel(prepare, (const Samples&, int y0, int y1))                                                                 \
    kernel(dilate, (const Samples&, int y0, int y1))                                                                  \
    kernel(make_tables, (const Tables&, float jitter_x, float jitter_y))                                              \
    kernel(spatial_read, (const SpatialWork&, int y0, int y1))                                                        \
    kernel(spatial_rows, (const SpatialWork&, Rect, int thread))                                                      \
    kernel(taa_read, (const TaaWork&, int y0, int y1))                                                                \
    kernel(taa_boxes, (const TaaWork&, int y0, int y1))                                                               \
    kernel(taa_rows, (const TaaWork&, Rect, int thread))                                                              \
    kernel(taau_shade, (const TaauWork&, int y0, int y1, int thread))                                                 \
    kernel(taau_compare, (const TaauWork&, int y0, int y1))                                                           \
    kernel(taau_rows, (const TaauWork&, Rect, int thread))                                                            \
    kernel(sign_blocks, (const RestWork&, int y0, int y1))                                                            \
    kernel(sum_blocks, (const RestWork&, int y0, int y1))                                                             \
    kernel(add_samples, (const RestWork&, Rect))                                                                      \
    kernel(show_mean, (const RestWork&, Rect))                                                                        \
    kernel(freeze_mean, (const RestWork&, Rect))                                                                      \
    kernel(downsample_rows, (const DownsampleWork&, int y0, int y1, int thread))                                      \
    kernel(copy_image, (const View& from, const View& to, int width, int y0, int y1, float factor))                   \
    kernel(pick_pixels, (const float* from, Size from_size, const View& to, Size size, int y0, int y1))               \
    kernel(write_converged, (const RestWork&, const View& image, int y0, int y1))                                     \
    kernel(warp_read_shaded, (const WarpWork&, int y0, int y1, int thread))                                           \
    kernel(warp_read_motion, (const WarpWork&, int y0, int y1, int thread))                                           \
    kernel(warp_rows, (const WarpWork&, int y0, int y1, int thread))                                                  \
    kernel(camera_motion_rows, (const CameraMotion&, int y0, int y1))                                                 \
    kernel(rgba_rows, (const View& image, uint8_t* pixels, ptrdiff_t row, int width, int y0, int y1, float* scratch)) \
    kernel(merge_row, (float* image, const float* other, const float* weight, const float* other_weight,              \
                       int width, float exposure))                                                                    \
    kernel(temporal_rows, (const TemporalFilter&, int y0, int y1))                                                    \
    kernel(blend_aovs, (const AovWork&, int y0, int y1, int thread))                                                  \
    kernel(nearest_motion_rows, (const float* depth, const float* motion, float* to, Size size, int y0, int y1))      \
    kernel(keep_depth, (const ClassifierWork&, int y0, int y1))                                                       \
    kernel(prepare_surfaces, (const ClassifierWork&, int y0, int y1, int thread))                                     \
    kernel(prepare_depth, (const ClassifierWork&, int y0, int y1, int thread))                                        \
    kernel(confirm_none, (const ClassifierWork&, Rect))                                                               \
    kernel(encode_first, (const ClassifierWork&, int depth, Rect, int thread))                                        \
    kernel(encode_others, (const ClassifierWork&, int depth, Rect, int thread))                                       \
    kernel(infer_rows, (const ClassifierWork&, int parameters, float* out, int y0, int y1))
// clang-format on

struct Kernels {
    const char* name;
#define SS_MEMBER(name, parameters) void(*name) parameters;
    SS_KERNELS(SS_MEMBER)
#undef SS_MEMBER
    // by variant: 1 of own_motion, 2 of rectified; 4 of guided, which has own_motion, and 1 of rectified
    void (*const* classifier_gather)(const ClassifierWork&, Rect, int thread);
    void (*const* classifier_finish)(const ClassifierWork&, Rect, int thread);
};

// Returns the kernels for instructions by name, of those that this CPU has; for null the best ones. Null: none.
const Kernels* find_kernels(const char* name);

}  // namespace ss
