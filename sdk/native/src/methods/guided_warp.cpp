// `guided-warp`: extrapolates the colour of frames that were not shaded. It keeps nothing between calls.
#include "../arrays.h"
#include "../step.h"

namespace ss {

using namespace guided_warp;

constexpr int MAX_RINGS = 7, MAX_STRIDE = 64, MAX_SAMPLES = 8 * MAX_RINGS + 1;

// The samples among which a pixel chooses: the nearest one, then rings of eight, at these distances.
struct Rings {
    float across[MAX_SAMPLES], down[MAX_SAMPLES];
    int strides[MAX_RINGS];
    int count;
};

static ss_status read_rings(Model& model, const Arrays& arrays, ss_error* error) {
    const Array* given = arrays.find("strides", ArrayType::FLOAT, 0);
    const float* strides = given ? static_cast<const float*>(given->values()) : nullptr;
    const size_t count = given ? given->count() : 0;
    if (count < 1 || count > MAX_RINGS)
        return fail(error, SS_BAD_MODEL, "the model has %d strides; want 1 to %d", static_cast<int>(count), MAX_RINGS);
    Rings* rings = model.arena.take<Rings>(1);
    if (!rings) return fail(error, SS_NO_MEMORY, "no memory for a model");
    rings->count = static_cast<int>(count);
    float before = 1.0f;
    for (int ring = 0; ring < rings->count; ring++) {
        const float stride = strides[ring];
        if (!(stride >= before && stride <= MAX_STRIDE && stride == static_cast<float>(static_cast<int>(stride))))
            return fail(error, SS_BAD_MODEL, "strides has %g; want whole numbers up to %d, ascending", stride,
                        MAX_STRIDE);
        rings->strides[ring] = static_cast<int>(stride);
        for (int k = 0; k < 8; k++) {
            rings->across[8 * ring + 1 + k] = stride * NEIGHBOURS[2 * k];
            rings->down[8 * ring + 1 + k] = stride * NEIGHBOURS[2 * k + 1];
        }
        before = stride;
    }
    model.weights = rings;
    return SS_OK;
}

// Buffers for a shaded frame of the size `render`, and motion of the size `image_size`.
static bool make_buffers(const Model&, StepBuffers& buffers) {
    WarpWork* work = buffers.arena.take<WarpWork>(1);
    if (!work) return false;
    work->shaded = buffers.render, work->stride = up_to(work->shaded.width, LANES);
    work->previous = buffers.image_size, work->previous_stride = up_to(work->previous.width, LANES);
    work->samples = buffers.arena.take<float>(static_cast<size_t>(WARP_PLANES) * work->shaded.height * work->stride);
    work->motion = buffers.arena.take<float>(static_cast<size_t>(2) * work->previous.height * work->previous_stride);
    work->rows = buffers.arena.take<float>(work->shaded.height),
    work->previous_rows = buffers.arena.take<float>(work->previous.height);
    buffers.own = work;
    return true;
}

static bool any(const float* rows, int count) {
    for (int y = 0; y < count; y++)
        if (rows[y] > 0.0f) return true;
    return false;
}

static ss_status check(const Model& model, const ss_frame& f, const ss_shaded& s, ss_error* error) {
    if (!model.method->extrapolates)
        return fail(error, SS_BAD_ARGUMENT, "the model is of %s; want one that extrapolates", model.method->name);
    const Size render = {f.width, f.height}, shaded = {s.width, s.height};
    if (ss_status status = check_size(f.width, f.height, "the frame", error)) return status;
    if (ss_status status = check_size(s.width, s.height, "the shaded frame", error)) return status;
    if (s.motion.data)
        if (ss_status status = check_size(s.motion_width, s.motion_height, "the motion of the previous frame", error))
            return status;
    const struct {
        const char* name;
        const ss_image& image;
        Size size;
        int channels;
    } inputs[] = {{"depth", f.depth, render, 1},
                  {"motion", f.motion, render, 2},
                  {"base_color", f.base_color, render, 3},
                  {"normal", f.normal, render, 3},
                  {"color of the shaded frame", s.color, shaded, 3},
                  {"depth of the shaded frame", s.depth, shaded, 1},
                  {"base_color of the shaded frame", s.base_color, shaded, 3},
                  {"normal of the shaded frame", s.normal, shaded, 3},
                  {"motion of the previous frame", s.motion, {s.motion_width, s.motion_height}, 2}};
    for (const auto& input : inputs) {
        const bool needed = &input.image != &s.motion;
        if (ss_status status = check_input(input.name, input.image, input.size, input.channels, needed, error))
            return status;
    }
    if (ss_status status = check_jitter(f.jitter, error)) return status;
    if (ss_status status = check_jitter(s.jitter, error)) return status;
    if (ss_status status = check_jitter(s.motion_jitter, error)) return status;
    if (ss_status status = check_pre_exposure(f.pre_exposure, error)) return status;
    return check_pre_exposure(s.pre_exposure, error);
}

// Checks that what is written is in memory of its own.
static ss_status check_apart(const ss_frame& f, const ss_shaded& s, const ss_extrapolated& out, ss_error* error) {
    return check_memory({{"color", out.color.data}, {"motion to write to", out.motion.data}},
                        {{"depth", f.depth.data},
                         {"motion", f.motion.data},
                         {"base_color", f.base_color.data},
                         {"normal", f.normal.data},
                         {"color of the shaded frame", s.color.data},
                         {"depth of the shaded frame", s.depth.data},
                         {"base_color of the shaded frame", s.base_color.data},
                         {"normal of the shaded frame", s.normal.data},
                         {"motion of the previous frame", s.motion.data}},
                        error);
}

ss_status run_extrapolation(Model& model, const ss_frame& f, const ss_shaded& s, const ss_extrapolated& out,
                            ss_error* error) {
    if (ss_status status = check(model, f, s, error)) return status;
    if (!out.color.data) return fail(error, SS_BAD_ARGUMENT, "color has no data; want an image to write to");
    const Size size = {f.width, f.height};
    if (ss_status status = check_output("color", out.color, size, 3, error)) return status;
    if (ss_status status = check_input("the motion to write to", out.motion, size, 2, false, error)) return status;
    if (ss_status status = check_apart(f, s, out, error)) return status;
    const bool has_motion = s.motion.data;
    StepBuffers* buffers =
        model.borrow({s.width, s.height}, has_motion ? Size{s.motion_width, s.motion_height} : Size{1, 1});
    Arena rows(model.arena.allocator());
    const size_t pitch = up_to(10 * max(f.width, max(s.width, has_motion ? s.motion_width : 0)), LANES);
    float* scratch = rows.take<float>(pitch * model.pool.threads());
    if (!buffers || !scratch) {
        if (buffers) model.give_back(buffers);
        return fail(error, SS_NO_MEMORY, "no memory for the work buffers of an extrapolation");
    }
    const IeeeArithmetic arithmetic;
    WarpWork& w = *static_cast<WarpWork*>(buffers->own);
    const Rings& rings = *static_cast<const Rings*>(model.weights);
    w.config = model.config_of<Config>();
    w.across = rings.across, w.down = rings.down, w.strides = rings.strides, w.rings = rings.count;
    w.frame = {f.width, f.height};
    w.base_color = view_of(f.base_color, f.width, 3), w.normal = view_of(f.normal, f.width, 3),
    w.depth = view_of(f.depth, f.width, 1);
    w.own_motion = view_of(f.motion, f.width, 2);
    w.shaded_color = view_of(s.color, s.width, 3), w.shaded_base_color = view_of(s.base_color, s.width, 3);
    w.shaded_normal = view_of(s.normal, s.width, 3), w.shaded_depth = view_of(s.depth, s.width, 1);
    w.previous_motion = view_of(s.motion, s.motion_width, 2);
    for (int axis = 0; axis < 2; axis++)
        w.jitter[axis] = f.jitter[axis], w.shaded_jitter[axis] = s.jitter[axis],
        w.previous_jitter[axis] = s.motion_jitter[axis];
    w.pre_exposure = f.pre_exposure > 0.0f ? f.pre_exposure : 1.0f,
    w.shaded_pre_exposure = s.pre_exposure > 0.0f ? s.pre_exposure : 1.0f;
    w.color = view_of(out.color, f.width, 3), w.next_motion = view_of(out.motion, f.width, 2);
    w.scratch = scratch, w.scratch_pitch = pitch;
    Canceller canceller(out.cancelled, out.user);
    const Workers workers = {model.pool, canceller};
    const Kernels& kernels = *model.kernels;
    workers.run_rows(s.height, [&](int y0, int y1, int thread) { kernels.warp_read_shaded(w, y0, y1, thread); });
    if (has_motion)
        workers.run_rows(s.motion_height,
                         [&](int y0, int y1, int thread) { kernels.warp_read_motion(w, y0, y1, thread); });
    w.has_depth = any(w.rows, s.height);
    w.moved = has_motion && any(w.previous_rows, s.motion_height);
    workers.run_rows(f.height, [&](int y0, int y1, int thread) { kernels.warp_rows(w, y0, y1, thread); });
    model.give_back(buffers);
    return canceller.is_set() ? fail(error, SS_CANCELLED, "the extrapolation was cancelled") : succeed(error);
}

extern const Method GUIDED_WARP = {.name = "guided-warp",
                                   .ratios = {1, 1},
                                   .extrapolates = true,
                                   .constants = CONSTANTS,
                                   .constant_count = sizeof CONSTANTS / sizeof(Constant),
                                   .make_buffers = make_buffers,
                                   .read_weights = read_rings};

}  // namespace ss
