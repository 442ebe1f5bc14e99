// States of upscalers as bytes: the tensors of a history, as named arrays.
#include <math.h>
#include <stdio.h>

#include "arrays.h"
#include "step.h"

using namespace ss;

constexpr int SIZES = 4;  // display width and height, then those of the previous frame; 0 where there is no history

static const ss_history* handle_of(const History* history) { return reinterpret_cast<const ss_history*>(history); }

// The header of an array; its values follow.
static Array header(const char* name, ArrayType type, int axes, const int64_t (&shape)[4]) {
    Array array = {};
    snprintf(array.name, sizeof array.name, "%s", name);
    array.type = type, array.axes = static_cast<uint32_t>(axes);
    for (int k = 0; k < axes; k++) array.shape[k] = static_cast<uint32_t>(shape[k]);
    return array;
}

// Appends an array without its values to `to`; returns where these are.
static void* append(char*& to, const Array& array) {
    memcpy(to, &array, sizeof array);
    char* values = to + sizeof array;
    to = values + filled_up(array.bytes());
    memset(to - 8, 0, 8);  // padding
    return values;
}

size_t ss_state_bytes(const ss_upscaler* handle) {
    if (!handle) return 0;
    const Upscaler& u = *reinterpret_cast<const Upscaler*>(handle);
    size_t total = ARRAYS_OVERHEAD + 4 * sizeof(Array) + filled_up(sizeof(float)) +
                   filled_up(strlen(u.model.method->name) + 1) + sizeof u.model.checksum + sizeof(float) * SIZES;
    int64_t shape[4];
    int axes;
    for (int k = 0; u.history; k++) {
        const char* name = ss_history_tensor(handle_of(u.history), k, shape, &axes);
        if (!name) break;
        total += sizeof(Array) + filled_up(header(name, ArrayType::FLOAT, axes, shape).bytes());
    }
    return total;
}

ss_status ss_state_save(const ss_upscaler* handle, void* bytes, size_t count, ss_error* error) {
    if (ss_status status = check_given({{"upscaler", handle}, {"bytes", bytes}}, error)) return status;
    const Upscaler& u = *reinterpret_cast<const Upscaler*>(handle);
    if (count != ss_state_bytes(handle))
        return fail(error, SS_BAD_ARGUMENT, "count is %zu; want %zu, as ss_state_bytes says", count,
                    ss_state_bytes(handle));
    char* to = begin_arrays(bytes);
    const int64_t of_version[4] = {1, 0, 0, 0};
    const float version = SS_VERSION;
    memcpy(append(to, header("version", ArrayType::FLOAT, 1, of_version)), &version, sizeof version);
    const int64_t name_size[4] = {static_cast<int64_t>(strlen(u.model.method->name)) + 1, 0, 0, 0};
    memcpy(append(to, header("method", ArrayType::TEXT, 1, name_size)), u.model.method->name,
           static_cast<size_t>(name_size[0]));
    const int64_t checksum_size[4] = {sizeof u.model.checksum, 0, 0, 0};
    memcpy(append(to, header("model", ArrayType::TEXT, 1, checksum_size)), &u.model.checksum, sizeof u.model.checksum);
    const int64_t of_sizes[4] = {SIZES, 0, 0, 0};
    const Size render = u.history ? u.history->render : Size{0, 0};
    const float sizes[SIZES] = {static_cast<float>(u.display.width), static_cast<float>(u.display.height),
                                static_cast<float>(render.width), static_cast<float>(render.height)};
    memcpy(append(to, header("sizes", ArrayType::FLOAT, 1, of_sizes)), sizes, sizeof sizes);
    int64_t shape[4];
    int axes;
    for (int k = 0; u.history; k++) {
        const char* name = ss_history_tensor(handle_of(u.history), k, shape, &axes);
        if (!name) break;
        float* values = static_cast<float*>(append(to, header(name, ArrayType::FLOAT, axes, shape)));
        if (ss_status status = ss_history_read(handle_of(u.history), k, values, error)) return status;
    }
    end_arrays(bytes, count);
    return succeed(error);
}

// Returns whether all magnitudes are at most `most`, and none is NaN: kernels may compute indices from the values.
static bool are_finite(const Array& array, float most) {
    const float* values = static_cast<const float*>(array.values());
    for (size_t k = 0; k < array.count(); k++)
        if (!(fabsf(values[k]) <= most)) return false;
    return true;
}

