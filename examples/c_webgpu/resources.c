#include "resources.h"

#include <string.h>

#include "files.h"

enum { LEAST_BYTES = 16 };

#define AOVS_OF(name) name "0", name "1", name "2", name "3", name "4", name "5", name "6", name "7"
const char* const given_names[GIVEN] = {
    "frame_color",
    "frame_depth",
    "frame_motion",
    "frame_reactive",
    "frame_gbuffer_base_color",
    "frame_gbuffer_normal",
    "frame_gbuffer_display_base_color",
    "frame_gbuffer_display_normal",
    "frame_gbuffer_display_depth",
    AOVS_OF("frame_aovs"),
    "image",
    AOVS_OF("aovs"),
};

WGPUStringView view_of(const char* text) { return (WGPUStringView){text, WGPU_STRLEN}; }

/* ---------------------------------------------------------------- upscaler.json */

Size read_size(const cJSON* object, const char* name) {
    static const char* const bases[BASES] = {"one",     "render",     "previous",
                                             "display", "signatures", "previous_signatures"};
    const cJSON* json = member(object, name);
    Size size = {.of = choice_of(json, "of", bases, BASES), .divide = whole_of(json, "divide", 1, LARGEST_SIDE)};
    two_wholes_of(json, "multiply", LARGEST_SIDE, size.multiply);
    uint32_t largest[BASES][2] = {{1, 1}}, extent[2];
    for (int base = RENDER; base < BASES; base++)
        largest[base][0] = largest[base][1] = base < SIGNATURES ? LARGEST_SIDE : LARGEST_EXTENT;
    size_at(&size, largest, extent);
    if (extent[0] > LARGEST_EXTENT || extent[1] > LARGEST_EXTENT)
        refuse(object, name, "at most %d pixels a side", LARGEST_EXTENT);
    return size;
}

static WGPUTextureFormat read_format(const cJSON* object) {
    static const char* const names[] = {"rgba32float", "rgba32uint", "rgba16float", "rg32float", "rg32uint", "r32uint"};
    static const WGPUTextureFormat formats[] = {WGPUTextureFormat_RGBA32Float, WGPUTextureFormat_RGBA32Uint,
                                                WGPUTextureFormat_RGBA16Float, WGPUTextureFormat_RG32Float,
                                                WGPUTextureFormat_RG32Uint,    WGPUTextureFormat_R32Uint};
    return formats[choice_of(object, "format", names, sizeof formats / sizeof *formats)];
}

/* The index of the pair (history, next) that has a resource on this side. */
static int read_pair(const cJSON* json, const cJSON* item, int side) {
    const cJSON* pairs = list_of(member(json, "history"), "pairs", 0, MOST_PAIRS);
    for (int i = 0; i < cJSON_GetArraySize(pairs); i++) {
        const char* name = cJSON_GetStringValue(cJSON_GetArrayItem(cJSON_GetArrayItem(pairs, i), side));
        if (name != NULL && strcmp(name, text_of(item, "name")) == 0) return i;
    }
    refuse(item, "name", "one of \"pairs\" of \"history\", [history, next]");
}

static bool is_output(const Resource* resource) { return resource->role == IMAGE || resource->role == AOVS; }

bool is_given(const Resource* resource) { return resource->role == FRAME || is_output(resource); }

Resource read_resource(const cJSON* json, const cJSON* item) {
    static const char* const roles[ROLES] = {"params", "weights", "history", "next", "work",
                                             "aux",    "frame",   "image",   "aovs"};
    static const char* const kinds[KINDS] = {"uniform", "buffer", "texture"};
    Resource resource = {
        .name = text_of(item, "name"),
        .role = choice_of(item, "role", roles, ROLES),
        .kind = choice_of(item, "kind", kinds, KINDS),
        .size = read_size(item, "size"),
    };
    bool is_texture = resource.kind == TEXTURE;
    if (is_given(&resource) && !is_texture) refuse(item, "kind", "\"texture\"");
    if (resource.role == WEIGHTS && is_texture) refuse(item, "kind", "\"uniform\" or \"buffer\"");
    if (resource.role == FRAME) resource.index = choice_of(item, "name", given_names, INPUTS);
    const char* const* outputs = given_names + INPUTS;
    if (resource.role == IMAGE) resource.index = INPUTS + choice_of(item, "name", outputs, OUTPUT_AOVS);
    if (resource.role == AOVS)
        resource.index = INPUTS + OUTPUT_AOVS + choice_of(item, "name", outputs + OUTPUT_AOVS, MOST_AOVS);
    if (resource.role == HISTORY) resource.index = read_pair(json, item, 0);
    if (resource.role == NEXT) resource.index = read_pair(json, item, 1);
    if (is_texture && resource.role != FRAME) resource.format = read_format(item);
    if (is_output(&resource) && resource.format != WGPUTextureFormat_RGBA16Float)
        refuse(item, "format", "\"rgba16float\", that of the image which the caller gives");
    if (!is_texture) resource.bytes = whole_of(item, "bytes", 0, LARGEST_PIXEL);
    if (resource.role == AUX) resource.bytes = 0; /* it is not written */
    return resource;
}

