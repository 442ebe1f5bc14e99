/* States: a saved one with changed bytes and a right checksum is refused, or the next step stays in its memory. */
#include "input.h"

enum { W = 13, H = 9, DW = 23, DH = 17, METHODS = 4 };
static const char* const methods[METHODS] = {"taau", "classifier-small", "taa", "bilinear"};
static float values[DW * DH * 3], motion[W * H * 2], image[DW * DH * 3];

static void step(ss_upscaler* upscaler) {
    ss_frame frame;
    ss_outputs outputs;
    memset(&frame, 0, sizeof frame);
    memset(&outputs, 0, sizeof outputs);
    frame.width = W, frame.height = H, frame.adds_samples = 1.0f;
    frame.color.data = frame.depth.data = values;
    memcpy(motion, image, sizeof motion); /* the last image */
    frame.motion.data = motion;
    outputs.image.data = image;
    if (ss_step(upscaler, &frame, &outputs, NULL) != SS_OK) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    static ss_upscaler* upscalers[METHODS];
    static uint8_t* states[METHODS];
    static size_t counts[METHODS];
    Input in = {data, size, 1};
    const int method = pick(&in, METHODS);
    ss_error error;
    if (!upscalers[method]) {
        ss_options options;
        ss_model* model;
        memset(&options, 0, sizeof options);
        options.threads = 1;
        for (int k = 0; k < DW * DH * 3; k++) values[k] = value_of(&in, 0, 1.0f);
        if (ss_model_create(methods[method], &options, &model, NULL) != SS_OK) abort();
        if (ss_upscaler_create(model, DW, DH, &upscalers[method], NULL) != SS_OK) abort();
        for (int k = 0; k < 3; k++) step(upscalers[method]);
        counts[method] = ss_state_bytes(upscalers[method]);
        states[method] = malloc(counts[method]);
        if (ss_state_save(upscalers[method], states[method], counts[method], NULL) != SS_OK) abort();
    }
    const size_t count = pick(&in, 8) ? counts[method] : (size_t)pick(&in, 256) * (counts[method] / 256);
    if (count < 16) return 0;
    uint8_t* bytes = malloc(count);
    memcpy(bytes, states[method], count);
    while (in.left) {
        const size_t at = (next_random(&in) + (size_t)pick(&in, 256) * 256) % (pick(&in, 2)  ? count
                                                                               : count < 800 ? count
                                                                                             : 800);
        bytes[at] = (uint8_t)pick(&in, 256);
    }
    const uint64_t sum = checksum_of(bytes, count - 8);
    memcpy(bytes + count - 8, &sum, 8);
    const ss_status status = ss_state_load(upscalers[method], bytes, count, &error);
    if (status != SS_OK && !error.message[0]) abort();
    for (int k = 0; k < 2; k++) step(upscalers[method]);
    free(bytes);
    return 0;
}
