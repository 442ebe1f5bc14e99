// Models and their pools of work buffers.
#include "network.h"
#include "step.h"

namespace ss {

constexpr int KEPT_BUFFERS = 4;  // minimum number, for dynamic resolution

void take_axes(Arena& arena, Tables& t, Size render, Size display) {
    Axis* axes[] = {&t.x, &t.y};
    const int pixels[] = {display.width, display.height}, samples[] = {render.width, render.height};
    for (int k = 0; k < 2; k++) {
        Axis& a = *axes[k];
        a.pixels = pixels[k], a.samples = samples[k], a.pitch = up_to(pixels[k], LANES);
        a.start = arena.take<int32_t>(a.pitch);
        a.nearest = arena.take<int32_t>(a.pitch);
        a.weights = arena.take<float>(static_cast<size_t>(4 * t.filter_count) * a.pitch);
        if (t.window_sigma > 0.0f) a.windows = arena.take<float>(static_cast<size_t>(3) * a.pitch);
    }
}

// Allocates the buffers that steps of all methods need.
static void make_step_buffers(const Model& model, StepBuffers& buffers) {
    const Size render = buffers.render, display = buffers.display;
    Samples& s = buffers.samples;
    s = {};
    s.width = render.width, s.height = render.height, s.stride = up_to(render.width, LANES),
    s.pitch = s.stride + 2 * PAD;
    s.kept = render.height;
    if (const int stages = model.method->stages) {  // a band for each stage, and one for each thread, at a time
        buffers.bands = min(divided_up(display.height, BAND), stages + model.pool.threads());
        s.kept = static_cast<int>(
            min<int64_t>(s.kept, buffers.bands * (int64_t{BAND} * render.height / display.height + 1)));
    }
    s.linear = buffers.rows_of_samples(3, s.stride);
    s.reactive = buffers.rows_of_samples(1, s.stride);
    s.rows = buffers.arena.take<RowFacts>(render.height);
    s.fill = buffers.arena.take<float>(6 * divided_up(s.width, FILL_WINDOW) * divided_up(s.height, FILL_WINDOW));
    if (model.method->reads_motion) {
        s.motion_x = buffers.rows_of_samples(1, s.pitch);
        s.motion_y = buffers.rows_of_samples(1, s.pitch);
    }
    if (model.method->reads_surfaces) {
        s.depth = buffers.rows_of_samples(1, s.pitch);
        s.eroded_depth = buffers.kept_rows_of_samples(1, s.pitch);
        s.color = buffers.kept_rows_of_samples(SAMPLE_PLANES, s.pitch);
        s.dilated = buffers.kept_rows_of_samples(4, s.stride);
        s.own = buffers.kept_rows_of_samples(4, s.stride);
    }
    Tables& t = buffers.tables;
    t = {};
    model.method->add_filters(model, t);
    take_axes(buffers.arena, t, render, display);
    make_rest(buffers, buffers.rest);
    if (model.method->larger) make_downsampling(model, buffers);
    buffers.warps = buffers.arena.take<WarpScratch>(model.pool.threads());
    buffers.scratch = buffers.arena.take<float>(static_cast<size_t>(model.pool.threads()) * up_to(3 * s.width, LANES));
}

static StepBuffers* new_buffers(const Model& model, Size render, Size image) {
    const IeeeArithmetic arithmetic;  // later steps read the tables that it computes
    const Size display = own_size(*model.method, image);
    StepBuffers* buffers =
        create<StepBuffers>(model.arena.allocator(), model.arena.allocator(), render, image, display);
    if (!buffers) return nullptr;
    if (!model.method->extrapolates) make_step_buffers(model, *buffers);
    if (model.method->make_buffers(model, *buffers) && !buffers->arena.failed()) return buffers;
    destroy(model.arena.allocator(), buffers);
    return nullptr;
}

// Adds a list of buffers before those that other threads have given back meanwhile.
static void put(StepBuffers*& free_buffers, StepBuffers* first) {
    if (!first) return;
    StepBuffers* last = first;
    while (last->next) last = last->next;
    last->next = __atomic_load_n(&free_buffers, __ATOMIC_RELAXED);
    while (!__atomic_compare_exchange_n(&free_buffers, &last->next, first, false, __ATOMIC_RELEASE, __ATOMIC_RELAXED)) {
    }
}

StepBuffers* Model::borrow(Size render, Size image) {
    StepBuffers *first = __atomic_exchange_n(&free_buffers, nullptr, __ATOMIC_ACQUIRE), *found = nullptr;
    for (StepBuffers** at = &first; *at && !found; at = &(*at)->next)
        if ((*at)->render == render && (*at)->image_size == image) {
            found = *at;
            *at = found->next;
            break;
        }
    put(free_buffers, first);
    return found ? found : new_buffers(*this, render, image);
}

void Model::give_back(StepBuffers* buffers) {
    buffers->next = __atomic_exchange_n(&free_buffers, nullptr, __ATOMIC_ACQUIRE);
    StepBuffers* last = buffers;
    for (int count = 1; last && count < max(KEPT_BUFFERS, pool.threads()); count++) last = last->next;
    StepBuffers* dropped = last ? last->next : nullptr;  // the least recently used ones
    if (last) last->next = nullptr;
    put(free_buffers, buffers);
    while (dropped) {
        StepBuffers* next = dropped->next;
        destroy(arena.allocator(), dropped);
        dropped = next;
    }
}

Model::~Model() {
    while (free_buffers) {
        StepBuffers* next = free_buffers->next;
        destroy(arena.allocator(), free_buffers);
        free_buffers = next;
    }
}

}  // namespace ss
