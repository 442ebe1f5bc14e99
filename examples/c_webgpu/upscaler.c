#include "upscaler.h"

#include <stdlib.h>
#include <string.h>

#include "files.h"
#include "resources.h"

enum { MOST_RESOURCES = 64, MOST_PASSES = 64, MOST_BINDINGS = 64, GROUPS = 2, PARAMS_BYTES = 64 };

typedef struct {
    uint32_t group, binding;
    int resource;
} Binding;

typedef struct {
    WGPUComputePipeline pipeline;
    WGPUBindGroupLayout layouts[GROUPS];
    Binding bindings[MOST_BINDINGS];
    int binding_count;
    Size covers;
    uint32_t tile[2];
} Pass;

struct Upscaler {
    WGPUDevice device;
    WGPUQueue queue;
    cJSON* json;
    Resource resources[MOST_RESOURCES];
    Pass passes[MOST_PASSES];
    int resource_count, pass_count;
    int params;                  /* index of the resource */
    int aovs;                    /* textures that are blended */
    Memory pairs[MOST_PAIRS][2]; /* histories: [current] is read, [1 - current] is written */
    int current;
    uint32_t display[2], previous[2];
    WGPUTexture no_mask; /* of 1x1, bound in place of a missing reactive mask; no shader reads it */
    bool has_history;
};

/* The index of the resource that a member of an object names. */
static int find(const Upscaler* upscaler, const cJSON* object, const char* name) {
    const char* wanted = text_of(object, name);
    for (int i = 0; i < upscaler->resource_count; i++)
        if (strcmp(upscaler->resources[i].name, wanted) == 0) return i;
    refuse(object, name, "the name of a resource");
}

/* ---------------------------------------------------------------- resources */

static void load_resource(Upscaler* upscaler, const char* folder, const cJSON* item) {
    const uint32_t one[2] = {1, 1};
    Resource resource = read_resource(upscaler->json, item);
    bool is_history = resource.role == HISTORY || resource.role == NEXT;
    for (int i = 0; i < upscaler->resource_count; i++) {
        const Resource* other = &upscaler->resources[i];
        if (strcmp(other->name, resource.name) == 0) refuse(item, "name", "another name for each resource");
        bool is_paired =
            is_history && (other->role == HISTORY || other->role == NEXT) && other->index == resource.index;
        if (is_paired &&
            (other->kind != resource.kind || other->format != resource.format || other->bytes != resource.bytes))
            refuse(item, "name", "the same kind, format and bytes in history and next: their memory swaps");
    }
    if (resource.role == WEIGHTS) {
        if (resource.bytes % 4 != 0) refuse(item, "bytes", "a multiple of 4: what WebGPU writes");
        char* data = read_bytes(folder, file_of(item, "file"), resource.bytes);
        hold(upscaler->device, &resource, &resource.held, one);
        wgpuQueueWriteBuffer(upscaler->queue, resource.held.buffer, 0, data, resource.bytes);
        free(data);
    }
    upscaler->aovs += resource.role == AOVS;
    upscaler->resources[upscaler->resource_count++] = resource;
}

/* ---------------------------------------------------------------- pipelines */

static WGPUComputePipeline compile(WGPUDevice device, const char* folder, const cJSON* item,
                                   WGPUPipelineLayout layout) {
    char* code = read_text(folder, file_of(item, "file"));
    WGPUShaderSourceWGSL source = {.chain.sType = WGPUSType_ShaderSourceWGSL, .code = view_of(code)};
    WGPUShaderModuleDescriptor described = {.nextInChain = &source.chain, .label = view_of(text_of(item, "name"))};
    WGPUShaderModule module = wgpuDeviceCreateShaderModule(device, &described);
    WGPUComputePipeline pipeline = wgpuDeviceCreateComputePipeline(
        device, &(WGPUComputePipelineDescriptor){
                    .label = view_of(text_of(item, "name")),
                    .layout = layout,
                    .compute = {.module = module, .entryPoint = view_of(text_of(item, "entry_point"))},
                });
    wgpuShaderModuleRelease(module);
    free(code);
    return pipeline;
}

