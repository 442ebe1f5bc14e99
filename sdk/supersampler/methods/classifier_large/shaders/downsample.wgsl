// The image of the display: a Lanczos filter of two lobes on the toned colours of the larger image.
// Same as ops/sampling.py. Auxiliary outputs are those of the nearest pixel.
// import params
// import large
// import state
// import sanitize
// import colors
// import show

const SIDE = 16;

@group(0) @binding(1) var<storage, read> next_state: State;
@group(0) @binding(2) var large_image: texture_2d<f32>;
@group(0) @binding(3) var<storage, read_write> aux: array<vec2f>;   // weight, converged

fn lanczos(distance: f32) -> f32 {
    let squared = min(distance * distance, 4.0);
    let base = LANCZOS_SLOPE * squared - 1.0;
    let window = 0.25 * squared - 1.0;
    return (LANCZOS_SCALE * base * base - (LANCZOS_SCALE - 1.0)) * window * window;
}

// Weights of the pixels from `first` on, along an axis; their sum is 1.
fn weights_of(first: f32, at: f32, scale: f32) -> array<f32, TAPS> {
    var weights = array<f32, TAPS>();
    var sum = 0.0;
    /* unroll */ for (var i = 0; i < TAPS; i++) {
        weights[i] = lanczos((first + f32(i) - at) * scale);
        sum += weights[i];
    }
    /* unroll */ for (var i = 0; i < TAPS; i++) { weights[i] /= sum; }
    return weights;
}

fn filtered(p: vec2i, exposure: f32) -> vec3f {
    let ratio = vec2f(large_size()) / params.display;
    let at = (vec2f(p) + 0.5) * ratio - 0.5;
    let first = floor(at) - f32(TAPS / 2 - 1);
    var across = weights_of(first.x, at.x, SHARPNESS / ratio.x);
    var down = weights_of(first.y, at.y, SHARPNESS / ratio.y);
    var sum = vec3f(0.0);
    var peak = HIGHLIGHT_TONED;    // of the four pixels around
    /* unroll */ for (var j = 0; j < TAPS; j++) {
        var row = vec3f(0.0);
        /* unroll */ for (var i = 0; i < TAPS; i++) {
            let q = clamped(vec2i(first) + vec2i(i, j), large_size());
            let color = tone(textureLoad(large_image, q, 0).rgb * exposure);
            row += across[i] * color;
            if (abs(2 * i + 1 - TAPS) == 1 && abs(2 * j + 1 - TAPS) == 1) { peak = max(peak, largest(color)); }
        }
        sum += down[j] * row;
    }
    return clamp(sum * dimming(sum, peak), vec3f(0.0), vec3f(MAX_TONED));
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    if (!inside(p, display_size())) { return; }
    let exposure = exposure_of(next_state);
    let nearest = (2 * p + 1) * large_size() / (2 * display_size());
    var image = vec3f(0.0);
    var weight = 0.0;
    if (params.skips <= 0.0 || !stays_frozen(p)) {
        image = bounded(inverse_tone(filtered(p, exposure)) / exposure);
        weight = textureLoad(large_image, nearest, 0).a;
    }
    show(p, image, weight);
}
