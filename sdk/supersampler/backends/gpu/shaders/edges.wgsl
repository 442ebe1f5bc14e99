// Upsampling of this frame along its edges, for pixels without history. Same as ops/edges.py.
// import sample_tile

// Luma of the usable ones of the 4x4 samples around a position, with a kernel that is long along the edge through them.
fn upsample_along_edges(at: vec2f) -> f32 {
    let first = vec2i(floor(at)) - 1;
    let part = fract(at);
    var taps: array<vec2f, 16>;    // luma, filled where the sample is missing; 1 where it is usable
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let tap = tile_sample(first + vec2i(i, j));
            taps[4 * j + i] = vec2f(ycocg(tap.rgb).x, tap.a);
        }
    }
    var tensor = vec3f(0.0);       // products xx, xy, yy of the gradients at the four samples around
    /* unroll */ for (var j = 0; j < 2; j++) {
        /* unroll */ for (var i = 0; i < 2; i++) {
            let k = 4 * j + i;
            let top = vec3f(taps[k].x, taps[k + 1].x, taps[k + 2].x);
            let middle = vec3f(taps[k + 4].x, taps[k + 5].x, taps[k + 6].x);
            let bottom = vec3f(taps[k + 8].x, taps[k + 9].x, taps[k + 10].x);
            let rows = top + 2.0 * middle + bottom;
            let steps = bottom - top;
            let slope = vec2f(rows.z - rows.x, steps.x + 2.0 * steps.y + steps.z) / 8.0;   // Sobel
            let near = abs(vec2f(1.0 - vec2f(vec2i(i, j))) - part);
            tensor += near.x * near.y * vec3f(slope.x * slope.x, slope.x * slope.y, slope.y * slope.y);
        }
    }
    let form = kernel_form(tensor);
    let left = vec2f(first) - at;
    var sum = vec2f(0.0);
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let d = left + vec2f(vec2i(i, j));
            let near = max(1.0 - dot(form, vec3f(d.x * d.x, d.x * d.y, d.y * d.y)), 0.0);
            sum += near * near * near * near * taps[4 * j + i].y * vec2f(taps[4 * j + i].x, 1.0);
        }
    }
    if (sum.y <= MIN_WEIGHT) { return ycocg(tile_sample(nearest(at)).rgb).x; }
    return sum.x / sum.y;
}

// The factor that keeps highlights of a toned colour from exceeding the 3x3 samples around a position.
fn dimming_to_samples(color: vec3f, at: vec2f) -> f32 {
    var peak = HIGHLIGHT_TONED;
    if (largest(color) <= peak) { return 1.0; }
    /* unroll */ for (var k = 0; k < 9; k++) {
        peak = max(peak, largest(tile_sample(nearest(at) + vec2i(k % 3, k / 3) - 1).rgb));
    }
    return dimming(color, peak);
}

// The quadratic form xx, xy, yy that is 1 at distances from which on samples have no weight.
fn kernel_form(tensor: vec3f) -> vec3f {
    let difference = tensor.x - tensor.z;
    let contrast = sqrt(difference * difference + 4.0 * tensor.y * tensor.y + 1e-12);
    let coherence = contrast / (tensor.x + tensor.z + EDGE_CONTRAST);
    let mean = ROUND + (0.5 * (ACROSS + ALONG) - ROUND) * coherence;
    let turn = 0.5 * (ACROSS - ALONG) * coherence / contrast;
    return vec3f(mean + turn * difference, 4.0 * turn * tensor.y, mean - turn * difference);
}
