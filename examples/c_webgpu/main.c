/* Upscale the frames of a shot with wgpu: a host that knows nothing of Python.
 *
 *   ./upscale SHADERS FRAMES OUTPUT
 *
 * SHADERS: folder that `supersampler export METHOD --target wgsl` wrote. FRAMES: folder that ../raw_frames.py
 * wrote. OUTPUT: folder for images: raw half floats (height, width, RGBA), linear; AOVs beside them. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files.h"
#include "shot.h"
#include "upscaler.h"
#include "wgpu.h"

enum { ROW = 256, TEXEL = 8 }; /* bytes: rows of a copied texture begin at multiples of it; of a pixel of the image */

static void on_adapter(WGPURequestAdapterStatus status, WGPUAdapter adapter, WGPUStringView message, void* found,
                       void* unused) {
    (void)unused;
    if (status != WGPURequestAdapterStatus_Success)
        fail("no adapter: %.*s; install a Vulkan, Metal or DirectX 12 driver", (int)message.length, message.data);
    *(WGPUAdapter*)found = adapter;
}

static void on_device(WGPURequestDeviceStatus status, WGPUDevice device, WGPUStringView message, void* found,
                      void* unused) {
    (void)unused;
    if (status != WGPURequestDeviceStatus_Success) fail("no device: %.*s", (int)message.length, message.data);
    *(WGPUDevice*)found = device;
}

static void on_error(WGPUDevice const* device, WGPUErrorType type, WGPUStringView message, void* one, void* two) {
    (void)device, (void)type, (void)one, (void)two;
    fail("%.*s", (int)message.length, message.data);
}

static void on_mapped(WGPUMapAsyncStatus status, WGPUStringView message, void* done, void* unused) {
    (void)unused;
    if (status != WGPUMapAsyncStatus_Success) fail("the image cannot be read: %.*s", (int)message.length, message.data);
    *(bool*)done = true;
}

static WGPUDevice open_device(WGPUInstance instance) {
    WGPUAdapter adapter = NULL;
    WGPUDevice device = NULL;
    wgpuInstanceRequestAdapter(
        instance, &(WGPURequestAdapterOptions){.powerPreference = WGPUPowerPreference_HighPerformance},
        (WGPURequestAdapterCallbackInfo){
            .mode = WGPUCallbackMode_AllowProcessEvents, .callback = on_adapter, .userdata1 = &adapter});
    while (adapter == NULL) wgpuInstanceProcessEvents(instance);
    WGPUDeviceDescriptor described = {.uncapturedErrorCallbackInfo.callback = on_error};
    wgpuAdapterRequestDevice(
        adapter, &described,
        (WGPURequestDeviceCallbackInfo){
            .mode = WGPUCallbackMode_AllowProcessEvents, .callback = on_device, .userdata1 = &device});
    while (device == NULL) wgpuInstanceProcessEvents(instance);
    WGPUAdapterInfo info = {0};
    wgpuAdapterGetInfo(adapter, &info);
    printf("adapter: %.*s\n", (int)info.device.length, info.device.data);
    wgpuAdapterInfoFreeMembers(info);
    wgpuAdapterRelease(adapter);
    return device;
}

static void submit(WGPUQueue queue, WGPUCommandEncoder encoder) {
    WGPUCommandBuffer commands = wgpuCommandEncoderFinish(encoder, NULL);
    wgpuQueueSubmit(queue, 1, &commands);
    wgpuCommandBufferRelease(commands);
    wgpuCommandEncoderRelease(encoder);
}

static WGPUTexture new_texture(WGPUDevice device, WGPUTextureFormat format, uint32_t width, uint32_t height,
                               WGPUTextureUsage usage) {
    return wgpuDeviceCreateTexture(device, &(WGPUTextureDescriptor){
                                               .usage = usage,
                                               .dimension = WGPUTextureDimension_2D,
                                               .size = {width, height, 1},
                                               .format = format,
                                               .mipLevelCount = 1,
                                               .sampleCount = 1,
                                           });
}

/* Load the images of a frame: float32, row by row. An engine has them in textures already. */
static WGPUTexture load(WGPUDevice device, WGPUQueue queue, const char* folder, const char* file,
                        const uint32_t size[2], uint32_t channels) {
    const WGPUTextureFormat formats[] = {0, WGPUTextureFormat_R32Float, WGPUTextureFormat_RG32Float, 0,
                                         WGPUTextureFormat_RGBA32Float};
    uint32_t width = size[0], height = size[1];
    size_t bytes = 4 * (size_t)channels * width * height;
    char* data = read_bytes(folder, file, bytes);
    WGPUTexture texture = new_texture(device, formats[channels], width, height,
                                      WGPUTextureUsage_TextureBinding | WGPUTextureUsage_CopyDst);
    wgpuQueueWriteTexture(queue, &(WGPUTexelCopyTextureInfo){.texture = texture, .aspect = WGPUTextureAspect_All}, data,
                          bytes,
                          &(WGPUTexelCopyBufferLayout){.bytesPerRow = 4 * channels * width, .rowsPerImage = height},
                          &(WGPUExtent3D){width, height, 1});
    free(data);
    return texture;
}

