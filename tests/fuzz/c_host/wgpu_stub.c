/* The functions of WebGPU that examples/c_webgpu calls, without a GPU: they compute nothing, and end the
 * program on what WebGPU does not allow, so that a host which checks a folder too little is found without a
 * driver. */

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "wgpu.h"

#define WANT(met) ((met) ? (void)0 : broken(__func__, #met))

enum { MOST_GROUPS = 4, MOST_EXTENT = 65535 };
#define MOST_BYTES ((uint64_t)1 << 61)

/* What a handle points at. A view has the size, format and usage of its texture. */
typedef struct {
    const char* kind;
    uint64_t bytes, usage;
    uint32_t width, height;
    WGPUTextureFormat format;
    WGPUBindGroupLayoutEntry* entries; /* of a layout */
    size_t count;                      /* of those, or of the groups of a pipeline */
    void* data;                        /* of a buffer that is mapped */
} Object;

static const Object* pipeline; /* of the pass that is encoded */
static size_t groups_set;

static void broken(const char* function, const char* wanted) {
    fprintf(stderr, "wgpu stub: %s: want %s\n", function, wanted);
    abort();
}

static void* made(const char* kind, Object values) {
    Object* object = malloc(sizeof *object);
    WANT(object != NULL);
    *object = values;
    object->kind = kind;
    return object;
}

static Object* as(const char* kind, const void* handle) {
    Object* object = (Object*)handle;
    WANT(object != NULL && strcmp(object->kind, kind) == 0);
    return object;
}

static void dropped(const char* kind, const void* handle) {
    Object* object = as(kind, handle);
    free(object->entries);
    free(object->data);
    free(object);
}

/* Read all bytes, so that a sanitizer sees those which are not there. */
static void touch(const void* data, size_t size) {
    void* copy = malloc(size + 1);
    WANT(copy != NULL);
    memcpy(copy, data, size);
    free(copy);
}

static void touch_text(WGPUStringView text) {
    WANT(text.data != NULL && text.length == WGPU_STRLEN);
    touch(text.data, strlen(text.data));
}

#define RELEASE(Kind) \
    void wgpu##Kind##Release(WGPU##Kind handle) { dropped(#Kind, handle); }
RELEASE(Adapter)
RELEASE(BindGroup)
RELEASE(BindGroupLayout)
RELEASE(Buffer)
RELEASE(CommandBuffer)
RELEASE(CommandEncoder)
RELEASE(ComputePassEncoder)
RELEASE(ComputePipeline)
RELEASE(Device)
RELEASE(Instance)
RELEASE(PipelineLayout)
RELEASE(Queue)
RELEASE(ShaderModule)
RELEASE(Texture)
RELEASE(TextureView)

/* ---------------------------------------------------------------- device */

WGPUInstance wgpuCreateInstance(const WGPUInstanceDescriptor* descriptor) {
    (void)descriptor;
    return made("Instance", (Object){0});
}

void wgpuInstanceProcessEvents(WGPUInstance instance) { as("Instance", instance); }

WGPUFuture wgpuInstanceRequestAdapter(WGPUInstance instance, const WGPURequestAdapterOptions* options,
                                      WGPURequestAdapterCallbackInfo info) {
    (void)options;
    as("Instance", instance);
    WGPUAdapter adapter = made("Adapter", (Object){0});
    info.callback(WGPURequestAdapterStatus_Success, adapter, (WGPUStringView){0}, info.userdata1, info.userdata2);
    return (WGPUFuture){0};
}

WGPUDevice stub_device(void) { return made("Device", (Object){0}); }

WGPUFuture wgpuAdapterRequestDevice(WGPUAdapter adapter, const WGPUDeviceDescriptor* descriptor,
                                    WGPURequestDeviceCallbackInfo info) {
    (void)descriptor;
    as("Adapter", adapter);
    info.callback(WGPURequestDeviceStatus_Success, stub_device(), (WGPUStringView){0}, info.userdata1, info.userdata2);
    return (WGPUFuture){0};
}

WGPUStatus wgpuAdapterGetInfo(WGPUAdapter adapter, WGPUAdapterInfo* info) {
    as("Adapter", adapter);
    info->device = (WGPUStringView){"stub", 4};
    return WGPUStatus_Success;
}

void wgpuAdapterInfoFreeMembers(WGPUAdapterInfo info) { (void)info; }

WGPUQueue wgpuDeviceGetQueue(WGPUDevice device) {
    as("Device", device);
    return made("Queue", (Object){0});
}

WGPUBool wgpuDevicePoll(WGPUDevice device, WGPUBool wait, const WGPUSubmissionIndex* index) {
    (void)wait, (void)index;
    as("Device", device);
    return 1;
}

/* ---------------------------------------------------------------- memory */