static void load_pass(Upscaler* upscaler, const char* folder, const cJSON* item) {
    Pass* pass = &upscaler->passes[upscaler->pass_count++];
    WGPUBindGroupLayoutEntry entries[GROUPS][MOST_BINDINGS];
    size_t counts[GROUPS] = {0}, groups = 0;
    const cJSON* binding;
    cJSON_ArrayForEach (binding, list_of(item, "bindings", 1, MOST_BINDINGS)) {
        int resource = find(upscaler, binding, "resource");
        WGPUBindGroupLayoutEntry entry = layout_entry(binding, &upscaler->resources[resource]);
        Binding one = {whole_of(binding, "group", 0, GROUPS - 1), entry.binding, resource};
        for (int i = 0; i < pass->binding_count; i++) {
            const Binding* other = &pass->bindings[i];
            if (other->resource == one.resource) refuse(binding, "resource", "another in each binding");
            if (other->group == one.group && other->binding == one.binding)
                refuse(binding, "binding", "another in each binding of a group");
        }
        entries[one.group][counts[one.group]++] = entry;
        pass->bindings[pass->binding_count++] = one;
    }
    if (counts[0] == 0) refuse(item, "bindings", "group 0 before group 1");
    for (; groups < GROUPS && counts[groups] > 0; groups++)
        pass->layouts[groups] = wgpuDeviceCreateBindGroupLayout(upscaler->device, &(WGPUBindGroupLayoutDescriptor){
                                                                                      .entryCount = counts[groups],
                                                                                      .entries = entries[groups],
                                                                                  });
    WGPUPipelineLayout layout = wgpuDeviceCreatePipelineLayout(upscaler->device, &(WGPUPipelineLayoutDescriptor){
                                                                                     .bindGroupLayoutCount = groups,
                                                                                     .bindGroupLayouts = pass->layouts,
                                                                                 });
    pass->pipeline = compile(upscaler->device, folder, item, layout);
    pass->covers = read_size(item, "covers");
    two_wholes_of(item, "tile", LARGEST_SIDE, pass->tile);
    wgpuPipelineLayoutRelease(layout);
}

/* ---------------------------------------------------------------- the interface */

Upscaler* upscaler_load(WGPUDevice device, const char* folder, uint32_t width, uint32_t height) {
    Upscaler* upscaler = calloc(1, sizeof *upscaler);
    if (upscaler == NULL) fail("no memory");
    *upscaler = (Upscaler){.device = device, .queue = wgpuDeviceGetQueue(device), .display = {width, height}};
    const cJSON* json = upscaler->json = read_json(folder, "upscaler.json");
    if (strcmp(text_of(json, "format"), "supersampler-shaders") != 0 || member(json, "version")->valuedouble != 3)
        fail("%s/upscaler.json: want supersampler-shaders version 3; export it again", folder);
    if (strcmp(text_of(json, "target"), "wgsl") != 0 || strcmp(text_of(json, "images"), "textures") != 0)
        fail("%s: want shaders in WGSL for textures: supersampler export METHOD --target wgsl", folder);
    const cJSON *item, *params = member(json, "params");
    cJSON_ArrayForEach (item, list_of(json, "resources", 1, MOST_RESOURCES)) load_resource(upscaler, folder, item);
    upscaler->params = find(upscaler, params, "resource");
    const Resource* resource = &upscaler->resources[upscaler->params];
    if (resource->role != PARAMS || resource->kind != UNIFORM || resource->bytes < PARAMS_BYTES)
        refuse(params, "resource", "a uniform of role \"params\" with %d bytes", PARAMS_BYTES);
    cJSON_ArrayForEach (item, list_of(json, "passes", 1, MOST_PASSES)) load_pass(upscaler, folder, item);
    upscaler->no_mask = wgpuDeviceCreateTexture(device, &(WGPUTextureDescriptor){
                                                            .usage = WGPUTextureUsage_TextureBinding,
                                                            .dimension = WGPUTextureDimension_2D,
                                                            .size = {1, 1, 1},
                                                            .format = WGPUTextureFormat_R32Float,
                                                            .mipLevelCount = 1,
                                                            .sampleCount = 1,
                                                        });
    return upscaler;
}

/* Write the step's parameters, fields of "params" in upscaler.json. */
static void write_params(Upscaler* upscaler, const Frame* frame) {
    const float params[PARAMS_BYTES / 4] = {
        (float)frame->size[0],
        (float)frame->size[1],
        (float)upscaler->display[0],
        (float)upscaler->display[1],
        (float)upscaler->previous[0],
        (float)upscaler->previous[1],
        frame->jitter[0],
        frame->jitter[1],
        frame->exposure,
        1.0f,                         /* adds_samples */
        upscaler->aovs ? 1.0f : 0.0f, /* writes_aux */
        frame->pre_exposure > 0.0f ? frame->pre_exposure : 1.0f,
        frame->inputs[INPUT_REACTIVE] ? 1.0f : 0.0f,
        upscaler->aovs ? 0.0f : 2.0f, /* skips: the sets of history take turns */
    };
    WGPUBuffer buffer = upscaler->resources[upscaler->params].held.buffer;
    wgpuQueueWriteBuffer(upscaler->queue, buffer, 0, params, sizeof params);
}

static WGPUBindGroup bind(Upscaler* upscaler, const Pass* pass, uint32_t group, Memory* bound[]) {
    WGPUBindGroupEntry entries[MOST_BINDINGS];
    size_t count = 0;
    for (int i = 0; i < pass->binding_count; i++) {
        const Binding* binding = &pass->bindings[i];
        if (binding->group != group) continue;
        const Memory* memory = bound[binding->resource];
        entries[count++] = (WGPUBindGroupEntry){
            .binding = binding->binding,
            .buffer = memory->buffer,
            .size = memory->buffer ? WGPU_WHOLE_SIZE : 0,
            .textureView = memory->view,
        };
    }
    WGPUBindGroupDescriptor described = {.layout = pass->layouts[group], .entryCount = count, .entries = entries};
    return wgpuDeviceCreateBindGroup(upscaler->device, &described);
}

