/* Bytes of models: with a right checksum or not, they are refused or make a model whose steps stay in their memory. */
#include "input.h"

enum { W = 11, H = 7, DW = 19, DH = 13 };

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    if (size < 16) return 0;
    uint8_t* bytes = malloc(size);
    memcpy(bytes, data, size);
    if (bytes[size - 1] != 1) {
        const uint64_t sum = checksum_of(bytes, size - 8);
        memcpy(bytes + size - 8, &sum, 8);
    }
    ss_model* model;
    ss_options options;
    ss_error error;
    memset(&options, 0, sizeof options);
    options.threads = 1;
    const ss_status status = ss_model_create_from_bytes(bytes, size, &options, &model, &error);
    if (status == SS_OK) {
        ss_upscaler* upscaler = NULL; /* guided-warp upscales nothing */
        Input in = {data, 0, 1};
        static float values[DW * DH * 3], image[DW * DH * 3];
        for (int k = 0; k < DW * DH * 3; k++) values[k] = value_of(&in, 0, 1.0f);
        ss_frame frame;
        ss_outputs outputs;
        memset(&frame, 0, sizeof frame);
        memset(&outputs, 0, sizeof outputs);
        frame.width = W, frame.height = H, frame.adds_samples = 1.0f;
        ss_image* const images[] = {&frame.color,          &frame.depth,        &frame.motion,
                                    &frame.base_color,     &frame.normal,       &frame.display_base_color,
                                    &frame.display_normal, &frame.display_depth};
        for (int k = 0; k < 8; k++) images[k]->data = values;
        outputs.image.data = image;
        ss_upscaler_create(model, DW, DH, &upscaler, &error);
        for (int k = 0; k < 2 && upscaler; k++) ss_step(upscaler, &frame, &outputs, &error);
        ss_upscaler_destroy(upscaler);
        ss_model_destroy(model);
    } else if (model || !error.message[0]) {
        abort();
    }
    free(bytes);
    return 0;
}
