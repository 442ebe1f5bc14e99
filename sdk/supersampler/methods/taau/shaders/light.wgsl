// Whether the light of this whole frame is unconfirmed. Same as `light_after`.
// import params
// import state

const THREADS = 256u;

@group(0) @binding(1) var<storage, read> light: array<vec2f>;   // sums of shade, by workgroup of `preprocess`
@group(0) @binding(2) var<storage, read> history_state: State;
@group(0) @binding(3) var<storage, read_write> next_state: State;

var<workgroup> sums: array<vec2f, THREADS>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    var sum = vec2f(0.0);
    for (var i = thread; i < arrayLength(&light); i += THREADS) { sum += light[i]; }
    sums[thread] = sum;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (thread < half) { sums[thread] += sums[thread + half]; }
    }
    if (thread == 0u && next_state.rests <= 0.0) {
        let mean = sums[0] / (params.render.x * params.render.y);
        next_state.light = light_after(mean, history_state.light, exposure_change(history_state, next_state));
    }
}

// Ratio of the exposures of this frame and the previous one; 1 without one.
fn exposure_change(before: State, now: State) -> f32 {
    let known = exposure_of(before);
    return exposure_of(now) / select(exposure_of(now), known, known > 0.0);
}

fn light_after(light_now: vec2f, before: vec4f, change: f32) -> vec4f {
    let dim = 1.0 + (change - 1.0) * before.x;
    let slope = change / (dim * dim);
    let contrasts = slope * slope * before.yz;
    let flashes = before.w;
    let known = select(max(contrasts.x, contrasts.y), contrasts.y, flashes > 0.0);
    let flash = known > NO_CONTRAST && flashes < 2.0 && light_now.y > FLASH * known + LEAST_FLASH;
    return vec4f(light_now, max(contrasts.x, FLASH_MEMORY * contrasts.y), select(0.0, flashes + 1.0, flash));
}
