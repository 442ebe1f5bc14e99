// Histories, and their tensors as the contract has them.
#include "step.h"

namespace ss {

static int rows_of(const PlaneSpec& spec, Size display, Size render) {
    return spec.extent == Extent::SAMPLES ? render.height
                                          : (spec.extent == Extent::HALF ? half_of(display) : display).height;
}

// Pixels from row to row.
static int pitch_of(const PlaneSpec& spec, Size display, Size render) {
    if (spec.extent == Extent::SAMPLES) return up_to(render.width, LANES) + 2 * PAD;
    return (spec.extent == Extent::HALF ? half_of(display) : display).width;
}

size_t plane_values(const PlaneSpec& spec, Size display, Size render) {
    return static_cast<size_t>(rows_of(spec, display, render)) * pitch_of(spec, display, render) * spec.channels;
}

History::History(const Allocator& allocator, Model& model, Size image, Size render)
    : arena(allocator), model(model), image(image), display(own_size(*model.method, image)), render(render) {
    const Layout& layout = model.method->layout;
    for (int k = 0; k < layout.planes; k++) {
        size_t values = plane_values(layout.plane[k], display, render);
        planes[k] = layout.plane[k].bytes ? static_cast<void*>(arena.take<uint8_t>(values)) : arena.take<float>(values);
    }
    const Size tiles = tiles_of(display);
    generations = arena.take<int64_t>(static_cast<size_t>(tiles.width) * tiles.height);
    if (layout.rests) rest.take(arena, image, render);
}

bool History::fits(Size frame) const {
    const Layout& layout = model.method->layout;
    for (int k = 0; k < layout.planes; k++)
        if (layout.plane[k].extent == Extent::SAMPLES && !(frame == render)) return false;
    return true;
}

size_t History::most_bytes() const {
    if (!model.method->layout.rests) return arena.bytes();
    const size_t mean = static_cast<size_t>(4) * image.width * image.height,
                 signatures = static_cast<size_t>(4) * rest.count() * rest.phase_count;
    return arena.bytes() + sizeof(float) * (rest.mean ? 0 : mean) + sizeof(float) * signatures;
}

void History::mark(int64_t generation) {
    const Size tiles = tiles_of(display), image_tiles = tiles_of(image);
    for (int k = 0; k < tiles.width * tiles.height; k++) generations[k] = generation;
    for (int k = 0; k < image_tiles.width * image_tiles.height && model.method->layout.rests; k++)
        rest.generations[k] = generation;
    frame_generation = generation;
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
            if (from != x)
                memcpy(row + x * plane.channels, row + from * plane.channels, sizeof(float) * plane.channels);
        }
    }
}

// Copies a tensor of static blocks out of a history.
static void read_rest(const RestHistory& rest, int plane, float* values) {
    const size_t count = static_cast<size_t>(rest.count()),
                 pixels = static_cast<size_t>(rest.display.width) * rest.display.height;
    if (plane == OF_PHASES) memcpy(values, rest.phases, sizeof(float[4]) * static_cast<size_t>(rest.phase_count));
    if (plane == OF_BLOCKS) {
        memcpy(values, rest.ages, sizeof(float) * count);
        memcpy(values + count, rest.tests, sizeof(float) * 3 * count);
    }
    for (int k = 0; k < rest.phase_count && plane == OF_SIGNATURES; k++) {
        float* to = values + static_cast<size_t>(k) * 4 * count;
        if (rest.signatures[k]) memcpy(to, rest.signatures[k]->values(), sizeof(float) * 4 * count);
        else memset(to, 0, sizeof(float) * 4 * count);
    }
    for (size_t pixel = 0; pixel < pixels && plane == OF_MEAN; pixel++) {  // where a block has none, 0
        const int y = static_cast<int>(pixel / rest.display.width), x = static_cast<int>(pixel % rest.display.width);
        const int block = block_of(y, rest.display.height, rest.render.height) * rest.blocks.width +
                          block_of(x, rest.display.width, rest.render.width);
        for (size_t c = 0; c < 4; c++)
            values[c * pixels + pixel] = rest.mean && rest.ages[block] != 0.0f ? rest.mean[4 * pixel + c] : 0.0f;
    }
}

