// Network inputs at half display size: six class probabilities of the previous frame, and two means that say how
// history and frame differ around. Same as `neighbourhood_inputs`.
// import params
// import sampling
// import motion
// import dilated

fn classes_at(p: vec2i, size: vec2i) -> array<vec4f, 2> {
    let word = history_classes[index_of(clamped(p, size), size)];
    return array(vec4f(unpack4xU8(word.x)), vec4f(unpack4xU8(word.y)));
}

// Class probabilities of the previous frame, resampled bilinearly; 255 is one.
fn warp_classes(p: vec2i, size: vec2i) -> vec2u {
    let there = reproject(2 * p, closest_at(dilated, upper_left(render_position(2 * p))).motion);
    if (!there.on_screen) { return vec2u(0u); }
    let at = 0.5 * there.at;
    let q = vec2i(floor(at));
    let t = fract(at);
    let a = classes_at(q, size);
    let b = classes_at(q + vec2i(1, 0), size);
    let c = classes_at(q + vec2i(0, 1), size);
    let d = classes_at(q + vec2i(1, 1), size);
    let low = mix(mix(a[0], b[0], t.x), mix(c[0], d[0], t.x), t.y);
    let high = mix(mix(a[1], b[1], t.x), mix(c[1], d[1], t.x), t.y);
    return vec2u(pack4xU8(vec4u(low + 0.5)), pack4xU8(vec4u(high + 0.5)));
}

// How often the mean of three, taken twice around `at`, counts each of five along an axis, of nine times: the
// border repeats before each of the two.
fn tent_weights(at: i32, size: i32) -> array<f32, 5> {
    var weights = array<f32, 5>();
    /* unroll */ for (var first = -1; first <= 1; first++) {
        let middle = clamp(at + first, 0, size - 1);
        /* unroll */ for (var second = -1; second <= 1; second++) {
            weights[clamp(middle + second, 0, size - 1) - at + 2] += 1.0;
        }
    }
    return weights;
}

// Means of the differences of history and frame under a 5x5 tent, as bytes 2 and 3 of a word.
fn difference_means(p: vec2i, size: vec2i) -> u32 {
    var across = tent_weights(p.x, size.x);
    var down = tent_weights(p.y, size.y);
    var sums = vec2f(0.0);
    /* unroll */ for (var j = 0; j < 5; j++) {
        /* unroll */ for (var i = 0; i < 5; i++) {
            let q = clamped(p + vec2i(i, j) - 2, size);
            sums += across[i] * down[j] * unpack2x16float(differences[index_of(q, size)]);
        }
    }
    return pack4x8unorm(vec4f(0.0, 0.0, sqrt(max(abs(sums) / 81.0, vec2f(1e-6)))));
}
