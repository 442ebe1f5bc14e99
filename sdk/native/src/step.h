// Methods, their histories, and what a step works on.
#pragma once

#include "rest.h"
#include "threads.h"
#include "work.h"

namespace ss {

constexpr int MAX_SIDE = 32768, MAX_PIXELS = 1 << 26;
constexpr int MAX_CHANNELS = 1024;  // of ids and AOVs
constexpr int MAX_PLANES = 4, MAX_VALUES = 4;

// An array of a history: of tiles at display or half display size, or of samples, whose rows are padded as those of
// `Samples` are.
enum class Extent { DISPLAY, HALF, SAMPLES };
struct PlaneSpec {
    Extent extent;
    int channels;
    bool bytes;  // 255 is 1; else float
};

// Location of a history tensor of the contract: in a plane, from channel `first` on, or in one of these.
enum {
    OF_JITTER = -1,
    OF_EXPOSURE = -2,
    OF_VALUES = -3,
    OF_MEAN = -4,
    OF_BLOCKS = -5,
    OF_SIGNATURES = -6,
    OF_PHASES = -7
};
// The tensors of a history that converges at rest, after its own.
#define SS_REST_TENSORS                                                                                      \
    {"static_mean", 4, OF_MEAN, 0}, {"static_blocks", 4, OF_BLOCKS, 0}, {"signatures", 4, OF_SIGNATURES, 0}, \
        {"phases", 4, OF_PHASES, 0}
struct TensorSpec {
    const char* name;
    int channels, plane, first;
};

struct Layout {
    int planes = 0, tensors = 0;
    PlaneSpec plane[MAX_PLANES] = {};
    TensorSpec tensor[12] = {};
    bool rests = false;  // whether it converges at rest
    // tensor whose last channel is increased by GLARE times the number of glaring frames, or null
    const char* glare = nullptr;
};

struct Model;
struct Step;
class Arrays;

// The work buffers of a step for one pair of sizes. The method's own follow in `own`.
struct StepBuffers {
    Arena arena;
    Size render, image_size, display;  // of the frame, of the image, and of what the method keeps
    Samples samples;
    int bands = 0;  // bands of the image whose buffers are kept, see `Method::stages`
    Tables tables;
    WarpScratch* warps;
    float* scratch;  // of each thread a row of packed values
    RestWork rest;
    float* image = nullptr;  // (display height, display width, 3), where that of the caller cannot be read back
    void* own = nullptr;
    StepBuffers* next = nullptr;

    DownsampleWork downsampling;
    float* weight = nullptr;  // (display height, display width), where the image is smaller

    StepBuffers(const Allocator& allocator, Size render, Size image, Size display)
        : arena(allocator), render(render), image_size(image), display(display) {}
    float* rows_of_samples(int planes, int pitch) {
        return arena.take<float>(static_cast<size_t>(render.height) * planes * pitch);
    }
    float* kept_rows_of_samples(int planes, int pitch) {
        return arena.take<float>(static_cast<size_t>(samples.kept) * planes * pitch);
    }
};

// The facts of a method, in a table of its own file.
struct Method {
    const char* name;
    float ratios[2];              // smallest and largest ratio of display to render size
    bool reads_surfaces = false;  // whether it takes depth, and motion dilated by it
    bool reads_motion = false;
    bool reads_gbuffers = false;
    bool larger = false;        // whether its history and image are LARGE, and filtered to the display
    int stages = 0;             // of bands in which it is computed; 0: of the whole frame at once
    bool extrapolates = false;  // whether it computes the colour of unshaded frames, and has no steps
    Layout layout = {};
    const Constant* constants = nullptr;
    int constant_count = 0;
    // defaults of the constants, floats in their order; null: the model's bytes have them
    const void* config = nullptr;
    void (*add_filters)(const Model& model, Tables& tables) = nullptr;
    bool (*make_buffers)(const Model& model, StepBuffers& buffers);
    ss_status (*compute)(Step& step) = nullptr;  // fails before it changes the next history
    ss_status (*read_weights)(Model& model, const Arrays& arrays, ss_error* error) = nullptr;  // null: it has none
};

// Size of what a method keeps for images of a display: see supersampler.methods.spec.large_size.
inline Size own_size(const Method& method, Size display) {
    return method.larger ? Size{(7 * display.width + 4) / 5, (7 * display.height + 4) / 5} : display;
}
const Method* find_method(const char* name);

// The history after a frame; empty at first.
struct History {
    Arena arena;
    Model& model;
    Size image, display, render;  // of the image, of the planes, of the frame
    void* planes[MAX_PLANES] = {};
    float values[MAX_VALUES] = {};
    float jitter[2] = {};
    float exposure = 0.0f;  // signed, see `followed_exposure`; 0: empty
    bool glares = false;    // whether pixels may hold counts of glaring frames
    RestHistory rest = {};
    int64_t* generations;          // of tiles; in two histories equal ones mean equal planes
    int64_t frame_generation = 0;  // in two histories equal ones mean equal planes of samples