// Copies a tensor of static blocks into a history; returns whether there was memory.
static bool write_rest(History& history, int plane, const float* values) {
    RestHistory& rest = history.rest;
    const Allocator& allocator = history.arena.allocator();
    const size_t count = static_cast<size_t>(rest.count()),
                 pixels = static_cast<size_t>(rest.display.width) * rest.display.height;
    if (plane == OF_PHASES) memcpy(rest.phases, values, sizeof(float[4]) * static_cast<size_t>(rest.phase_count));
    if (plane == OF_BLOCKS) {
        memcpy(rest.ages, values, sizeof(float) * count);
        memcpy(rest.tests, values + count, sizeof(float) * 3 * count);
    }
    if (plane == OF_SIGNATURES) rest.release(allocator);
    for (int k = 0; k < rest.phase_count && plane == OF_SIGNATURES; k++) {
        rest.signatures[k] = new_signature(allocator, rest.count());
        if (!rest.signatures[k]) return false;
        memcpy(rest.signatures[k]->values(), values + static_cast<size_t>(k) * 4 * count, sizeof(float) * 4 * count);
    }
    if (plane == OF_MEAN && !rest.mean) rest.mean = history.arena.take<float>(4 * pixels);
    if (plane == OF_MEAN && !rest.mean) return false;
    for (size_t k = 0; k < 4 * pixels && plane == OF_MEAN; k++) rest.mean[4 * (k % pixels) + k / pixels] = values[k];
    return true;
}

}  // namespace ss

using namespace ss;

const char* ss_history_tensor(const ss_history* handle, int index, int64_t shape[4], int* axes) {
    if (!handle || !shape || !axes) return nullptr;
    const History& history = *reinterpret_cast<const History*>(handle);
    if (!has_tensor(history, index)) return nullptr;
    const TensorSpec& tensor = history.model.method->layout.tensor[index];
    int64_t found[4] = {1, tensor.channels, 1, 1};
    if (tensor.plane >= 0) {
        const PlaneSpec& plane = history.model.method->layout.plane[tensor.plane];
        found[2] = rows_of(plane, history.display, history.render);
        found[3] =
            plane.extent == Extent::SAMPLES ? history.render.width : pitch_of(plane, history.display, history.render);
    }
    const RestHistory& rest = history.rest;
    if (tensor.plane == OF_MEAN) found[2] = rest.display.height, found[3] = rest.display.width;
    if (tensor.plane == OF_BLOCKS || tensor.plane == OF_SIGNATURES)
        found[2] = rest.blocks.height, found[3] = rest.blocks.width;
    if (tensor.plane == OF_SIGNATURES || tensor.plane == OF_PHASES) found[0] = rest.phase_count;
    *axes = tensor.plane == OF_EXPOSURE                                                           ? 1
            : tensor.plane == OF_JITTER || tensor.plane == OF_VALUES || tensor.plane == OF_PHASES ? 2
                                                                                                  : 4;
    memcpy(shape, found, sizeof found);
    return tensor.name;
}

ss_status ss_history_read(const ss_history* handle, int index, float* values, ss_error* error) {
    if (ss_status status = check_given({{"history", handle}, {"values", values}}, error)) return status;
    const History& history = *reinterpret_cast<const History*>(handle);
    if (!has_tensor(history, index)) return fail(error, SS_BAD_ARGUMENT, "there is no history tensor %d", index);
    const TensorSpec& tensor = history.model.method->layout.tensor[index];
    if (tensor.plane == OF_JITTER) memcpy(values, history.jitter, sizeof history.jitter);
    else if (tensor.plane == OF_EXPOSURE) *values = history.exposure;
    else if (tensor.plane == OF_VALUES) memcpy(values, history.values, sizeof(float) * tensor.channels);
    else if (tensor.plane < 0) read_rest(history.rest, tensor.plane, values);
    else if (history.model.method->layout.plane[tensor.plane].bytes)
        each_value(history, tensor, [&](size_t to, size_t at) {
            values[to] = static_cast<const uint8_t*>(history.planes[tensor.plane])[at] / 255.0f;
        });
    else each_value(history, tensor, [&](size_t to, size_t at) { values[to] = history.plane(tensor.plane)[at]; });
    return succeed(error);
}

ss_status ss_history_write(ss_history* handle, int index, const float* values, ss_error* error) {
    if (ss_status status = check_given({{"history", handle}, {"values", values}}, error)) return status;
    History& history = *reinterpret_cast<History*>(handle);
    if (!has_tensor(history, index)) return fail(error, SS_BAD_ARGUMENT, "there is no history tensor %d", index);
    const Layout& layout = history.model.method->layout;
    const TensorSpec& tensor = layout.tensor[index];
    history.mark(__atomic_add_fetch(&history.model.generation, 1, __ATOMIC_RELAXED));
    if (tensor.plane == OF_JITTER) memcpy(history.jitter, values, sizeof history.jitter);
    else if (tensor.plane == OF_EXPOSURE) history.exposure = *values;
    else if (tensor.plane == OF_VALUES) memcpy(history.values, values, sizeof(float) * tensor.channels);
    else if (tensor.plane < 0) {
        if (!write_rest(history, tensor.plane, values)) return fail(error, SS_NO_MEMORY, "no memory for a history");
    } else if (layout.plane[tensor.plane].bytes)
        each_value(history, tensor, [&](size_t from, size_t at) {
            static_cast<uint8_t*>(history.planes[tensor.plane])[at] = to_unorm8(values[from]);
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
