/* The C interface: views, threads, memory, errors, hostile frames. C99, as the header is. */
#include <fenv.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "supersampler.h"

enum { W = 37, H = 22, DW = 73, DH = 43, FRAMES = 4 };

static int failures = 0;
#define CHECK(condition, ...)                                               \
    do {                                                                    \
        if (!(condition)) {                                                 \
            failures++;                                                     \
            fprintf(stderr, "%s:%d: %s: ", __FILE__, __LINE__, #condition); \
            fprintf(stderr, __VA_ARGS__);                                   \
            fprintf(stderr, "\n");                                          \
        }                                                                   \
    } while (0)

static const char* const methods[] = {"bilinear",         "bicubic",          "taa",          "taau",
                                      "classifier-small", "classifier-large", "gbuffer-fast", "classifier"};
enum { METHODS = sizeof methods / sizeof *methods, WITHOUT_NETWORK = 4 };

static uint32_t state = 1;
static uint32_t random_bits(void) { return state = state * 1664525u + 1013904223u, state ^ state >> 15; }
static float random_unit(void) { return (float)(random_bits() >> 8) * 0x1p-24f; }

typedef struct Pixels {
    float color[H][W][3], depth[H][W], motion[H][W][2], base_color[H][W][3], normal[H][W][3];
    float display_base_color[DH][DW][3], display_normal[DH][DW][3], display_depth[DH][DW];
} Pixels;

static void fill(Pixels* p, int index) {
    state = (uint32_t)index + 7;
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) {
            for (int c = 0; c < 3; c++) p->color[y][x][c] = 2.0f * random_unit();
            p->depth[y][x] = 0.01f + 0.1f * random_unit();
            for (int c = 0; c < 2; c++) p->motion[y][x][c] = 2.0f * random_unit() - 1.0f;
            for (int c = 0; c < 3; c++)
                p->base_color[y][x][c] = random_unit(), p->normal[y][x][c] = 2.0f * random_unit() - 1.0f;
        }
    for (int y = 0; y < DH; y++)
        for (int x = 0; x < DW; x++) {
            const int sy = y * H / DH, sx = x * W / DW;
            memcpy(p->display_base_color[y][x], p->base_color[sy][sx], sizeof p->base_color[sy][sx]);
            memcpy(p->display_normal[y][x], p->normal[sy][sx], sizeof p->normal[sy][sx]);
            p->display_depth[y][x] = p->depth[sy][sx];
        }
}

static ss_frame frame_of(Pixels* p, int index) {
    ss_frame f;
    memset(&f, 0, sizeof f);
    f.width = W, f.height = H;
    f.color.data = p->color, f.depth.data = p->depth, f.motion.data = p->motion;
    f.base_color.data = p->base_color, f.normal.data = p->normal;
    f.display_base_color.data = p->display_base_color, f.display_normal.data = p->display_normal;
    f.display_depth.data = p->display_depth;
    f.jitter[0] = 0.3f * (float)(index % 3 - 1), f.jitter[1] = -0.2f * (float)(index % 2);
    f.adds_samples = 1.0f;
    return f;
}

static ss_outputs outputs_of(void* image) {
    ss_outputs outputs;
    memset(&outputs, 0, sizeof outputs);
    outputs.image.data = image;
    return outputs;
}

/* Steps FRAMES frames of a method; writes the last image. */
static void run(const char* method, const ss_options* options, float* image) {
    ss_error error;
    ss_model* model = NULL;
    ss_upscaler* upscaler = NULL;
    CHECK(ss_model_create(method, options, &model, &error) == SS_OK, "%s", error.message);
    CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
    for (int index = 0; index < FRAMES; index++) {
        static Pixels pixels;
        fill(&pixels, index);
        ss_frame frame = frame_of(&pixels, index);
        ss_outputs outputs = outputs_of(image);
        CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
    }
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
}

static float images[2][DH * DW * 3];

static void serial_for(void* user, void (*task)(void*, int), void* context, int count) {
    ++*(int*)user;
    for (int index = count - 1; index >= 0; index--) task(context, index);
}

static void thread_counts_change_no_bit(void) {
    for (int m = 0; m < METHODS; m++)
        for (int threads = 2; threads <= 5; threads++) {
            int calls = 0;
            ss_options one, many, own;
            memset(&one, 0, sizeof one);
            many = own = one;
            one.threads = 1, many.threads = threads;
            own.threads = threads, own.parallel_for = serial_for, own.user = &calls;
            run(methods[m], &one, images[0]);
            run(methods[m], &many, images[1]);
            CHECK(memcmp(images[0], images[1], sizeof images[0]) == 0, "%s with %d threads", methods[m], threads);
            run(methods[m], &own, images[1]);
            CHECK(memcmp(images[0], images[1], sizeof images[0]) == 0, "%s with the caller's threads", methods[m]);
            CHECK(calls > 0, "the caller's parallel-for is not called");
        }
}

enum { VIEWS = 7 };

/* Steps of several cameras in one call have the images of a call for each, bit for bit; a refused frame changes none. */
static void views_at_once_have_the_images_of_one_at_a_time(void) {
    static Pixels pixels[VIEWS];
    static float at_once[VIEWS][DH * DW * 3], alone[DH * DW * 3];
    for (int m = 0; m < METHODS; m++)
        for (int threads = 1; threads <= 4; threads += 3) /* all counts would take minutes in QEMU */
            for (int own = 0; own < 2; own++) {
                ss_error error;
                ss_options options;
                ss_model* model = NULL;
                ss_upscaler *many[VIEWS], *one[VIEWS];
                ss_frame frames[VIEWS];
                ss_outputs outputs[VIEWS];
                int calls = 0;
                memset(&options, 0, sizeof options);
                options.threads = threads;
                if (own) options.parallel_for = serial_for, options.user = &calls;
                CHECK(ss_model_create(methods[m], &options, &model, &error) == SS_OK, "%s", error.message);
                for (int k = 0; k < VIEWS; k++) {
                    CHECK(ss_upscaler_create(model, DW, DH, &many[k], &error) == SS_OK, "%s", error.message);
                    CHECK(ss_upscaler_create(model, DW, DH, &one[k], &error) == SS_OK, "%s", error.message);
                }
                for (int index = 0; index < FRAMES; index++) {
                    const int count = index == 2 ? 3 : VIEWS;
                    for (int k = 0; k < VIEWS; k++) {
                        fill(&pixels[k], index + 10 * k);
                        frames[k] = frame_of(&pixels[k], index + k);
                        frames[k].reset = index == k;
                        outputs[k] = outputs_of(at_once[k]);
                    }
                    frames[2].jitter[0] = 0.7f;
                    CHECK(ss_step_many(many, frames, outputs, count, &error) == SS_BAD_FRAME, "a jitter of 0.7");
                    CHECK(strncmp(error.message, "view 2: jitter is 0.7", 21) == 0, "%s", error.message);
                    frames[2].jitter[0] = 0.2f;
                    CHECK(ss_step_many(many, frames, outputs, count, &error) == SS_OK, "%s", error.message);
                    for (int k = 0; k < count; k++) {
                        ss_outputs output = outputs_of(alone);
                        CHECK(ss_step(one[k], &frames[k], &output, &error) == SS_OK, "%s", error.message);
                        CHECK(memcmp(alone, at_once[k], sizeof alone) == 0, "%s, %d threads, view %d", methods[m],
                              threads, k);
                    }
                }
                ss_upscaler* const kept = many[5];
                many[5] = many[1];
                CHECK(ss_step_many(many, frames, outputs, VIEWS, &error) == SS_BAD_ARGUMENT, "an upscaler comes twice");
                CHECK(strstr(error.message, "view 1: ") && strstr(error.message, "view 5"), "%s", error.message);
                CHECK(ss_step_many(many, frames, outputs, 0, &error) == SS_BAD_ARGUMENT, "no view");
                many[5] = NULL;
                CHECK(ss_step_many(many, frames, outputs, VIEWS, &error) == SS_BAD_ARGUMENT, "NULL is an upscaler");
                for (int k = 0; k < VIEWS; k++)
                    ss_upscaler_destroy(one[k]), ss_upscaler_destroy(k == 5 ? kept : many[k]);
                ss_model_destroy(model);
            }
}

enum { TALL_W = 16, TALL_H = 200 };

/* Steps three frames of which a model of few threads keeps but some bands at a time. */
static void run_tall(const char* method, int threads, float* image) {
    static float color[TALL_H][TALL_W][3], depth[TALL_H][TALL_W], motion[TALL_H][TALL_W][2];
    ss_error error;
    ss_options options;
    memset(&options, 0, sizeof options);
    options.threads = threads;
    ss_model* model = NULL;
    ss_upscaler* upscaler = NULL;
    CHECK(ss_model_create(method, &options, &model, &error) == SS_OK, "%s", error.message);
    CHECK(ss_upscaler_create(model, 2 * TALL_W, 2 * TALL_H, &upscaler, &error) == SS_OK, "%s", error.message);
    state = 3;
    for (int index = 0; index < 3; index++) {
        for (int y = 0; y < TALL_H; y++)
            for (int x = 0; x < TALL_W; x++) {
                for (int c = 0; c < 3; c++) color[y][x][c] = 2.0f * random_unit();
                depth[y][x] = 0.01f + 0.1f * random_unit();
                for (int c = 0; c < 2; c++) motion[y][x][c] = 20.0f * random_unit() - 10.0f;
            }
        ss_frame frame;
        memset(&frame, 0, sizeof frame);
        frame.width = TALL_W, frame.height = TALL_H, frame.adds_samples = 1.0f;
        frame.color.data = color, frame.depth.data = depth, frame.motion.data = motion;
        ss_outputs outputs = outputs_of(image);
        CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
    }
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
}

