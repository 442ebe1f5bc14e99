#include "resources.h"

#include <stdbool.h>
#include <string.h>

#include "files.h"

enum { LEAST_BYTES = 16 };

WGPUStringView view_of(const char *text)
{
    return (WGPUStringView){text, WGPU_STRLEN};
}

Size read_size(const cJSON *json)
{
    static const char *const names[BASES] = {"one", "render", "previous", "display"};
    const char *of = text_of(json, "of");
    Size size = {.divide = (uint32_t)number_of(json, "divide")};
    while (size.of < BASES && strcmp(of, names[size.of]) != 0) size.of++;
    if (size.of == BASES) fail("upscaler.json: unknown size \"%s\"", of);
    for (int axis = 0; axis < 2; axis++)
        size.multiply[axis] = (uint32_t)item_of(member(json, "multiply"), axis);
    return size;
}

static WGPUTextureFormat read_format(const char *name)
{
    static const struct {
        const char *name;
        WGPUTextureFormat format;
    } known[] = {
        {"rgba32float", WGPUTextureFormat_RGBA32Float}, {"rgba32uint", WGPUTextureFormat_RGBA32Uint},
        {"rgba16float", WGPUTextureFormat_RGBA16Float}, {"rg32float", WGPUTextureFormat_RG32Float},
        {"rg32uint", WGPUTextureFormat_RG32Uint},
    };
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcmp(name, known[i].name) == 0) return known[i].format;
    fail("upscaler.json: unknown format %s", name);
    return WGPUTextureFormat_Undefined;
}

static int pair_of(const cJSON *json, const char *name)
{
    const cJSON *pairs = member(member(json, "history"), "pairs");
    for (int i = 0; i < cJSON_GetArraySize(pairs); i++)
        for (int side = 0; side < 2; side++)
            if (strcmp(cJSON_GetStringValue(cJSON_GetArrayItem(cJSON_GetArrayItem(pairs, i), side)), name) ==
                0)
                return i;
    return -1;
}

Resource read_resource(const cJSON *json, const cJSON *item)
{
    const char *role = text_of(item, "role"), *kind = text_of(item, "kind");
    Resource resource = {
        .name = text_of(item, "name"), .size = read_size(member(item, "size")), .role = HELD
    };
    resource.pair = pair_of(json, resource.name);
    if (strcmp(role, "history") == 0) resource.role = HISTORY;
    if (strcmp(role, "next") == 0) resource.role = NEXT;
    if (strcmp(role, "frame") == 0 || strcmp(role, "image") == 0) {
        resource.role = GIVEN;
    } else if (strcmp(kind, "texture") == 0) {
        resource.format = read_format(text_of(item, "format"));
    } else {
        resource.bytes =
            strcmp(role, "aux") == 0 ? 0 : (uint64_t)number_of(item, "bytes"); /* aux is not written */
        resource.usage = strcmp(kind, "uniform") == 0 ? WGPUBufferUsage_Uniform : WGPUBufferUsage_Storage;
    }
    return resource;
}

WGPUBindGroupLayoutEntry layout_entry(const cJSON *binding)
{
    const char *kind = text_of(binding, "kind");
    WGPUBindGroupLayoutEntry entry = {
        .binding = (uint32_t)number_of(binding, "binding"),
        .visibility = WGPUShaderStage_Compute,
    };
    if (strcmp(kind, "uniform") == 0) entry.buffer.type = WGPUBufferBindingType_Uniform;
    else if (strcmp(kind, "storage") == 0) entry.buffer.type = WGPUBufferBindingType_Storage;
    else if (strcmp(kind, "read-only-storage") == 0)
        entry.buffer.type = WGPUBufferBindingType_ReadOnlyStorage;
    else if (strcmp(kind, "storage-texture") == 0) {
        entry.storageTexture.access = WGPUStorageTextureAccess_WriteOnly;
        entry.storageTexture.format = read_format(text_of(binding, "format"));
        entry.storageTexture.viewDimension = WGPUTextureViewDimension_2D;
    } else {
        bool is_uint = strcmp(kind, "uint-texture") == 0;
        entry.texture.sampleType =
            is_uint ? WGPUTextureSampleType_Uint : WGPUTextureSampleType_UnfilterableFloat;
        entry.texture.viewDimension = WGPUTextureViewDimension_2D;
    }
    return entry;
}

void release(Memory *memory)
{
    if (memory->buffer) wgpuBufferRelease(memory->buffer);
    if (memory->view) wgpuTextureViewRelease(memory->view);
    if (memory->texture) wgpuTextureRelease(memory->texture);
    *memory = (Memory){0};
}

void size_at(const Size *rule, uint32_t bases[BASES][2], uint32_t size[2])
{
    for (int axis = 0; axis < 2; axis++)
        size[axis] = (bases[rule->of][axis] + rule->divide - 1) / rule->divide * rule->multiply[axis];
}

static uint64_t buffer_bytes(const Resource *resource, const uint32_t size[2])
{
    uint64_t bytes = (resource->bytes * size[0] * size[1] + 3) / 4 * 4;
    return bytes < LEAST_BYTES ? LEAST_BYTES : bytes;
}

/* Allocate memory, zeros, unless it has this size. A history that is read has it: it was written at this
 * size. */
void hold(WGPUDevice device, const Resource *resource, Memory *memory, const uint32_t size[2])
{
    bool exists = memory->buffer || memory->texture;
    if (exists && memory->size[0] == size[0] && memory->size[1] == size[1]) return;
    release(memory);
    memcpy(memory->size, size, sizeof memory->size);
    if (resource->format == WGPUTextureFormat_Undefined) {
        memory->buffer = wgpuDeviceCreateBuffer(
            device, &(WGPUBufferDescriptor){
                        .label = view_of(resource->name),
                        .usage = resource->usage | WGPUBufferUsage_CopyDst,
                        .size = buffer_bytes(resource, size),
                    }
        );
        return;
    }
    memory->texture = wgpuDeviceCreateTexture(
        device, &(WGPUTextureDescriptor){
                    .label = view_of(resource->name),
                    .usage = WGPUTextureUsage_TextureBinding | WGPUTextureUsage_StorageBinding,
                    .dimension = WGPUTextureDimension_2D,
                    .size = {size[0], size[1], 1},
                    .format = resource->format,
                    .mipLevelCount = 1,
                    .sampleCount = 1,
                }
    );
    memory->view = wgpuTextureCreateView(memory->texture, NULL);
}
