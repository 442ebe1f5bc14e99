// The C interface.
#include <stdio.h>
#include <stdlib.h>
#ifdef __linux__
#include <sys/mman.h>
#endif

#include "arrays.h"
#include "models.h"
#include "step.h"

namespace ss {

extern const Method BILINEAR, BICUBIC, TAA, TAAU, CLASSIFIER, CLASSIFIER_LARGE, GBUFFER_FAST, GUIDED_WARP;
static const Method* const METHODS[] = {&BILINEAR,   &BICUBIC,          &TAA,          &TAAU,
                                        &CLASSIFIER, &CLASSIFIER_LARGE, &GBUFFER_FAST, &GUIDED_WARP};

const Method* find_method(const char* name) {
    for (const Method* method : METHODS)
        if (strcmp(method->name, name) == 0) return method;
    return nullptr;
}

#ifdef __linux__
// Large arrays in huge pages: steps read and write hundreds of megabytes from end to end.
constexpr size_t HUGE_PAGE = 1 << 21;

static size_t whole_pages(size_t bytes) { return (bytes + HUGE_PAGE - 1) / HUGE_PAGE * HUGE_PAGE; }

static void* allocate_default(void*, size_t bytes) {
    if (bytes < 2 * HUGE_PAGE) return calloc(1, bytes);
    void* memory = mmap(nullptr, whole_pages(bytes), PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) return nullptr;
    madvise(memory, whole_pages(bytes), MADV_HUGEPAGE);  // without them, small pages are used
    return memory;
}
static void release_default(void*, void* memory, size_t bytes) {
    if (bytes < 2 * HUGE_PAGE) free(memory);
    else munmap(memory, whole_pages(bytes));
}
#else
static void* allocate_default(void*, size_t bytes) { return calloc(1, bytes); }
static void release_default(void*, void* memory, size_t) { free(memory); }
#endif

static History* history_of(ss_history* handle) { return reinterpret_cast<History*>(handle); }
static Model* model_of(ss_model* handle) { return reinterpret_cast<Model*>(handle); }
static const Model* model_of(const ss_model* handle) { return reinterpret_cast<const Model*>(handle); }
static Upscaler* upscaler_of(ss_upscaler* handle) { return reinterpret_cast<Upscaler*>(handle); }

static ss_status check_count(int count, ss_error* error) {
    return count >= 1 ? SS_OK : fail(error, SS_BAD_ARGUMENT, "count is %d; want 1 or more", count);
}

static ss_status check_upscales(const Model& model, ss_error* error) {
    if (!model.method->extrapolates) return SS_OK;
    return fail(error, SS_BAD_ARGUMENT, "the model is of %s, which extrapolates; ss_extrapolate takes it",
                model.method->name);
}

History* new_history(Model& model, Size display, Size render) {
    const Allocator& allocator = model.arena.allocator();
    History* history = create<History>(allocator, allocator, model, display, render);
    if (!history || !history->arena.failed()) return history;
    destroy(allocator, history);
    return nullptr;
}

}  // namespace ss

using namespace ss;

int ss_version(void) { return SS_VERSION; }

// Creates a model with the default constants of a method.
static ss_status make_model(const Method* method, const ss_options* given, Model** model, ss_error* error) {
    const ss_options options = given ? *given : ss_options{};
    if (options.threads < 0 || options.threads > MAX_THREADS)
        return fail(error, SS_BAD_ARGUMENT, "threads is %d; want 0 to %d", options.threads, MAX_THREADS);
    if (!options.allocate != !options.release)
        return fail(error, SS_BAD_ARGUMENT, "only one of allocate and release is set; want both or none");
    const Kernels* kernels = find_kernels(options.instructions);
    if (!kernels)
        return fail(error, SS_BAD_ARGUMENT, "instructions is '%.64s', which this CPU does not have; want '%s' or NULL",
                    options.instructions, find_kernels(nullptr)->name);
    const Allocator allocator = {options.allocate ? options.allocate : allocate_default,
                                 options.release ? options.release : release_default, options.user, !options.allocate};
    *model = create<Model>(allocator, allocator, options);
    if (!*model) return fail(error, SS_NO_MEMORY, "no memory for a model");
    (*model)->method = method;
    (*model)->kernels = kernels;
    if (options.log) {
        char message[128];
        snprintf(message, sizeof message, "%s: %s kernels, %d threads", method->name, kernels->name,
                 (*model)->pool.threads());
        options.log(options.user, message);
    }
    return succeed(error);
}

