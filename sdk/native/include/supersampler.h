/* supersampler: temporal supersampling of rendered frames on the CPU.
 *
 *     ss_model* model;
 *     ss_upscaler* upscaler;
 *     ss_error error;
 *     if (ss_model_create("taau", NULL, &model, &error) != SS_OK) { puts(error.message); return 1; }
 *     if (ss_upscaler_create(model, 1920, 1080, &upscaler, &error) != SS_OK) { puts(error.message); return 1; }
 *     for (each frame) ss_step(upscaler, &frame, &outputs, &error);
 *
 * Functions return SS_OK or an error. The message in `error`, which may be NULL, states the value received, the value
 * expected, and how to fix it. An error leaves the history unchanged. There is no global state: models are independent.
 *
 * Threads: a model may be used by several threads at once. An upscaler or a history is used by one thread at a time.
 *
 * Conventions: x points right, y down; row 0 is on top. Colours are linear RGB. docs/contract.md has the whole
 * contract.
 */
#ifndef SUPERSAMPLER_H
#define SUPERSAMPLER_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Programs that link the static library define SS_STATIC; the target of find_package does, and pkg-config. */
#if defined(SS_STATIC)
#define SS_API
#elif defined(_WIN32) && defined(SS_BUILDS)
#define SS_API __declspec(dllexport)
#elif defined(_WIN32)
#define SS_API __declspec(dllimport)
#else
#define SS_API __attribute__((visibility("default")))
#endif

#define SS_VERSION 100 /* 10000 * major + 100 * minor + patch */

typedef enum ss_status {
    SS_OK = 0,
    SS_BAD_ARGUMENT = 1, /* an argument other than the frame: a size, a pointer, an option */
    SS_BAD_FRAME = 2,    /* the frame breaks the contract; the next one may be valid */
    SS_BAD_MODEL = 3,    /* the bytes of a model are damaged, or of another version */
    SS_BAD_STATE = 4,    /* the bytes of a state are damaged, or of another model or size */
    SS_NO_MEMORY = 5,    /* the allocator returned NULL */
    SS_CANCELLED = 6     /* `cancelled` of the outputs returned something other than 0 */
} ss_status;

typedef struct ss_error {
    char message[256]; /* UTF-8, ends with a zero; empty after SS_OK */
} ss_error;

/* Version of the loaded library, to compare with SS_VERSION. */
SS_API int ss_version(void);

/* Models ------------------------------------------------------------------------------------------------------- */

typedef struct ss_model ss_model;

/* Memory, threads and messages of a model. Zeros choose the defaults. The callbacks get `user`. They are called on any thread
 * that uses the model, and on its own threads, and must not call into this library. */
typedef struct ss_options {
    int threads; /* threads that work on a step, the calling one included; 0: one for each core */
    /* Calls task(context, 0) to task(context, count - 1), on up to `threads` threads, and returns when all have
     * returned. NULL: the model has threads of its own. */
    void (*parallel_for)(void* user, void (*task)(void* context, int index), void* context, int count);
    void* (*allocate)(void* user, size_t bytes); /* any alignment; NULL if there is no memory */
    void (*release)(void* user, void* memory, size_t bytes);
    /* called when a model is created, with its instruction set and threads */
    void (*log)(void* user, const char* message);
    void* user;
    const char* instructions; /* NULL: the best that this CPU has; "avx512", "avxvnni", "avx2", "neon",
                                 "portable" */
} ss_options;

/* Creates a model that the library contains: "bilinear", "bicubic", "taa", "taau", "classifier", "classifier-small",
 * "classifier-large" or "gbuffer-fast"; "guided-warp" is for `ss_extrapolate`.
 *
 * SS_BAD_ARGUMENT: there is no such model, or the CPU lacks the instructions that `options` names. */
SS_API ss_status ss_model_create(const char* name, const ss_options* options, ss_model** model, ss_error* error);

/* Creates a model from the bytes of its file, which are copied. `bytes` is aligned to 8, as malloc aligns it. */
SS_API ss_status ss_model_create_from_bytes(const void* bytes, size_t count, const ss_options* options,
                                            ss_model** model, ss_error* error);

/* Frees a model. Its histories and upscalers must have been freed. NULL does nothing. */
SS_API void ss_model_destroy(ss_model* model);

/* Name of the method, and of the instruction set that runs; NULL for NULL. */
SS_API const char* ss_model_method(const ss_model* model);
SS_API const char* ss_model_instructions(const ss_model* model);

