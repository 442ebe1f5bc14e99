#include "upscaler.h"

#include <stdlib.h>
#include <string.h>

#include "files.h"
#include "resources.h"

enum { MOST = 64, GROUPS = 2 };

typedef struct {
    uint32_t group, binding;
    int resource;
} Binding;

typedef struct {
    WGPUComputePipeline pipeline;
    WGPUBindGroupLayout layouts[GROUPS];
    Binding bindings[MOST];
    int binding_count;
    Size covers;
    uint32_t tile[2];
} Pass;

struct Upscaler {
    WGPUDevice device;
    WGPUQueue queue;
    cJSON *json;
    Resource resources[MOST];
    Pass passes[MOST];
    int resource_count, pass_count;
    Memory pairs[MOST][2]; /* histories: [current] is read, [1 - current] is written */
    int current;
    uint32_t display[2], previous[2];
    float jitter[2]; /* of the previous frame */
    bool has_history;
};

static int find(const Upscaler *upscaler, const char *name)
{
    for (int i = 0; i < upscaler->resource_count; i++)
        if (strcmp(upscaler->resources[i].name, name) == 0) return i;
    fail("upscaler.json: no resource \"%s\"", name);
    return -1;
}

/* ---------------------------------------------------------------- pipelines */

static WGPUComputePipeline
compile(WGPUDevice device, const char *folder, const cJSON *item, WGPUPipelineLayout layout)
{
    char *code = read_file(folder, text_of(item, "file"), NULL);
    WGPUShaderSourceWGSL source = {.chain.sType = WGPUSType_ShaderSourceWGSL, .code = view_of(code)};
    WGPUShaderModuleDescriptor described = {
        .nextInChain = &source.chain, .label = view_of(text_of(item, "name"))
    };
    WGPUShaderModule module = wgpuDeviceCreateShaderModule(device, &described);
    WGPUComputePipeline pipeline = wgpuDeviceCreateComputePipeline(
        device, &(WGPUComputePipelineDescriptor){
                    .label = view_of(text_of(item, "name")),
                    .layout = layout,
                    .compute = {.module = module, .entryPoint = view_of(text_of(item, "entry_point"))},
                }
    );
    wgpuShaderModuleRelease(module);
    free(code);
    return pipeline;
}

static void load_pass(Upscaler *upscaler, const char *folder, const cJSON *item)
{
    Pass *pass = &upscaler->passes[upscaler->pass_count++];
    WGPUBindGroupLayoutEntry entries[GROUPS][MOST];
    size_t counts[GROUPS] = {0}, groups = 0;
    const cJSON *binding;
    cJSON_ArrayForEach (binding, member(item, "bindings")) {
        uint32_t group = (uint32_t)number_of(binding, "group");
        if (group >= GROUPS || pass->binding_count == MOST) fail("upscaler.json: too many bindings");
        entries[group][counts[group]++] = layout_entry(binding);
        Binding *one = &pass->bindings[pass->binding_count++];
        *one = (Binding){
            group, (uint32_t)number_of(binding, "binding"), find(upscaler, text_of(binding, "resource"))
        };
    }
    for (; groups < GROUPS && counts[groups] > 0; groups++)
        pass->layouts[groups] = wgpuDeviceCreateBindGroupLayout(
            upscaler->device, &(WGPUBindGroupLayoutDescriptor){
                                  .entryCount = counts[groups],
                                  .entries = entries[groups],
                              }
        );
    WGPUPipelineLayout layout = wgpuDeviceCreatePipelineLayout(
        upscaler->device, &(WGPUPipelineLayoutDescriptor){
                              .bindGroupLayoutCount = groups,
                              .bindGroupLayouts = pass->layouts,
                          }
    );
    pass->pipeline = compile(upscaler->device, folder, item, layout);
    pass->covers = read_size(member(item, "covers"));
    for (int axis = 0; axis < 2; axis++) pass->tile[axis] = (uint32_t)item_of(member(item, "tile"), axis);
    wgpuPipelineLayoutRelease(layout);
}