    ~History() { rest.release(arena.allocator()); }
    History(const Allocator& allocator, Model& model, Size image, Size render);
    float* plane(int index) const { return static_cast<float*>(planes[index]); }
    int pitch() const { return up_to(render.width, LANES) + 2 * PAD; }  // of rows of samples
    bool fits(Size frame) const;
    size_t most_bytes() const;      // also of what is allocated at rest
    void mark(int64_t generation);  // all arrays
    void spoil() { mark(SPOILT); }  // after a step that did not end

    static constexpr int64_t SPOILT = -1;  // equal to no other generation, as a history is written before it is read
};
size_t plane_values(const PlaneSpec& spec, Size display, Size render);

struct Model {
    Arena arena;
    const Method* method;
    const Kernels* kernels;
    ThreadPool pool;
    float config[64] = {};
    void* weights = nullptr;
    uint64_t checksum = 0;                // of its bytes
    int64_t generation = 0;               // the last one assigned
    StepBuffers* free_buffers = nullptr;  // a list without a lock, which a forked child might find held

    Model(const Allocator& allocator, const ss_options& options) : arena(allocator), pool(options) {}
    ~Model();
    template <class Config>
    const Config& config_of() const {
        return *reinterpret_cast<const Config*>(config);
    }
    StepBuffers* borrow(Size render, Size image);
    void give_back(StepBuffers* buffers);
};

// Wall seconds of a step by stage.
class StageClock {
   public:
    void enter(ss_stage stage) {
        const double now = seconds_now();
        seconds_[stage_] += now - since_;
        since_ = now, stage_ = stage;
    }
    // Divides the time since `enter` among stages, in proportion to what threads have spent on them.
    void divide(const double (&spent)[SS_STAGES]) {
        const double now = seconds_now();
        double total = 0.0;
        for (double one : spent) total += one;
        for (int k = 0; k < SS_STAGES && total > 0.0; k++) seconds_[k] += (now - since_) * spent[k] / total;
        since_ = now;
    }
    void read(double* seconds) {
        enter(stage_);
        memcpy(seconds, seconds_, sizeof seconds_);
    }

   private:
    double seconds_[SS_STAGES] = {};
    double since_ = seconds_now();
    ss_stage stage_ = SS_PREPROCESS;
};

// The images of one camera, in order.
struct Upscaler {
    Model& model;
    Size display;
    History* history = nullptr;
    History* spare = nullptr;
    History* empty = nullptr;  // history of the step that is being computed, where it is the first one
    int64_t frames = 0;
};
History* new_history(Model& model, Size display, Size render);  // null: no memory

struct Step {
    Model& model;
    const ss_frame& frame;
    StepBuffers& buffers;
    const History& before;
    History& after;
    Target target;
    Workers at_work;
    StageClock clock = {};
    float exposure = 0.0f;           // signed, see `followed_exposure`
    const RestWork* rest = nullptr;  // static blocks; null where the method does not ask

