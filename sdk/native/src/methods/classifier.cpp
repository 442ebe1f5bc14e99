// `classifier` and its relatives: gather, int8 network and finish.
#include <math.h>
#include <stdio.h>

#include "../arrays.h"
#include "../network.h"
#include "../step.h"

namespace ss {

using namespace classifier;

static bool is_guided(const Model& model) { return model.method->layout.planes == 4; }

// Returns the constants of the model, without those that only `gbuffer-fast` has.
static Config config_of(const Model& model) {
    if (!is_guided(model)) return model.config_of<Config>();
    const gbuffer_fast::Config& c = model.config_of<gbuffer_fast::Config>();
    return {c.sample_sigma, c.moment_sigma, c.guide_sigma, c.gamma,     c.history_sharpness, c.samples,
            c.contraction,  c.depth_margin, c.depth_ramp,  c.rectified, c.own_motion};
}

static Variant variant_of(const Model& model) {
    const Config c = config_of(model);
    return {c.rectified > 0.0f, c.own_motion > 0.0f, is_guided(model)};
}
static int kernel_of(const Variant& v) { return v.guided ? 4 + v.rectified : 2 * v.rectified + v.own_motion; }

static void add_filters(const Model& model, Tables& tables) {
    const Config c = config_of(model);
    tables.add({GAUSSIAN, c.sample_sigma, true});
    tables.add({CUBIC});
    tables.add({GAUSSIAN, c.moment_sigma});
    tables.add({DISTANCE});
    tables.window_sigma = c.kernel_sigma;
}

// Weights -----------------------------------------------------------------------------------------------------------

// Reads a layer: weights of this shape (0: any), scale and bias of `outputs`, or of all outputs of the weights' blocks.
static bool read_layer(Model& model, const Arrays& arrays, const char* name, uint32_t a, uint32_t b, uint32_t c,
                       uint32_t d, int outputs, Layer& layer) {
    char part[48];
    const auto named = [&](const char* suffix) {
        snprintf(part, sizeof part, "%s.%s", name, suffix);
        return part;
    };
    const Array* weights = arrays.find(named("weights"), ArrayType::INT8, a, b, c, d);
    if (!weights) return false;
    layer.blocks = static_cast<int>(weights->shape[0]), layer.words = static_cast<int>(weights->shape[1]);
    layer.outputs = outputs ? outputs : layer.blocks * BLOCK_OUTPUTS;
    const Array* scale = arrays.find(named("scale"), ArrayType::FLOAT, static_cast<uint32_t>(layer.outputs));
    const Array* bias = arrays.find(named("bias"), ArrayType::FLOAT, static_cast<uint32_t>(layer.outputs));
    if (!scale || !bias) return false;
    const Array* parts[] = {weights, scale, bias};
    const void* copies[3];
    for (int k = 0; k < 3; k++) {
        void* copy = model.arena.take<char>(parts[k]->bytes());
        if (copy) memcpy(copy, parts[k]->values(), parts[k]->bytes());
        copies[k] = copy;
    }
    layer.weights = static_cast<const int8_t*>(copies[0]);
    layer.scale = static_cast<const float*>(copies[1]), layer.bias = static_cast<const float*>(copies[2]);
    for (int k = 0; k < layer.outputs && !model.arena.failed(); k++)
        if (!(layer.scale[k] - layer.scale[k] == 0.0f) || !(layer.bias[k] - layer.bias[k] == 0.0f)) return false;
    return true;
}

static bool read_level(Model& model, const Arrays& arrays, int k, uint32_t& words, Level& level) {
    char name[3][16];
    const char* parts[] = {"first", "spatial", "last"};
    for (int part = 0; part < 3; part++) snprintf(name[part], sizeof name[part], "%d.%s", k, parts[part]);
    if (!read_layer(model, arrays, name[0], 0, words, BLOCK_OUTPUTS, 4, 0, level.first)) return false;
    char spatial[32];
    snprintf(spatial, sizeof spatial, "%s.weights", name[1]);
    const Array* weights = arrays.find(spatial, ArrayType::INT8, 0, 3, LANES, 4);
    if (!weights || weights->shape[0] > static_cast<uint32_t>(level.first.blocks * BLOCK_OUTPUTS / LANES)) return false;
    level.channels = static_cast<int>(weights->shape[0]) * LANES;
    if (level.first.blocks != divided_up(level.channels, BLOCK_OUTPUTS)) return false;
    const bool last = k + 1 == LEVELS;
    const int kept = last ? level.channels : level.channels / 2, covered = KEPT[k] << 2 * k;
    if (kept > covered) return false;  // bytes that the decoder has room for
    const int made = covered + level.channels - kept;
    words = static_cast<uint32_t>(level.channels - kept) / 4;
    level.inputs = 0;
    return read_layer(model, arrays, name[1], 0, 3, LANES, 4, level.channels, level.spatial) &&
           read_layer(model, arrays, name[2], divided_up(made, BLOCK_OUTPUTS), level.channels / 4, BLOCK_OUTPUTS, 4, 0,
                      level.last);
}

static ss_status read_weights(Model& model, const Arrays& arrays, ss_error* error) {
    Network* n = model.arena.take<Network>(1);
    if (!n) return fail(error, SS_NO_MEMORY, "no memory for the weights");
    const int outputs = variant_of(model).outputs();
    if (is_guided(model) && !variant_of(model).own_motion)
        return fail(error, SS_BAD_MODEL, "own_motion of the model is 0; want 1 with G-buffers");
    uint32_t words = RECORD_WORDS;
    bool good = true;
    for (int k = 0; k < LEVELS && good; k++) {
        good = read_level(model, arrays, k, words, n->level[k]);
        if (k && good) n->level[k].inputs = up_to(4 * n->level[k].first.words, 16);
    }
    good = good && read_layer(model, arrays, "decoder", 1, 8, BLOCK_OUTPUTS, 4, 0, n->decoder) &&
           read_layer(model, arrays, "hidden", 0, INPUT_PLANES + 8, BLOCK_OUTPUTS, 4, 0, n->hidden) &&
           read_layer(model, arrays, "blend", outputs, 0, 4, 1, outputs, n->blend);
    const Array* first = arrays.find("logits.first", ArrayType::FLOAT, 1);
    const Array* scale = arrays.find("logits.scale", ArrayType::FLOAT, 1);
    good = good && first && scale && n->hidden.blocks <= 2 && n->blend.words <= WIDE;
    if (good) {
        const float byte = *static_cast<const float*>(first->values());
        n->logits_scale = *static_cast<const float*>(scale->values());
        good = byte >= 0.0f && byte <= 4 * WIDE - CLASSES && n->logits_scale >= 0.0f &&
               n->logits_scale - n->logits_scale == 0.0f;
        n->logits = good ? static_cast<int>(byte) : 0;
    }
    if (!good) return fail(error, SS_BAD_MODEL, "the weights are not those of a network that this library runs");
    if (model.arena.failed()) return fail(error, SS_NO_MEMORY, "no memory for the weights");
    model.weights = n;
    return SS_OK;
}

// Work buffers --------------------------------------------------------------------------------------------------------

static void make_network(const Model& model, StepBuffers& buffers, Network& n) {
    n = *static_cast<const Network*>(model.weights);
    n.half = half_of(buffers.display);
    n.row = up_to(n.half.width, ALIGNED) + ROOM;
    n.means_pitch = up_to(n.half.width, LANES) + 2 * PAD;
    n.kept = buffers.bands * ALIGNED;
    n.records = buffers.arena.take<int32_t>(static_cast<size_t>(n.kept) * n.row * RECORD_WORDS);
    n.means = buffers.arena.take<float>(static_cast<size_t>(n.kept) * 2 * n.means_pitch);
    size_t longest = 0;
    for (int k = 0; k < LEVELS; k++) {
        Level& l = n.level[k];
        l.width = up_to(n.half.width, ALIGNED) >> k, l.height = up_to(n.half.height, ALIGNED) >> k;
        l.x_pitch = l.first.outputs, l.x_row = (l.width + ROOM) * l.x_pitch;
        l.out_pitch = l.last.outputs, l.out_row = (l.width + ROOM) * l.out_pitch;
        l.kept = n.kept >> k;
        l.x = buffers.arena.take<uint8_t>(static_cast<size_t>(l.kept) * l.x_row);
        l.out = buffers.arena.take<uint8_t>(static_cast<size_t>(l.kept) * l.out_row);
        longest = max(longest, static_cast<size_t>(l.x_row));
        n.line_pitch = max(n.line_pitch, static_cast<size_t>((l.width + ROOM) * max(l.inputs, l.channels)));
    }
    n.line_pitch = (n.line_pitch + 2 * LINE) / LINE * LINE;
    n.lines = buffers.arena.take<uint8_t>(n.line_pitch * model.pool.threads());
    n.zeros = buffers.arena.take<uint8_t>(longest);
}

static void make_guide(const Model& model, StepBuffers& buffers, ClassifierWork& work) {
    const gbuffer_fast::Config& c = model.config_of<gbuffer_fast::Config>();
    Guide& g = work.guide;
    const size_t padded = static_cast<size_t>(work.gathered.kept) * (work.gathered.pitch + 2 * PAD);
    work.gathered.image = buffers.arena.take<uint16_t>(3 * padded);
    g.samples = buffers.kept_rows_of_samples(SURFACE_PLANES, buffers.samples.pitch);
    g.depth = buffers.arena.take<float>(padded);
    g.scratch_pitch = static_cast<size_t>(up_to(6 * max(buffers.display.width, buffers.render.width), LANES));
    g.scratch = buffers.arena.take<float>(g.scratch_pitch * model.pool.threads());
    g.normal_scale = sqrtf(c.normal_falloff), g.color_scale = sqrtf(c.base_color_falloff);
    g.depth_scale = 0.5f / (c.depth_sigma * c.depth_sigma), g.min_reflectance = c.min_reflectance;
}

static bool make_buffers(const Model& model, StepBuffers& buffers) {
    ClassifierWork* work = buffers.arena.take<ClassifierWork>(1);
    Network* network = buffers.arena.take<Network>(1);
    ClassifierScratch* scratch = buffers.arena.take<ClassifierScratch>(model.pool.threads());
    if (!work || !network || !scratch) return false;
    make_network(model, buffers, *network);
    const Variant variant = variant_of(model);
    const int width = up_to(buffers.display.width, LANES), half = buffers.display.width / 2 + 1 + LANES;
    const size_t all = static_cast<size_t>(buffers.display.height) * width;
    work->network = network, work->scratch = scratch;
    Gathered& g = work->gathered;
    g.pitch = width, g.kept = buffers.bands * BAND;
    const size_t kept = static_cast<size_t>(g.kept) * width;
    g.history = buffers.arena.take<float>(kept * 3), g.rest = buffers.arena.take<uint16_t>(kept * variant.planes());
    g.luma = buffers.arena.take<float>(kept + static_cast<size_t>(g.kept) * 2 * PAD),
    g.samples = buffers.arena.take<uint8_t>(kept);
    g.rising = buffers.arena.take<float>(all / LANES), g.rises = buffers.arena.take<uint16_t>(all / 4);
    if (variant.guided) make_guide(model, buffers, *work);
    for (int k = 0; k < model.pool.threads(); k++) {
        ClassifierScratch& s = scratch[k];
        s.places = buffers.arena.take<float>(2 * width + LANES);
        s.inputs = buffers.arena.take<uint8_t>(2 * INPUT_PLANES * width + 2 * LANES);
        s.differences = buffers.arena.take<float>(2 * width + 2 * LANES);
        s.lines = buffers.arena.take<float>(static_cast<size_t>(16) * buffers.samples.pitch);
        for (float*& tall : s.tall) tall = buffers.arena.take<float>(network->means_pitch);
        s.line = buffers.arena.take<float>(network->means_pitch);
        s.read = buffers.arena.take<uint8_t>(32 * half);
        s.decoded = buffers.arena.take<uint8_t>(32 * half);
        s.hidden = buffers.arena.take<uint8_t>(4 * WIDE * half);
        s.blend = buffers.arena.take<float>(static_cast<size_t>(variant.outputs() + CLASSES) * up_to(half, LANES));
    }
    buffers.own = work;
    return true;
}

// Steps ---------------------------------------------------------------------------------------------------------------

ss_status run_network(Model& model, const uint8_t* inputs, Size half, float* out, ss_error* error) {
    if (model.method->read_weights != read_weights)
        return fail(error, SS_BAD_ARGUMENT, "%s has no network", model.method->name);
    if (ss_status status = check_size(2 * half.width, 2 * half.height, "the display", error)) return status;
    const Size display = {2 * half.width, 2 * half.height};
    StepBuffers buffers(model.arena.allocator(), {1, 1}, display, display);
    buffers.bands = divided_up(half.height, ALIGNED);
    Network n;
    make_network(model, buffers, n);
    const int outputs = variant_of(model).outputs(), pixels = half.width + LANES;
    ClassifierScratch scratch = {};
    scratch.read = buffers.arena.take<uint8_t>(32 * pixels), scratch.decoded = buffers.arena.take<uint8_t>(32 * pixels);
    scratch.hidden = buffers.arena.take<uint8_t>(4 * WIDE * pixels);
    scratch.blend = buffers.arena.take<float>(static_cast<size_t>(outputs + CLASSES) * up_to(half.width, LANES));
    ClassifierWork work = {};
    work.next_classes = buffers.arena.take<uint8_t>(8 * pixels);
    if (buffers.arena.failed()) return fail(error, SS_NO_MEMORY, "no memory for a network");
    work.network = &n, work.scratch = &scratch;
    for (int y = 0; y < half.height; y++)
        memcpy(n.records_at(y), inputs + static_cast<ptrdiff_t>(y) * half.width * 4 * RECORD_WORDS,
               static_cast<size_t>(half.width) * 4 * RECORD_WORDS);
    n.means = nullptr;
    const IeeeArithmetic arithmetic;
    const Kernels& kernels = *model.kernels;
    for (int k = 0; k < LEVELS; k++) {
        const Rect all = {0, n.level[k].height, 0, n.level[k].width};
        kernels.encode_first(work, k, all, 0);
        kernels.encode_others(work, k, all, 0);
    }
    kernels.infer_rows(work, variant_of(model).parameters(), out, 0, half.height);
    return succeed(error);
}

static bool is_flash(const ss_frame& frame, float followed, float before) {
    const bool given = frame.exposure >= MIN_EXPOSURE && frame.exposure <= MAX_EXPOSURE;
    const float known = before < 0.0f ? -before : before, used = followed < 0.0f ? -followed : followed;
    const bool outlier = followed < 0.0f || !(known / EXPOSURE_OUTLIER <= used && used <= known * EXPOSURE_OUTLIER);
    return !given && known > 0.0f && outlier;
}

// Prepares the arrays of kernels.
static void make_work(const Step& step, ClassifierWork& work) {
    work.samples = step.buffers.samples, work.tables = step.buffers.tables, work.config = config_of(step.model);
    work.history = step.before.plane(0), work.classes = static_cast<const uint8_t*>(step.before.planes[1]);
    work.previous = previous_frame(step.before, 2);
    work.next_history = step.after.plane(0), work.next_classes = static_cast<uint8_t*>(step.after.planes[1]);
    work.next_depth = step.after.plane(2);
    work.target = step.target, work.warps = step.buffers.warps;
    work.glares = step.after.glares || step.before.glares;
    work.next_glares = &step.after.glares;
    work.flash = is_flash(step.frame, step.exposure, step.before.exposure);
    memset(work.gathered.rising, 0, sizeof(float) * step.target.height * work.gathered.pitch / LANES);
    for (int k = 0; k < step.model.pool.threads(); k++) memset(work.scratch[k].spent, 0, sizeof work.scratch[k].spent);
    if (!is_guided(step.model)) return;
    const ss_frame& f = step.frame;
    Guide& g = work.guide;
    const int width = step.target.width;
    g.base_color = view_of(f.base_color, f.width, 3), g.normal = view_of(f.normal, f.width, 3);
    g.display_base_color = view_of(f.display_base_color, width, 3),
    g.display_normal = view_of(f.display_normal, width, 3);
    g.display_depth = view_of(f.display_depth, width, 1);
    g.before = static_cast<const uint8_t*>(step.before.planes[3]), g.next = static_cast<uint8_t*>(step.after.planes[3]);
}

// The stages of a band. Each reads the previous stage's results for the band and its neighbours. A stage of the encoder runs
// the first layer of a level and the other layers of the level above.
enum BandStage { PREPARE, GATHER, ENCODE, FINISH = ENCODE + LEVELS, BAND_STAGES };

// The history of classifier-large has 7/5 of the display's rows.
static_assert(MAX_SIDE / 5 * 7 / BAND + BAND_STAGES + 1 <= MAX_BANDS);

static ss_stage run_stage(const Step& step, const ClassifierWork& work, int stage, int band, int thread) {
    const Kernels& kernels = step.kernels();
    const Samples& s = work.samples;
    const Network& n = *work.network;
    const Size display = {work.target.width, work.target.height}, tiles = tiles_of(display);
    const int kernel = kernel_of(variant_of(step.model)), y0 = band * BAND, y1 = min(y0 + BAND, display.height);
    // a band has at least three samples, so that filters reach into the neighbouring bands only
    const auto sample_at = [&](int y) { return static_cast<int>(int64_t{y} * s.height / display.height); };
    const auto of_level = [&](int k, auto encode) {
        const Level& level = n.level[k];
        const int rows = ALIGNED >> k;
        run_tiles_of_rows(step.buffers.rest.gathered, tiles, TILE / 2 >> k, {level.width, level.height}, band * rows,
                          (band + 1) * rows, [&](Rect rect) { encode(work, k, rect, thread); });
    };
    if (stage == PREPARE) {
        kernels.prepare(s, sample_at(y0), sample_at(y1));
        kernels.dilate(s, sample_at(y0), sample_at(y1));
        if (!is_guided(step.model)) return SS_PREPROCESS;
        kernels.prepare_surfaces(work, sample_at(y0), sample_at(y1), thread);
        kernels.prepare_depth(work, y0, y1, thread);
        return SS_PREPROCESS;
    }
    if (stage == GATHER) {
        kernels.keep_depth(work, sample_at(y0), sample_at(y1));
        run_tiles_of_rows(step.buffers.rest.gathered, tiles, TILE, {work.gathered.pitch, display.height}, y0, y1,
                          [&](Rect rect) { kernels.classifier_gather[kernel](work, rect, thread); });
        return SS_GATHER;
    }
    if (stage > ENCODE) of_level(stage - ENCODE - 1, kernels.encode_others);
    if (stage < FINISH) {
        of_level(stage - ENCODE, kernels.encode_first);
        return SS_NETWORK;
    }
    run_tiles_of_rows(step.buffers.rest.computed, tiles, TILE / 2, n.half, y0 / 2, y0 / 2 + BAND / 2,
                      [&](Rect rect) { kernels.classifier_finish[kernel](work, rect, thread); });
    return SS_FINISH;
}

// Returns whether more light rises over the history than movement explains.
static bool is_unconfirmed(const Step& step, const ClassifierWork& work) {
    const Size display = {work.target.width, work.target.height};
    const int across = work.gathered.pitch / LANES;
    double rising = 0.0;
    for (int y = 0; y < display.height; y++)
        for (int x = 0; x < across; x++)
            if (!step.buffers.rest.resting[y / TILE * tiles_of(display).width + x * LANES / TILE])
                rising += work.gathered.rising[static_cast<size_t>(y) * across + x];
    return rising > FLASH_FRACTION * display.width * display.height;
}

static ss_status compute(Step& step) {
    ClassifierWork& work = *static_cast<ClassifierWork*>(step.buffers.own);
    make_tables(step);
    fill_missing(step);
    step.after.glares = may_glare(step);
    make_work(step, work);
    step.workers().run_bands(divided_up(work.target.height, BAND), BAND_STAGES, step.buffers.bands,
                             [&](int stage, int band, int thread) {
                                 const double began = seconds_now();
                                 const ss_stage named = run_stage(step, work, stage, band, thread);
                                 work.scratch[thread].spent[named] += seconds_now() - began;
                             });
    double spent[SS_STAGES] = {};
    for (int thread = 0; thread < step.model.pool.threads(); thread++)
        for (int k = 0; k < SS_STAGES; k++) spent[k] += work.scratch[thread].spent[k];
    step.clock.divide(spent);
    if (!is_unconfirmed(step, work)) return SS_OK;
    step.after.glares = true;
    run_tiles(step, computed_tiles(step), TILE, step.buffers.display,
              [&](Rect rect, int) { step.kernels().confirm_none(work, rect); });
    return SS_OK;
}

static constexpr Layout LAYOUT = {
    .planes = 3,
    .tensors = 10,
    .plane = {{Extent::DISPLAY, HISTORY_VALUES, false}, {Extent::HALF, 8, true}, {Extent::SAMPLES, 2, false}},
    .tensor = {{"color", 3, 0, 0},
               {"state", 3, 0, 3},
               {"classes", CLASSES, 1, 0},
               {"depth", 2, 2, 0},
               {"jitter", 2, OF_JITTER, 0},
               {"exposure", 1, OF_EXPOSURE, 0},
               SS_REST_TENSORS},
    .rests = true,
    .glare = "state",
};
static constexpr Method learned(const char* name, float most, bool larger = false) {
    return {.name = name,
            .ratios = {1, most},
            .reads_surfaces = true,
            .reads_motion = true,
            .larger = larger,
            .stages = BAND_STAGES,
            .layout = LAYOUT,
            .constants = CONSTANTS,
            .constant_count = sizeof CONSTANTS / sizeof(Constant),
            .add_filters = add_filters,
            .make_buffers = make_buffers,
            .compute = compute,
            .read_weights = read_weights};
}
extern const Method CLASSIFIER = learned("classifier", 3);
extern const Method CLASSIFIER_LARGE = learned("classifier-large", 2, true);

static constexpr Layout GUIDED_LAYOUT = {
    .planes = 4,
    .tensors = 11,
    .plane = {{Extent::DISPLAY, HISTORY_VALUES, false},
              {Extent::HALF, 8, true},
              {Extent::SAMPLES, 2, false},
              {Extent::DISPLAY, 4, true}},
    .tensor = {{"color", 3, 0, 0},
               {"state", 3, 0, 3},
               {"classes", CLASSES, 1, 0},
               {"depth", 2, 2, 0},
               {"jitter", 2, OF_JITTER, 0},
               {"exposure", 1, OF_EXPOSURE, 0},
               {"reflectance", 3, 3, 0},
               SS_REST_TENSORS},
    .rests = true,
    .glare = "state",
};
extern const Method GBUFFER_FAST = {.name = "gbuffer-fast",
                                    .ratios = {1, 4},
                                    .reads_surfaces = true,
                                    .reads_motion = true,
                                    .reads_gbuffers = true,
                                    .stages = BAND_STAGES,
                                    .layout = GUIDED_LAYOUT,
                                    .constants = gbuffer_fast::CONSTANTS,
                                    .constant_count = sizeof gbuffer_fast::CONSTANTS / sizeof(Constant),
                                    .add_filters = add_filters,
                                    .make_buffers = make_buffers,
                                    .compute = compute,
                                    .read_weights = read_weights};

}  // namespace ss