WGPUBuffer wgpuDeviceCreateBuffer(WGPUDevice device, const WGPUBufferDescriptor* descriptor) {
    as("Device", device);
    WANT(descriptor->size > 0 && descriptor->size % 4 == 0 && descriptor->size < MOST_BYTES);
    WANT(descriptor->usage != 0);
    return made("Buffer", (Object){.bytes = descriptor->size, .usage = descriptor->usage});
}

WGPUTexture wgpuDeviceCreateTexture(WGPUDevice device, const WGPUTextureDescriptor* descriptor) {
    as("Device", device);
    WGPUExtent3D size = descriptor->size;
    WANT(size.width > 0 && size.width <= MOST_EXTENT && size.height > 0 && size.height <= MOST_EXTENT);
    WANT(descriptor->format != WGPUTextureFormat_Undefined && descriptor->usage != 0);
    return made("Texture", (Object){
                               .width = size.width,
                               .height = size.height,
                               .format = descriptor->format,
                               .usage = descriptor->usage,
                           });
}

WGPUTextureView wgpuTextureCreateView(WGPUTexture texture, const WGPUTextureViewDescriptor* descriptor) {
    (void)descriptor;
    return made("TextureView", *as("Texture", texture));
}

void wgpuQueueWriteBuffer(WGPUQueue queue, WGPUBuffer buffer, uint64_t offset, const void* data, size_t size) {
    as("Queue", queue);
    const Object* to = as("Buffer", buffer);
    WANT(size % 4 == 0 && offset == 0 && size <= to->bytes && (to->usage & WGPUBufferUsage_CopyDst));
    touch(data, size);
}

void wgpuQueueWriteTexture(WGPUQueue queue, const WGPUTexelCopyTextureInfo* destination, const void* data, size_t size,
                           const WGPUTexelCopyBufferLayout* layout, const WGPUExtent3D* extent) {
    as("Queue", queue);
    const Object* to = as("Texture", destination->texture);
    WANT(extent->width == to->width && extent->height == to->height);
    WANT(size == (size_t)layout->bytesPerRow * extent->height && (to->usage & WGPUTextureUsage_CopyDst));
    touch(data, size);
}

WGPUFuture wgpuBufferMapAsync(WGPUBuffer buffer, WGPUMapMode mode, size_t offset, size_t size,
                              WGPUBufferMapCallbackInfo info) {
    Object* object = as("Buffer", buffer);
    WANT(mode == WGPUMapMode_Read && offset == 0 && size == object->bytes && object->data == NULL);
    object->data = calloc(size, 1);
    info.callback(WGPUMapAsyncStatus_Success, (WGPUStringView){0}, info.userdata1, info.userdata2);
    return (WGPUFuture){0};
}

const void* wgpuBufferGetConstMappedRange(WGPUBuffer buffer, size_t offset, size_t size) {
    const Object* object = as("Buffer", buffer);
    WANT(object->data != NULL && offset == 0 && size == object->bytes);
    return object->data;
}

void wgpuBufferUnmap(WGPUBuffer buffer) {
    Object* object = as("Buffer", buffer);
    free(object->data);
    object->data = NULL;
}

/* ---------------------------------------------------------------- pipelines */

WGPUShaderModule wgpuDeviceCreateShaderModule(WGPUDevice device, const WGPUShaderModuleDescriptor* descriptor) {
    as("Device", device);
    touch_text(descriptor->label);
    touch_text(((const WGPUShaderSourceWGSL*)descriptor->nextInChain)->code);
    return made("ShaderModule", (Object){0});
}

WGPUBindGroupLayout wgpuDeviceCreateBindGroupLayout(WGPUDevice device,
                                                    const WGPUBindGroupLayoutDescriptor* descriptor) {
    as("Device", device);
    size_t count = descriptor->entryCount, bytes = count * sizeof *descriptor->entries;
    WANT(count > 0);
    for (size_t i = 0; i < count; i++)
        for (size_t j = 0; j < i; j++) WANT(descriptor->entries[i].binding != descriptor->entries[j].binding);
    Object object = {.count = count, .entries = malloc(bytes)};
    WANT(object.entries != NULL);
    memcpy(object.entries, descriptor->entries, bytes);
    return made("BindGroupLayout", object);
}

WGPUPipelineLayout wgpuDeviceCreatePipelineLayout(WGPUDevice device, const WGPUPipelineLayoutDescriptor* descriptor) {
    as("Device", device);
    WANT(descriptor->bindGroupLayoutCount <= MOST_GROUPS);
    for (size_t i = 0; i < descriptor->bindGroupLayoutCount; i++)
        as("BindGroupLayout", descriptor->bindGroupLayouts[i]);
    return made("PipelineLayout", (Object){.count = descriptor->bindGroupLayoutCount});
}

WGPUComputePipeline wgpuDeviceCreateComputePipeline(WGPUDevice device,
                                                    const WGPUComputePipelineDescriptor* descriptor) {
    as("Device", device);
    as("ShaderModule", descriptor->compute.module);
    touch_text(descriptor->compute.entryPoint);
    return made("ComputePipeline", (Object){.count = as("PipelineLayout", descriptor->layout)->count});
}