static void encode_passes(Upscaler* upscaler, WGPUCommandEncoder encoder, uint32_t bases[BASES][2], Memory* bound[]) {
    WGPUComputePassEncoder compute = wgpuCommandEncoderBeginComputePass(encoder, NULL);
    for (int i = 0; i < upscaler->pass_count; i++) {
        const Pass* pass = &upscaler->passes[i];
        wgpuComputePassEncoderSetPipeline(compute, pass->pipeline);
        for (uint32_t group = 0; group < GROUPS && pass->layouts[group]; group++) {
            WGPUBindGroup made = bind(upscaler, pass, group, bound); /* an engine keeps those of both histories */
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

/* The size of the signatures of a frame's blocks, those of each phase of the jitter below each other. */
static void signatures_at(const uint32_t render[2], const uint32_t display[2], uint32_t size[2]) {
    uint64_t phases = 9ull * display[0] * display[1] / ((uint64_t)render[0] * render[1]) + 2;
    size[0] = (render[0] + 3) / 4;
    size[1] = (uint32_t)((render[1] + 3) / 4 * phases);
}

int upscaler_aovs(const Upscaler* upscaler) { return upscaler->aovs; }

void upscaler_encode(Upscaler* upscaler, WGPUCommandEncoder encoder, const Frame* frame,
                     const WGPUTexture outputs[OUTPUTS]) {
    if (frame->reset || !upscaler->has_history) { /* new memory is zeros, which mean no history */
        for (int pair = 0; pair < MOST_PAIRS; pair++) release(&upscaler->pairs[pair][upscaler->current]);
        memcpy(upscaler->previous, frame->size, sizeof upscaler->previous);
    }
    uint32_t bases[BASES][2] = {
        {1, 1},
        {frame->size[0], frame->size[1]},
        {upscaler->previous[0], upscaler->previous[1]},
        {upscaler->display[0], upscaler->display[1]},
    };
    signatures_at(frame->size, upscaler->display, bases[SIGNATURES]);
    signatures_at(upscaler->previous, upscaler->display, bases[PREVIOUS_SIGNATURES]);
    WGPUTexture given[GIVEN];
    memcpy(given, frame->inputs, INPUTS * sizeof *given);
    memcpy(given + INPUTS, outputs, OUTPUTS * sizeof *given);
    if (given[INPUT_REACTIVE] == NULL) given[INPUT_REACTIVE] = upscaler->no_mask;
    Memory* bound[MOST_RESOURCES];
    for (int i = 0; i < upscaler->resource_count; i++) {
        Resource* resource = &upscaler->resources[i];
        bound[i] = &resource->held;
        if (resource->role == HISTORY) bound[i] = &upscaler->pairs[resource->index][upscaler->current];
        if (resource->role == NEXT) bound[i] = &upscaler->pairs[resource->index][1 - upscaler->current];
        if (is_given(resource)) {
            if (given[resource->index] == NULL) fail("%s is NULL; a pass of the folder binds it", resource->name);
            bound[i]->view = wgpuTextureCreateView(
                given[resource->index], &(WGPUTextureViewDescriptor){.mipLevelCount = 1, .arrayLayerCount = 1});
        } else if (resource->role != WEIGHTS) {
            uint32_t size[2];
            size_at(&resource->size, bases, size);
            hold(upscaler->device, resource, bound[i], size);
        }
    }
    write_params(upscaler, frame);
    encode_passes(upscaler, encoder, bases, bound);
    for (int i = 0; i < upscaler->resource_count; i++)
        if (is_given(&upscaler->resources[i])) release(&upscaler->resources[i].held);
    upscaler->current = 1 - upscaler->current;
    upscaler->has_history = true;
    memcpy(upscaler->previous, frame->size, sizeof upscaler->previous);
}

void upscaler_free(Upscaler* upscaler) {
    for (int i = 0; i < upscaler->resource_count; i++) release(&upscaler->resources[i].held);
    for (int pair = 0; pair < MOST_PAIRS; pair++)
        for (int set = 0; set < 2; set++) release(&upscaler->pairs[pair][set]);
    for (int i = 0; i < upscaler->pass_count; i++) {
        wgpuComputePipelineRelease(upscaler->passes[i].pipeline);
        for (int group = 0; group < GROUPS; group++)
            if (upscaler->passes[i].layouts[group]) wgpuBindGroupLayoutRelease(upscaler->passes[i].layouts[group]);
    }
    wgpuTextureRelease(upscaler->no_mask);
    wgpuQueueRelease(upscaler->queue);
    cJSON_Delete(upscaler->json);
    free(upscaler);
}
