/* Functions on images without a history: motion of a camera, bytes, merged and extrapolated frames. */
#include "input.h"

static void camera_motion(Input* in, int w, int h) {
    void* memory[2];
    double matrix[16];
    const float jitter[2] = {pick_float(in), pick_float(in)};
    ss_image depth = image_of(in, &memory[0], w, h, 1, 0, 0.1f), motion = image_of(in, &memory[1], w, h, 2, 1, 1.0f);
    for (int k = 0; k < 16; k++) matrix[k] = pick(in, 2) ? (double)pick_float(in) : k % 5 == 0;
    ss_camera_motion(&depth, w, h, matrix, pick_float(in), jitter, &motion, NULL);
    free(memory[0]);
    free(memory[1]);
}

static void encode_rgba(Input* in, int w, int h) {
    void* memory;
    ss_image image = image_of(in, &memory, w, h, 3, 0, 1.0f);
    const ptrdiff_t row = 4 * w + pick(in, 3);
    uint8_t* pixels = malloc((size_t)(row * h));
    const int upside_down = pick(in, 2);
    ss_encode_rgba(&image, w, h, upside_down ? pixels + row * (h - 1) : pixels, upside_down ? -row : row, NULL);
    free(pixels);
    free(memory);
}

static float* values_of(Input* in, size_t count, float scale) {
    float* values = malloc(count * sizeof *values);
    const int hostile = pick(in, 256);
    for (size_t k = 0; k < count; k++) values[k] = value_of(in, hostile, scale);
    return values;
}

static void merge(Input* in, int w, int h) {
    const size_t pixels = (size_t)w * h;
    float *image = values_of(in, 3 * pixels, 1.0f), *other = values_of(in, 3 * pixels, 1.0f);
    float *weight = values_of(in, pixels, 1.0f), *other_weight = values_of(in, pixels, 1.0f);
    ss_merge_images(image, other, weight, other_weight, w, h, pick_float(in), NULL);
    free(image), free(other), free(weight), free(other_weight);
}

static void scatter(Input* in, int w, int h) {
    ss_scatter s;
    memset(&s, 0, sizeof s);
    s.width = w, s.height = h, s.next_width = 1 + pick(in, 40), s.next_height = 1 + pick(in, 40);
    const size_t pixels = (size_t)w * h, next = (size_t)s.next_width * s.next_height;
    float *depth = values_of(in, pixels, 0.1f), *next_depth = values_of(in, next, 0.1f),
          *next_motion = values_of(in, 2 * next, 4.0f);
    float *motion = malloc(8 * pixels), *mismatch = malloc(4 * pixels);
    s.depth = depth, s.next_depth = next_depth, s.next_motion = next_motion;
    s.jitter[0] = pick_float(in), s.next_jitter[1] = pick_float(in);
    ss_scatter_motion(&s, motion, mismatch, NULL);
    free(depth), free(next_depth), free(next_motion), free(motion), free(mismatch);
}

static void extrapolate(Input* in, int w, int h) {
    static ss_model* model;
    ss_options options;
    ss_frame frame;
    ss_shaded shaded;
    ss_extrapolated outputs;
    ss_error error;
    void* memory[11] = {NULL};
    memset(&options, 0, sizeof options);
    memset(&frame, 0, sizeof frame);
    memset(&shaded, 0, sizeof shaded);
    memset(&outputs, 0, sizeof outputs);
    options.threads = 1;
    if (!model && ss_model_create("guided-warp", &options, &model, NULL) != SS_OK) abort();
    frame.width = w, frame.height = h;
    shaded.width = pick(in, 4) ? w : 1 + pick(in, 40), shaded.height = pick(in, 4) ? h : 1 + pick(in, 40);
    shaded.motion_width = pick(in, 4) ? w : 1 + pick(in, 40), shaded.motion_height = pick(in, 4) ? h : 1 + pick(in, 40);
    ss_image* const of_frame[] = {&frame.depth, &frame.motion, &frame.base_color, &frame.normal};
    ss_image* const of_shaded[] = {&shaded.color, &shaded.depth, &shaded.base_color, &shaded.normal};
    static const int frame_channels[] = {1, 2, 3, 3}, shaded_channels[] = {3, 1, 3, 3};
    for (int k = 0; k < 4; k++) {
        *of_frame[k] = image_of(in, &memory[k], w, h, frame_channels[k], 0, 1.0f);
        *of_shaded[k] = image_of(in, &memory[4 + k], shaded.width, shaded.height, shaded_channels[k], 0, 1.0f);
    }
    if (pick(in, 2)) shaded.motion = image_of(in, &memory[8], shaded.motion_width, shaded.motion_height, 2, 0, 4.0f);
    frame.pre_exposure = pick_float(in), shaded.pre_exposure = pick_float(in);
    for (int k = 0; k < 2; k++)
        frame.jitter[k] = shaded.jitter[k] = shaded.motion_jitter[k] = (float)(pick(in, 5) - 2) * 0.25f;
    outputs.color = image_of(in, &memory[9], w, h, 3, 1, 1.0f);
    if (pick(in, 2)) outputs.motion = image_of(in, &memory[10], w, h, 2, 1, 1.0f);
    if (ss_extrapolate(model, &frame, &shaded, &outputs, &error) == SS_OK)
        check_image(&outputs.color, memory[9], (size_t)w * h * 3);
    for (int k = 0; k < 11; k++) free(memory[k]);
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    static void (*const functions[])(Input*, int, int) = {camera_motion, encode_rgba, merge, scatter, extrapolate};
    Input in = {data, size, 1};
    const int function = pick(&in, 5), w = 1 + pick(&in, 40), h = 1 + pick(&in, 40);
    functions[function](&in, w, h);
    return 0;
}