    const Kernels& kernels() const { return *model.kernels; }
    Samples& samples() const { return buffers.samples; }
    const Workers& workers() const { return at_work; }
};

void take_axes(Arena& arena, Tables& tables, Size render, Size display);  // after the filters were added
void fill_missing(Step& step);  // computes the values of missing samples; the exposure is known
void make_tables(const Step& step);
void resample(Step& step);         // fills and tones samples, dilates motion
bool may_glare(const Step& step);  // whether a sample glares, or pixels that rest do
PreviousFrame previous_frame(const History& history, int plane);
// Calls function(rect, thread) on rectangles of pixels of an image of `size`, in which a tile has `unit` pixels.
template <class Function>
void run_tiles(Step& step, const Runs& runs, int unit, Size size, const Function& function, int multiple = 1) {
    Rect* rects = step.buffers.rest.scaled;
    int count = 0;
    for (int k = 0; k < runs.count; k++) {
        const Rect& r = runs.rects[k];
        const Rect rect = {r.y0 * unit, min(r.y1 * unit, size.height), r.x0 * unit, min(r.x1 * unit, size.width)};
        if (rect.y0 < rect.y1 && rect.x0 < rect.x1) rects[count++] = rect;
    }
    step.workers().run_rects(rects, count, multiple, function);
}
// Calls function(rect) on rectangles of rows y0 to y1 of an image of `size`, in which a tile has `unit` pixels.
template <class Function>
void run_tiles_of_rows(const uint8_t* tiles, Size across, int unit, Size size, int y0, int y1,
                       const Function& function) {
    const uint8_t* row = tiles + y0 / unit * across.width;
    for (int x = 0; x < across.width; x++) {
        if (!row[x]) continue;
        const int first = x;
        while (x < across.width && row[x]) x++;
        const Rect rect = {y0, min(y1, size.height), first * unit, min(x * unit, size.width)};
        if (rect.y0 < rect.y1 && rect.x0 < rect.x1) function(rect);
    }
}
inline const Runs& computed_tiles(const Step& step) { return step.buffers.rest.runs; }
inline bool rests_anywhere(const Step& step) {
    const Size tiles = tiles_of(step.buffers.display);
    return memchr(step.buffers.rest.resting, 1, static_cast<size_t>(tiles.width) * tiles.height);
}
bool make_downsampling(const Model& model, StepBuffers& buffers);
bool make_rest(StepBuffers& buffers, RestWork& work);
void make_runs(uint8_t* mask, Size tiles, int gap, Runs& runs);  // joins tiles of a row less than `gap` apart
bool compare_with_rest(Step& step, RestWork& work, const RestHistory& before, RestHistory& after);
bool plan_tiles(const Step& step, RestWork& work, bool compute_all);  // returns whether a tile is computed
bool show_rest(Step& step, RestWork& work, const RestHistory& before, RestHistory& after, int64_t generation);
View view_of(const ss_image& image, int width, int channels);
ss_status check_size(int width, int height, const char* name, ss_error* error);
ss_status check_ratio(const Method& method, Size render, Size display, ss_error* error);
// Returns the number of an image's type. A caller may pass one that is no `ss_type`, which C++ must not read as one.
inline int type_of(const ss_image& image) {
    int type;
    memcpy(&type, &image.type, sizeof type);
    return type;
}
ss_status check_output(const char* name, const ss_image& image, Size size, int channels, ss_error* error);
ss_status check_input(const char* name, const ss_image& image, Size size, int channels, bool needed, ss_error* error);
ss_status check_jitter(const float (&jitter)[2], ss_error* error);
ss_status check_pre_exposure(float pre_exposure, ss_error* error);
ss_status run_network(Model& model, const uint8_t* inputs, Size half, float* out, ss_error* error);
ss_status run_extrapolation(Model& model, const ss_frame& frame, const ss_shaded& shaded,
                            const ss_extrapolated& outputs, ss_error* error);

// The arguments of a step.
struct StepCall {
    const ss_frame& frame;
    const History& before;
    History& after;
    const ss_outputs& outputs;
};
ss_status check_step(const Model& model, const StepCall& call, ss_error* error);
// checks that no output of a call has the address of another image, of its own or of the other call
ss_status check_apart(const StepCall& call, const StepCall& other, ss_error* error);
ss_status run_step(Model& model, const StepCall& call, Canceller& canceller, bool alone);  // after `check_step`
ss_status fail_in_view(int view, ss_status status, ss_error* error);  // puts the view in front of the message

// Computes the steps of several views; call_of(index) returns the StepCall of one. Each thread takes a view at a time. The
// last ones, which are fewer than threads, share all threads.
template <class CallOf>
ss_status run_steps(Model& model, int count, const CallOf& call_of, ss_error* error) {
    for (int k = 0; k < count; k++) {
        const StepCall call = call_of(k);
        ss_status status = check_step(model, call, error);
        for (int j = 0; j < count && status == SS_OK; j++)
            if (j != k && (&call.after == &call_of(j).after || &call.after == &call_of(j).before))
                status = fail(error, SS_BAD_ARGUMENT, "it writes to a history of view %d; want one for each view", j);
            else if (j != k) status = check_apart(call, call_of(j), error);
        if (status != SS_OK) return count == 1 ? status : fail_in_view(k, status, error);
    }
    Canceller canceller(call_of(0).outputs.cancelled, call_of(0).outputs.user);
    const int sharing = count == 1 ? 1 : model.pool.nests() ? count % model.pool.threads() : 0;
    ss_status status = SS_OK;
    Workers{model.pool, canceller}.run(count, [&](int k, int) {
        if (run_step(model, call_of(k), canceller, k < count - sharing) == SS_NO_MEMORY)
            __atomic_store_n(&status, SS_NO_MEMORY, __ATOMIC_RELAXED);
    });
    if (canceller.is_set()) status = SS_CANCELLED;
    for (int k = 0; k < count && status != SS_OK; k++) call_of(k).after.spoil();
    if (status == SS_CANCELLED) return fail(error, status, "the step was cancelled");
    return status == SS_OK ? succeed(error) : fail(error, status, "no memory for a step");
}

// Checks each of several views, and that what it writes is apart from itself and the others.
template <class View>
ss_status check_views(const View* views, int count, ss_status (*check)(const View&, ss_error*),
                      ss_status (*check_apart)(const View&, const View&, ss_error*), ss_error* error) {
    if (!views || count < 1) return fail(error, SS_BAD_ARGUMENT, "views is %s", views ? "empty" : "NULL");
    for (int k = 0; k < count; k++) {
        ss_status status = check(views[k], error);
        for (int j = 0; j < count && status == SS_OK; j++) status = check_apart(views[k], views[j], error);
        if (status != SS_OK) return count == 1 ? status : fail_in_view(k, status, error);
    }
    return SS_OK;
}

// Calls function(view, y0, y1, thread) on bands of display rows of several views, by their numbers. The calling thread does
// the work without a model.
template <class View, class Function>
void run_views(Model* model, const View* views, int count, const Function& function) {
    constexpr int ROWS = 32;
    int bands = 0;
    for (int k = 0; k < count; k++) bands += divided_up(views[k].display_height, ROWS);
    const auto run_band = [&](int band, int thread) {
        int view = 0;
        for (; band >= divided_up(views[view].display_height, ROWS); view++)
            band -= divided_up(views[view].display_height, ROWS);
        function(view, band * ROWS, min((band + 1) * ROWS, views[view].display_height), thread);
    };
    if (model) {
        Canceller canceller(nullptr, nullptr);
        return Workers{model->pool, canceller}.run(bands, run_band);
    }
    const IeeeArithmetic arithmetic;
    for (int band = 0; band < bands; band++) run_band(band, 0);
}

// Calls `rows(y0, y1)` and then `beside(y0, y1)`, which reads one more row on either side, on all rows. `beside` runs
// while its rows are in the cache, except where the rows of two threads meet.
template <class RowFunction, class BesideFunction>
void run_rows_with_neighbours(const Workers& workers, int height, const RowFunction& rows,
                              const BesideFunction& beside) {
    workers.run_rows(height, [&](int y0, int y1, int) {
        rows(y0, y1);
        int first = y0 ? y0 + 1 : 0, end = y1 < height ? y1 - 1 : height;
        if (first < end) beside(first, end);
    });
    workers.run_rows(height, [&](int y0, int y1, int) {  // the same parts
        if (y0) beside(y0, y0 + 1);
        if (y1 < height && (y1 - 1 > y0 || !y0)) beside(y1 - 1, y1);
    });
}

}  // namespace ss