static ss_status read_history(const Arrays& arrays, History& history, ss_error* error) {
    int64_t shape[4];
    int axes;
    for (int k = 0; const char* name = ss_history_tensor(handle_of(&history), k, shape, &axes); k++) {
        const auto extent = [&](int axis) { return axis < axes ? static_cast<uint32_t>(shape[axis]) : 1u; };
        const Array* array = arrays.find(name, ArrayType::FLOAT, extent(0), extent(1), extent(2), extent(3));
        if (!array) return fail(error, SS_BAD_STATE, "the state has no tensor %s of the model", name);
        if (!are_finite(*array, strcmp(name, "jitter") == 0 ? 0.5f : 3.4e38f))
            return fail(error, SS_BAD_STATE, "%s of the state has values that no frame can produce", name);
        if (ss_status status = ss_history_write(reinterpret_cast<ss_history*>(&history), k,
                                                static_cast<const float*>(array->values()), error))
            return status;
    }
    return SS_OK;
}

ss_status ss_state_load(ss_upscaler* handle, const void* bytes, size_t count, ss_error* error) {
    if (ss_status status = check_given({{"upscaler", handle}, {"bytes", bytes}}, error)) return status;
    if (reinterpret_cast<uintptr_t>(bytes) % alignof(uint64_t))
        return fail(error, SS_BAD_ARGUMENT,
                    "bytes are at an address that is not a multiple of 8; want memory as from malloc");
    Upscaler& u = *reinterpret_cast<Upscaler*>(handle);
    const Arrays arrays(bytes, count);
    if (arrays.message()) return fail(error, SS_BAD_STATE, "the bytes are not a state: %s", arrays.message());
    const Array *version = arrays.find("version", ArrayType::FLOAT, 1),
                *method = arrays.find("method", ArrayType::TEXT, 0),
                *model = arrays.find("model", ArrayType::TEXT, sizeof u.model.checksum),
                *array = arrays.find("sizes", ArrayType::FLOAT, SIZES);
    if (!version || !method || !model || !array || !memchr(method->values(), 0, method->bytes()))
        return fail(error, SS_BAD_STATE, "the bytes are not a state; want those that ss_state_save writes");
    const float saved = *static_cast<const float*>(version->values());
    if (saved != static_cast<float>(SS_VERSION))
        return fail(error, SS_BAD_STATE, "the state is of version %g of the library; want %d", saved, SS_VERSION);
    if (strcmp(static_cast<const char*>(method->values()), u.model.method->name) != 0)
        return fail(error, SS_BAD_STATE, "the state is of %.64s; want one of %s",
                    static_cast<const char*>(method->values()), u.model.method->name);
    if (memcmp(model->values(), &u.model.checksum, sizeof u.model.checksum) != 0)
        return fail(error, SS_BAD_STATE, "the state is of another model of %s; want one of the upscaler's model",
                    u.model.method->name);
    const float* sizes = static_cast<const float*>(array->values());
    if (sizes[0] != static_cast<float>(u.display.width) || sizes[1] != static_cast<float>(u.display.height))
        return fail(error, SS_BAD_STATE, "the state is of a display of %g x %g; want %d x %d", sizes[0], sizes[1],
                    u.display.width, u.display.height);
    const Allocator& allocator = u.model.arena.allocator();
    History* made = nullptr;
    if (sizes[2] != 0.0f) {
        if (!(sizes[2] >= 1.0f && sizes[2] <= MAX_SIDE && sizes[3] >= 1.0f && sizes[3] <= MAX_SIDE &&
              sizes[2] * sizes[3] <= MAX_PIXELS))
            return fail(error, SS_BAD_STATE, "the state is of a frame of %g x %g", sizes[2], sizes[3]);
        const Size render = {static_cast<int>(sizes[2]), static_cast<int>(sizes[3])};
        // Before memory is taken for it.
        if (check_ratio(*u.model.method, render, u.display, error)) return SS_BAD_STATE;
        made = new_history(u.model, u.display, render);
        if (!made) return fail(error, SS_NO_MEMORY, "no memory for a history");
        if (ss_status status = read_history(arrays, *made, error)) {
            destroy(allocator, made);
            return status;
        }
    }
    destroy(allocator, u.history);
    u.history = made;
    return succeed(error);
}