/* Frames ------------------------------------------------------------------------------------------------------- */

typedef enum ss_type {
    SS_FLOAT32 = 0,
    SS_FLOAT16 = 1, /* of outputs: values beyond +-65504 are clamped to these */
    SS_UNORM8 = 2   /* 255 stands for 1. Outputs only: values are clamped to [0, 1], and rounded */
} ss_type;

/* The pixels of an image in memory of the caller, at any address. Strides are in bytes and may be negative; no two values
 * overlap. */
typedef struct ss_image {
    void* data; /* first channel of the upper left pixel; NULL: no image */
    ss_type type;
    ptrdiff_t row_stride;     /* to the pixel below; 0: rows of packed pixels */
    ptrdiff_t pixel_stride;   /* to the pixel on the right; 0: packed channels */
    ptrdiff_t channel_stride; /* to the next channel; 0: the size of `type` */
} ss_image;

/* A frame of width x height samples. Images are read only during the call. */
typedef struct ss_frame {
    int width, height; /* render size; it may change from frame to frame */
    ss_image color;    /* 3 channels (more are not read): linear RGB, jittered, without anti-aliasing. NaN is a missing
                          sample; negative values count as 0, those above 65504 as 65504 */
    ss_image depth;    /* 1 channel: reversed, infinite far: near / view distance; 0 at the sky */
    ss_image motion;   /* 2 channels: render pixels without jitter, previous minus current position */
    ss_image reactive; /* 1 channel in [0, 1], or none: how unreliable the history is */
    ss_image base_color, normal; /* G-buffers at render size, for methods that read them */
    ss_image display_base_color, display_normal, display_depth; /* the same at display size */
    float jitter[2];    /* sample position minus pixel centre, render pixels, in [-0.5, 0.5] */
    float exposure;     /* multiplies the colour before the tone curve; 0: measured */
    float pre_exposure; /* factor that the colour already contains, 2^-24 to 2^24; 0 counts as 1 */
    int reset;          /* 1 on the first frame after a cut: the history is dropped */
    float adds_samples; /* 1: static pixels converge to the mean of their samples; 0: they do not, or this frame's
                           colour was extrapolated; 2: a path tracer's samples, averaged without limit */
} ss_frame;

/* Stages of a step. */
typedef enum ss_stage {
    SS_PREPROCESS = 0, /* the frame is read, its samples toned, its motion dilated */
    SS_GATHER = 1,     /* frame and history are resampled at display pixels */
    SS_NETWORK = 2,    /* classifiers: the encoder */
    SS_FINISH = 3,     /* history and frame are blended; other methods: all work at display size */
    SS_REST = 4,       /* convergence at rest */
    SS_STAGES = 5
} ss_stage;

/* Returns the name of a stage: "preprocess"; NULL from SS_STAGES on. */
SS_API const char* ss_stage_name(int stage);

/* Results of a step. Images have display size; those whose data is NULL are not computed. Their memory must not overlap
 * another output of any view, or a frame. */
typedef struct ss_outputs {
    ss_image image;     /* 3 channels: linear RGB, finite, >= 0, in the units of the colour */
    ss_image weight;    /* 1 channel: weight of the history in the image, [0, 1]; 0 of methods without one */
    ss_image converged; /* 1 channel: 1 where the image is frozen, else 0; 0 of methods without convergence */
    int compute_all;    /* 1: also compute frozen tiles, for tests; the images are the same, bit for bit */
    double* seconds;    /* SS_STAGES wall times by stage, or NULL */
    /* polled on the calling thread during the step: a result other than 0 cancels it; or NULL */
    int (*cancelled)(void* user);
    void* user;
} ss_outputs;

/* Upscalers ---------------------------------------------------------------------------------------------------- */

/* Upscales the frames of one camera, in order. */
typedef struct ss_upscaler ss_upscaler;

SS_API ss_status ss_upscaler_create(ss_model* model, int display_width, int display_height, ss_upscaler** upscaler,
                                    ss_error* error);
SS_API void ss_upscaler_destroy(ss_upscaler* upscaler);

/* Upscales the next frame. */
SS_API ss_status ss_step(ss_upscaler* upscaler, const ss_frame* frame, const ss_outputs* outputs, ss_error* error);

