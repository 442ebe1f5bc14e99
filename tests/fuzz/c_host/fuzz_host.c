/* Fuzz target: load a folder, encode a few steps. An input is upscaler.json, a zero byte, frames.json; other
 * files are those of the working directory. */

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files.h"
#include "shot.h"
#include "upscaler.h"
#undef exit /* of hooks.h */
#undef fopen
#undef malloc
#undef calloc
#undef free

enum { STEPS = 4 };

WGPUDevice stub_device(void);                      /* of wgpu_stub.c */
void keep_input(const uint8_t* data, size_t size); /* of mutate.c */

static jmp_buf refused;
static const char* files[2]; /* upscaler.json and frames.json */
static size_t sizes[2];

/* ---------------------------------------------------------------- hooks */

typedef struct Block {
    struct Block *previous, *next;
} Block;

static Block blocks = {&blocks, &blocks};

void* hook_calloc(size_t count, size_t size) {
    Block* block = calloc(1, sizeof *block + count * size);
    if (block == NULL) return NULL;
    *block = (Block){&blocks, blocks.next};
    block->next->previous = blocks.next = block;
    return block + 1;
}

void* hook_malloc(size_t size) { return hook_calloc(1, size); }

void hook_free(void* data) {
    if (data == NULL) return;
    Block* block = (Block*)data - 1;
    block->previous->next = block->next;
    block->next->previous = block->previous;
    free(block);
}

void hook_exit(int status) { longjmp(refused, status); }

FILE* hook_fopen(const char* path, const char* mode) {
    const char *name = path + 2, *const known[2] = {"upscaler.json", "frames.json"};
    if (strncmp(path, "./", 2) != 0 || strchr(name, '/') != NULL || strcmp(name, "..") == 0) {
        fprintf(stderr, "a file outside of the folder: %s\n", path);
        abort();
    }
    for (int i = 0; i < 2; i++)
        if (strcmp(name, known[i]) == 0) return fmemopen((void*)files[i], sizes[i], mode);
    return fopen(path, mode);
}

/* ---------------------------------------------------------------- a run */

static WGPUTexture texture(WGPUDevice device, const uint32_t size[2], WGPUTextureFormat format) {
    bool is_image = format == WGPUTextureFormat_RGBA16Float;
    WGPUTextureDescriptor described = {
        .usage = is_image ? WGPUTextureUsage_StorageBinding : WGPUTextureUsage_TextureBinding,
        .size = {size[0], size[1], 1},
        .format = format,
    };
    return wgpuDeviceCreateTexture(device, &described);
}

static void step(WGPUDevice device, Upscaler* upscaler, const ShotFrame* item, const WGPUTexture outputs[OUTPUTS]) {
    Frame frame = {
        .size = {item->size[0], item->size[1]},
        .jitter = {item->jitter[0], item->jitter[1]},
        .exposure = item->exposure,
        .pre_exposure = item->pre_exposure,
        .reset = item->reset,
    };
    for (int i = 0; i < INPUTS; i++)
        if (i != INPUT_REACTIVE) frame.inputs[i] = texture(device, item->size, WGPUTextureFormat_RGBA32Float);
    WGPUCommandEncoder encoder = wgpuDeviceCreateCommandEncoder(device, NULL);
    upscaler_encode(upscaler, encoder, &frame, outputs);
    wgpuCommandEncoderRelease(encoder);
    for (int i = 0; i < INPUTS; i++)
        if (frame.inputs[i]) wgpuTextureRelease(frame.inputs[i]);
}

static void load_and_step(void) {
    WGPUDevice device = stub_device();
    Shot shot = shot_load(".");
    Upscaler* upscaler = upscaler_load(device, ".", shot.display[0], shot.display[1]);
    WGPUTexture outputs[OUTPUTS] = {0};
    for (int i = 0; i <= upscaler_aovs(upscaler); i++)
        outputs[i] = texture(device, shot.display, WGPUTextureFormat_RGBA16Float);
    for (int i = 0; i < shot.count && i < STEPS; i++) step(device, upscaler, &shot.frames[i], outputs);
    for (int i = 0; i <= upscaler_aovs(upscaler); i++) wgpuTextureRelease(outputs[i]);
    upscaler_free(upscaler);
    shot_free(&shot);
    wgpuDeviceRelease(device);
    if (blocks.next != &blocks) {
        fprintf(stderr, "memory that is not freed\n");
        abort();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    const uint8_t* end = memchr(data, 0, size);
    sizes[0] = end ? (size_t)(end - data) : size;
    sizes[1] = end ? size - sizes[0] - 1 : 0;
    files[0] = (const char*)data;
    files[1] = (const char*)data + size - sizes[1];
    cJSON_InitHooks(&(cJSON_Hooks){hook_malloc, hook_free});
    if (setjmp(refused) == 0) {
        load_and_step();
        keep_input(data, size);
    }
    while (blocks.next != &blocks) hook_free(blocks.next + 1);
    return 0;
}
