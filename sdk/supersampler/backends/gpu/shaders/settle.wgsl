// Add this frame's samples to the mean where a pixel stands still, and fade the image to it.
// Twin of `settle` of ops/convergence.py.
// import convergence
// import samples
// import sample_flags
// import sanitize

const SIGMA = 0.4;
const BRIGHTENING = 8.0;

struct Settled {
    image: vec3f,
    still: vec4f,        // mean, and the sum of its weights
    converged: f32,
}

fn darkening(peak: f32, other: f32) -> f32 {
    let most = 1.0 + BRIGHTENING * other;
    return most / max(peak, most);
}

fn tent_gaussian(distance: f32) -> f32 { return gaussian1(distance, SIGMA) * tent(distance); }

// Samples near a display pixel: sum of weighted exposed RGB, sum of weights.
fn samples_near(samples: texture_2d<f32>, at: vec2f) -> vec4f {
    let scale = display_extent() / params.render;
    let first = floor(at);
    var sums = vec4f(0.0);
    /* unroll */ for (var k = 0; k < 4; k++) {
        let q = first + vec2f(f32(k & 1), f32(k >> 1));
        let distance = (q - at) * scale;
        let weight = tent_gaussian(distance.x) * tent_gaussian(distance.y);
        sums += weight * mean_sample(samples, vec2i(q));
    }
    return sums;
}

fn settle(image: vec3f, history: vec4f, p: vec2i, samples: texture_2d<f32>, flags: texture_2d<u32>,
          exposure: f32, reactive: f32) -> Settled {
    let at = render_position(p);
    if (has_flag(flags, upper_left(at), MOVES_2X2)) {
        return Settled(bounded(image), vec4f(history.rgb, 0.0), 0.0);
    }
    let opened = has_flag(flags, nearest(at), OPENED_5X5);
    let doubted = has_flag(flags, nearest(at), DOUBTED_5X5);
    let weight = select(abs(history.a), 0.0, doubted && history.a < 0.0);
    let rejected = doubted && history.a > 0.0;
    let near = samples_near(samples, at);
    let added = select(near.a * params.counts, 0.0, rejected && opened);
    let total = weight + added;
    let share = added / max(total + clamp(total - PERIOD, 0.0, PERIOD), 1e-6);
    var mean = history.rgb;
    var sample = near.rgb / (max(near.a, 1e-6) * exposure);
    let sample_peak = largest(sample * exposure);
    let mean_peak = largest(mean * exposure);
    let early = weight < READY && added > 0.0;
    mean *= darkening(mean_peak, select(mean_peak, sample_peak, early));
    sample *= darkening(sample_peak, select(sample_peak, mean_peak, weight > 0.0));
    mean += share * (sample - mean);
    let fraction = select(clamp((total - READY) / (PERIOD - READY), 0.0, 1.0), 0.0, opened);
    let converged = fraction * (1.0 - reactive);
    let stays = history.a < 0.0 && params.counts <= 0.0;
    let next_weight = select(total, -min(total, PERIOD), rejected || stays);
    return Settled(bounded(image + converged * (mean - image)), vec4f(mean, next_weight), converged);
}