static void bands_share_buffers_without_a_trace(void) {
    static float all[4 * TALL_W * TALL_H * 3], few[4 * TALL_W * TALL_H * 3];
    for (int m = 0; m < METHODS; m++) {
        if (strcmp(methods[m], "gbuffer-fast") == 0) continue; /* reads G-buffers */
        run_tall(methods[m], 64, all);                         /* keeps all bands */
        for (int threads = 1; threads <= 7; threads += 2) {
            run_tall(methods[m], threads, few);
            CHECK(memcmp(all, few, sizeof all) == 0, "%s with %d threads", methods[m], threads);
        }
    }
}

static const char* const instructions[] = {"avx512", "avxvnni", "avx2", "neon", "portable"};
enum { INSTRUCTIONS = 5 };

static void instructions_agree(void) {
    for (int m = 0; m < METHODS; m++) {
        run(methods[m], NULL, images[0]);
        for (int k = 0; k < INSTRUCTIONS; k++) {
            ss_options options;
            ss_model* model = NULL;
            memset(&options, 0, sizeof options);
            options.instructions = instructions[k];
            if (ss_model_create(methods[m], &options, &model, NULL) != SS_OK) continue;
            ss_model_destroy(model);
            run(methods[m], &options, images[1]);
            double sum = 0.0;
            for (int i = 0; i < DW * DH * 3; i++) sum += fabs((double)images[0][i] - images[1][i]);
            CHECK(sum / (DW * DH * 3) < (m < WITHOUT_NETWORK ? 1e-4 : 5e-3), "%s on %s: %g", methods[m],
                  instructions[k], sum / (DW * DH * 3));
        }
    }
}

static uint16_t half_of(float value) { /* of numbers that half floats hold */
    uint32_t bits;
    memcpy(&bits, &value, 4);
    return value == 0.0f ? 0 : (uint16_t)((bits >> 16 & 0x8000) | ((bits >> 13 & 0x3FFFF) - (112u << 10)));
}

/* Frames upside down, with alpha, planar and in half floats are the same frames. */
static void views_of_any_strides_are_read(void) {
    static Pixels p;
    static float rgba[H][W + 3][4], planar[3][H][W];
    static uint16_t half_color[H][W][3];
    ss_model* model = NULL;
    ss_error error;
    CHECK(ss_model_create("taau", NULL, &model, &error) == SS_OK, "%s", error.message);
    fill(&p, 3);
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int c = 0; c < 3; c++) {
                p.color[y][x][c] = floorf(p.color[y][x][c] * 512.0f + 1.0f) / 512.0f; /* a half float */
                rgba[H - 1 - y][x][c] = planar[c][y][x] = p.color[y][x][c];
                half_color[y][x][c] = half_of(p.color[y][x][c]);
                rgba[y][x][3] = NAN;
            }
    for (int kind = 0; kind < 4; kind++) {
        ss_upscaler* upscaler = NULL;
        ss_frame frame = frame_of(&p, 0);
        ss_outputs outputs = outputs_of(images[kind > 0]);
        if (kind == 1)
            frame.color.data = rgba[H - 1], frame.color.pixel_stride = 16,
            frame.color.row_stride = -(ptrdiff_t)sizeof rgba[0];
        if (kind == 2)
            frame.color.data = planar, frame.color.pixel_stride = 4, frame.color.channel_stride = sizeof planar[0];
        if (kind == 2) frame.color.row_stride = sizeof planar[0][0];
        if (kind == 3) frame.color.data = half_color, frame.color.type = SS_FLOAT16;
        CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
        CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
        ss_upscaler_destroy(upscaler);
        CHECK(kind == 0 || memcmp(images[0], images[1], sizeof images[0]) == 0, "view %d", kind);
    }
    ss_model_destroy(model);
}

/* An image may begin at any address, as in a file that is mapped: no float of it is then at a multiple of 4. */
static void images_of_any_address_are_read_and_written(void) {
    static Pixels p;
    static uint8_t color[sizeof p.color + 1], depth[sizeof p.depth + 1], motion[sizeof p.motion + 1];
    static uint8_t image[sizeof images[0] + 1], weight[2][DH * DW * sizeof(float) + 1];
    for (int k = 0; k < (int)(sizeof methods / sizeof *methods); k++) {
        ss_model* model = NULL;
        ss_error error;
        CHECK(ss_model_create(methods[k], NULL, &model, &error) == SS_OK, "%s", error.message);
        for (int odd = 0; odd < 2; odd++) {
            ss_upscaler* upscaler = NULL;
            CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
            for (int index = 0; index < 3; index++) {
                fill(&p, index);
                ss_frame frame = frame_of(&p, index);
                ss_outputs outputs = outputs_of(odd ? (void*)(image + 1) : images[0]);
                outputs.weight.data = weight[odd] + odd;
                if (odd) {
                    frame.color.data = memcpy(color + 1, p.color, sizeof p.color);
                    frame.depth.data = memcpy(depth + 1, p.depth, sizeof p.depth);
                    frame.motion.data = memcpy(motion + 1, p.motion, sizeof p.motion);
                }
                CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
            }
            ss_upscaler_destroy(upscaler);
        }
        CHECK(memcmp(images[0], image + 1, sizeof images[0]) == 0, "%s", methods[k]);
        CHECK(memcmp(weight[0], weight[1] + 1, sizeof weight[0] - 1) == 0, "%s: weight", methods[k]);
        ss_model_destroy(model);
    }
}

/* Every pixel of each output is written, by methods without a history, too: their weight is 0. */
static void all_pixels_of_all_outputs_are_written(void) {
    static Pixels p;
    static float weight[DH * DW], converged[DH * DW];
    for (int m = 0; m < METHODS; m++) {
        ss_error error;
        ss_model* model = NULL;
        ss_upscaler* upscaler = NULL;
        CHECK(ss_model_create(methods[m], NULL, &model, &error) == SS_OK, "%s", error.message);
        CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
        for (int index = 0; index < 2; index++) {
            fill(&p, index);
            const ss_frame frame = frame_of(&p, index);
            ss_outputs outputs = outputs_of(images[0]);
            outputs.weight.data = weight, outputs.converged.data = converged;
            memset(images[0], 0xFF, sizeof images[0]);
            memset(weight, 0xFF, sizeof weight), memset(converged, 0xFF, sizeof converged);
            CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
            int bad = 0, blended = 0;
            for (int k = 0; k < DW * DH * 3; k++) bad += !(images[0][k] >= 0.0f);
            for (int k = 0; k < DW * DH; k++) {
                blended += weight[k] > 0.0f;
                bad += !(weight[k] >= 0.0f && weight[k] <= 1.0f);
                bad += !(converged[k] == 0.0f || converged[k] == 1.0f);
            }
            CHECK(bad == 0, "%s, frame %d: %d values", methods[m], index, bad);
            CHECK(!blended == (index == 0 || m < 2), "%s, frame %d: %d pixels", methods[m], index, blended);
        }
        ss_upscaler_destroy(upscaler);
        ss_model_destroy(model);
    }
}

/* Bytes of an image upside down, with alpha, are those of floats. */
static void images_of_any_strides_are_written(void) {
    static Pixels p;
    static uint8_t bytes[DH][DW][4];
    ss_model* model = NULL;
    ss_error error;
    CHECK(ss_model_create("taau", NULL, &model, &error) == SS_OK, "%s", error.message);
    for (int kind = 0; kind < 2; kind++) {
        ss_upscaler* upscaler = NULL;
        CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
        for (int index = 0; index < 2; index++) {
            fill(&p, 1);
            memset(p.motion, 0, sizeof p.motion);
            ss_frame frame = frame_of(&p, 0);
            ss_outputs outputs = outputs_of(images[0]);
            frame.pre_exposure = 2.0f;
            if (kind == 1) {
                outputs.image.data = bytes[DH - 1], outputs.image.type = SS_UNORM8, outputs.image.pixel_stride = 4;
                outputs.image.row_stride = -(ptrdiff_t)sizeof bytes[0];
            }
            CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
        }
        ss_upscaler_destroy(upscaler);
    }
    for (int y = 0; y < DH; y++)
        for (int x = 0; x < DW; x++) {
            for (int c = 0; c < 3; c++) {
                const float value = images[0][3 * (y * DW + x) + c];
                const int want = (int)((value < 1.0f ? value : 1.0f) * 255.0f + 0.5f), got = bytes[DH - 1 - y][x][c];
                CHECK(got == want, "pixel %d %d: %d, not %d", x, y, got, want);
            }
            CHECK(bytes[y][x][3] == 0, "alpha is written");
        }
    ss_model_destroy(model);
}

