/* Temporal supersampling with WebGPU in C, from a folder that `supersampler export METHOD --target wgsl`
 * wrote.
 *
 * One Upscaler holds the history of one view. Errors print a line and end the program: an engine has its own
 * way. */

#ifndef UPSCALER_H
#define UPSCALER_H

#include <stdbool.h>
#include <stdint.h>

#include "webgpu.h"

typedef struct Upscaler Upscaler;

enum { MOST_AOVS = 8 }; /* textures, of four channels each */

/* Textures of a frame. Units are those of "inputs" in upscaler.json, which lists those that are read. */
enum {
    INPUT_COLOR,      /* rgba16float or rgba32float; all have TextureBinding */
    INPUT_DEPTH,      /* r32float */
    INPUT_MOTION,     /* rg16float or rg32float */
    INPUT_REACTIVE,   /* r8unorm, r16float or r32float; NULL: none */
    INPUT_BASE_COLOR, /* G-buffers: rgba16float or rgba32float, base colours also rgba8unorm */
    INPUT_NORMAL,
    INPUT_DISPLAY_BASE_COLOR,
    INPUT_DISPLAY_NORMAL,
    INPUT_DISPLAY_DEPTH, /* r32float */
    INPUT_AOVS,          /* the first of them: rgba8unorm, rgba16float or rgba32float */
    INPUTS = INPUT_AOVS + MOST_AOVS
};

/* Textures that a step writes: rgba16float with StorageBinding, of display size. */
enum { OUTPUT_IMAGE, OUTPUT_AOVS, OUTPUTS = OUTPUT_AOVS + MOST_AOVS };

typedef struct {
    WGPUTexture inputs[INPUTS];
    uint32_t size[2];   /* (width, height) of what was rendered, each 1 to 16384 */
    float jitter[2];    /* render pixels */
    float exposure;     /* 0: measured */
    float pre_exposure; /* what the colour was multiplied by, in [2^-24, 2^24]; 0 counts as 1 */
    bool reset;         /* true on the first frame after a cut */
} Frame;

/* Compile the shaders for images of this size, each side 1 to 16384. All that the folder says is checked
 * here. */
Upscaler* upscaler_load(WGPUDevice device, const char* folder, uint32_t width, uint32_t height);

/* The number of textures of AOVs that the folder blends; see `supersampler export --aovs`. */
int upscaler_aovs(const Upscaler* upscaler);

/* Encode one step; submit it before the next one is encoded. */
void upscaler_encode(Upscaler* upscaler, WGPUCommandEncoder encoder, const Frame* frame,
                     const WGPUTexture outputs[OUTPUTS]);

void upscaler_free(Upscaler* upscaler);

#endif
