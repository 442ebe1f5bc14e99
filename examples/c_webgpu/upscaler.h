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

/* A frame. Units are those of "inputs" in upscaler.json. */
typedef struct {
    WGPUTexture color;    /* rgba16float or rgba32float; all have TextureBinding */
    WGPUTexture depth;    /* r32float */
    WGPUTexture motion;   /* rg16float or rg32float */
    WGPUTexture reactive; /* r8unorm, r16float or r32float; NULL: none */
    uint32_t size[2];     /* (width, height) of what was rendered, each 1 to 16384 */
    float jitter[2];      /* render pixels */
    float exposure;       /* 0: measured */
    float pre_exposure;   /* what the colour was multiplied by, in [2^-24, 2^24]; 0 counts as 1 */
    bool reset;           /* true on the first frame after a cut */
} Frame;

/* Compile the shaders for images of this size, each side 1 to 16384. All that the folder says is checked
 * here. */
Upscaler* upscaler_load(WGPUDevice device, const char* folder, uint32_t width, uint32_t height);

/* Encode one step; submit it before the next one is encoded. image: rgba16float with StorageBinding, of
 * display size. */
void upscaler_encode(Upscaler* upscaler, WGPUCommandEncoder encoder, const Frame* frame, WGPUTexture image);

void upscaler_free(Upscaler* upscaler);

#endif