/* Half floats hold no more than 65504, whatever the pre-exposure multiplies the image by. */
static void images_of_half_floats_saturate(void) {
    static Pixels p;
    static uint16_t halves[DH * DW * 3];
    for (int m = 0; m < METHODS; m++) {
        int saturated = 0;
        ss_model* model = NULL;
        ss_error error;
        CHECK(ss_model_create(methods[m], NULL, &model, &error) == SS_OK, "%s", error.message);
        for (int kind = 0; kind < 2; kind++) {
            ss_upscaler* upscaler = NULL;
            CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
            for (int index = 0; index < 2; index++) {
                fill(&p, 0);
                memset(p.motion, 0, sizeof p.motion);
                for (int x = 0; x < W / 2; x++)
                    for (int y = 0; y < H; y++) p.color[y][x][0] = p.color[y][x][1] = p.color[y][x][2] = 5e5f;
                ss_frame frame = frame_of(&p, 0);
                ss_outputs outputs = outputs_of(images[0]);
                frame.pre_exposure = 16.0f;
                if (kind) outputs.image.data = halves, outputs.image.type = SS_FLOAT16;
                CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
            }
            ss_upscaler_destroy(upscaler);
        }
        for (int k = 0; k < DW * DH * 3; k++) {
            const int is_large = images[0][k] > 65504.0f;
            saturated += is_large;
            CHECK(halves[k] <= 0x7BFF && (!is_large || halves[k] == 0x7BFF), "%s: %#x for %g", methods[m], halves[k],
                  images[0][k]);
        }
        CHECK(saturated, "%s writes no large value", methods[m]);
        ss_model_destroy(model);
    }
}

static void extrapolated_motion_of_half_floats_has_its_sign(void) {
    static Pixels p;
    static uint16_t motion[H][W][2];
    static float color[H][W][3];
    ss_model* model = NULL;
    ss_error error;
    ss_shaded shaded;
    ss_extrapolated outputs;
    CHECK(ss_model_create("guided-warp", NULL, &model, &error) == SS_OK, "%s", error.message);
    fill(&p, 0);
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) p.motion[y][x][0] = -0.625f, p.motion[y][x][1] = x ? 0.25f : -1e5f;
    ss_frame frame = frame_of(&p, 0);
    memset(&shaded, 0, sizeof shaded);
    memset(&outputs, 0, sizeof outputs);
    shaded.width = W, shaded.height = H, shaded.color = frame.color, shaded.depth = frame.depth;
    shaded.base_color = frame.base_color, shaded.normal = frame.normal;
    outputs.color.data = color, outputs.motion.data = motion, outputs.motion.type = SS_FLOAT16;
    CHECK(ss_extrapolate(model, &frame, &shaded, &outputs, &error) == SS_OK, "%s", error.message);
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            CHECK(motion[y][x][0] == half_of(-0.625f) && motion[y][x][1] == (x ? half_of(0.25f) : 0xFBFF),
                  "pixel %d %d: %#x %#x", x, y, motion[y][x][0], motion[y][x][1]);
    ss_model_destroy(model);
}

static int allocations, left, fails_once;
static void* allocate_counted(void* user, size_t bytes) {
    (void)user;
    if (left-- <= 0 && (!fails_once || left == -1)) return NULL;
    allocations++;
    return malloc(bytes);
}
static void release_counted(void* user, void* memory, size_t bytes) {
    (void)user;
    memset(memory, 0xEE, bytes); /* what is read afterwards shows */
    allocations--;
    free(memory);
}

/* Wherever memory ends, the status says so, nothing leaks, and the next call may succeed. */
static void memory_may_end_anywhere(void) {
    int succeeded = 0;
    for (int limit = 0; !succeeded && limit < 600; limit++) {
        static Pixels p;
        ss_options options;
        ss_model* model = NULL;
        ss_upscaler* upscaler = NULL;
        memset(&options, 0, sizeof options);
        options.threads = 2, options.allocate = allocate_counted, options.release = release_counted;
        left = limit;
        ss_status status = ss_model_create(methods[METHODS - 1], &options, &model, NULL);
        if (status == SS_OK) status = ss_upscaler_create(model, DW, DH, &upscaler, NULL);
        for (int index = 0; index < 3 && status == SS_OK; index++) {
            fill(&p, 0);
            memset(p.motion, 0, sizeof p.motion);
            ss_frame frame = frame_of(&p, index);
            ss_outputs outputs = outputs_of(images[0]);
            status = ss_step(upscaler, &frame, &outputs, NULL);
        }
        CHECK(status == SS_OK || status == SS_NO_MEMORY, "status %d", status);
        succeeded = status == SS_OK;
        if (upscaler) ss_upscaler_destroy(upscaler);
        ss_model_destroy(model);
        CHECK(allocations == 0, "%d allocations are left after %d", allocations, limit);
    }
    CHECK(succeeded, "it never succeeds");
}

static void* allocate_odd(void* user, size_t bytes) {
    char* memory = malloc(bytes + *(const int*)user);
    return memory ? memory + *(const int*)user : NULL;
}
static void release_odd(void* user, void* memory, size_t bytes) {
    memset(memory, 0xEE, bytes);
    free((char*)memory - *(const int*)user);
}

/* Memory of the caller may be at any address; the sanitizers see what reads it otherwise. */
static void allocated_memory_has_any_address(void) {
    for (int m = 0; m < METHODS; m++)
        for (int shift = 0; shift < 8; shift += 1 + 2 * m % 3) {
            ss_options options;
            memset(&options, 0, sizeof options);
            options.allocate = allocate_odd, options.release = release_odd, options.user = &shift;
            run(methods[m], &options, images[shift > 0]);
            CHECK(shift == 0 || memcmp(images[0], images[1], sizeof images[0]) == 0, "%s, shift %d", methods[m], shift);
        }
}

enum { RESTING = 5 };

/* Steps still frames, of which one has another size, to bytes. Returns how many calls were refused for lack of memory; the
 * call after each of these succeeds. */
static int step_to_bytes(uint8_t* bytes) {
    static Pixels p;
    int refused = 0;
    ss_options options;
    ss_model* model = NULL;
    ss_upscaler* upscaler = NULL;
    memset(&options, 0, sizeof options);
    options.threads = 2, options.allocate = allocate_counted, options.release = release_counted;
    for (int call = 0; call < RESTING + 2; call++)
        for (int again = 0; again < 2; again++) {
            fill(&p, 0);
            memset(p.motion, 0, sizeof p.motion);
            ss_frame frame = frame_of(&p, 0);
            ss_outputs outputs = outputs_of(bytes);
            frame.width -= call == 3;
            outputs.image.type = SS_UNORM8;
            const ss_status status = call == 0   ? ss_model_create("taau", &options, &model, NULL)
                                     : call == 1 ? ss_upscaler_create(model, DW, DH, &upscaler, NULL)
                                                 : ss_step(upscaler, &frame, &outputs, NULL);
            if (status == SS_OK) break;
            CHECK(status == SS_NO_MEMORY && !again, "call %d, try %d: status %d", call, again, status);
            refused++;
        }
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
    return refused;
}

/* An allocation that fails once costs one call: the next one succeeds, and images are as if none had failed. */
static void one_failed_allocation_refuses_one_call(void) {
    static uint8_t bytes[2][DH * DW * 3];
    left = 1 << 20, fails_once = 1;
    CHECK(step_to_bytes(bytes[0]) == 0, "memory ends");
    int refused = 1, limit = 0;
    for (; refused && limit < 600; limit++) {
        left = limit;
        refused = step_to_bytes(bytes[1]);
        CHECK(refused <= 1, "allocation %d refuses %d calls", limit, refused);
        CHECK(memcmp(bytes[0], bytes[1], sizeof bytes[0]) == 0, "another image after allocation %d", limit);
    }
    CHECK(!refused && limit > 50 && allocations == 0, "%d allocations", limit);
    fails_once = 0;
}

static void changes_of_size_keep_no_memory(void) {
    static Pixels p;
    int kept = 0;
    ss_error error;
    ss_options options;
    ss_model* model = NULL;
    ss_upscaler* upscaler = NULL;
    memset(&options, 0, sizeof options);
    options.allocate = allocate_counted, options.release = release_counted;
    left = 1 << 30;
    CHECK(ss_model_create("taau", &options, &model, &error) == SS_OK, "%s", error.message);
    CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
    for (int index = 0; index < 24; index++) {
        fill(&p, 0);
        ss_frame frame = frame_of(&p, 0);
        ss_outputs outputs = outputs_of(images[0]);
        frame.width -= index % 2;
        CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
        if (index == 11) kept = allocations;
    }
    CHECK(allocations == kept, "%d allocations, then %d", kept, allocations);
    ss_frame frame = frame_of(&p, 0);
    const ss_outputs outputs = outputs_of(images[0]);
    frame.width = 3, left = 0; /* a size that no step takes needs no memory */
    CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_BAD_FRAME && allocations == kept, "%s", error.message);
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
}

