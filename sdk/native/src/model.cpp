// Models and their pools of work buffers.
#include "network.h"
#include "step.h"

namespace ss {

constexpr int KEPT_SPACES = 4;  // minimum number, for dynamic resolution

// Allocates the buffers that steps of all methods need.
static void make_step_buffers(const Model& model, Space& space) {
    const Size render = space.render, display = space.display;
    Samples& s = space.samples;
    s = {};
    s.width = render.width, s.height = render.height, s.stride = up_to(render.width, LANES),
    s.pitch = s.stride + 2 * PAD;
    s.kept = render.height;
    if (const int stages = model.method->stages) {  // a band for each stage, and one for each thread, at a time
        space.bands = min(divided_up(display.height, BAND), stages + model.pool.threads());
        s.kept =
            static_cast<int>(min<int64_t>(s.kept, space.bands * (int64_t{BAND} * render.height / display.height + 1)));
    }
    s.linear = space.rows_of_samples(3, s.stride);
    s.reactive = space.rows_of_samples(1, s.stride);
    s.rows = space.arena.take<RowFacts>(render.height);
    s.fill = space.arena.take<float>(6 * divided_up(s.width, FILL_WINDOW) * divided_up(s.height, FILL_WINDOW));
    if (model.method->reads_motion) {
        s.motion_x = space.rows_of_samples(1, s.pitch);
        s.motion_y = space.rows_of_samples(1, s.pitch);
    }
    if (model.method->reads_surfaces) {
        s.depth = space.rows_of_samples(1, s.pitch);
        s.eroded_depth = space.kept_rows_of_samples(1, s.pitch);
        s.color = space.kept_rows_of_samples(SAMPLE_PLANES, s.pitch);
        s.dilated = space.kept_rows_of_samples(4, s.stride);
        s.own = space.kept_rows_of_samples(4, s.stride);
    }
    Tables& t = space.tables;
    t = {};
    Filter* filters = space.arena.take<Filter>(8);
    if (filters) t.filters = model.method->filters(model, filters, &t.filter_count, &t.window_sigma);
    Axis* axes[] = {&t.x, &t.y};
    const int pixels[] = {display.width, display.height}, samples[] = {render.width, render.height};
    for (int k = 0; k < 2; k++) {
        Axis& a = *axes[k];
        a.pixels = pixels[k], a.samples = samples[k], a.pitch = up_to(pixels[k], LANES);
        a.start = space.arena.take<int32_t>(a.pitch);
        a.nearest = space.arena.take<int32_t>(a.pitch);
        a.weights = space.arena.take<float>(static_cast<size_t>(4 * t.filter_count) * a.pitch);
        if (t.window_sigma > 0.0f) a.windows = space.arena.take<float>(static_cast<size_t>(3) * a.pitch);
    }
    make_rest(space, space.rest);
    if (model.method->larger) make_downsampling(model, space);
    space.warps = space.arena.take<WarpScratch>(model.pool.threads());
    space.scratch = space.arena.take<float>(static_cast<size_t>(model.pool.threads()) * up_to(3 * s.width, LANES));
}

static Space* make_space(const Model& model, Size render, Size image) {
    const Size display = own_size(*model.method, image);
    Space* space = create<Space>(model.arena.allocator(), model.arena.allocator(), render, image, display);
    if (!space) return nullptr;
    if (!model.method->extrapolates) make_step_buffers(model, *space);
    if (model.method->make_space(model, *space) && !space->arena.failed()) return space;
    destroy(model.arena.allocator(), space);
    return nullptr;
}

// Adds a list of spaces before those that other threads have given back meanwhile.
static void put(Space*& spaces, Space* first) {
    if (!first) return;
    Space* last = first;
    while (last->next) last = last->next;
    last->next = __atomic_load_n(&spaces, __ATOMIC_RELAXED);
    while (!__atomic_compare_exchange_n(&spaces, &last->next, first, false, __ATOMIC_RELEASE, __ATOMIC_RELAXED)) {}
}

Space* Model::borrow(Size render, Size image) {
    Space *first = __atomic_exchange_n(&spaces, nullptr, __ATOMIC_ACQUIRE), *found = nullptr;
    for (Space** at = &first; *at && !found; at = &(*at)->next)
        if ((*at)->render == render && (*at)->image_size == image) {
            found = *at;
            *at = found->next;
            break;
        }
    put(spaces, first);
    return found ? found : make_space(*this, render, image);
}

void Model::give_back(Space* space) {
    space->next = __atomic_exchange_n(&spaces, nullptr, __ATOMIC_ACQUIRE);
    Space* last = space;
    for (int count = 1; last && count < max(KEPT_SPACES, pool.threads()); count++) last = last->next;
    Space* dropped = last ? last->next : nullptr;  // the least recently used ones
    if (last) last->next = nullptr;
    put(spaces, space);
    while (dropped) {
        Space* next = dropped->next;
        destroy(arena.allocator(), dropped);
        dropped = next;
    }
}

Model::~Model() {
    while (spaces) {
        Space* next = spaces->next;
        destroy(arena.allocator(), spaces);
        spaces = next;
    }
}

}  // namespace ss
