// Upsampling of this frame along its edges, for pixels without history. Same as ops/edges.py.
// import samples
// import sampling

// YCoCg of the usable ones of the 4x4 samples around a position, under a Gaussian along the edge through them.
fn upsample_along_edges(samples: texture_2d<f32>, at: vec2f) -> vec3f {
    let first = vec2i(floor(at)) - 1;
    let part = fract(at);
    var taps: array<vec4f, 16>;    // YCoCg, filled where the sample is missing; 1 where it is usable
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let p = clamped(first + vec2i(i, j), render_size());
            taps[4 * j + i] = vec4f(ycocg(filled_sample(samples, p)), toned_sample(samples, p).a);
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
    let form = steering_form(tensor);
    let left = vec2f(first) - at;
    var sum = vec4f(0.0);
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let d = left + vec2f(vec2i(i, j));
            let window = 1.0 - 0.25 * d * d;     // 0 where samples come and go
            let near = exp(-0.5 * dot(form, vec3f(d.x * d.x, d.x * d.y, d.y * d.y))) * window.x * window.y;
            let weight = near * taps[4 * j + i].w;
            sum += weight * vec4f(taps[4 * j + i].xyz, 1.0);
        }
    }
    if (sum.w <= MIN_WEIGHT) { return ycocg(filled_sample(samples, nearest(at))); }
    return sum.xyz / sum.w;
}

// The quadratic form xx, xy, yy whose negative half is the exponent of that Gaussian.
fn steering_form(tensor: vec3f) -> vec3f {
    let difference = tensor.x - tensor.z;
    let contrast = sqrt(difference * difference + 4.0 * tensor.y * tensor.y + 1e-12);
    let coherence = contrast / (tensor.x + tensor.z + EDGE_CONTRAST);
    let across = exp(-2.0 * ACROSS * coherence) / (EDGE_SIGMA * EDGE_SIGMA);    // 1 / variance
    let along = exp(-2.0 * ALONG * coherence) / (EDGE_SIGMA * EDGE_SIGMA);
    let mean = 0.5 * (across + along);
    let turn = 0.5 * (across - along) / contrast;
    return vec3f(mean + turn * difference, 4.0 * turn * tensor.y, mean - turn * difference);
}
