// Upsample AOVs to display size, and blend them with their history by the weights of the colour.
// Same as `BlendAovs`. CHANNELS: of a frame.
// import params
// import sanitize
// import sampling
// import motion
// import frame
// import aov_history

@group(0) @binding(1) var<storage, read> frame_aovs: array<f32>;        // (h, w, CHANNELS)
@group(0) @binding(2) var<storage, read_write> next_aovs: array<f32>;   // (CHANNELS, H, W)

// Motion of the closest of a sample and of its right and lower neighbours; same as `dilate_motion_2x2`.
fn dilated_motion(p: vec2i) -> vec2f {
    var best = p;
    var closest = usable_depth(depth_at(p));
    /* unroll */ for (var k = 1; k < 4; k++) {
        let q = clamped(p + vec2i(k & 1, k >> 1), render_size());
        let depth = usable_depth(depth_at(q));
        if (depth > closest) {
            best = q;
            closest = depth;
        }
    }
    return usable_motion(motion_at(best));
}

// Weighted sum of a channel of the 4x4 samples from `first` on, and sum of the weights; a NaN is a missing sample.
fn upsampled(channel: u32, first: vec2i, across: vec4f, down: vec4f) -> vec2f {
    var sum = vec2f(0.0);
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let q = clamped(first + vec2i(i, j), render_size());
            let value = frame_aovs[index_of(q, render_size()) * CHANNELS + channel];
            if (is_number(value)) { sum += across[i] * down[j] * vec2f(limited(value), 1.0); }
        }
    }
    return sum;
}

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    if (!inside(p, display_size())) { return; }
    let at = render_position(p);
    let first = floor(at) - 1.0;
    let across = gaussian(first.x + vec4f(0.0, 1.0, 2.0, 3.0) - at.x, SIGMA);
    let down = gaussian(first.y + vec4f(0.0, 1.0, 2.0, 3.0) - at.y, SIGMA);
    let there = reproject(p, dilated_motion(upper_left(at))).at;
    let weight = history_weight(p);
    for (var channel = 0u; channel < CHANNELS; channel++) {
        let sum = upsampled(channel, vec2i(first), across, down);
        let current = sum.x / max(sum.y, 1e-6);
        let kept = select(1.0, weight, sum.y > MIN_CERTAINTY);
        let blend = current + kept * (aov_before(channel, there) - current);
        next_aovs[plane_index(channel, p)] = blend;
    }
}
