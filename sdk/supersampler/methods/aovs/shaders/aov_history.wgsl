// The AOVs of the previous frame at display size, and the weight of the history in the image.
// import params
// import motion
// import state
// import aov_values

@group(0) @binding(3) var<storage, read> history_aovs: array<Value>;
@group(0) @binding(4) var<storage, read> aux: array<vec2f>;          // weight, converged
@group(0) @binding(6) var<storage, read> history_state: State;

fn history_weight(p: vec2i) -> f32 { return clamp(aux[index_of(p, display_size())].x, 0.0, 1.0); }

// A value resampled with Catmull-Rom, bounded by the known ones of the four pixels around. UNKNOWN if none is, and in a first
// frame. Same as `read_bounded`.
fn aov_before(part: u32, at: vec2f) -> Value {
    if (exposure_of(history_state) == 0.0) { return Value(UNKNOWN); }
    let whole = floor(at);
    let t = at - whole;
    let across = cubic_weights(t.x, CATMULL_ROM);
    let down = cubic_weights(t.y, CATMULL_ROM);
    var sum = Value(0.0);
    var total = 0.0;
    var low = Value(2.0 * MAX_HALF);
    var high = Value(-2.0 * MAX_HALF);
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let is_corner = (i == 0 || i == 3) && (j == 0 || j == 3);
            if (!is_corner) {
                let q = clamped(vec2i(whole) - 1 + vec2i(i, j), display_size());
                let value = history_aovs[value_index(part, q)];
                sum += across[i] * down[j] * value;
                total += across[i] * down[j];
                if (i > 0 && i < 3 && j > 0 && j < 3) {
                    low = select(min(low, value), low, value == Value(UNKNOWN));
                    high = select(max(high, value), high, value == Value(UNKNOWN));
                }
            }
        }
    }
    return select(Value(UNKNOWN), clamp(sum / total, low, high), low <= high);
}
