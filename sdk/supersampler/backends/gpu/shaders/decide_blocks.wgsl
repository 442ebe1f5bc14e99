// Decide what stands still, is shown and freezes, by block. A workgroup is a large window.
// Same as `compare` and `converge`, but for the pixels.
// import at_rest
// import block_sums
// import state

const SIDE = 8;            // blocks of a workgroup in either direction
const AROUND = 2;          // blocks around it: a neighbour, and what is in its small window
const WIDE = SIDE + 2 * AROUND;
const NEAR = SIDE + 2;     // with the neighbours
const THREADS = SIDE * SIDE;

@group(0) @binding(1) var<storage, read> next_state: State;
@group(0) @binding(2) var<storage, read> block_sums: array<Sums>;   // of static blocks
@group(0) @binding(3) var history_mean: texture_2d<f32>;   // of static blocks
@group(0) @binding(4) var history_blocks: texture_2d<f32>;   // age, negative where frozen; tests
@group(0) @binding(5) var<storage, read> history_signatures: array<vec4f>;      // of 1 phase
@group(0) @binding(6) var<storage, read_write> next_signatures: array<vec4f>;   // of 1 phase
@group(0) @binding(7) var next_blocks: texture_storage_2d<rgba32float, write>;
@group(0) @binding(8) var block_states: texture_storage_2d<rg32uint, write>;   // flags, and bits of a float: see at_rest.wgsl
@group(0) @binding(9) var<storage, read_write> awake: array<atomic<u32>>;
@group(0) @binding(10) var<storage, read> block_marks: array<u32>;

var<workgroup> sums: array<Sums, WIDE * WIDE>;
var<workgroup> marks: array<u32, NEAR * NEAR>;

struct Window {
    count: f32,          // samples
    level: f32,          // largest channel of the mean
    residuals: vec3f,    // mean of the samples less that of the mean
    variance: f32,       // of the residuals, summed over channels
    contrast: f32,       // variance of the samples
}

// The window of `side` blocks that a block is in.
fn window_of(block: vec2i, origin: vec2i, side: i32) -> Window {
    let first = block / side * side - origin + AROUND;
    var difference = vec4f(0.0);
    var color = vec4f(0.0);
    var expected = vec4f(0.0);
    for (var j = 0; j < side; j++) {
        for (var i = 0; i < side; i++) {
            let one = sums[(first.y + j) * WIDE + first.x + i];
            difference += one.difference;
            color += one.color;
            expected += one.expected;
        }
    }
    let share = 1.0 / max(difference.a, 1e-6 * f32(side * side));
    let residuals = difference.rgb * share;
    let level = expected.rgb * share;
    let mean = color.rgb * share;
    return Window(
        difference.a * f32(BLOCK * BLOCK),
        max(max(level.r, level.g), level.b),
        residuals,
        max(color.a * share - dot(residuals, residuals), 0.0),
        max(expected.a * share - dot(mean, mean), 0.0));
}

fn shown_level(window: Window) -> f32 { return window.level + DARK / exposure_of(next_state); }

fn excess(square: f32, variance: f32, ratio: f32, window: Window) -> f32 {
    let level = shown_level(window);
    return clamp((square - ratio * variance) / (level * level) - FLICKER * FLICKER, -OLDEST, OLDEST);
}

fn square(window: Window) -> f32 { return dot(window.residuals, window.residuals); }

// Maxima over the small window of a block and those around it: how far residuals are over UNIFORM, and the contrast.
fn windows_around(block: vec2i, origin: vec2i) -> vec2f {
    var most = vec2f(-OLDEST, 0.0);
    for (var i = 0; i < 9; i++) {
        let near = block / SMALL_WINDOW * SMALL_WINDOW + SMALL_WINDOW * vec2i(i % 3 - 1, i / 3 - 1);
        if (!inside(near, blocks_size())) { continue; }
        let window = window_of(near, origin, SMALL_WINDOW);
        most = max(most, vec2f(excess(square(window), window.variance, UNIFORM, window), window.contrast));
    }
    return most;
}

// Excess of the residuals over UNIFORM (PARTIAL beside a window above it), COMMON and UNRESOLVED; below 0 is steady.
fn steadiness(block: vec2i, origin: vec2i) -> vec3f {
    let small = window_of(block, origin, SMALL_WINDOW);
    let large = window_of(block, origin, LARGE_WINDOW);
    let around = windows_around(block, origin);
    let sparkling = max(small.contrast - SPARKLING * small.level * small.level, 0.0);
    let explained = small.contrast + BESIDE * around.y + (1.0 / UNRESOLVED - 1.0) * sparkling;
    return vec3f(
        min(around.x, excess(square(small), small.variance, PARTIAL, small)),
        excess(square(large), large.variance, COMMON, large),
        excess(small.variance, explained, UNRESOLVED, small));
}

// Age, negative where frozen, and tests.
fn block_before(block: vec2i) -> vec4f {
    return select(vec4f(0.0), textureLoad(history_blocks, block, 0), has_blocks());
}

