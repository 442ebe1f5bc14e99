// Number of samples of the history that are kept, by block; a workgroup is a window. Same as `samples_kept`.
// import at_rest
// import samples
// import history_pixel
// import state

const SIDE = 8;                  // blocks of a workgroup in either direction
const THREADS = 64u;
const STEPS = BLOCK / LAG_STEP;  // samples of a block that are compared, in either direction

@group(0) @binding(1) var<storage, read> next_state: State;
@group(0) @binding(2) var samples: texture_2d<f32>;
@group(0) @binding(3) var block_states: texture_2d<u32>;
@group(0) @binding(4) var history_pixels: texture_2d<u32>;
@group(0) @binding(5) var kept_samples: texture_storage_2d<rg32float, write>;   // x

struct Sums {
    difference: vec4f,   // of samples and history, toned RGB; number of blocks
    square: vec4f,       // of the difference
    level: vec4f,        // of the history
}

var<workgroup> sums: array<Sums, THREADS>;

fn compared(block: vec2i) -> Sums {
    var difference = vec3f(0.0);
    var level = vec3f(0.0);
    for (var i = 0; i < STEPS * STEPS; i++) {
        let step = min(STEPS * block + vec2i(i % STEPS, i / STEPS), (render_size() - 1) / LAG_STEP);   // edges repeat
        let now = toned_sample(samples, LAG_STEP * step);
        let history = pixel_at(history_pixels, pixel_of(LAG_STEP * step)).rgb;
        let before = tone(history * exposure_of(next_state));
        difference += now.a * (now.rgb - before);
        level += now.a * before;
    }
    difference /= f32(STEPS * STEPS);
    level /= f32(STEPS * STEPS);
    return Sums(vec4f(difference, 1.0), vec4f(difference * difference, 0.0), vec4f(level, 0.0));
}

fn samples_kept(window: Sums) -> f32 {
    let count = window.difference.a;
    if (count < LEAST_BLOCKS * f32(SIDE * SIDE)) { return MOST_SAMPLES; }
    let difference = window.difference.rgb / count;
    let level = window.level.rgb / count;
    let variance = max(window.square.rgb / count - difference * difference, vec3f(0.0));
    let lag = abs(difference) - LAG_DEVIATIONS * sqrt(variance / max(count - 1.0, 1.0));
    let part = max(max(lag.r, lag.g), lag.b) / (max(max(level.r, level.g), level.b) + DARK);
    return LAG_SAMPLES / max(part - LAG, LAG_SAMPLES / MOST_SAMPLES);
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) thread: u32) {
    let block = vec2i(id.xy);
    let exists = inside(block, blocks_size());
    let free = exists && (textureLoad(block_states, clamped(block, blocks_size()), 0).x & FREE) != 0u;
    sums[thread] = Sums();
    if (free) { sums[thread] = compared(block); }
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (thread < half) {
            sums[thread].difference += sums[thread + half].difference;
            sums[thread].square += sums[thread + half].square;
            sums[thread].level += sums[thread + half].level;
        }
    }
    workgroupBarrier();
    var kept = f32(MOST_SAMPLES);
    if (free) { kept = samples_kept(sums[0]); }
    if (exists) { textureStore(kept_samples, block, vec4f(kept)); }
}