/* Upscales the next frames of several cameras: one frame and one output for each of `count` upscalers of one model. Sizes
 * may differ. The images are those of `ss_step` on each, bit for bit. Each thread computes a whole view at a time, which is
 * faster than a call per view where images are small: robot simulators, stereo, thumbnails.
 *
 * An error leaves all histories unchanged; its message begins with the view: "view 3: jitter is 0.7". `cancelled` of the
 * first outputs counts for all views. `ss_options.parallel_for` gets one task for each view. */
SS_API ss_status ss_step_many(ss_upscaler* const* upscalers, const ss_frame* frames, const ss_outputs* outputs,
                              int count, ss_error* error);

/* Drops the history, as `reset` of a frame does. NULL does nothing. */
SS_API void ss_reset(ss_upscaler* upscaler);

typedef struct ss_stats {
    int64_t frames;       /* completed steps */
    float converged;      /* fraction of the image that is frozen, [0, 1] */
    size_t history_bytes; /* of both histories once they have converged */
} ss_stats;

/* Without an upscaler all are 0. */
SS_API void ss_upscaler_stats(const ss_upscaler* upscaler, ss_stats* stats);

/* States: an upscaler of the same model and display size that loads one computes the same next images, bit for bit. Only
 * this version of the library loads them. `bytes` are aligned to 8, as malloc aligns them.
 *
 * ss_state_bytes: 0 for NULL.
 * ss_state_save: count is the result of ss_state_bytes.
 * ss_state_load: SS_BAD_STATE if the bytes are damaged, or of another version, model or display size; the history is
 *     unchanged. */
SS_API size_t ss_state_bytes(const ss_upscaler* upscaler);
SS_API ss_status ss_state_save(const ss_upscaler* upscaler, void* bytes, size_t count, ss_error* error);
SS_API ss_status ss_state_load(ss_upscaler* upscaler, const void* bytes, size_t count, ss_error* error);

/* Frames that were not shaded ------------------------------------------------------------------------------------- */

/* The last shaded frame, and the motion since. The caller owns the arrays: copy them if the renderer reuses its buffers. */
typedef struct ss_shaded {
    int width, height;                         /* of the shaded frame */
    ss_image color, depth, base_color, normal; /* as in `ss_frame` */
    float jitter[2], pre_exposure;
    int motion_width, motion_height; /* of the frame before the unshaded one */
    /* from that frame back to the shaded one, in that frame's pixels: `motion` of the call before. No data: that frame is
     * the shaded one */
    ss_image motion;
    float motion_jitter[2]; /* of that frame */
} ss_shaded;

typedef struct ss_extrapolated {
    /* 3 channels of the frame's size: linear RGB, >= 0, with the frame's pre-exposure; NaN where all samples of the shaded
     * frame around are missing */
    ss_image color;
    ss_image motion; /* 2 channels: motion of the frame back to the shaded one, for the next call; or no data */
    int (*cancelled)(void* user); /* as in `ss_outputs` */
    void* user;
} ss_extrapolated;

/* Computes the colour of a frame that was not shaded, with a model of "guided-warp". The frame has depth, motion,
 * base_color and normal. Then `ss_step` takes the frame with that colour, and with adds_samples 0. */
SS_API ss_status ss_extrapolate(ss_model* model, const ss_frame* frame, const ss_shaded* shaded,
                                const ss_extrapolated* outputs, ss_error* error);

/* Images without a model ------------------------------------------------------------------------------------------ */

/* Writes the motion of static surfaces: where the previous camera saw each sample. Samples that were behind that camera get
 * a vector that points out of the image. It runs on the calling thread.
 *
 * depth, motion: as in `ss_frame`; the depth may be that of a z-buffer. Motion is float32.
 * to_previous: row-major, takes (x, y, depth - far_depth, 1) in this frame's clip space, divided by w, y up, to the clip
 *     space of the previous frame: previous_view_projection * inverse(view_projection), both without jitter, where
 *     far_depth is 0.
 * far_depth: the depth far away, 0 if reversed; subtracted first, so that small differences are not rounded. */
SS_API ss_status ss_camera_motion(const ss_image* depth, int width, int height, const double to_previous[16],
                                  double far_depth, const float jitter[2], const ss_image* motion, ss_error* error);

/* Writes opaque RGBA bytes of an image of display values; these are clamped to [0, 1]. `row_stride` is in bytes: 0 for
 * packed rows; negative if `pixels` is the last row in memory, for OpenGL. */