static void load_weights(Upscaler *upscaler, const char *folder)
{
    const uint32_t one[2] = {1, 1};
    const cJSON *item;
    cJSON_ArrayForEach (item, member(upscaler->json, "resources")) {
        const char *file = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(item, "file"));
        if (file == NULL) continue;
        size_t size;
        char *data = read_file(folder, file, &size);
        Resource *resource = &upscaler->resources[find(upscaler, text_of(item, "name"))];
        hold(upscaler->device, resource, &resource->held, one);
        if (size != resource->bytes) fail("%s: %zu bytes; want %zu", file, size, (size_t)resource->bytes);
        wgpuQueueWriteBuffer(upscaler->queue, resource->held.buffer, 0, data, size);
        free(data);
    }
}

/* ---------------------------------------------------------------- the interface */

Upscaler *upscaler_load(WGPUDevice device, const char *folder, uint32_t width, uint32_t height)
{
    Upscaler *upscaler = calloc(1, sizeof *upscaler);
    if (upscaler == NULL) fail("no memory");
    *upscaler = (Upscaler){.device = device, .queue = wgpuDeviceGetQueue(device), .display = {width, height}};
    const cJSON *json = upscaler->json = read_json(folder, "upscaler.json");
    if (strcmp(text_of(json, "format"), "supersampler-shaders") != 0 || number_of(json, "version") != 1)
        fail("%s/upscaler.json: want supersampler-shaders version 1; export it again", folder);
    if (strcmp(text_of(json, "target"), "wgsl") != 0 || strcmp(text_of(json, "images"), "textures") != 0)
        fail("%s: want shaders in WGSL for textures: supersampler export METHOD --target wgsl", folder);
    const cJSON *item;
    cJSON_ArrayForEach (item, member(json, "resources")) {
        if (upscaler->resource_count == MOST) fail("upscaler.json: too many resources");
        upscaler->resources[upscaler->resource_count++] = read_resource(json, item);
    }
    cJSON_ArrayForEach (item, member(json, "passes")) {
        if (upscaler->pass_count == MOST) fail("upscaler.json: too many passes");
        load_pass(upscaler, folder, item);
    }
    load_weights(upscaler, folder);
    return upscaler;
}

/* Write the step's parameters, fields of "params" in upscaler.json. */
static void write_params(Upscaler *upscaler, const Frame *frame)
{
    bool moved = frame->jitter[0] != upscaler->jitter[0] || frame->jitter[1] != upscaler->jitter[1];
    const float params[16] = {
        (float)frame->size[0],
        (float)frame->size[1],
        (float)upscaler->display[0],
        (float)upscaler->display[1],
        (float)upscaler->previous[0],
        (float)upscaler->previous[1],
        frame->jitter[0],
        frame->jitter[1],
        upscaler->jitter[0],
        upscaler->jitter[1],
        frame->exposure,
        moved ? 1.0f : 0.0f,
        0.0f,
    };
    WGPUBuffer buffer = upscaler->resources[find(upscaler, "params")].held.buffer;
    wgpuQueueWriteBuffer(upscaler->queue, buffer, 0, params, sizeof params);
}

static WGPUBindGroup bind(Upscaler *upscaler, const Pass *pass, uint32_t group, Memory *bound[])
{
    WGPUBindGroupEntry entries[MOST];
    size_t count = 0;
    for (int i = 0; i < pass->binding_count; i++) {
        const Binding *binding = &pass->bindings[i];
        if (binding->group != group) continue;
        const Memory *memory = bound[binding->resource];
        entries[count++] = (WGPUBindGroupEntry){
            .binding = binding->binding,
            .buffer = memory->buffer,
            .size = memory->buffer ? WGPU_WHOLE_SIZE : 0,
            .textureView = memory->view,
        };
    }
    WGPUBindGroupDescriptor described = {
        .layout = pass->layouts[group], .entryCount = count, .entries = entries
    };
    return wgpuDeviceCreateBindGroup(upscaler->device, &described);
}

