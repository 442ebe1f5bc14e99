// The image of `taa`: clip the history towards the new sample, and blend 10 % of it. Same as `Taa.finish`.
// import params
// import sanitize
// import colors
// import state
// import sampling
// import motion
// import variance_box
// import store

const SLACK = 1e-5;   // more than rounding: in a box of one colour, enter and leave differ by rounding only

@group(0) @binding(1) var<storage, read> history_state: State;
@group(0) @binding(2) var<storage, read> next_state: State;
@group(0) @binding(3) var tones: texture_2d<f32>;
@group(0) @binding(4) var lows: texture_2d<f32>;
@group(0) @binding(5) var highs: texture_2d<f32>;
@group(0) @binding(6) var longest: texture_2d<f32>;
@group(0) @binding(7) var history_pixels: texture_2d<u32>;
@group(0) @binding(8) var next_pixels: texture_storage_2d<rg32uint, write>;
@group(0) @binding(9) var<storage, read_write> aux: array<vec2f>;   // weight; there is no mean

// The segment from the history to the new sample, where it enters the box. A segment that misses the box (the
// sample may be outside of a variance box) is clipped towards the box's centre.
fn clip_to_sample(color: vec3f, sample: vec3f, box: Box) -> vec3f {
    let difference = sample - color;
    let step = select(difference, vec3f(1e-6), abs(difference) < vec3f(1e-6));
    let near = (box.low - color) / step;
    let far = (box.high - color) / step;
    let enter = largest(min(near, far));
    let latest = max(near, far);
    let leave = min(min(latest.x, latest.y), latest.z);
    if (enter <= leave + SLACK && enter <= 1.0 + SLACK && leave >= -SLACK) { return color + clamp(enter, 0.0, 1.0) * step; }
    return clip_to_center(color, box);
}

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    if (!inside(p, display_size())) { return; }
    let at = render_position(p);
    let sample = read_linear(tones, at, render_size()).xyz;
    let around = nearest(at);
    let box = Box(textureLoad(lows, around, 0).xyz, textureLoad(highs, around, 0).xyz);
    let motion = textureLoad(longest, around, 0);
    let usable = motion.z > 0.0;
    let there = reproject(p, motion.xy);
    let exposure = exposure_of(next_state);
    let warped = resample(history_pixels, there.at, CATMULL_ROM).cubic.rgb;
    var history = ycocg(tone(sanitize(warped) * exposure));
    if (usable) { history = clip_to_sample(history, sample, box); }
    let known = there.on_screen && history_state.followed != 0.0;
    let given = select(1.0, select(0.0, ALPHA, usable), known);
    let weight = given + (1.0 - given) * motion.w;
    let blend = from_ycocg(history + weight * (sample - history));
    let image = bounded(inverse_tone(max(blend, vec3f(0.0))) / exposure);
    textureStore(next_pixels, p, vec4u(pack_pixel(vec4f(image, 0.0)), 0u, 0u));
    store(p, image, vec2f(1.0 - weight, 0.0));
}