/* Blocks at the border have fewer pixels than others. */
static void the_converged_fraction_counts_pixels(void) {
    static Pixels p;
    static float converged[DH * DW];
    int partly = 0;
    ss_error error;
    ss_model* model = NULL;
    ss_upscaler* upscaler = NULL;
    CHECK(ss_model_create("taau", NULL, &model, &error) == SS_OK, "%s", error.message);
    CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
    for (int index = 0; index < 60; index++) {
        fill(&p, index);
        memset(p.motion, 0, sizeof p.motion);
        for (int y = 0; y < H; y++)
            for (int x = 0; x < W; x++)
                for (int c = 0; c < 3; c++) p.color[y][x][c] = x < W / 3 ? p.color[y][x][c] : 0.5f;
        ss_frame frame = frame_of(&p, index);
        ss_outputs outputs = outputs_of(images[0]);
        frame.exposure = 1.0f, outputs.converged.data = converged;
        CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
        double sum = 0.0;
        for (int k = 0; k < DH * DW; k++) sum += converged[k];
        ss_stats stats;
        ss_upscaler_stats(upscaler, &stats);
        CHECK(fabs(stats.converged - sum / (DH * DW)) < 1e-6, "frame %d: %g, not %g", index, stats.converged,
              sum / (DH * DW));
        partly += sum > 0.0 && sum < DH * DW;
    }
    CHECK(partly, "no frame has converged in part");
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
}

static void bad_arguments_are_named(void) {
    static Pixels p;
    ss_model* model = NULL;
    ss_upscaler* upscaler = NULL;
    ss_error error;
    ss_options options;
    memset(&options, 0, sizeof options);
    CHECK(ss_model_create("nothing", NULL, &model, &error) == SS_BAD_ARGUMENT && strstr(error.message, "nothing"), "%s",
          error.message);
    for (int m = 0; m < METHODS; m++) CHECK(strstr(error.message, methods[m]), "%s: %s", methods[m], error.message);
    CHECK(ss_model_create(NULL, NULL, &model, NULL) == SS_BAD_ARGUMENT, "NULL is a name");
    options.instructions = "mmx";
    CHECK(ss_model_create("taa", &options, &model, &error) == SS_BAD_ARGUMENT &&
              strstr(error.message, "mmx', which this CPU does not have; want '"),
          "%s", error.message);
    static const uint64_t damaged[4] = {1, 2, 3};
    CHECK(ss_model_create_from_bytes(damaged, sizeof damaged, NULL, &model, &error) == SS_BAD_MODEL, "%s",
          error.message);
    CHECK(ss_model_create_from_bytes((const char*)damaged + 1, 8, NULL, &model, &error) == SS_BAD_ARGUMENT, "%s",
          error.message);
    CHECK(ss_model_create("taau", NULL, &model, &error) == SS_OK, "%s", error.message);
    CHECK(ss_upscaler_create(model, 0, 5, &upscaler, &error) == SS_BAD_ARGUMENT && strstr(error.message, "0 x 5"), "%s",
          error.message);
    CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
    fill(&p, 0);
    for (int k = 0; k < 14; k++) {
        ss_frame frame = frame_of(&p, 0);
        ss_outputs outputs = outputs_of(images[0]);
        const char* named[] = {"width",  "jitter",         "jitter",          "color",         "motion",
                               "depth",  "exposure",       "pre_exposure",    "adds_samples",  "width",
                               "height", "color overlaps", "motion overlaps", "depth overlaps"};
        if (k == 0) frame.width = 3;
        if (k == 1) frame.jitter[1] = 0.7f;
        if (k == 2) frame.jitter[0] = NAN;
        if (k == 3) frame.color.data = NULL;
        if (k == 4) frame.motion.type = (ss_type)200;
        if (k == 5) frame.depth.data = NULL;
        if (k == 6) frame.exposure = -1.0f;
        if (k == 7) frame.pre_exposure = INFINITY;
        if (k == 8) frame.adds_samples = 0.5f;
        if (k == 9) frame.width = DW + 1;
        if (k == 10) frame.height = DH + 1;
        if (k == 11) frame.color.row_stride = W; /* in pixels */
        if (k == 12) frame.motion.pixel_stride = 2, frame.motion.channel_stride = 1;
        if (k == 13) frame.depth.row_stride = -4 * W + 1;
        CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_BAD_FRAME, "case %d", k);
        CHECK(strstr(error.message, named[k]), "case %d: %s", k, error.message);
    }
    for (int k = 0; k < 6; k++) {
        ss_frame frame = frame_of(&p, 0);
        ss_outputs outputs = outputs_of(images[0]);
        const char* said[] = {"image overlaps itself: its strides are 876, 4, 4",
                              "image has no data",
                              "image is in the memory of weight",
                              "image is in the memory of depth",
                              "weight has the type",
                              "image is in the memory of display_base_color"};
        if (k == 0) outputs.image.pixel_stride = 4, outputs.image.row_stride = sizeof *images[0] * DW * 3;
        if (k == 1) outputs.image.data = NULL;
        if (k == 2) outputs.weight.data = images[0];
        if (k == 3) outputs.image.data = p.depth;
        if (k == 4) outputs.weight.data = images[1], outputs.weight.type = (ss_type)200;
        if (k == 5) outputs.image.data = p.display_base_color;
        CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_BAD_ARGUMENT, "case %d", k);
        CHECK(strstr(error.message, said[k]), "case %d: %s", k, error.message);
    }
    ss_frame unread = frame_of(&p, 0);
    const ss_outputs outputs = outputs_of(images[0]);
    unread.display_normal.row_stride = 4, unread.display_normal.pixel_stride = 4; /* taau reads no G-buffers */
    CHECK(ss_step(upscaler, &unread, &outputs, &error) == SS_OK, "%s", error.message);
    double matrix[16] = {1.0, 0.0, 0.0, 0.0, 0.0, NAN};
    const ss_image depth = {p.depth, SS_FLOAT32, 0, 0, 0}, motion = {p.motion, SS_FLOAT32, 0, 0, 0};
    CHECK(ss_camera_motion(&depth, W, H, matrix, 0.0, unread.jitter, &motion, &error) == SS_BAD_ARGUMENT &&
              strstr(error.message, "to_previous is nan at [5]; want finite numbers"),
          "%s", error.message);
    matrix[5] = 1.0;
    CHECK(ss_camera_motion(&depth, W, H, matrix, INFINITY, unread.jitter, &motion, &error) == SS_BAD_ARGUMENT &&
              strstr(error.message, "far_depth is inf, jitter"),
          "%s", error.message);
    const ss_scatter scatter = {2, 2, 2, 2, images[0], images[0], images[0], {0.0f, NAN}, {0.0f, 0.0f}};
    CHECK(ss_scatter_motion(&scatter, images[1], images[1] + 8, &error) == SS_BAD_FRAME &&
              strstr(error.message, "jitter"),
          "%s", error.message);
    CHECK(ss_merge_images(images[1], images[0], images[0], images[0], 2, 2, NAN, &error) == SS_BAD_ARGUMENT &&
              strstr(error.message, "exposure"),
          "%s", error.message);
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
}