WGPUBindGroupLayoutEntry layout_entry(const cJSON* binding, const Resource* resource) {
    enum { UNIFORM_BUFFER, STORAGE, READ_ONLY, STORAGE_TEXTURE, SAMPLED, SAMPLED_UINT, BINDINGS };
    static const char* const kinds[BINDINGS] = {"uniform",         "storage", "read-only-storage",
                                                "storage-texture", "texture", "uint-texture"};
    static const WGPUBufferBindingType types[] = {WGPUBufferBindingType_Uniform, WGPUBufferBindingType_Storage,
                                                  WGPUBufferBindingType_ReadOnlyStorage};
    WGPUBindGroupLayoutEntry entry = {
        .binding = whole_of(binding, "binding", 0, LARGEST_BINDING),
        .visibility = WGPUShaderStage_Compute,
    };
    int kind = choice_of(binding, "kind", kinds, BINDINGS);
    bool fits, is_uint = resource->format == WGPUTextureFormat_RGBA32Uint ||
                         resource->format == WGPUTextureFormat_RG32Uint ||
                         resource->format == WGPUTextureFormat_R32Uint;
    if (kind < STORAGE_TEXTURE) {
        entry.buffer.type = types[kind];
        fits = resource->kind == (kind == UNIFORM_BUFFER ? UNIFORM : BUFFER);
    } else if (kind == STORAGE_TEXTURE) {
        entry.storageTexture.access = WGPUStorageTextureAccess_WriteOnly;
        entry.storageTexture.format = read_format(binding);
        entry.storageTexture.viewDimension = WGPUTextureViewDimension_2D;
        fits = resource->kind == TEXTURE && resource->format == entry.storageTexture.format;
    } else {
        entry.texture.sampleType = is_uint ? WGPUTextureSampleType_Uint : WGPUTextureSampleType_UnfilterableFloat;
        entry.texture.viewDimension = WGPUTextureViewDimension_2D;
        fits = resource->kind == TEXTURE && !is_output(resource) && is_uint == (kind == SAMPLED_UINT);
    }
    if (!fits) refuse(binding, "resource", "a resource that binds as \"%s\"", kinds[kind]);
    return entry;
}

/* ---------------------------------------------------------------- memory */

void release(Memory* memory) {
    if (memory->buffer) wgpuBufferRelease(memory->buffer);
    if (memory->view) wgpuTextureViewRelease(memory->view);
    if (memory->texture) wgpuTextureRelease(memory->texture);
    *memory = (Memory){0};
}

void size_at(const Size* rule, uint32_t bases[BASES][2], uint32_t size[2]) {
    for (int axis = 0; axis < 2; axis++)
        size[axis] = (bases[rule->of][axis] + rule->divide - 1) / rule->divide * rule->multiply[axis];
}

static uint64_t buffer_bytes(const Resource* resource, const uint32_t size[2]) {
    uint64_t bytes = ((uint64_t)resource->bytes * size[0] * size[1] + 3) / 4 * 4;
    return bytes < LEAST_BYTES ? LEAST_BYTES : bytes;
}

void hold(WGPUDevice device, const Resource* resource, Memory* memory, const uint32_t size[2]) {
    bool exists = memory->buffer || memory->texture;
    if (exists && memory->size[0] == size[0] && memory->size[1] == size[1]) return;
    release(memory);
    memcpy(memory->size, size, sizeof memory->size);
    if (resource->kind != TEXTURE) {
        bool is_uniform = resource->kind == UNIFORM;
        WGPUBufferUsage usage = is_uniform ? WGPUBufferUsage_Uniform : WGPUBufferUsage_Storage;
        memory->buffer = wgpuDeviceCreateBuffer(device, &(WGPUBufferDescriptor){
                                                            .label = view_of(resource->name),
                                                            .usage = usage | WGPUBufferUsage_CopyDst,
                                                            .size = buffer_bytes(resource, size),
                                                        });
        return;
    }
    memory->texture =
        wgpuDeviceCreateTexture(device, &(WGPUTextureDescriptor){
                                            .label = view_of(resource->name),
                                            .usage = WGPUTextureUsage_TextureBinding | WGPUTextureUsage_StorageBinding,
                                            .dimension = WGPUTextureDimension_2D,
                                            .size = {size[0], size[1], 1},
                                            .format = resource->format,
                                            .mipLevelCount = 1,
                                            .sampleCount = 1,
                                        });
    memory->view = wgpuTextureCreateView(memory->texture, NULL);
}