static void
encode_passes(Upscaler *upscaler, WGPUCommandEncoder encoder, uint32_t bases[BASES][2], Memory *bound[])
{
    WGPUComputePassEncoder compute = wgpuCommandEncoderBeginComputePass(encoder, NULL);
    for (int i = 0; i < upscaler->pass_count; i++) {
        const Pass *pass = &upscaler->passes[i];
        wgpuComputePassEncoderSetPipeline(compute, pass->pipeline);
        for (uint32_t group = 0; group < GROUPS && pass->layouts[group]; group++) {
            WGPUBindGroup made =
                bind(upscaler, pass, group, bound); /* an engine keeps those of both histories */
            wgpuComputePassEncoderSetBindGroup(compute, group, made, 0, NULL);
            wgpuBindGroupRelease(made);
        }
        uint32_t size[2];
        size_at(&pass->covers, bases, size);
        uint32_t across = (size[0] + pass->tile[0] - 1) / pass->tile[0],
                 down = (size[1] + pass->tile[1] - 1) / pass->tile[1];
        wgpuComputePassEncoderDispatchWorkgroups(compute, across, down, 1);
    }
    wgpuComputePassEncoderEnd(compute);
    wgpuComputePassEncoderRelease(compute);
}

void upscaler_encode(Upscaler *upscaler, WGPUCommandEncoder encoder, const Frame *frame, WGPUTexture image)
{
    if (frame->reset || !upscaler->has_history) { /* new memory is zeros, which mean no history */
        for (int pair = 0; pair < MOST; pair++) release(&upscaler->pairs[pair][upscaler->current]);
        memcpy(upscaler->previous, frame->size, sizeof upscaler->previous);
        upscaler->jitter[0] = upscaler->jitter[1] = 0.0f;
    }
    uint32_t bases[BASES][2] = {
        {1, 1},
        {frame->size[0], frame->size[1]},
        {upscaler->previous[0], upscaler->previous[1]},
        {upscaler->display[0], upscaler->display[1]},
    };
    const struct {
        const char *name;
        WGPUTexture texture;
    } given[] = {
        {"frame_color", frame->color},
        {"frame_depth", frame->depth},
        {"frame_motion", frame->motion},
        {"image", image}
    };
    Memory *bound[MOST];
    for (int i = 0; i < upscaler->resource_count; i++) {
        Resource *resource = &upscaler->resources[i];
        bound[i] = &resource->held;
        if (resource->role == HISTORY) bound[i] = &upscaler->pairs[resource->pair][upscaler->current];
        if (resource->role == NEXT) bound[i] = &upscaler->pairs[resource->pair][1 - upscaler->current];
        if (resource->role == GIVEN) {
            for (int k = 0; k < 4; k++)
                if (strcmp(resource->name, given[k].name) == 0)
                    bound[i]->view = wgpuTextureCreateView(given[k].texture, NULL);
        } else {
            uint32_t size[2];
            size_at(&resource->size, bases, size);
            hold(upscaler->device, resource, bound[i], size);
        }
    }
    write_params(upscaler, frame);
    encode_passes(upscaler, encoder, bases, bound);
    for (int i = 0; i < upscaler->resource_count; i++)
        if (upscaler->resources[i].role == GIVEN) release(&upscaler->resources[i].held);
    upscaler->current = 1 - upscaler->current;
    upscaler->has_history = true;
    memcpy(upscaler->previous, frame->size, sizeof upscaler->previous);
    memcpy(upscaler->jitter, frame->jitter, sizeof upscaler->jitter);
}

void upscaler_free(Upscaler *upscaler)
{
    for (int i = 0; i < upscaler->resource_count; i++) release(&upscaler->resources[i].held);
    for (int pair = 0; pair < MOST; pair++)
        for (int set = 0; set < 2; set++) release(&upscaler->pairs[pair][set]);
    for (int i = 0; i < upscaler->pass_count; i++) {
        wgpuComputePipelineRelease(upscaler->passes[i].pipeline);
        for (int group = 0; group < GROUPS; group++)
            if (upscaler->passes[i].layouts[group])
                wgpuBindGroupLayoutRelease(upscaler->passes[i].layouts[group]);
    }
    wgpuQueueRelease(upscaler->queue);
    cJSON_Delete(upscaler->json);
    free(upscaler);
}