// Reads the constants of a model.
static ss_status read_constants(Model& model, const Arrays& arrays, ss_error* error) {
    for (int k = 0; k < model.method->constant_count; k++) {
        const Constant& constant = model.method->constants[k];
        const Array* array = arrays.find(constant.name, ArrayType::FLOAT, 1);
        if (!array) return fail(error, SS_BAD_MODEL, "the model lacks the number %s", constant.name);
        const float value = *static_cast<const float*>(array->values());
        if (!(value >= constant.low && value <= constant.high))
            return fail(error, SS_BAD_MODEL, "%s of the model is %g; want a number from %g to %g", constant.name, value,
                        constant.low, constant.high);
        model.config[k] = value;
    }
    return SS_OK;
}

ss_status ss_model_create(const char* name, const ss_options* options, ss_model** model, ss_error* error) {
    if (ss_status status = check_given({{"name", name}, {"model", model}}, error)) return status;
    *model = nullptr;
    for (const ShippedModel* shipped = SHIPPED_MODELS; shipped->name; shipped++)
        if (strcmp(shipped->name, name) == 0)
            return ss_model_create_from_bytes(shipped->bytes, shipped->count, options, model, error);
    char names[160] = "";
    for (const ShippedModel* shipped = SHIPPED_MODELS; shipped->name; shipped++) {
        strncat(names, names[0] ? ", " : "", sizeof names - strlen(names) - 1);
        strncat(names, shipped->name, sizeof names - strlen(names) - 1);
    }
    return fail(error, SS_BAD_ARGUMENT, "there is no model '%.64s' in this library; want one of %s", name, names);
}

ss_status ss_model_create_from_bytes(const void* bytes, size_t count, const ss_options* options, ss_model** model,
                                     ss_error* error) {
    if (ss_status status = check_given({{"bytes", bytes}, {"model", model}}, error)) return status;
    *model = nullptr;
    if (reinterpret_cast<uintptr_t>(bytes) % alignof(uint64_t))
        return fail(error, SS_BAD_ARGUMENT,
                    "bytes are at an address that is not a multiple of 8; want memory as from malloc");
    const Arrays arrays(bytes, count);
    if (arrays.message()) return fail(error, SS_BAD_MODEL, "the bytes are not a model: %s", arrays.message());
    const Array* name = arrays.find("method", ArrayType::TEXT, 0);
    const Method* method = nullptr;
    if (name && memchr(name->values(), 0, name->bytes()))
        method = find_method(static_cast<const char*>(name->values()));
    if (!method) return fail(error, SS_BAD_MODEL, "the model is of no method of this library");
    Model* made = nullptr;
    ss_status status = make_model(method, options, &made, error);
    if (status == SS_OK) status = read_constants(*made, arrays, error);
    if (status == SS_OK && method->read_weights) status = method->read_weights(*made, arrays, error);
    if (status == SS_OK) {
        made->checksum = arrays.checksum();
        *model = reinterpret_cast<ss_model*>(made);
    } else if (made) destroy(Allocator(made->arena.allocator()), made);
    return status;
}

void ss_model_destroy(ss_model* handle) {
    Model* model = model_of(handle);
    if (!model) return;
    const Allocator allocator = model->arena.allocator();
    destroy(allocator, model);
}

const char* ss_model_method(const ss_model* model) { return model ? model_of(model)->method->name : nullptr; }
const char* ss_model_instructions(const ss_model* model) { return model ? model_of(model)->kernels->name : nullptr; }

ss_status ss_history_create(ss_model* model, int display_width, int display_height, int width, int height,
                            ss_history** history, ss_error* error) {
    if (ss_status status = check_given({{"model", model}, {"history", history}}, error)) return status;
    *history = nullptr;
    if (ss_status status = check_size(display_width, display_height, "the display", error)) return status;
    if (ss_status status = check_upscales(*model_of(model), error)) return status;
    if (ss_status status = check_size(width, height, "the frame", error)) return status;
    History* made = new_history(*model_of(model), {display_width, display_height}, {width, height});
    if (!made) return fail(error, SS_NO_MEMORY, "no memory for a history");
    *history = reinterpret_cast<ss_history*>(made);
    return succeed(error);
}

void ss_history_destroy(ss_history* handle) {
    if (History* history = history_of(handle)) destroy(Allocator(history->arena.allocator()), history);
}

