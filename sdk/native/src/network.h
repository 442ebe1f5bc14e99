// The int8 network of the classifiers, and the data of its kernels. A packed pixel is 2x2 display pixels.
#pragma once

#include "work.h"

namespace ss {

constexpr int HISTORY_VALUES = 6;
constexpr int LEVELS = 4;
constexpr int KEPT[LEVELS] = {16, 8, 4, 4};  // bytes that each level has for a packed pixel among the decoder's 32
constexpr int INPUT_PLANES = 16;             // network inputs of a display pixel, one byte each
constexpr int RECORD_WORDS = 18;   // words of a packed pixel: INPUT_PLANES, then two of inputs at half display size
constexpr int BLOCK_OUTPUTS = 32;  // outputs of a layer that are computed at once
constexpr int WIDE = 16;           // words of the hidden layer's output
constexpr int PIXELS_AT_ONCE = 6;  // pixels that a layer computes at once
constexpr int ROOM = 16;           // spare pixels after a row, because of that
constexpr int ALIGNED = 8;         // sizes are multiples of it: the deepest level has 1/8 of the packed size
constexpr int BAND = 2 * ALIGNED;  // rows of the image that are computed at once: of a row of the deepest level

// A layer. weights: of blocks of BLOCK_OUTPUTS outputs, of words of four inputs, four bytes for each output.
struct Layer {
    const int8_t* weights;
    const float *scale, *bias;  // of the sums of each output
    int blocks, words, outputs;
};

// A level of the encoder. x: output of the first layer, (kept, x_row / x_pitch, x_pitch) bytes with a column on either side;
// out: (kept, ...) of the level.
struct Level {
    Layer first, spatial, last;
    int width, height;
    int kept;    // rows that x and out have; row y is at y % kept
    int inputs;  // channels that are pooled from the level above
    uint8_t* x;
    int x_pitch, x_row, channels;
    uint8_t* out;
    int out_pitch, out_row;

    uint8_t* x_at(int y) const { return x + static_cast<ptrdiff_t>(y % kept) * x_row; }
    uint8_t* out_at(int y) const { return out + static_cast<ptrdiff_t>(y % kept) * out_row; }
};

struct Network {
    Level level[LEVELS];
    Layer decoder, hidden, blend;
    int logits;          // first byte of the hidden layer's output that is a class logit
    float logits_scale;  // of these bytes
    // network inputs of packed pixels: (kept, row, RECORD_WORDS) words, and mean differences between history and frame,
    // signed and absolute: (kept, 2, means_pitch) with PAD columns on either side; row y is at y % kept
    int32_t* records;
    float* means;  // null where the records are complete
    Size half;
    int row, means_pitch, kept;
    uint8_t* lines;  // of each thread, `line_pitch` bytes apart
    size_t line_pitch;
    const uint8_t* zeros;  // a row of any level, above and below the image

    int32_t* records_at(int y) const { return records + static_cast<ptrdiff_t>(y % kept) * row * RECORD_WORDS; }
    float* means_at(int y, int plane) const {
        return means + (2 * static_cast<ptrdiff_t>(y % kept) + plane) * means_pitch;
    }
};

// A variant of the classifier: its planes and parameters.
struct Variant {
    bool rectified, own_motion, guided;
    constexpr int mean() const { return 14; }  // first plane of `rest` with mean and half extent of the box, YCoCg
    constexpr int own() const { return mean() + 6 * rectified; }      // history warped by the pixel's own motion
    constexpr int sampled() const { return own() + 3 * own_motion; }  // 1 where a sample around is usable, else 0
    constexpr int planes() const { return sampled() + guided; }
    constexpr int history_colors() const { return 1 + rectified + own_motion; }
    constexpr int sharpness() const { return history_colors() + 3; }
    constexpr int kernel_weights() const { return sharpness() + 1; }
    constexpr int parameters() const { return kernel_weights() + 9; }
    constexpr int outputs() const { return up_to(4 * parameters(), 8); }
};

// Values gathered for the compositor, by groups of W pixels of a row: (kept, pitch / W, planes, W); row y is at y % kept.
struct Gathered {
    int pitch, kept;
    float* history;    // toned RGB of the reprojected history: rounding to half floats would accumulate
    uint16_t* rest;    // half floats, see `Variant`
    float* luma;       // (kept, PAD + pitch + PAD) of the reprojected history
    uint8_t* samples;  // (kept, pitch) luma of the sample, a network input
    uint16_t* image;   // (kept, 3, PAD + pitch + PAD) toned guided colour; only of the variant `guided`
    float* rising;     // (height, pitch / LANES) number of pixels that count towards FLASH_FRACTION
    uint16_t* rises;   // (height, pitch / 4) of groups of W pixels a bit for each where light rises, see `confirm_none`

    ptrdiff_t place(int y) const { return static_cast<ptrdiff_t>(y % kept) * pitch; }
    ptrdiff_t padded(int y) const { return static_cast<ptrdiff_t>(y % kept) * (pitch + 2 * PAD) + PAD; }
};

struct ClassifierScratch {
    double spent[SS_STAGES];  // seconds
    float* places;            // positions of a row's pixels in the previous frame
    uint8_t* inputs;          // two rows of network inputs, INPUT_PLANES planes each
    float* differences;       // luma of the history minus that of the frame, two rows
    float* lines;             // filtered samples
    float *tall[2], *line;    // rows of means
    uint8_t *read, *decoded, *hidden;
    float* blend;  // rows of blend parameters and logits
};

struct ClassifierWork {
    Samples samples;
    Tables tables;
    classifier::Config config;
    const float* history;    // (display height, display width, HISTORY_VALUES) linear RGB, count, luma range
    const uint8_t* classes;  // (half height, half width, 8) class probabilities; 255 is one
    PreviousFrame previous;  // of two channels: depth, and occluding depth
    float* next_history;
    uint8_t* next_classes;
    float* next_depth;
    Target target;
    Gathered gathered;
    Guide guide;  // of the variant `guided`
    Network* network;
    WarpScratch* warps;
    ClassifierScratch* scratch;
    bool glares;        // whether the frame or the history may have light over GLARE_EXPOSED
    bool* next_glares;  // set where a pixel of the next history has counts of frames with such light
    bool flash;         // whether all light of the frame is unconfirmed
};

}  // namespace ss