/* NULL in place of any argument that is needed is an error that names it, or the empty answer. */
static void null_arguments_are_named(void) {
    static Pixels p;
    ss_error error;
    ss_model *model = NULL, *made = NULL;
    ss_upscaler *upscaler = NULL, *other = NULL;
    ss_history *history = NULL, *next = NULL;
    CHECK(ss_model_create("taau", NULL, &model, &error) == SS_OK, "%s", error.message);
    CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
    CHECK(ss_history_create(model, DW, DH, W, H, &history, &error) == SS_OK, "%s", error.message);
    fill(&p, 0);
    const ss_frame frame = frame_of(&p, 0);
    const ss_outputs outputs = outputs_of(images[0]);
    const ss_shaded shaded = {0};
    const ss_extrapolated extrapolated = {0};
    const double matrix[16] = {0.0};
    const ss_image image = {p.color, SS_FLOAT32, 0, 0, 0};
    float* const values = images[1];
    size_t bytes = 0;
#define NAMED(name, call) \
    CHECK((call) == SS_BAD_ARGUMENT && strstr(error.message, name " is NULL"), "%s: %s", #call, error.message)
    NAMED("name", ss_model_create(NULL, NULL, &made, &error));
    NAMED("model", ss_model_create("taau", NULL, NULL, &error));
    NAMED("bytes", ss_model_create_from_bytes(NULL, 8, NULL, &made, &error));
    NAMED("model", ss_model_create_from_bytes(values, 8, NULL, NULL, &error));
    NAMED("model", ss_upscaler_create(NULL, DW, DH, &other, &error));
    NAMED("upscaler", ss_upscaler_create(model, DW, DH, NULL, &error));
    NAMED("upscaler", ss_step(NULL, &frame, &outputs, &error));
    NAMED("frame", ss_step(upscaler, NULL, &outputs, &error));
    NAMED("outputs", ss_step(upscaler, &frame, NULL, &error));
    NAMED("upscalers", ss_step_many(NULL, &frame, &outputs, 1, &error));
    NAMED("frames", ss_step_many(&upscaler, NULL, &outputs, 1, &error));
    NAMED("outputs", ss_step_many(&upscaler, &frame, NULL, 1, &error));
    NAMED("upscaler", ss_state_save(NULL, values, 8, &error));
    NAMED("bytes", ss_state_save(upscaler, NULL, 8, &error));
    NAMED("upscaler", ss_state_load(NULL, values, 8, &error));
    NAMED("bytes", ss_state_load(upscaler, NULL, 8, &error));
    NAMED("model", ss_extrapolate(NULL, &frame, &shaded, &extrapolated, &error));
    NAMED("frame", ss_extrapolate(model, NULL, &shaded, &extrapolated, &error));
    NAMED("shaded", ss_extrapolate(model, &frame, NULL, &extrapolated, &error));
    NAMED("outputs", ss_extrapolate(model, &frame, &shaded, NULL, &error));
    NAMED("depth", ss_camera_motion(NULL, W, H, matrix, 0.0, values, &image, &error));
    NAMED("to_previous", ss_camera_motion(&image, W, H, NULL, 0.0, values, &image, &error));
    NAMED("jitter", ss_camera_motion(&image, W, H, matrix, 0.0, NULL, &image, &error));
    NAMED("motion", ss_camera_motion(&image, W, H, matrix, 0.0, values, NULL, &error));
    NAMED("image", ss_encode_rgba(NULL, W, H, values, 0, &error));
    NAMED("pixels", ss_encode_rgba(&image, W, H, NULL, 0, &error));
    NAMED("image", ss_merge_images(NULL, values, values, values, 2, 2, 1.0f, &error));
    NAMED("other_weight", ss_merge_images(values, values, values, NULL, 2, 2, 1.0f, &error));
    NAMED("frames", ss_scatter_motion(NULL, values, values, &error));
    NAMED("model", ss_blend_aovs(NULL, NULL, 1, &error));
    NAMED("views", ss_blend_aovs(model, NULL, 1, &error));
    NAMED("views", ss_resample_ids(model, NULL, 1, &error));
    NAMED("filter", ss_filter_temporal(NULL, &error));
    NAMED("to", ss_nearest_motion(values, values, 2, 2, NULL, &error));
    NAMED("model", ss_history_create(NULL, DW, DH, W, H, &next, &error));
    NAMED("history", ss_history_create(model, DW, DH, W, H, NULL, &error));
    NAMED("model", ss_run(NULL, &frame, history, history, &outputs, &error));
    NAMED("frame", ss_run(model, NULL, history, history, &outputs, &error));
    NAMED("history", ss_run(model, &frame, NULL, history, &outputs, &error));
    NAMED("next_history", ss_run(model, &frame, history, NULL, &outputs, &error));
    NAMED("outputs", ss_run(model, &frame, history, history, NULL, &error));
    NAMED("histories", ss_run_many(model, &frame, NULL, NULL, &outputs, 1, &error));
    NAMED("inputs", ss_run_network(model, NULL, 1, 1, values, &error));
    NAMED("history", ss_history_read(NULL, 0, values, &error));
    NAMED("values", ss_history_write(history, 0, NULL, &error));
    NAMED("model", ss_required_bytes(NULL, DW, DH, W, H, &bytes, &bytes, &error));
    NAMED("working", ss_required_bytes(model, DW, DH, W, H, &bytes, NULL, &error));
#undef NAMED
    CHECK(ss_required_bytes(model, 9 * W, DH, W, H, &bytes, &bytes, &error) == SS_BAD_FRAME, "a ratio of 9");
    CHECK(ss_step(upscaler, NULL, NULL, NULL) == SS_BAD_ARGUMENT, "without an error");
    CHECK(!ss_model_method(NULL) && !ss_model_instructions(NULL), "names of no model");
    ss_stats stats = {7, 1.0f, 7};
    ss_upscaler_stats(upscaler, NULL);
    ss_upscaler_stats(NULL, &stats);
    CHECK(stats.frames == 0 && stats.converged == 0.0f && stats.history_bytes == 0, "of no upscaler");
    int64_t shape[4];
    int axes;
    CHECK(ss_state_bytes(NULL) == 0 && !ss_history_fits(NULL, W, H), "of nothing");
    CHECK(!ss_history_tensor(NULL, 0, shape, &axes) && !ss_history_tensor(history, 0, NULL, NULL), "a tensor of none");
    ss_reset(NULL), ss_model_destroy(NULL), ss_upscaler_destroy(NULL), ss_history_destroy(NULL);
    ss_history_destroy(history), ss_upscaler_destroy(upscaler), ss_model_destroy(model);
}

/* What a function writes is in memory that it does not read. */
static void outputs_in_the_memory_of_inputs_are_refused(void) {
    static Pixels p;
    static float motion[H][W][2], color[H][W][3];
    static uint8_t pixels[W * H * 4 + 1];
    ss_error error;
    ss_model* model = NULL;
    CHECK(ss_model_create("guided-warp", NULL, &model, &error) == SS_OK, "%s", error.message);
    fill(&p, 0);
#define REFUSED(text, call) \
    CHECK((call) == SS_BAD_ARGUMENT && strstr(error.message, text), "%s: %s", #call, error.message)
    for (int k = 0; k < 4; k++) {
        const ss_frame frame = frame_of(&p, 0);
        static const char* const said[] = {"color is in the memory of color of the shaded frame",
                                           "motion to write to is in the memory of motion of the previous frame",
                                           "color is in the memory of motion to write to",
                                           "motion to write to is in the memory of motion;"};
        ss_shaded shaded;
        ss_extrapolated outputs;
        memset(&shaded, 0, sizeof shaded);
        memset(&outputs, 0, sizeof outputs);
        shaded.width = W, shaded.height = H, shaded.color.data = color, shaded.depth = frame.depth;
        shaded.base_color = frame.base_color, shaded.normal = frame.normal;
        shaded.motion.data = motion, shaded.motion_width = W, shaded.motion_height = H;
        outputs.color.data = k == 0 ? (void*)color : images[0];
        outputs.motion.data = k == 1 ? (void*)motion : k == 2 ? images[0] : k == 3 ? (void*)p.motion : images[1];
        REFUSED(said[k], ss_extrapolate(model, &frame, &shaded, &outputs, &error));
    }
    const double matrix[16] = {1.0};
    const ss_image depth = {p.depth, SS_FLOAT32, 0, 0, 0}, image = {p.color, SS_FLOAT32, 0, 0, 0};
    REFUSED("motion is in the memory of depth",
            ss_camera_motion(&depth, W, H, matrix, 0.0, *p.motion[0], &depth, &error));
    REFUSED("pixels is in the memory of image", ss_encode_rgba(&image, W, H, p.color, 0, &error));
    REFUSED("pixels overlaps itself", ss_encode_rgba(&image, W, H, pixels, W, &error)); /* a stride in pixels */
    CHECK(ss_encode_rgba(&image, W, H, pixels + 4 * W * (H - 1), -4 * W, &error) == SS_OK, "%s", error.message);
    REFUSED("to is in the memory of motion",
            ss_nearest_motion(p.depth[0], p.motion[0][0], W, H, p.motion[0][0], &error));
    const ss_scatter scatter = {W, H, W, H, p.depth[0], p.depth[0], p.motion[0][0], {0.0f, 0.0f}, {0.0f, 0.0f}};
    REFUSED("motion is in the memory of next_motion", ss_scatter_motion(&scatter, p.motion[0][0], images[0], &error));
    const ss_temporal_frame frame = {images[0], NULL, images[1], NULL, NULL, NULL};
    const ss_temporal filter = {4, 4, &frame, 0, 0, 0, 1.0f, 4.0f, 0, 4, images[0], NULL};
    REFUSED("image is in the memory of frame 0 of the window", ss_filter_temporal(&filter, &error));
    const ss_aovs aovs = {4, 4, 8, 8, 1, images[0], images[0], images[0], {0.0f, 0.0f}, NULL, NULL, images[1]};
    ss_aovs views[] = {aovs, aovs};
    views[1].aovs = images[1], views[1].image = images[1] + 64;
    REFUSED("view 0: image is in the memory of aovs of another view", ss_blend_aovs(model, views, 2, &error));
#undef REFUSED
    ss_model_destroy(model);
}

/* Without a motion of the previous frame its size is not read. */
static void a_size_of_no_motion_is_not_read(void) {
    static Pixels p;
    static float color[H][W][3], image[2][H][W][3];
    ss_error error;
    ss_model* model = NULL;
    CHECK(ss_model_create("guided-warp", NULL, &model, &error) == SS_OK, "%s", error.message);
    fill(&p, 0);
    memcpy(color, p.color, sizeof color);
    for (int k = 0; k < 2; k++) {
        const ss_frame frame = frame_of(&p, 0);
        ss_shaded shaded;
        ss_extrapolated outputs;
        memset(&shaded, k ? 0x7F : 0, sizeof shaded); /* an uninitialised struct */
        memset(&outputs, 0, sizeof outputs);
        shaded.width = W, shaded.height = H, shaded.color.data = color, shaded.depth = frame.depth;
        shaded.color.type = SS_FLOAT32;
        shaded.color.row_stride = shaded.color.pixel_stride = shaded.color.channel_stride = 0;
        shaded.base_color = frame.base_color, shaded.normal = frame.normal, shaded.motion.data = NULL;
        shaded.pre_exposure = shaded.jitter[0] = shaded.jitter[1] = 0.0f;
        shaded.motion_jitter[0] = shaded.motion_jitter[1] = 0.0f;
        outputs.color.data = image[k];
        CHECK(ss_extrapolate(model, &frame, &shaded, &outputs, &error) == SS_OK, "%s", error.message);
    }
    CHECK(memcmp(image[0], image[1], sizeof image[0]) == 0, "another image");
    ss_model_destroy(model);
}

/* Whatever rounding the caller has set, the tables of a model's work buffers are the same. */
static void the_rounding_of_the_caller_changes_no_bit(void) {
    for (int m = 0; m < METHODS; m++)
        for (int upward = 0; upward < 2; upward++) {
            static Pixels p;
            size_t history, working;
            ss_error error;
            ss_model* model = NULL;
            ss_upscaler* upscaler = NULL;
            if (upward) fesetround(FE_UPWARD);
            CHECK(ss_model_create(methods[m], NULL, &model, &error) == SS_OK, "%s", error.message);
            CHECK(ss_required_bytes(model, DW, DH, W, H, &history, &working, &error) == SS_OK, "%s", error.message);
            CHECK(!upward || fegetround() == FE_UPWARD, "the rounding has changed");
            fesetround(FE_TONEAREST);
            CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
            for (int index = 0; index < FRAMES; index++) {
                fill(&p, index);
                const ss_frame frame = frame_of(&p, index);
                const ss_outputs outputs = outputs_of(images[upward]);
                CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
            }
            CHECK(!upward || memcmp(images[0], images[1], sizeof images[0]) == 0, "%s", methods[m]);
            ss_upscaler_destroy(upscaler);
            ss_model_destroy(model);
        }
}

/* Whatever bits a frame holds, images are finite and not negative, and a good frame after it is, too. */
static void hostile_frames_do_no_harm(void) {
    const char* set = getenv("SS_HOSTILE"); /* frames of each method */
    const int frames = set ? atoi(set) : 60;
    for (int run = 0; run < METHODS * INSTRUCTIONS; run++) {
        static Pixels p;
        const char* method = methods[run / INSTRUCTIONS];
        ss_options options;
        ss_model* model = NULL;
        ss_upscaler* upscaler = NULL;
        ss_error error;
        memset(&options, 0, sizeof options);
        options.instructions = instructions[run % INSTRUCTIONS];
        if (ss_model_create(method, &options, &model, &error) != SS_OK) continue; /* of another CPU */
        CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
        for (int index = 0; index < frames; index++) {
            fill(&p, index);
            state = (uint32_t)index * 77 + 5;
            for (size_t k = 0; k < sizeof p / 4 && index % 4 != 3; k++) {
                uint32_t bits = random_bits();
                if (bits % 3 == 0) bits = random_bits(), memcpy((char*)&p + 4 * k, &bits, 4);
            }
            ss_frame frame = frame_of(&p, index);
            ss_outputs outputs = outputs_of(images[0]);
            if (index % 5 == 4) frame.motion.data = memset(p.motion, 0, sizeof p.motion);
            CHECK(ss_step(upscaler, &frame, &outputs, &error) == SS_OK, "%s", error.message);
            int bad = 0;
            for (int k = 0; k < DW * DH * 3; k++) bad += !(images[0][k] >= 0.0f && images[0][k] <= 65504.0f);
            CHECK(bad == 0, "%s on %s, frame %d: %d values", method, options.instructions, index, bad);
        }
        ss_upscaler_destroy(upscaler);
        ss_model_destroy(model);
    }
}

static void log_once(void* user, const char* message) {
    (*(int*)user)++;
    CHECK(strstr(message, "threads") != NULL, "%s", message);
}

/* A state restores the history, and damaged ones change nothing. */
static void states_are_saved_and_loaded(void) {
    static Pixels p;
    static float images[2][DH][DW][3];
    for (int m = 2; m < METHODS; m++) {
        int logged = 0;
        ss_options options;
        memset(&options, 0, sizeof options);
        options.threads = 2, options.log = log_once, options.user = &logged;
        ss_error error;
        ss_model* model = NULL;
        ss_upscaler *one = NULL, *other = NULL;
        CHECK(ss_model_create(methods[m], &options, &model, &error) == SS_OK, "%s", error.message);
        CHECK(logged == 1, "%d", logged);
        CHECK(ss_upscaler_create(model, DW, DH, &one, &error) == SS_OK, "%s", error.message);
        CHECK(ss_upscaler_create(model, DW, DH, &other, &error) == SS_OK, "%s", error.message);
        ss_outputs out;
        memset(&out, 0, sizeof out);
        for (int index = 0; index < 5; index++) {
            fill(&p, index);
            ss_frame frame = frame_of(&p, index);
            frame.adds_samples = 1.0f;
            if (index == 3) {
                const size_t count = ss_state_bytes(one);
                char* bytes = malloc(count);
                CHECK(ss_state_save(one, bytes, count - 1, &error) == SS_BAD_ARGUMENT, "%s", methods[m]);
                CHECK(ss_state_save(one, bytes, count, &error) == SS_OK, "%s", error.message);
                bytes[count / 2] ^= 1;
                CHECK(ss_state_load(other, bytes, count, &error) == SS_BAD_STATE, "%s", methods[m]);
                bytes[count / 2] ^= 1;
                CHECK(ss_state_load(other, bytes, count - 8, &error) == SS_BAD_STATE, "%s", methods[m]);
                CHECK(ss_state_load(other, bytes, count, &error) == SS_OK, "%s", error.message);
                free(bytes);
            }
            out.image.data = images[0];
            CHECK(ss_step(one, &frame, &out, &error) == SS_OK, "%s", error.message);
            if (index < 3) continue;
            out.image.data = images[1];
            CHECK(ss_step(other, &frame, &out, &error) == SS_OK, "%s", error.message);
            CHECK(memcmp(images[0], images[1], sizeof images[0]) == 0, "%s", methods[m]);
        }
        ss_stats stats;
        ss_upscaler_stats(one, &stats);
        CHECK(stats.frames == 5 && stats.history_bytes > 0 && stats.converged == 0.0f, "%s", methods[m]);
        ss_upscaler_destroy(one);
        ss_upscaler_destroy(other);
        ss_model_destroy(model);
    }
}

static void states_of_another_model_are_refused(void) {
    static const char* const names[] = {"classifier", "classifier-small", "taau"};
    ss_error error;
    ss_model* models[3];
    ss_upscaler* upscalers[3];
    for (int k = 0; k < 3; k++) {
        CHECK(ss_model_create(names[k], NULL, &models[k], &error) == SS_OK, "%s", error.message);
        CHECK(ss_upscaler_create(models[k], DW, DH, &upscalers[k], &error) == SS_OK, "%s", error.message);
    }
    const size_t count = ss_state_bytes(upscalers[0]);
    char* bytes = malloc(count);
    CHECK(ss_state_save(upscalers[0], bytes, count, &error) == SS_OK, "%s", error.message);
    CHECK(ss_state_load(upscalers[0], bytes, count, &error) == SS_OK, "%s", error.message);
    CHECK(ss_state_load(upscalers[1], bytes, count, &error) == SS_BAD_STATE, "of the same method");
    CHECK(strstr(error.message, "the state is of another model of classifier"), "%s", error.message);
    CHECK(ss_state_load(upscalers[2], bytes, count, &error) == SS_BAD_STATE, "of another method");
    CHECK(strstr(error.message, "the state is of classifier; want one of taau"), "%s", error.message);
    free(bytes);
    for (int k = 0; k < 3; k++) ss_upscaler_destroy(upscalers[k]), ss_model_destroy(models[k]);
}

/* Writes the checksum of a state: the CRC-32 of zip. */
static void seal(uint8_t* bytes, size_t count) {
    uint32_t sum = ~0u;
    for (size_t k = 0; k + 8 < count; k++) {
        sum ^= bytes[k];
        for (int bit = 0; bit < 8; bit++) sum = sum >> 1 ^ (sum & 1 ? 0xEDB88320u : 0);
    }
    const uint64_t whole = (uint32_t)~sum;
    memcpy(bytes + count - 8, &whole, 8);
}

static void states_of_another_version_are_refused(void) {
    ss_error error;
    ss_model* model = NULL;
    ss_upscaler* upscaler = NULL;
    CHECK(ss_model_create("taau", NULL, &model, &error) == SS_OK, "%s", error.message);
    CHECK(ss_upscaler_create(model, DW, DH, &upscaler, &error) == SS_OK, "%s", error.message);
    const size_t count = ss_state_bytes(upscaler);
    uint8_t* bytes = malloc(count);
    CHECK(ss_state_save(upscaler, bytes, count, &error) == SS_OK, "%s", error.message);
    const float own = SS_VERSION, later = SS_VERSION + 1;
    size_t at = 0;
    while (at + 4 < count && memcmp(bytes + at, &own, 4) != 0) at += 4;
    memcpy(bytes + at, &later, 4);
    seal(bytes, count);
    CHECK(ss_state_load(upscaler, bytes, count, &error) == SS_BAD_STATE &&
              strstr(error.message, "the state is of version 101 of the library; want 100"),
          "%s", error.message);
    free(bytes);
    ss_upscaler_destroy(upscaler);
    ss_model_destroy(model);
}

static void histories_of_another_model_are_refused(void) {
    static Pixels p;
    static float image[DH][DW][3];
    ss_error error;
    ss_model* models[3] = {NULL};
    ss_history *own[2] = {NULL}, *others[2] = {NULL};
    const char* const names[] = {"taau", "taau", "bilinear"};
    for (int k = 0; k < 3; k++)
        CHECK(ss_model_create(names[k], NULL, &models[k], &error) == SS_OK, "%s", error.message);
    for (int k = 0; k < 2; k++) {
        CHECK(ss_history_create(models[0], DW, DH, W, H, &own[k], &error) == SS_OK, "%s", error.message);
        CHECK(ss_history_create(models[k + 1], DW, DH, W, H, &others[k], &error) == SS_OK, "%s", error.message);
    }
    fill(&p, 0);
    const ss_frame frame = frame_of(&p, 0);
    const ss_outputs outputs = outputs_of(image);
    for (int k = 0; k < 2; k++) {
        CHECK(ss_run(models[0], &frame, others[k], own[0], &outputs, &error) == SS_BAD_ARGUMENT, "%s", names[k + 1]);
        CHECK(strstr(error.message, "another model"), "%s", error.message);
        CHECK(ss_run(models[0], &frame, own[0], others[k], &outputs, &error) == SS_BAD_ARGUMENT, "%s", names[k + 1]);
    }
    CHECK(ss_run(models[0], &frame, own[0], own[1], &outputs, &error) == SS_OK, "%s", error.message);
    const ss_frame frames[] = {frame, frame};
    const ss_outputs same[] = {outputs, outputs};
    const ss_history* before[] = {own[0], own[0]};
    ss_history* after[] = {own[1], own[1]};
    CHECK(ss_run_many(models[0], frames, before, after, same, 2, &error) == SS_BAD_ARGUMENT, "one next history");
    CHECK(strstr(error.message, "view 0: it writes to a history of view 1"), "%s", error.message);
    CHECK(ss_history_create(models[0], DW, DH, W, H, &after[0], &error) == SS_OK, "%s", error.message);
    CHECK(ss_run_many(models[0], frames, before, after, same, 2, &error) == SS_BAD_ARGUMENT, "one image");
    CHECK(strstr(error.message, "view 0: image is in the memory of image of another view"), "%s", error.message);
    ss_history_destroy(after[0]);
    CHECK(ss_history_read(NULL, 0, image[0][0], &error) == SS_BAD_ARGUMENT, "NULL is a history");
    CHECK(ss_history_write(own[0], 0, NULL, &error) == SS_BAD_ARGUMENT, "NULL is values");
    for (int k = 0; k < 2; k++) ss_history_destroy(own[k]), ss_history_destroy(others[k]);
    for (int k = 0; k < 3; k++) ss_model_destroy(models[k]);
}

enum { TW = 37, TH = 21, WINDOW = 5 };

static void the_temporal_filter_averages_frames(void) {
    static float color[WINDOW][TH][TW][4], guides[TH][TW][8], depth[TH][TW], motion[TH][TW][2], step[TH][TW][2];
    static float image[2][TH][TW][4], means[TH][TW][4];
    ss_temporal_frame frames[WINDOW];
    const float* aovs[WINDOW][1];
    float* mean[1] = {&means[0][0][0]};
    ss_error error;
    for (int y = 0; y < TH; y++)
        for (int x = 0; x < TW; x++) {
            for (int k = 0; k < WINDOW; k++) {
                for (int c = 0; c < 3; c++) color[k][y][x][c] = 0.5f + (k % 2 ? 0.001f : -0.001f);
                color[k][y][x][3] = 1.0f;
            }
            motion[y][x][0] = x % 3 ? 0.0f : NAN;
            motion[y][x][1] = x % 5 ? 0.0f : 1e30f;
            depth[y][x] = 1.0f;
        }
    CHECK(ss_nearest_motion(&depth[0][0], &motion[0][0][0], TW, TH, &step[0][0][0], &error) == SS_OK, "%s",
          error.message);
    CHECK(ss_nearest_motion(NULL, &motion[0][0][0], TW, TH, &step[0][0][0], &error) == SS_BAD_ARGUMENT,
          "NULL is a depth");
    for (int k = 0; k < WINDOW; k++) {
        aovs[k][0] = &color[k][0][0][0];
        frames[k] =
            (ss_temporal_frame){&color[k][0][0][0], NULL, &guides[0][0][0], &step[0][0][0], &step[0][0][0], aovs[k]};
    }
    ss_temporal filter = {TW, TH, frames, 2, 2, 1, 1.0f, 4.0f, 0, TH, &image[0][0][0][0], mean};
    CHECK(ss_filter_temporal(&filter, &error) == SS_OK, "%s", error.message);
    filter.image = &image[1][0][0][0];
    for (int y = 0; y < TH; y += 5) {  // as threads would
        filter.first_row = y, filter.end_row = y + 5 < TH ? y + 5 : TH;
        CHECK(ss_filter_temporal(&filter, &error) == SS_OK, "%s", error.message);
    }
    CHECK(memcmp(image[0], image[1], sizeof image[0]) == 0, "rows depend on how they are split");
    for (int y = 0; y < TH; y++)
        for (int x = 0; x < TW; x++) {
            CHECK(fabsf(image[0][y][x][0] - 0.5f) < 0.0011f, "pixel %d %d: %g", x, y, image[0][y][x][0]);
            // apart from the change of light, which AOVs keep
            CHECK(image[0][y][x][3] >= 1.0f && fabsf(means[y][x][0] - image[0][y][x][0]) < 1e-4f, "pixel %d %d", x, y);
        }
    CHECK(image[0][10][16][3] > 1.5f, "no neighbour has a weight: %g", image[0][10][16][3]);
    for (int k = 0; k < WINDOW; k++) frames[k].noisy = k ? NULL : frames[k].color;
    CHECK(ss_filter_temporal(&filter, &error) == SS_BAD_ARGUMENT && strstr(error.message, "noisy"), "%s",
          error.message);
    for (int k = 0; k < WINDOW; k++) frames[k].noisy = frames[k].color;
    filter.first_row = 0, filter.end_row = TH;
    CHECK(ss_filter_temporal(&filter, &error) == SS_OK, "%s", error.message);
    CHECK(image[1][10][16][3] > image[0][10][16][3], "noisy neighbours count no more");
    for (int k = 0; k < WINDOW; k++) frames[k].noisy = NULL;
    filter.end_row = TH + 1;
    CHECK(ss_filter_temporal(&filter, &error) == SS_BAD_ARGUMENT && strstr(error.message, "rows"), "%s", error.message);
    filter.end_row = TH, frames[3].guides = NULL;
    CHECK(ss_filter_temporal(&filter, &error) == SS_BAD_ARGUMENT && strstr(error.message, "frame 3"), "%s",
          error.message);
    frames[3].guides = &guides[0][0][0], aovs[2][0] = NULL;
    CHECK(ss_filter_temporal(&filter, &error) == SS_BAD_ARGUMENT && strstr(error.message, "frame 2"), "%s",
          error.message);
    aovs[2][0] = &color[2][0][0][0], mean[0] = NULL;
    CHECK(ss_filter_temporal(&filter, &error) == SS_BAD_ARGUMENT && strstr(error.message, "NULL"), "%s", error.message);
    mean[0] = &means[0][0][0], filter.samples = 0.0f;
    CHECK(ss_filter_temporal(&filter, &error) == SS_BAD_ARGUMENT && strstr(error.message, "samples"), "%s",
          error.message);
    CHECK(ss_filter_temporal(NULL, &error) == SS_BAD_ARGUMENT, "NULL is a filter");
    filter.samples = 4.0f, filter.exposure = NAN;
    CHECK(ss_filter_temporal(&filter, &error) == SS_BAD_ARGUMENT && strstr(error.message, "exposure nan"), "%s",
          error.message);
}

/* Ids are never blended, become as detailed as the display, and follow what moves. */
static void ids_follow_surfaces_and_are_never_blended(void) {
    enum { SIDE = 16, BIG = 2 * SIDE, STEPS = 64 };
    static uint32_t ids[SIDE][SIDE][2], image[2][BIG][BIG][2], alone[BIG][BIG][2], nearest[BIG][BIG][2];
    static float depth[SIDE][SIDE], motion[SIDE][SIDE][2], distance[2][BIG][BIG], alone_distance[BIG][BIG];
    ss_error error;
    ss_model* model = NULL;
    ss_options options;
    memset(&options, 0, sizeof options);
    options.threads = 3;
    CHECK(ss_model_create("taau", &options, &model, &error) == SS_OK, "%s", error.message);
    for (int speed = 0; speed < 2; speed++) { /* a disc that stands, then one that moves by 0.1 pixels a frame */
        int wrong = 0, wrong_nearest = 0;
        for (int index = 0; index < STEPS; index++) {
            const float centre = 6.0f + 0.1f * (float)(speed * index);
            ss_ids v;
            memset(&v, 0, sizeof v);
            v.width = v.height = SIDE, v.display_width = v.display_height = BIG, v.channels = 2;
            v.jitter[0] = (float)(index * 5 % 8) / 8.0f - 0.4375f,
            v.jitter[1] = (float)((index * 3 + index / 8) % 8) / 8.0f - 0.4375f;
            for (int y = 0; y < SIDE; y++)
                for (int x = 0; x < SIDE; x++) {
                    const float dx = (float)x + v.jitter[0] - centre, dy = (float)y + v.jitter[1] - 7.0f;
                    const int inside = dx * dx + dy * dy < 12.0f;
                    ids[y][x][0] = inside ? 0xFFFFFFFFu : 7u, ids[y][x][1] = inside ? 3u : 0u;
                    depth[y][x] = inside ? 0.2f : 0.1f;
                    motion[y][x][0] = inside ? -0.1f * (float)speed : 0.0f, motion[y][x][1] = 0.0f;
                }
            v.image = &nearest[0][0][0], v.distance = &alone_distance[0][0];
            v.ids = &ids[0][0][0], v.depth = &depth[0][0], v.motion = &motion[0][0][0];
            CHECK(ss_resample_ids(NULL, &v, 1, &error) == SS_OK, "%s", error.message);
            if (index > 0)
                v.previous = &image[(index + 1) % 2][0][0][0], v.previous_distance = &distance[(index + 1) % 2][0][0];
            v.image = &alone[0][0][0];
            CHECK(ss_resample_ids(NULL, &v, 1, &error) == SS_OK, "%s", error.message);
            v.image = &image[index % 2][0][0][0], v.distance = &distance[index % 2][0][0];
            CHECK(ss_resample_ids(model, &v, 1, &error) == SS_OK, "%s", error.message);
            CHECK(memcmp(alone, image[index % 2], sizeof alone) == 0, "threads change ids");
            for (int y = 0; y < BIG; y++)
                for (int x = 0; x < BIG; x++) {
                    const uint32_t* got = image[index % 2][y][x];
                    CHECK((got[0] == 0xFFFFFFFFu && got[1] == 3) || (got[0] == 7 && got[1] == 0), "%u %u", got[0],
                          got[1]);
                    const float dx = ((float)x + 0.5f) / 2.0f - 0.5f - centre,
                                dy = ((float)y + 0.5f) / 2.0f - 0.5f - 7.0f;
                    const uint32_t truth = dx * dx + dy * dy < 12.0f ? 3 : 0;
                    wrong += index >= STEPS / 2 && got[1] != truth,
                        wrong_nearest += index >= STEPS / 2 && nearest[y][x][1] != truth;
                }
        }
        CHECK(4 * wrong < (speed ? 3 : 2) * wrong_nearest, "speed %d: %d of %d", speed, wrong, wrong_nearest);
    }
    ss_ids bad;
    memset(&bad, 0, sizeof bad);
    CHECK(ss_resample_ids(model, &bad, 1, &error) == SS_BAD_ARGUMENT && strstr(error.message, "0 x 0"), "%s",
          error.message);
    CHECK(ss_resample_ids(model, NULL, 1, &error) == SS_BAD_ARGUMENT, "NULL is a view");
    for (int k = 0; k < 4; k++) {
        static const char* const said[] = {"view 0: image is in the memory of image of another view",
                                           "view 0: image or distance is that of the previous frame",
                                           "view 1: image or distance is that of the previous frame",
                                           "view 1: image is in the memory of ids of another view"};
        const ss_ids one = {SIDE,         SIDE, BIG,  BIG,  2,   &ids[0][0][0], &depth[0][0], &motion[0][0][0],
                            {0.0f, 0.0f}, NULL, NULL, NULL, NULL};
        ss_ids views[] = {one, one};
        views[0].image = &image[0][0][0][0], views[0].distance = &distance[0][0][0];
        views[1].image = k == 0 ? views[0].image : k == 3 ? &ids[0][0][0] : &image[1][0][0][0];
        views[1].distance = &distance[1][0][0];
        if (k == 1 || k == 2)
            views[1].previous = views[k - 1].image, views[1].previous_distance = &alone_distance[0][0];
        CHECK(ss_resample_ids(model, views, 2, &error) == SS_BAD_ARGUMENT, "case %d", k);
        CHECK(strstr(error.message, said[k]), "case %d: %s", k, error.message);
    }
    ss_model_destroy(model);
}

/* Constant channels stay constant, missing samples keep the history, and what moves takes it along. */
static void aovs_are_blended_by_the_weight(void) {
    enum { SIDE = 12, BIG = 2 * SIDE, CHANNELS = 5 };
    static float aovs[SIDE][SIDE][CHANNELS], depth[SIDE][SIDE], motion[SIDE][SIDE][2], weight[BIG][BIG];
    static float image[2][BIG][BIG][CHANNELS], alone[BIG][BIG][CHANNELS];
    ss_error error;
    ss_model *model = NULL, *single = NULL;
    ss_options options;
    memset(&options, 0, sizeof options);
    options.threads = 3;
    CHECK(ss_model_create("bilinear", &options, &model, &error) == SS_OK, "%s", error.message);
    options.threads = 1;
    CHECK(ss_model_create("bilinear", &options, &single, &error) == SS_OK, "%s", error.message);
    ss_aovs v;
    memset(&v, 0, sizeof v);
    CHECK(ss_blend_aovs(model, &v, 1, &error) == SS_BAD_ARGUMENT && strstr(error.message, "0 x 0"), "%s",
          error.message);
    v.width = v.height = SIDE, v.display_width = v.display_height = BIG;
    CHECK(ss_blend_aovs(model, &v, 1, &error) == SS_BAD_ARGUMENT && strstr(error.message, "channels is 0"), "%s",
          error.message);
    v.channels = CHANNELS;
    CHECK(ss_blend_aovs(model, &v, 1, &error) == SS_BAD_ARGUMENT && strstr(error.message, "NULL"), "%s", error.message);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            for (int c = 0; c < CHANNELS; c++) aovs[y][x][c] = c == 4 ? 1e30f : (float)c;
            depth[y][x] = 0.1f, motion[y][x][0] = -1.0f; /* by two display pixels to the right */
        }
    for (int y = 0; y < BIG; y++)
        for (int x = 0; x < BIG; x++) weight[y][x] = x < 2 ? 0.0f : 1.0f;
    v.aovs = &aovs[0][0][0], v.depth = &depth[0][0], v.motion = &motion[0][0][0], v.image = &image[0][0][0][0];
    CHECK(ss_blend_aovs(NULL, &v, 1, &error) == SS_BAD_ARGUMENT, "NULL is a model");
    CHECK(ss_blend_aovs(model, &v, 1, &error) == SS_OK, "%s", error.message);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) aovs[y][x][0] = NAN, aovs[y][x][1] = 9.0f;
    image[0][8][6][0] = 7.0f; /* one pixel, which moves to (8, 8) */
    v.previous = v.image, v.weight = &weight[0][0];
    CHECK(ss_blend_aovs(model, &v, 1, &error) == SS_BAD_ARGUMENT && strstr(error.message, "previous"), "%s",
          error.message);
    v.image = &weight[0][0];
    CHECK(ss_blend_aovs(model, &v, 1, &error) == SS_BAD_ARGUMENT && strstr(error.message, "image is in the memory of"),
          "%s", error.message);
    v.image = &alone[0][0][0];
    CHECK(ss_blend_aovs(single, &v, 1, &error) == SS_OK, "%s", error.message);
    v.image = &image[1][0][0][0];
    ss_aovs views[] = {v, v};
    CHECK(ss_blend_aovs(model, views, 2, &error) == SS_BAD_ARGUMENT && strstr(error.message, "view 0: image"), "%s",
          error.message);
    CHECK(ss_blend_aovs(model, &v, 1, &error) == SS_OK, "%s", error.message);
    CHECK(memcmp(alone, image[1], sizeof alone) == 0, "threads change AOVs");
    for (int y = 0; y < BIG; y++)
        for (int x = 2; x < BIG; x++) {
            const float* got = image[1][y][x];
            const float want[CHANNELS] = {y == 8 && x == 8 ? 7.0f : 0.0f, 1.0f, 2.0f, 3.0f, 65504.0f};
            for (int c = 0; c < CHANNELS; c++)
                CHECK(fabsf(got[c] - want[c]) <= 1e-6f * want[c], "%d %d %d: %g", x, y, c, (double)got[c]);
        }
    CHECK(image[1][3][0][1] == 9.0f, "%g", (double)image[1][3][0][1]);
    ss_model_destroy(model);
    ss_model_destroy(single);
}

