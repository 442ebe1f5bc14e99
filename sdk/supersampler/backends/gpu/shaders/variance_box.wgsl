// Variance clipping (Salvi 2016). Same as ops/blending.py, but for a larger least extent.

struct Box {
    low: vec3f,
    high: vec3f,
}

fn variance_box(first: vec3f, second: vec3f, gamma: f32) -> Box {
    let reach = gamma * sqrt(max(second - first * first, vec3f(0.0)));
    return Box(first - reach, first + reach);
}

// Rounding of a colour in the history, whose pixels have 14 bits. If all colours of a neighbourhood have one chroma, their
// box is flat, and a rounded history is beside it.
fn rounding_of(color: vec3f) -> f32 { return dot(abs(color), vec3f(1.0 / 16384.0)); }

// Distance of a colour from the box's centre in half extents: at most 1 inside.
fn overshoot(color: vec3f, box: Box) -> f32 {
    let extent = max(0.5 * (box.high - box.low), vec3f(max(2.0 * rounding_of(color), 1e-5)));
    let ratio = abs(color - 0.5 * (box.low + box.high)) / extent;
    return max(max(ratio.x, ratio.y), ratio.z);
}

fn clip_to_center(color: vec3f, box: Box) -> vec3f {
    let center = 0.5 * (box.low + box.high);
    return center + (color - center) / max(overshoot(color, box), 1.0);
}
