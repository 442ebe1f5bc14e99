/* Upscales raw frames to PNG files:
 *
 *     upscale RAW_FOLDER OUT_FOLDER [MODEL]
 *
 * RAW_FOLDER/frames.txt has a line for each frame: NAME w h W H jitter_x jitter_y exposure pre_exposure reset
 * has_reactive. Images are RAW_FOLDER/NAME.color, .depth, .motion and, if has_reactive is 1, .reactive, planes of
 * float32. examples/cpp_onnxruntime/raw_planes.py writes them.
 * OUT_FOLDER exists. MODEL is the name of a shipped model; classifier where there is none. */
#include <stdlib.h>
#include <string.h>

#include <supersampler.h>

#include "png.h"

typedef struct Line {
    char name[64];
    int width, height, display_width, display_height, reset, has_reactive;
    float jitter[2], exposure, pre_exposure;
} Line;

static int fail(const char* where, const char* what) {
    fprintf(stderr, "%s: %s\n", where, what);
    return 1;
}

/* Reads a line of frames.txt. Returns 0 at the end, -1 where it is damaged. */
static int read_line(FILE* list, Line* l) {
    char text[256];
    if (!fgets(text, sizeof text, list)) return 0;
    const int count = sscanf(text, "%63s %d %d %d %d %f %f %f %f %d %d", l->name, &l->width, &l->height,
                             &l->display_width, &l->display_height, &l->jitter[0], &l->jitter[1], &l->exposure,
                             &l->pre_exposure, &l->reset, &l->has_reactive);
    const int is_plain = count == 11 && l->name[0] != '.' && !strpbrk(l->name, "/\\:"); /* it leads out of no folder */
    const int is_size = l->width > 0 && l->height > 0 && l->width <= 16384 && l->height <= 16384;
    return is_plain && is_size && l->pre_exposure > 0.0f ? 1 : -1;
}

/* Reads planes of a frame to memory that the caller frees, and describes them. */
static float* read_planes(const char* folder, const Line* l, const char* kind, int channels, ss_image* image) {
    char path[512];
    const size_t pixels = (size_t)l->width * l->height;
    float* values = malloc(sizeof(float) * channels * pixels);
    snprintf(path, sizeof path, "%s/%s.%s", folder, l->name, kind);
    FILE* file = values ? fopen(path, "rb") : NULL;
    const int is_whole = file && fread(values, sizeof(float) * channels, pixels, file) == pixels && fgetc(file) == EOF;
    if (file) fclose(file);
    image->data = values;
    image->pixel_stride = sizeof(float);
    image->row_stride = sizeof(float) * l->width;
    image->channel_stride = (ptrdiff_t)(sizeof(float) * pixels);
    if (is_whole) return values;
    fail(path, "it is missing, or has another size than frames.txt says");
    free(values);
    return NULL;
}

/* Steps a frame and writes its image. Returns 0 where that succeeds. */
static int upscale(ss_upscaler* upscaler, const char* folder, const char* out, const Line* l) {
    ss_frame frame = {0};
    ss_outputs outputs = {0};
    ss_error error;
    char path[512];
    const size_t pixels = (size_t)l->display_width * l->display_height;
    float* color = read_planes(folder, l, "color", 3, &frame.color);
    float* depth = read_planes(folder, l, "depth", 1, &frame.depth);
    float* motion = read_planes(folder, l, "motion", 2, &frame.motion);
    float* reactive = l->has_reactive ? read_planes(folder, l, "reactive", 1, &frame.reactive) : NULL;
    float* image = malloc(sizeof(float) * 3 * pixels);
    uint8_t* bytes = malloc(3 * pixels);
    int failed = !color || !depth || !motion || (l->has_reactive && !reactive) || !image || !bytes;
    if (!failed) {
        frame.width = l->width, frame.height = l->height;
        frame.jitter[0] = l->jitter[0], frame.jitter[1] = l->jitter[1];
        frame.exposure = l->exposure, frame.pre_exposure = l->pre_exposure;
        frame.reset = l->reset, frame.adds_samples = 1.0f;
        outputs.image.data = image;
        failed = ss_step(upscaler, &frame, &outputs, &error) != SS_OK && fail(l->name, error.message);
    }
    if (!failed) {
        snprintf(path, sizeof path, "%s/%s.png", out, l->name);
        to_display(image, pixels, (l->exposure > 0.0f ? l->exposure : 1.0f) / l->pre_exposure, bytes);
        failed = !write_png(path, bytes, l->display_width, l->display_height) && fail(path, "it cannot be written");
    }
    free(color), free(depth), free(motion), free(reactive), free(image), free(bytes);
    return failed;
}

int main(int count, char** arguments) {
    if (count != 3 && count != 4) return fail("usage", "upscale RAW_FOLDER OUT_FOLDER [MODEL]");
    char path[512];
    snprintf(path, sizeof path, "%s/frames.txt", arguments[1]);
    FILE* list = fopen(path, "r");
    if (!list) return fail(path, "it cannot be read");
    ss_model* model;
    ss_error error;
    if (ss_model_create(count == 4 ? arguments[3] : "classifier", NULL, &model, &error) != SS_OK)
        return fail("model", error.message);

    ss_upscaler* upscaler = NULL;
    Line l, before = {0};
    int found, failed = 0;
    while (!failed && (found = read_line(list, &l)) != 0) {
        if (found < 0) {
            failed = fail(path, "a line cannot be read");
            break;
        }
        if (!upscaler || l.display_width != before.display_width || l.display_height != before.display_height) {
            ss_upscaler_destroy(upscaler);
            upscaler = NULL;
            if (ss_upscaler_create(model, l.display_width, l.display_height, &upscaler, &error) != SS_OK)
                failed = fail(l.name, error.message);
        }
        failed = failed || upscale(upscaler, arguments[1], arguments[2], &l);
        before = l;
    }
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
    fclose(list);
    return failed;
}