int ss_history_fits(const ss_history* history, int width, int height) {
    return history && reinterpret_cast<const History*>(history)->fits({width, height});
}

ss_status ss_required_bytes(ss_model* handle, int display_width, int display_height, int width, int height,
                            size_t* history, size_t* working, ss_error* error) {
    if (ss_status status = check_given({{"history", history}, {"working", working}}, error)) return status;
    ss_history* made = nullptr;
    if (ss_status status = ss_history_create(handle, display_width, display_height, width, height, &made, error))
        return status;
    Model& model = *model_of(handle);
    const size_t bytes = history_of(made)->most_bytes();
    ss_history_destroy(made);
    if (ss_status status = check_ratio(*model.method, {width, height}, {display_width, display_height}, error))
        return status;
    *history = bytes;
    StepBuffers* buffers = model.borrow({width, height}, {display_width, display_height});
    if (!buffers) return fail(error, SS_NO_MEMORY, "no memory for the work buffers of a step");
    *working = buffers->arena.bytes();
    model.give_back(buffers);
    return succeed(error);
}

const char* ss_stage_name(int stage) {
    static constexpr const char* NAMES[SS_STAGES] = {"preprocess", "gather", "network", "finish", "rest"};
    return stage >= 0 && stage < SS_STAGES ? NAMES[stage] : nullptr;
}

ss_status ss_run(ss_model* model, const ss_frame* frame, const ss_history* history, ss_history* next_history,
                 const ss_outputs* outputs, ss_error* error) {
    if (ss_status status = check_given({{"frame", frame}, {"history", history}, {"next_history", next_history}}, error))
        return status;
    return ss_run_many(model, frame, &history, &next_history, outputs, 1, error);
}

ss_status ss_run_many(ss_model* model, const ss_frame* frames, const ss_history* const* histories,
                      ss_history* const* next_histories, const ss_outputs* outputs, int count, ss_error* error) {
    if (ss_status status = check_given({{"model", model},
                                        {"frames", frames},
                                        {"histories", histories},
                                        {"next_histories", next_histories},
                                        {"outputs", outputs}},
                                       error))
        return status;
    if (ss_status status = check_count(count, error)) return status;
    for (int k = 0; k < count; k++)
        if (!histories[k] || !next_histories[k]) return fail(error, SS_BAD_ARGUMENT, "a history of view %d is NULL", k);
    return run_steps(
        *model_of(model), count,
        [&](int k) {
            return StepCall{frames[k], *reinterpret_cast<const History*>(histories[k]), *history_of(next_histories[k]),
                            outputs[k]};
        },
        error);
}

ss_status ss_extrapolate(ss_model* model, const ss_frame* frame, const ss_shaded* shaded,
                         const ss_extrapolated* outputs, ss_error* error) {
    if (ss_status status =
            check_given({{"model", model}, {"frame", frame}, {"shaded", shaded}, {"outputs", outputs}}, error))
        return status;
    return run_extrapolation(*model_of(model), *frame, *shaded, *outputs, error);
}

ss_status ss_run_network(ss_model* model, const uint8_t* inputs, int width, int height, float* outputs,
                         ss_error* error) {
    if (ss_status status = check_given({{"model", model}, {"inputs", inputs}, {"outputs", outputs}}, error))
        return status;
    return run_network(*model_of(model), inputs, {width, height}, outputs, error);
}

ss_status ss_upscaler_create(ss_model* model, int display_width, int display_height, ss_upscaler** upscaler,
                             ss_error* error) {
    if (ss_status status = check_given({{"model", model}, {"upscaler", upscaler}}, error)) return status;
    *upscaler = nullptr;
    if (ss_status status = check_size(display_width, display_height, "the display", error)) return status;
    if (ss_status status = check_upscales(*model_of(model), error)) return status;
    Upscaler* made =
        create<Upscaler>(model_of(model)->arena.allocator(), *model_of(model), Size{display_width, display_height});
    if (!made) return fail(error, SS_NO_MEMORY, "no memory for an upscaler");
    *upscaler = reinterpret_cast<ss_upscaler*>(made);
    return succeed(error);
}

void ss_upscaler_destroy(ss_upscaler* handle) {
    Upscaler* upscaler = upscaler_of(handle);
    if (!upscaler) return;
    const Allocator allocator = upscaler->model.arena.allocator();
    destroy(allocator, upscaler->history);
    destroy(allocator, upscaler->spare);
    destroy(allocator, upscaler);
}

