// Histories, and their tensors as the contract has them.
#include "step.h"

namespace ss {

static int rows_of(const PlaneSpec& spec, Size display, Size render) {
    return spec.extent == Extent::SAMPLES ? render.height : (spec.extent == Extent::HALF ? half_of(display) : display).height;
}

// Pixels from row to row.
static int pitch_of(const PlaneSpec& spec, Size display, Size render) {
    if (spec.extent == Extent::SAMPLES) return up_to(render.width, LANES) + 2 * PAD;
    return (spec.extent == Extent::HALF ? half_of(display) : display).width;
}

size_t plane_values(const PlaneSpec& spec, Size display, Size render) {
    return static_cast<size_t>(rows_of(spec, display, render)) * pitch_of(spec, display, render) * spec.channels;
}

History::History(const Allocator& allocator, Model& model, Size display, Size render)
    : arena(allocator), model(model), display(display), render(render) {
    const Layout& layout = model.method->layout;
    for (int k = 0; k < layout.planes; k++) {
        size_t values = plane_values(layout.plane[k], display, render);
        planes[k] = layout.plane[k].bytes ? static_cast<void*>(arena.take<uint8_t>(values)) : arena.take<float>(values);
    }
}

bool History::fits(Size frame) const {
    const Layout& layout = model.method->layout;
    for (int k = 0; k < layout.planes; k++)
        if (layout.plane[k].extent == Extent::SAMPLES && !(frame == render)) return false;
    return true;
}

void History::clear() {
    const Layout& layout = model.method->layout;
    for (int k = 0; k < layout.planes; k++)
        memset(planes[k], 0, plane_values(layout.plane[k], display, render) * (layout.plane[k].bytes ? 1 : sizeof(float)));
    memset(values, 0, sizeof values);
    jitter[0] = jitter[1] = exposure = 0.0f;
    glares = false;
}

static bool has_tensor(const History& history, int index) {
    return index >= 0 && index < history.model.method->layout.tensors;
}

// Calls function(value of the tensor, its place in the history) for each value of a tensor in C order.
template <class History_, class Function>
static void each_value(History_& history, const TensorSpec& tensor, const Function& function) {
    const PlaneSpec& plane = history.model.method->layout.plane[tensor.plane];
    const int height = rows_of(plane, history.display, history.render);
    const int pitch = pitch_of(plane, history.display, history.render);
    const int pad = plane.extent == Extent::SAMPLES ? PAD : 0;
    const int width = pad ? history.render.width : pitch;
    size_t index = 0;
    for (int c = tensor.first; c < tensor.first + tensor.channels; c++)
        for (int y = 0; y < height; y++)
            for (int x = 0; x < width; x++)
                function(index++, (static_cast<size_t>(y) * pitch + pad + x) * plane.channels + c);
}

// Repeats the border in the padding of rows of samples.
static void pad_rows(History& history, int plane_index) {
    const PlaneSpec& plane = history.model.method->layout.plane[plane_index];
    const int pitch = history.pitch(), width = history.render.width;
    for (int y = 0; y < history.render.height; y++) {
        float* row = history.plane(plane_index) + static_cast<size_t>(y) * pitch * plane.channels;
        for (int x = 0; x < pitch; x++) {
            int from = clamp(x, PAD, PAD + width - 1);
            if (from != x) memcpy(row + x * plane.channels, row + from * plane.channels, sizeof(float) * plane.channels);
        }
    }
}

}  // namespace ss

using namespace ss;

const char* ss_history_tensor(const ss_history* handle, int index, int64_t shape[4]) {
    const History& history = *reinterpret_cast<const History*>(handle);
    if (!has_tensor(history, index)) return nullptr;
    const TensorSpec& tensor = history.model.method->layout.tensor[index];
    int64_t found[4] = {1, tensor.channels, 1, 1};
    if (tensor.plane >= 0) {
        const PlaneSpec& plane = history.model.method->layout.plane[tensor.plane];
        found[2] = rows_of(plane, history.display, history.render);
        found[3] = plane.extent == Extent::SAMPLES ? history.render.width : pitch_of(plane, history.display, history.render);
    }
    memcpy(shape, found, sizeof found);
    return tensor.name;
}

ss_status ss_history_read(const ss_history* handle, int index, float* values, ss_error* error) {
    const History& history = *reinterpret_cast<const History*>(handle);
    if (!has_tensor(history, index)) return fail(error, SS_BAD_ARGUMENT, "there is no history tensor %d", index);
    const TensorSpec& tensor = history.model.method->layout.tensor[index];
    if (tensor.plane == OF_JITTER) memcpy(values, history.jitter, sizeof history.jitter);
    else if (tensor.plane == OF_EXPOSURE) *values = history.exposure;
    else if (tensor.plane == OF_VALUES) memcpy(values, history.values, sizeof(float) * tensor.channels);
    else if (history.model.method->layout.plane[tensor.plane].bytes)
        each_value(history, tensor, [&](size_t to, size_t at) {
            values[to] = static_cast<const uint8_t*>(history.planes[tensor.plane])[at] / 255.0f;
        });
    else each_value(history, tensor, [&](size_t to, size_t at) { values[to] = history.plane(tensor.plane)[at]; });
    return succeed(error);
}

ss_status ss_history_write(ss_history* handle, int index, const float* values, ss_error* error) {
    History& history = *reinterpret_cast<History*>(handle);
    if (!has_tensor(history, index)) return fail(error, SS_BAD_ARGUMENT, "there is no history tensor %d", index);
    const Layout& layout = history.model.method->layout;
    const TensorSpec& tensor = layout.tensor[index];
    if (tensor.plane == OF_JITTER) memcpy(history.jitter, values, sizeof history.jitter);
    else if (tensor.plane == OF_EXPOSURE) history.exposure = *values;
    else if (tensor.plane == OF_VALUES) memcpy(history.values, values, sizeof(float) * tensor.channels);
    else if (layout.plane[tensor.plane].bytes)
        each_value(history, tensor, [&](size_t from, size_t at) {
            static_cast<uint8_t*>(history.planes[tensor.plane])[at] =
                static_cast<uint8_t>(clamp(values[from] * 255.0f + 0.5f, 0.0f, 255.0f));
        });
    else {
        float largest = 0.0f;
        const size_t last = static_cast<size_t>(tensor.first + tensor.channels - 1);
        each_value(history, tensor, [&](size_t from, size_t at) {
            history.plane(tensor.plane)[at] = values[from];
            if (at % layout.plane[tensor.plane].channels == last) largest = max(largest, values[from]);
        });
        if (layout.glare && strcmp(layout.glare, tensor.name) == 0) history.glares = largest > 1.0f;
        if (layout.plane[tensor.plane].extent == Extent::SAMPLES) pad_rows(history, tensor.plane);
    }
    return succeed(error);
}

size_t ss_history_bytes(const ss_history* handle) { return reinterpret_cast<const History*>(handle)->arena.bytes(); }
