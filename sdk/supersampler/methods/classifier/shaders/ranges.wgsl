// The range of luma of a pixel's samples, packed: 16 bits of its minimum, 14 of its maximum, and two of the
// number of frames with glare.
// import colors

@group(0) @binding(1) var history_ranges: texture_2d<u32>;

fn pack_range(low: f32, high: f32, glare: f32) -> u32 {
    let least = u32(clamp(low, 0.0, 1.0) * LOW_STEPS + 0.5);
    let most = u32(clamp(high, 0.0, 1.0) * HIGH_STEPS + 0.5);
    return least | (most << 16u) | (u32(clamp(glare, 0.0, CONFIRMED)) << 30u);
}

fn range_at(p: vec2i) -> vec2f {
    let packed = textureLoad(history_ranges, clamped(p, display_size()), 0).x;
    let high = f32((packed >> 16u) & 0x3fffu) / HIGH_STEPS + GLARE * f32(packed >> 30u);
    return vec2f(f32(packed & 0xffffu) / LOW_STEPS, high);
}

// Minimum luma, and maximum with GLARE for each frame with glare, resampled bilinearly.
fn read_range(at: vec2f) -> vec2f {
    let p = vec2i(floor(at));
    let t = fract(at);
    return mix(mix(range_at(p), range_at(p + vec2i(1, 0)), t.x),
               mix(range_at(p + vec2i(0, 1)), range_at(p + vec2i(1, 1)), t.x), t.y);
}
