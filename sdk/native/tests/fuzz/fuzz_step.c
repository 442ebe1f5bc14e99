/* Frames of any contents, sizes, strides and types, on any method and instructions, after a history of any values. */
#include "input.h"

static const char* const methods[] = {"taau", "classifier",       "bilinear",         "bicubic",
                                      "taa",  "classifier-small", "classifier-large", "gbuffer-fast"};
static const char* const instructions[] = {"portable", "avx2", "avxvnni", "avx512", "neon"};
enum { METHODS = 8, INSTRUCTIONS = 5, INPUTS = 9, OUTPUTS = 3, MAX_SIDE = 70 };

/* Models are kept: most of the time would go to them. */
static ss_model* model_of(int method, int set) {
    static ss_model* models[METHODS][INSTRUCTIONS];
    ss_options options;
    memset(&options, 0, sizeof options);
    options.threads = 1, options.instructions = instructions[set];
    if (!models[method][set]) ss_model_create(methods[method], &options, &models[method][set], NULL);
    return models[method][set];
}

/* Writes any values to all tensors of a history. */
static void tamper(Input* in, ss_history* history) {
    int64_t shape[4];
    int axes;
    const int hostile = pick(in, 256);
    const float scale = pick_float(in);
    for (int index = 0; ss_history_tensor(history, index, shape, &axes); index++) {
        const size_t count = (size_t)(shape[0] * shape[1] * shape[2] * shape[3]);
        float* values = malloc(count * sizeof *values);
        for (size_t k = 0; k < count; k++) values[k] = value_of(in, hostile, scale);
        ss_history_write(history, index, values, NULL);
        ss_history_read(history, index, values, NULL);
        free(values);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    Input in = {data, size, 1};
    ss_model* model = model_of(pick(&in, METHODS), pick(&in, INSTRUCTIONS));
    if (!model) return 0;
    const int dw = 1 + pick(&in, MAX_SIDE), dh = 1 + pick(&in, MAX_SIDE);
    ss_history *history = NULL, *next = NULL;
    int tampered = 0;
    while (in.left) {
        static const int channels[INPUTS] = {3, 1, 2, 1, 3, 3, 3, 3, 1};
        static const float scales[INPUTS] = {2.0f, 0.1f, 3.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 0.1f};
        ss_frame frame;
        ss_outputs outputs;
        ss_error error;
        void* memory[INPUTS + OUTPUTS] = {NULL};
        memset(&frame, 0, sizeof frame);
        memset(&outputs, 0, sizeof outputs);
        const int ratio = 4 + pick(&in, 10); /* quarters */
        frame.width = dw * 4 / ratio + pick(&in, 2), frame.height = dh * 4 / ratio + pick(&in, 2);
        if (frame.width < 1 || frame.height < 1) frame.width = frame.height = 1;
        ss_image* const images[INPUTS] = {&frame.color,
                                          &frame.depth,
                                          &frame.motion,
                                          &frame.reactive,
                                          &frame.base_color,
                                          &frame.normal,
                                          &frame.display_base_color,
                                          &frame.display_normal,
                                          &frame.display_depth};
        const int absent = pick(&in, 256);
        for (int k = 0; k < INPUTS; k++)
            if (k < 3 ? absent != k : absent & 1 || k > 3)
                *images[k] = image_of(&in, &memory[k], k < 6 ? frame.width : dw, k < 6 ? frame.height : dh, channels[k],
                                      0, scales[k]);
        if (pick(&in, 4) == 0 && frame.motion.data) memset(memory[2], 0, (size_t)frame.width * frame.height * 4);
        frame.jitter[0] = (float)(pick(&in, 5) - 2) * 0.25f, frame.jitter[1] = (float)(pick(&in, 5) - 2) * 0.25f;
        frame.exposure = pick(&in, 4) ? 0.0f : pick_float(&in),
        frame.pre_exposure = pick(&in, 4) ? 0.0f : pick_float(&in);
        frame.adds_samples = (float)pick(&in, 3);
        outputs.image = image_of(&in, &memory[INPUTS], dw, dh, 3, 1, 1.0f);
        if (pick(&in, 2)) outputs.weight = image_of(&in, &memory[INPUTS + 1], dw, dh, 1, 1, 1.0f);
        if (pick(&in, 2)) outputs.converged = image_of(&in, &memory[INPUTS + 2], dw, dh, 1, 1, 1.0f);
        if (!history && ss_history_create(model, dw, dh, frame.width, frame.height, &history, NULL) != SS_OK) abort();
        if (pick(&in, 8) == 0) tampered = 1, tamper(&in, history);
        if (!next || !ss_history_fits(next, frame.width, frame.height)) {
            ss_history_destroy(next);
            if (ss_history_create(model, dw, dh, frame.width, frame.height, &next, NULL) != SS_OK) abort();
        }
        const ss_status status = ss_run(model, &frame, history, next, &outputs, &error);
        if (status == SS_OK) {
            if (!tampered) check_image(&outputs.image, memory[INPUTS], (size_t)dw * dh * 3);
            ss_history* before = history;
            history = next, next = before;
        } else if (!error.message[0]) {
            abort();
        }
        for (int k = 0; k < INPUTS + OUTPUTS; k++) free(memory[k]);
    }
    ss_history_destroy(history);
    ss_history_destroy(next);
    return 0;
}