static bool is_uint(WGPUTextureFormat format) {
    return format == WGPUTextureFormat_RGBA32Uint || format == WGPUTextureFormat_RG32Uint ||
           format == WGPUTextureFormat_R32Uint;
}

static void check_binding(const WGPUBindGroupLayoutEntry* wanted, const WGPUBindGroupEntry* given) {
    if (wanted->buffer.type != WGPUBufferBindingType_BindingNotUsed) {
        bool is_uniform = wanted->buffer.type == WGPUBufferBindingType_Uniform;
        WANT(given->size == WGPU_WHOLE_SIZE && given->textureView == NULL);
        WANT(as("Buffer", given->buffer)->usage & (is_uniform ? WGPUBufferUsage_Uniform : WGPUBufferUsage_Storage));
        return;
    }
    const Object* view = as("TextureView", given->textureView);
    WANT(given->buffer == NULL);
    if (wanted->storageTexture.access != WGPUStorageTextureAccess_BindingNotUsed) {
        WANT(view->format == wanted->storageTexture.format);
        WANT(view->usage & WGPUTextureUsage_StorageBinding);
    } else {
        WANT(is_uint(view->format) == (wanted->texture.sampleType == WGPUTextureSampleType_Uint));
        WANT(view->usage & WGPUTextureUsage_TextureBinding);
    }
}

WGPUBindGroup wgpuDeviceCreateBindGroup(WGPUDevice device, const WGPUBindGroupDescriptor* descriptor) {
    as("Device", device);
    const Object* layout = as("BindGroupLayout", descriptor->layout);
    WANT(descriptor->entryCount == layout->count);
    for (size_t i = 0; i < layout->count; i++) {
        size_t j = 0;
        while (j < layout->count && descriptor->entries[j].binding != layout->entries[i].binding) j++;
        WANT(j < layout->count);
        check_binding(&layout->entries[i], &descriptor->entries[j]);
    }
    return made("BindGroup", (Object){0});
}

/* ---------------------------------------------------------------- commands */

WGPUCommandEncoder wgpuDeviceCreateCommandEncoder(WGPUDevice device, const WGPUCommandEncoderDescriptor* descriptor) {
    (void)descriptor;
    as("Device", device);
    return made("CommandEncoder", (Object){0});
}

WGPUComputePassEncoder wgpuCommandEncoderBeginComputePass(WGPUCommandEncoder encoder,
                                                          const WGPUComputePassDescriptor* descriptor) {
    (void)descriptor;
    as("CommandEncoder", encoder);
    return made("ComputePassEncoder", (Object){0});
}

void wgpuComputePassEncoderSetPipeline(WGPUComputePassEncoder pass, WGPUComputePipeline handle) {
    as("ComputePassEncoder", pass);
    pipeline = as("ComputePipeline", handle);
    groups_set = 0;
}

void wgpuComputePassEncoderSetBindGroup(WGPUComputePassEncoder pass, uint32_t index, WGPUBindGroup group, size_t count,
                                        const uint32_t* offsets) {
    as("ComputePassEncoder", pass);
    as("BindGroup", group);
    WANT(index == groups_set++ && count == 0 && offsets == NULL);
}

void wgpuComputePassEncoderDispatchWorkgroups(WGPUComputePassEncoder pass, uint32_t x, uint32_t y, uint32_t z) {
    as("ComputePassEncoder", pass);
    WANT(groups_set == pipeline->count);
    WANT(x > 0 && x <= MOST_EXTENT && y > 0 && y <= MOST_EXTENT && z == 1);
}

void wgpuComputePassEncoderEnd(WGPUComputePassEncoder pass) { as("ComputePassEncoder", pass); }

void wgpuCommandEncoderCopyTextureToBuffer(WGPUCommandEncoder encoder, const WGPUTexelCopyTextureInfo* source,
                                           const WGPUTexelCopyBufferInfo* destination, const WGPUExtent3D* size) {
    as("CommandEncoder", encoder);
    const Object *from = as("Texture", source->texture), *to = as("Buffer", destination->buffer);
    WANT(size->width == from->width && size->height == from->height);
    WANT(destination->layout.bytesPerRow % 256 == 0);
    WANT((uint64_t)destination->layout.bytesPerRow * size->height <= to->bytes);
}

WGPUCommandBuffer wgpuCommandEncoderFinish(WGPUCommandEncoder encoder, const WGPUCommandBufferDescriptor* descriptor) {
    (void)descriptor;
    as("CommandEncoder", encoder);
    return made("CommandBuffer", (Object){0});
}

void wgpuQueueSubmit(WGPUQueue queue, size_t count, const WGPUCommandBuffer* commands) {
    as("Queue", queue);
    for (size_t i = 0; i < count; i++) as("CommandBuffer", commands[i]);
}