int main(void) {
    states_are_saved_and_loaded();
    states_of_another_model_are_refused();
    states_of_another_version_are_refused();
    histories_of_another_model_are_refused();
    CHECK(ss_version() == SS_VERSION, "%d", ss_version());
    thread_counts_change_no_bit();
    views_at_once_have_the_images_of_one_at_a_time();
    bands_share_buffers_without_a_trace();
    instructions_agree();
    views_of_any_strides_are_read();
    images_of_any_address_are_read_and_written();
    all_pixels_of_all_outputs_are_written();
    images_of_any_strides_are_written();
    images_of_half_floats_saturate();
    extrapolated_motion_of_half_floats_has_its_sign();
    memory_may_end_anywhere();
    allocated_memory_has_any_address();
    one_failed_allocation_refuses_one_call();
    changes_of_size_keep_no_memory();
    the_converged_fraction_counts_pixels();
    bad_arguments_are_named();
    null_arguments_are_named();
    outputs_in_the_memory_of_inputs_are_refused();
    a_size_of_no_motion_is_not_read();
    the_rounding_of_the_caller_changes_no_bit();
    hostile_frames_do_no_harm();
    the_temporal_filter_averages_frames();
    ids_follow_surfaces_and_are_never_blended();
    aovs_are_blended_by_the_weight();
    return failures ? 1 : 0;
}
