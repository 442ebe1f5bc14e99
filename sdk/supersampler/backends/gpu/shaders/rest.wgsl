// The image of a pixel and the mean of its samples; same as `converge` in torch.
// import at_rest
// import state
// import sanitize
// import frame

@group(1) @binding(5) var block_states: texture_2d<u32>;
@group(1) @binding(6) var history_mean: texture_2d<f32>;   // of static blocks: linear RGB, and the sum of weights
@group(1) @binding(7) var next_mean: texture_storage_2d<rgba32float, write>;   // of static blocks
@group(1) @binding(8) var next_phases: texture_2d<f32>;

struct Rested {
    image: vec3f,    // linear RGB
    frozen: f32,     // 1 where it stays until something changes
}

fn block_state(p: vec2i) -> vec2u { return textureLoad(block_states, block_of(p, image_size()), 0).xy; }

fn stays_frozen(p: vec2i) -> bool { return (block_state(p).x & STAYS) != 0u; }

// Weight of a sample in the mean, by its distance along an axis.
fn trapezoid(distance: f32) -> f32 { return clamp((OUTER - abs(distance)) / (OUTER - INNER), 0.0, 1.0); }

// Position of a pixel among the samples of a frame with this jitter.
fn sample_position(p: vec2i, jitter: vec2f) -> vec2f {
    return (vec2f(p) + 0.5) * params.render / params.display - 0.5 - jitter;
}

// Sum of the weighted samples near a pixel, and of their weights.
fn samples_near(p: vec2i) -> vec4f {
    let at = sample_position(p, params.jitter);
    var sum = vec4f(0.0);
    /* unroll */ for (var k = 0; k < 4; k++) {
        let q = floor(at) + vec2f(f32(k & 1), f32(k >> 1));
        let distance = (q - at) * params.display / params.render;
        let weight = trapezoid(distance.x) * trapezoid(distance.y);
        if (weight > 0.0 && inside(vec2i(q), render_size())) {
            let given = color_at(vec2i(q));
            if (all_valid(given)) { sum += weight * vec4f(scene_color(given), 1.0); }
        }
    }
    return sum;
}

// The mean, with this frame's samples where they are added.
fn mean_after(p: vec2i, flags: u32) -> vec4f {
    var mean = vec4f(0.0);
    if ((flags & KEEPS) != 0u) { mean = textureLoad(history_mean, p, 0); }
    if ((flags & ADDS) == 0u) { return mean; }
    let near = samples_near(p);
    let total = mean.a + near.a;
    if (near.a <= 0.0) { return mean; }
    return vec4f((mean.rgb * mean.a + near.rgb) / max(total, 1e-6), total);
}

// A neighbour's mean, and 1 if it has the samples of a whole period.
fn complete_mean(p: vec2i) -> vec4f {
    let q = clamped(p, image_size());
    let flags = block_state(q).x;
    if ((flags & COMPLETE) == 0u) { return vec4f(0.0); }
    let mean = mean_after(q, flags);
    return vec4f(mean.rgb, select(0.0, 1.0, mean.a >= LEAST_WEIGHT));
}

// Slope of the mean: at most twice the smaller of those to each neighbour.
fn slope(p: vec2i, step: vec2i, here: vec3f) -> vec3f {
    var before = vec4f();
    var after = vec4f();
    for (var side = 0; side < 2; side++) {   // a loop, as drivers would inline `complete_mean` twice
        before = after;
        after = complete_mean(p + (2 * side - 1) * step);
    }
    let below = here - before.rgb;
    let above = after.rgb - here;
    let most = 2.0 * min(abs(below), abs(above)) * before.a * after.a;
    return max(min(0.5 * (below + above), most), -most);
}

// Mean offset of the samples of a period from the pixel's centre.
fn offset_of(p: vec2i, period: f32) -> vec2f {
    var sum = vec2f(0.0);
    var total = 0.0;
    for (var row = 0; row < phase_count(); row++) {
        let phase = textureLoad(next_phases, vec2i(row, 0), 0);
        if (phase.z <= 0.0 || phase.z > period) { continue; }
        let at = sample_position(p, phase.xy);
        var weights = vec2f(0.0);
        var offsets = vec2f(0.0);
        /* unroll */ for (var k = 0; k < 2; k++) {
            let q = floor(at) + f32(k);
            let offset = (q - at) * params.display / params.render;
            let is_inside = (q >= vec2f(0.0)) & (q < params.render);
            let weight = select(vec2f(0.0), vec2f(trapezoid(offset.x), trapezoid(offset.y)), is_inside);
            weights += weight;
            offsets += weight * offset;
        }
        sum += offsets * weights.yx;
        total += weights.x * weights.y;
    }
    return sum / max(total, 1e-6);
}

// The mean at the pixel's centre.
fn centred(p: vec2i, here: vec3f, period: f32) -> vec3f {
    if (is_noisy()) { return max(here, vec3f(0.0)); }
    let offset = offset_of(p, period);
    var moved = vec3f(0.0);
    for (var axis = 0; axis < 2; axis++) {
        moved += slope(p, vec2i(1 - axis, axis), here) * select(offset.x, offset.y, axis == 1);
    }
    return max(here - moved, vec3f(0.0));
}

// Fade the image of a pixel to the mean where nothing changes, and write the next mean.
fn rest(p: vec2i, image: vec3f, period: f32) -> Rested {
    let state = block_state(p);
    if ((state.x & HOLDS) == 0u) { return Rested(bounded(image), 0.0); }
    let mean = mean_after(p, state.x);
    if ((state.x & STAYS) != 0u) {
        textureStore(next_mean, p, mean);
        return Rested(mean.rgb, 1.0);
    }
    var share = select(0.0, bitcast<f32>(state.y), mean.a >= LEAST_WEIGHT);
    if (is_noisy()) { share = clamp(mean.a / NOISE_WEIGHT - 1.0, 0.0, 1.0); }
    var shown = image;
    if (share > 0.0) { shown += share * (centred(p, mean.rgb, period) - image); }
    shown = bounded(shown);
    let freezes = (state.x & FREEZES) != 0u;
    textureStore(next_mean, p, vec4f(select(mean.rgb, shown, freezes), mean.a));
    return Rested(shown, select(0.0, 1.0, freezes));
}
