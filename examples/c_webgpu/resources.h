/* Resources of upscaler.json: their sizes and formats, and the memory that they take. */

#ifndef RESOURCES_H
#define RESOURCES_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stdint.h>

#include "upscaler.h"

enum {
    MOST_PAIRS = 32,         /* of histories */
    LARGEST_EXTENT = 65535,  /* of a resource or a pass, in pixels: the workgroups that WebGPU dispatches */
    LARGEST_PIXEL = 1 << 28, /* of a buffer, in bytes */
    LARGEST_BINDING = 999,   /* number of a binding in its group, of WebGPU */
};

/* A size by rule: ceil(base / divide) * multiply. */
typedef struct {
    enum { ONE, RENDER, PREVIOUS, DISPLAY, SIGNATURES, PREVIOUS_SIGNATURES, BASES } of;
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
    const char* name;
    enum { PARAMS, WEIGHTS, HISTORY, NEXT, WORK, AUX, FRAME, IMAGE, AOVS, ROLES } role;
    enum { UNIFORM, BUFFER, TEXTURE, KINDS } kind;
    WGPUTextureFormat format; /* of a texture; Undefined for FRAME */
    Size size;                /* of all but WEIGHTS, which have one pixel */
    uint32_t bytes;           /* of a buffer, for each pixel of its size */
    int index;                /* of the pair of HISTORY and NEXT; of FRAME, IMAGE and AOVS in `given_names` */
    Memory held;
} Resource;

/* Names of what the caller gives: inputs of FRAME, then outputs, IMAGE and AOVS. */
enum { GIVEN = INPUTS + OUTPUTS };
extern const char* const given_names[GIVEN];

WGPUStringView view_of(const char* text);

/* A member of an object that is a size. */
Size read_size(const cJSON* object, const char* name);

/* A resource of `json`, the content of upscaler.json. */
Resource read_resource(const cJSON* json, const cJSON* item);

/* Whether the caller gives it. */
bool is_given(const Resource* resource);

/* The entry of a bind group layout for a binding of a pass to a resource, which must be of its kind. */
WGPUBindGroupLayoutEntry layout_entry(const cJSON* binding, const Resource* resource);

/* A size at these sizes. */
void size_at(const Size* rule, uint32_t bases[BASES][2], uint32_t size[2]);

/* Allocate memory, zeros, unless it has this size. A history that is read has it: it was written at this
 * size. */
void hold(WGPUDevice device, const Resource* resource, Memory* memory, const uint32_t size[2]);

/* Free memory, if there is some. */
void release(Memory* memory);

#endif
