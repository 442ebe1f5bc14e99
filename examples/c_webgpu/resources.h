/* Resources of upscaler.json: their sizes and formats, and the memory that they take. */

#ifndef RESOURCES_H
#define RESOURCES_H

#include <cjson/cJSON.h>
#include <stdint.h>

#include "webgpu.h"

/* A size by rule: ceil(base / divide) * multiply. */
typedef struct {
    enum { ONE, RENDER, PREVIOUS, DISPLAY, BASES } of;
    uint32_t divide, multiply[2];
} Size;

/* What is allocated: a buffer, or a texture and its view. */
typedef struct {
    WGPUBuffer buffer;
    WGPUTexture texture;
    WGPUTextureView view;
    uint32_t size[2];
} Memory;

typedef struct {
    const char *name;
    enum { GIVEN, HELD, HISTORY, NEXT } role; /* GIVEN: by the caller */
    WGPUTextureFormat format;                 /* of a texture; Undefined for a buffer */
    WGPUBufferUsage usage;
    Size size;
    uint64_t bytes; /* of a buffer, for each pixel of its size */
    int pair;       /* of HISTORY and NEXT */
    Memory held;
} Resource;

WGPUStringView view_of(const char *text);

Size read_size(const cJSON *json);

/* A resource of `json`, the content of upscaler.json. */
Resource read_resource(const cJSON *json, const cJSON *item);

/* The entry of a bind group layout for a binding of a pass. */
WGPUBindGroupLayoutEntry layout_entry(const cJSON *binding);

/* A size at these sizes. */
void size_at(const Size *rule, uint32_t bases[BASES][2], uint32_t size[2]);

/* Allocate memory, zeros, unless it has this size. A history that is read has it: it was written at this
 * size. */
void hold(WGPUDevice device, const Resource *resource, Memory *memory, const uint32_t size[2]);

/* Free memory, if there is some. */
void release(Memory *memory);

#endif