SS_API ss_status ss_encode_rgba(const ss_image* image, int width, int height, void* pixels, ptrdiff_t row_stride,
                                ss_error* error);

/* Writes the mean of two images, (height, width, 3) packed linear RGB, to the first. It is weighted by (height, width) and
 * taken after the tone curve c / (1 + max(c)) of colours times exposure, which is more than 0, because the brighter of two
 * linear values would dominate. */
SS_API ss_status ss_merge_images(float* image, const float* other, const float* weight, const float* other_weight,
                                 int width, int height, float exposure, ss_error* error);

/* Two neighbouring frames, packed. */
typedef struct ss_scatter {
    int width, height, next_width, next_height;
    const float* depth;       /* (height, width) of the first frame */
    const float* next_depth;  /* (next_height, next_width) of the second */
    const float* next_motion; /* (next_height, next_width, 2) of the second, back to the first */
    float jitter[2], next_jitter[2];
} ss_scatter;

/* Writes the motion of each sample of the first frame to the second, (height, width, 2) render pixels, for backward runs: it
 * scatters the motion of the second. A pixel that no sample of its depth reached takes the motion of the nearest pixel of
 * its surface. mismatch: (height, width), written to: the relative difference of depth. */
SS_API ss_status ss_scatter_motion(const ss_scatter* frames, float* motion, float* mismatch, ss_error* error);

/* Ids of one view: integers that name objects, parts, materials or classes. They are never blended. Arrays are packed. */
typedef struct ss_ids {
    int width, height, display_width, display_height, channels;
    const uint32_t* ids; /* (height, width, channels) of the frame's samples; the channels of a pixel are one name */
    const float* depth;  /* (height, width) as in `ss_frame` */
    const float* motion; /* (height, width, 2) as in `ss_frame` */
    float jitter[2];
    const uint32_t* previous;       /* `image` of the previous frame; NULL on the first frame, and after a cut */
    const float* previous_distance; /* `distance` of the previous frame; NULL with `previous` */
    uint32_t* image;                /* (display_height, display_width, channels), written to; not `previous` */
    /* (display_height, display_width), written to: distance of each pixel's centre from the sample whose ids it has, in
     * display pixels; not `previous_distance` */
    float* distance;
} ss_ids;

/* Resamples the ids of several views to display size: segmentation beside the images of `ss_step`. A pixel takes the ids
 * of the nearest sample of this frame; or keeps those of an earlier sample that was nearer to its centre, if the
 * surface survives: one of the 3x3 samples has these ids now, and its motion leads to them. Of several such surfaces the one
 * closest to the camera counts. So ids become as detailed as the image, and stay where nothing moves. The distance of a
 * sample that is kept grows by its motion relative to that of the nearest sample.
 *
 * model: its threads do the work; NULL: the calling thread does. */
SS_API ss_status ss_resample_ids(ss_model* model, const ss_ids* views, int count, ss_error* error);

/* AOVs of one view: alpha, masks, normals or any other channels. Arrays are packed. */
typedef struct ss_aovs {
    int width, height, display_width, display_height, channels;
    const float* aovs;   /* (height, width, channels) of the frame's samples; NaN: missing in this channel */
    const float* depth;  /* (height, width) as in `ss_frame` */
    const float* motion; /* (height, width, 2) as in `ss_frame` */
    float jitter[2];
    const float* weight;   /* (display_height, display_width) as `ss_outputs.weight`; NULL: 0 */
    const float* previous; /* `image` of the previous frame; NULL on the first frame, and after a cut */
    float* image; /* (display_height, display_width, channels), written to, in [-65504, 65504]; not `previous` */
} ss_aovs;

/* Upsamples the AOVs of several views to display size, after `ss_step` with `weight` among its outputs, and blends each with
 * its history by this weight. Where a channel has only missing samples, its history is kept; before its first one, it is 1e-30.
 *
 * model: its threads do the work. */
SS_API ss_status ss_blend_aovs(ss_model* model, const ss_aovs* views, int count, ss_error* error);

/* One frame of the temporal filter: packed arrays of the size of the image. */
typedef struct ss_temporal_frame {
    const float* color;  /* (height, width, 4) linear RGB, denoised, and 1; 0 in all four where a sample is missing */
    const float* noisy;  /* (height, width, 4) the same before denoising, which is averaged in place of it; or NULL */
    const float* guides; /* (height, width, 8) albedo, 0, normal, 0 */
    /* (height, width, 2) pixels, previous minus current: `ss_nearest_motion`; NULL at a cut */
    const float* to_previous;
    const float* to_next;     /* (height, width, 2) pixels, next minus current; NULL before a cut */
    const float* const* aovs; /* arrays of four channels each, (height, width, 4) */
} ss_temporal_frame;