static void load_frame(WGPUDevice device, WGPUQueue queue, const char* folder, const Shot* shot, const ShotFrame* item,
                       Frame* frame) {
    for (int i = 0; i < INPUTS; i++) {
        bool is_depth = i == INPUT_DEPTH || i == INPUT_REACTIVE || i == INPUT_DISPLAY_DEPTH;
        bool is_display = i >= INPUT_DISPLAY_BASE_COLOR && i <= INPUT_DISPLAY_DEPTH;
        uint32_t channels = is_depth ? 1 : i == INPUT_MOTION ? 2 : 4;
        if (item->inputs[i])
            frame->inputs[i] =
                load(device, queue, folder, item->inputs[i], is_display ? shot->display : item->size, channels);
    }
}

/* Copy an image from its texture, and write it without the padding of its rows. */
static void write_image(WGPUDevice device, WGPUQueue queue, WGPUTexture image, WGPUBuffer copy, uint32_t width,
                        uint32_t height, uint32_t pitch, const char* folder, const char* name) {
    WGPUCommandEncoder encoder = wgpuDeviceCreateCommandEncoder(device, NULL);
    wgpuCommandEncoderCopyTextureToBuffer(
        encoder, &(WGPUTexelCopyTextureInfo){.texture = image, .aspect = WGPUTextureAspect_All},
        &(WGPUTexelCopyBufferInfo){.buffer = copy, .layout = {.bytesPerRow = pitch, .rowsPerImage = height}},
        &(WGPUExtent3D){width, height, 1});
    submit(queue, encoder);
    bool done = false;
    size_t row = (size_t)TEXEL * width, size = (size_t)pitch * height;
    wgpuBufferMapAsync(copy, WGPUMapMode_Read, 0, size,
                       (WGPUBufferMapCallbackInfo){
                           .mode = WGPUCallbackMode_AllowProcessEvents, .callback = on_mapped, .userdata1 = &done});
    while (!done) wgpuDevicePoll(device, true, NULL);
    const char* rows = wgpuBufferGetConstMappedRange(copy, 0, size);
    char* packed = malloc(row * height);
    if (packed == NULL) fail("no memory");
    for (uint32_t y = 0; y < height; y++) memcpy(packed + y * row, rows + (size_t)y * pitch, row);
    write_file(folder, name, packed, row * height);
    free(packed);
    wgpuBufferUnmap(copy);
}

int main(int count, char** arguments) {
    if (count != 4) fail("usage: %s SHADERS FRAMES OUTPUT", arguments[0]);
    const char *shaders = arguments[1], *frames = arguments[2], *output = arguments[3];
    WGPUInstance instance = wgpuCreateInstance(NULL);
    WGPUDevice device = open_device(instance);
    WGPUQueue queue = wgpuDeviceGetQueue(device);
    Shot shot = shot_load(frames);
    uint32_t width = shot.display[0], height = shot.display[1];
    uint32_t pitch = (TEXEL * width + ROW - 1) / ROW * ROW;
    WGPUBuffer copy = wgpuDeviceCreateBuffer(device, &(WGPUBufferDescriptor){
                                                         .usage = WGPUBufferUsage_CopyDst | WGPUBufferUsage_MapRead,
                                                         .size = (uint64_t)pitch * height,
                                                     });
    Upscaler* upscaler = upscaler_load(device, shaders, width, height);
    WGPUTexture outputs[OUTPUTS] = {0};
    for (int i = 0; i <= upscaler_aovs(upscaler); i++)
        outputs[i] = new_texture(device, WGPUTextureFormat_RGBA16Float, width, height,
                                 WGPUTextureUsage_StorageBinding | WGPUTextureUsage_CopySrc);

    for (int i = 0; i < shot.count; i++) {
        const ShotFrame* item = &shot.frames[i];
        Frame frame = {
            .size = {item->size[0], item->size[1]},
            .jitter = {item->jitter[0], item->jitter[1]},
            .exposure = item->exposure,
            .pre_exposure = item->pre_exposure,
            .reset = item->reset,
        };
        load_frame(device, queue, frames, &shot, item, &frame);
        WGPUCommandEncoder encoder = wgpuDeviceCreateCommandEncoder(device, NULL);
        upscaler_encode(upscaler, encoder, &frame, outputs);
        submit(queue, encoder);
        for (int k = 0; k < OUTPUTS && outputs[k]; k++) {
            char name[32];
            if (k == OUTPUT_IMAGE) snprintf(name, sizeof name, "%04d.rgba16f", i);
            else snprintf(name, sizeof name, "%04d.aovs%d.rgba16f", i, k - OUTPUT_AOVS);
            write_image(device, queue, outputs[k], copy, width, height, pitch, output, name);
        }
        for (int k = 0; k < INPUTS; k++)
            if (frame.inputs[k]) wgpuTextureRelease(frame.inputs[k]);
    }
    printf("%d images: %s\n", shot.count, output);

    upscaler_free(upscaler);
    shot_free(&shot);
    wgpuBufferRelease(copy);
    for (int k = 0; k < OUTPUTS && outputs[k]; k++) wgpuTextureRelease(outputs[k]);
    wgpuQueueRelease(queue);
    wgpuDeviceRelease(device);
    wgpuInstanceRelease(instance);
    return 0;
}