ss_status ss_step(ss_upscaler* handle, const ss_frame* frame, const ss_outputs* outputs, ss_error* error) {
    if (ss_status status = check_given({{"upscaler", handle}, {"frame", frame}}, error)) return status;
    return ss_step_many(&handle, frame, outputs, 1, error);
}

// Allocates the histories that an upscaler lacks for a step.
static ss_status prepare(Upscaler& u, const ss_frame& frame, ss_error* error) {
    const Size render = {frame.width, frame.height};
    if (check_size(render.width, render.height, "the frame", error)) return SS_BAD_FRAME;
    if (ss_status status = check_ratio(*u.model.method, render, u.display, error)) return status;
    if (u.spare && !u.spare->fits(render)) {
        destroy(u.model.arena.allocator(), u.spare);
        u.spare = nullptr;
    }
    const bool starts = !u.history || frame.reset;
    if (starts && !u.empty) u.empty = new_history(u.model, u.display, render);
    if (!u.spare) u.spare = new_history(u.model, u.display, render);
    return u.spare && (u.empty || !starts) ? SS_OK : fail(error, SS_NO_MEMORY, "no memory for a history");
}

// Continues from the next history, or drops what was allocated for a step that failed.
static void conclude(Upscaler& u, bool succeeded) {
    const Allocator& allocator = u.model.arena.allocator();
    if (succeeded) {
        if (u.empty) destroy(allocator, u.history);
        History* before = u.empty ? u.empty : u.history;
        u.history = u.spare, u.spare = before;
        u.frames++;
    } else {
        destroy(allocator, u.empty);
    }
    u.empty = nullptr;
}

ss_status ss_step_many(ss_upscaler* const* handles, const ss_frame* frames, const ss_outputs* outputs, int count,
                       ss_error* error) {
    if (ss_status status = check_given({{"upscalers", handles}, {"frames", frames}, {"outputs", outputs}}, error))
        return status;
    if (ss_status status = check_count(count, error)) return status;
    for (int k = 0; k < count; k++) {
        if (!handles[k]) return fail(error, SS_BAD_ARGUMENT, "upscaler %d is NULL", k);
        if (&upscaler_of(handles[k])->model != &upscaler_of(handles[0])->model)
            return fail(error, SS_BAD_ARGUMENT,
                        "upscaler %d is of another model than the first; want upscalers of one model", k);
    }
    ss_status status = SS_OK;
    for (int k = 0; k < count && status == SS_OK; k++) {
        status = prepare(*upscaler_of(handles[k]), frames[k], error);
        if (status != SS_OK && count > 1) fail_in_view(k, status, error);
    }
    if (status == SS_OK)
        status = run_steps(
            upscaler_of(handles[0])->model, count,
            [&](int k) {
                const Upscaler& u = *upscaler_of(handles[k]);
                return StepCall{frames[k], *(u.empty ? u.empty : u.history), *u.spare, outputs[k]};
            },
            error);
    for (int k = 0; k < count; k++) conclude(*upscaler_of(handles[k]), status == SS_OK);
    return status;
}

void ss_upscaler_stats(const ss_upscaler* handle, ss_stats* stats) {
    if (!stats) return;
    *stats = {};
    if (!handle) return;
    const Upscaler& u = *reinterpret_cast<const Upscaler*>(handle);
    *stats = {u.frames, 0.0f, (u.history ? u.history->most_bytes() : 0) + (u.spare ? u.spare->most_bytes() : 0)};
    if (!u.history || !u.model.method->layout.rests) return;
    const RestHistory& rest = u.history->rest;
    const auto pixels_of = [](int block, int display, int render) {
        return pixels_before(block + 1, display, render) - pixels_before(block, display, render);
    };
    int64_t frozen = 0;
    for (int y = 0; y < rest.blocks.height; y++)
        for (int x = 0; x < rest.blocks.width; x++)
            if (rest.ages[y * rest.blocks.width + x] < 0.0f)
                frozen += int64_t{1} * pixels_of(y, rest.display.height, rest.render.height) *
                          pixels_of(x, rest.display.width, rest.render.width);
    stats->converged = static_cast<float>(static_cast<double>(frozen) /
                                          (static_cast<double>(rest.display.width) * rest.display.height));
}

void ss_reset(ss_upscaler* upscaler) {
    if (!upscaler) return;
    Upscaler& u = *upscaler_of(upscaler);
    destroy(u.model.arena.allocator(), u.history);
    u.history = nullptr;
}
