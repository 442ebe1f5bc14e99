// Upsample AOVs to display size, and blend them with their history by the weights of the colour.
// Same as `BlendAovs`.
// import params
// import sanitize
// import sampling
// import motion
// import frame
// import aov_values
// import aov_history

@group(0) @binding(2) var<storage, read_write> next_aovs: array<Value>;

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

// Weighted sum of a value of the 4x4 samples from `first` on, and sum of the weights.
struct Upsampled {
    sum: Value,
    weight: Value,
}

fn upsampled(part: u32, first: vec2i, across: vec4f, down: vec4f) -> Upsampled {
    var found = Upsampled(Value(0.0), Value(0.0));
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let value = aov_at(clamped(first + vec2i(i, j), render_size()), part);
            let weight = across[i] * down[j] * known(value);    // a NaN is a missing sample
            found.sum += weight * limited_value(value);
            found.weight += weight;
        }
    }
    return found;
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
    for (var part = 0u; part < OWN; part++) {
        let current = upsampled(part, vec2i(first), across, down);
        let found = current.weight > Value(MIN_CERTAINTY);
        let color = current.sum / max(current.weight, Value(1e-6));
        let before = aov_before(part, there);
        let unknown = before == Value(UNKNOWN);
        let kept = select(Value(1.0), Value(weight), found);
        let value = select(color + kept * (before - color), color, unknown);
        let blend = select(clamp(value, Value(-MAX_HALF), Value(MAX_HALF)), Value(UNKNOWN), unknown & !found);
        next_aovs[value_index(part, p)] = blend;
        show_aov(p, blend);
    }
}