/* A frame and its neighbours. */
typedef struct ss_temporal {
    int width, height;
    /* the frame, `previous` frames before it, the nearest one first, and `following` after it */
    const ss_temporal_frame* frames;
    int previous, following;
    int aov_groups;         /* arrays of AOVs in each frame */
    float exposure;         /* > 0, multiplies colour where colours are compared */
    float samples;          /* > 0, per pixel, of the renderer: the more, the less a neighbour may differ */
    int first_row, end_row; /* rows that are computed; several threads may compute rows of one image */
    float* image;           /* (height, width, 4) the mean, and the sum of the weights, of which 1 is the frame's own */
    float* const* aovs;     /* the means of the AOVs, (height, width, 4) each */
} ss_temporal;

/* Averages a frame and its neighbours along their motion, for frames of a path tracer at the size of the result. The
 * colour of a neighbour is scaled to the light of the frame where that changed a little; AOVs are not. With noisy
 * colours, neighbours count more: the mean is to be denoised. */
SS_API ss_status ss_filter_temporal(const ss_temporal* filter, ss_error* error);

/* Writes the motion of the closest of the 3x3 pixels around each, (height, width, 2). depth: (height, width) reversed,
 * without NaN; motion: (height, width, 2). */
SS_API ss_status ss_nearest_motion(const float* depth, const float* motion, int width, int height, float* to,
                                   ss_error* error);

/* Histories, for hosts that keep them: the step as a pure function ----------------------------------------------- */

typedef struct ss_history ss_history;

/* Creates an empty history for frames and images of these sizes. */
SS_API ss_status ss_history_create(ss_model* model, int display_width, int display_height, int width, int height,
                                   ss_history** history, ss_error* error);
SS_API void ss_history_destroy(ss_history* history);

/* Returns 1 if `history` can hold the history after a frame of this size, else 0. 0 for NULL. */
SS_API int ss_history_fits(const ss_history* history, int width, int height);

/* Computes an image and the next history. The histories are two different ones of `model`; the next one fits the frame.
 * `reset` of the frame is not read: pass an empty history. */
SS_API ss_status ss_run(ss_model* model, const ss_frame* frame, const ss_history* history, ss_history* next_history,
                        const ss_outputs* outputs, ss_error* error);

/* Computes the images and the next histories of several views; see `ss_step_many`. Views may read one history, and each
 * writes to one of its own. */
SS_API ss_status ss_run_many(ss_model* model, const ss_frame* frames, const ss_history* const* histories,
                             ss_history* const* next_histories, const ss_outputs* outputs, int count, ss_error* error);

/* Runs the network of a classifier alone, as docs/contract.md describes it, with one thread.
 *
 * inputs: (height, width, 72) of packed pixels, which are 2x2 display pixels: the 64 channels of `packed` and the 8 of
 *     `half_inputs`. 255 is the largest value of an input, 0 the smallest.
 * outputs: (n + 6, height, width): the n channels of `blend_parameters`, then `logits`. */
SS_API ss_status ss_run_network(ss_model* model, const uint8_t* inputs, int width, int height, float* outputs,
                                ss_error* error);

/* Returns the name of a history tensor of the contract; NULL if there is no such index, or an argument is NULL. `shape` is
 * (n, channels, height, width), or fewer axes: `axes` of them. */
SS_API const char* ss_history_tensor(const ss_history* history, int index, int64_t shape[4], int* axes);

/* Copies a tensor out of a history, or into it: float32, in C order. A history is complete when all have been written.
 */
SS_API ss_status ss_history_read(const ss_history* history, int index, float* values, ss_error* error);
SS_API ss_status ss_history_write(ss_history* history, int index, const float* values, ss_error* error);

/* Writes the bytes of a history that has converged, and of the work buffers of a step, which the steps of a model share
 * unless they overlap in time. To measure them, it allocates and frees both. A ratio outside of the method's is
 * SS_BAD_FRAME. */
SS_API ss_status ss_required_bytes(ss_model* model, int display_width, int display_height, int width, int height,
                                   size_t* history, size_t* working, ss_error* error);

#ifdef __cplusplus
}
#endif

#endif