// The running mean of relative residuals of noisy samples.
fn drift_of(tests: vec3f, window: Window) -> vec3f {
    let drift = tests + NOISE_RATE * (window.residuals / shown_level(window) - tests);
    return select(vec3f(0.0), drift, window.count > 0.0);
}

// Whether that mean is more than noise.
fn drifts(block: vec2i, origin: vec2i) -> bool {
    let window = window_of(block, origin, SMALL_WINDOW);
    let drift = abs(drift_of(block_before(block).yzw, window));
    let frames = NOISE_RATE / (2.0 - NOISE_RATE);
    let noise = sqrt(window.variance * frames / max(window.count, 1.0)) / shown_level(window);
    return max(max(drift.x, drift.y), drift.z) > NOISE_FLICKER + NOISE_SIGMAS * noise;
}

// Whether the mean has enough samples in all of a block.
fn has_enough(block: vec2i) -> bool {
    for (var i = 0; i < BLOCK * BLOCK; i++) {
        let sample = clamped(BLOCK * block + vec2i(i % BLOCK, i / BLOCK), render_size());
        if (textureLoad(history_mean, pixel_of(sample), 0).a < LEAST_WEIGHT) { return false; }
    }
    return true;
}

fn flag(bit: u32, holds: bool) -> u32 { return select(0u, bit, holds); }

fn decide(block: vec2i, origin: vec2i, restarts: bool, moves: bool) {
    let before = block_before(block);
    let was_frozen = before.x < 0.0;
    let counts = next_state.counts > 0.0;
    let known = next_state.cycle > 0.0 && next_state.cycle <= abs(before.x) && is_sampled() && !is_noisy();
    let stands = !moves && !restarts;
    let stays = was_frozen && stands;
    let adds = counts && !moves && (restarts || !known);
    let verifies = known && stands && counts && !was_frozen;
    var age = select(0.0, min(select(0.0, abs(before.x), stands) + next_state.counts, OLDEST), !moves);

    var tests = vec3f(0.0);
    if (is_noisy()) {
        if (stands) { tests = drift_of(before.yzw, window_of(block, origin, SMALL_WINDOW)); }
    } else if (!counts) {
        if (stands) { tests = before.yzw; }
    } else if (verifies) {
        tests = before.yzw + steadiness(block, origin);
    }
    if (!counts || (known && stands)) {   // no phase is added: nor is its signature
        let here = signature_index(next_state.slot, block);
        next_signatures[here] = history_signatures[here];
    }

    let steady = stands && max(max(tests.x, tests.y), tests.z) <= 0.0;
    let periods = select(0.0, age / max(next_state.period, 1.0), next_state.period > 0.0);
    let fade = clamp((periods - SHOWN_FROM) / (SHOWN - SHOWN_FROM), 0.0, 1.0);
    let due = verifies && periods >= 2.0;
    var freezes = false;   // no sample is added now: the mean of the history is that of this frame
    if (due && steady) { freezes = has_enough(block); }
    let flags = flag(KEEPS, stands && before.x != 0.0) | flag(ADDS, adds) | flag(HOLDS, age != 0.0)
        | flag(STAYS, stays) | flag(FREEZES, freezes) | flag(COMPLETE, !is_noisy() && (stays || periods >= 1.0))
        | flag(FREE, !moves && !stays);
    textureStore(block_states, block, vec4u(flags, bitcast<u32>(select(0.0, fade, steady && !adds)), 0u, 0u));

    if (due && !freezes) { age = next_state.period; }
    if (due) { tests = vec3f(0.0); }
    if (stays || freezes) { age = -age; }
    textureStore(next_blocks, block, vec4f(age, tests));
    if (!stays) { atomicStore(&awake[0], 1u); }
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u,
        @builtin(local_invocation_index) index: u32) {
    let origin = SIDE * vec2i(group.xy);
    let size = blocks_size();
    for (var i = i32(index); i < WIDE * WIDE; i += THREADS) {
        let block = clamped(origin - AROUND + vec2i(i % WIDE, i / WIDE), size);   // at edges they repeat
        let at = index_of(block, size);
        sums[i] = Sums();
        if ((block_marks[at] & HAS_SUMS) != 0u) { sums[i] = block_sums[at]; }
    }
    workgroupBarrier();
    for (var i = i32(index); i < NEAR * NEAR; i += THREADS) {
        let block = origin - 1 + vec2i(i % NEAR, i / NEAR);
        marks[i] = 0u;
        if (inside(block, size)) {
            marks[i] = block_marks[index_of(block, size)];
            if (is_noisy() && drifts(block, origin)) { marks[i] |= RESTARTS; }
        }
    }
    workgroupBarrier();
    let block = origin + vec2i(local.xy);
    if (!inside(block, size)) { return; }
    var around = 0u;   // a pixel near the border of a block has samples of its neighbour
    for (var i = 0; i < 9; i++) {
        around |= marks[(i32(local.y) + i / 3) * NEAR + i32(local.x) + i % 3];
    }
    decide(block, origin, (around & RESTARTS) != 0u, (around & MOVES) != 0u);
}
