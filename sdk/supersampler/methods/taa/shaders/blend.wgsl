// The image of `taa`: clip the history towards the new sample, and blend 10 % of it. Same as `Taa.neighbourhood_box` and
// `Taa.finish`.
// import params
// import sanitize
// import colors
// import state
// import sampling
// import motion
// import variance_box
// import reactive
// import frame
// import missing
// import store

const SIDE = 16;          // display pixels of a workgroup in either direction
const WIDE = SIDE + 3;    // samples that they read: a sample is at least as large as a pixel
const SLACK = 1e-5;   // more than rounding: in a box of one colour, enter and leave differ by rounding only

@group(0) @binding(1) var<storage, read> history_state: State;
@group(0) @binding(2) var<storage, read> next_state: State;
@group(0) @binding(3) var history_pixels: texture_2d<u32>;
@group(0) @binding(4) var next_pixels: texture_storage_2d<rg32uint, write>;
@group(0) @binding(5) var<storage, read_write> aux: array<vec2f>;   // weight; there is no mean

var<workgroup> colors: array<vec4f, WIDE * WIDE>;    // toned YCoCg, 1 where usable
var<workgroup> motions: array<vec2f, WIDE * WIDE>;

struct Neighbourhood {    // 3x3 samples
    box: Box,             // YCoCg
    motion: vec2f,        // the longest
    usable: f32,          // 1 where all are
}

fn load_frame(first: vec2i, thread: i32) {
    for (var i = thread; i < WIDE * WIDE; i += SIDE * SIDE) {
        let q = clamped(first + vec2i(i % WIDE, i / WIDE), render_size());
        let found = sample_of_frame(q, exposure_of(next_state));
        colors[i] = vec4f(ycocg(tone(found.color * exposure_of(next_state))), found.usable);
        motions[i] = usable_motion(motion_at(q));
    }
}

fn cell_of(p: vec2i) -> i32 {
    let q = clamp(p, vec2i(0), vec2i(WIDE - 1));
    return q.y * WIDE + q.x;
}

// p: sample, from the first one of the workgroup
fn neighbourhood_box(p: vec2i) -> Neighbourhood {
    let center = colors[cell_of(p)];
    var first = vec3f(0.0);
    var second = vec3f(0.0);
    var extent = Box(center.xyz, center.xyz);
    var usable = 1.0;
    var motion = motions[cell_of(p)];
    /* unroll */ for (var j = -1; j <= 1; j++) {
        /* unroll */ for (var i = -1; i <= 1; i++) {
            let color = colors[cell_of(p + vec2i(i, j))];
            first += color.xyz;
            second += color.xyz * color.xyz;
            extent = Box(min(extent.low, color.xyz), max(extent.high, color.xyz));
            usable = min(usable, color.w);
            let other = motions[cell_of(p + vec2i(i, j))];
            if (dot(other, other) > dot(motion, motion)) { motion = other; }
        }
    }
    let box = variance_box(first / 9.0, second / 9.0, GAMMA);
    return Neighbourhood(Box(max(box.low, extent.low), min(box.high, extent.high)), motion, usable);
}

// The frame at a position, bilinearly; first: sample of the workgroup.
fn frame_at(at: vec2f, first: vec2i) -> vec3f {
    let t = fract(at);
    let p = vec2i(floor(at)) - first;
    let upper = mix(colors[cell_of(p)].xyz, colors[cell_of(p + vec2i(1, 0))].xyz, t.x);
    let lower = mix(colors[cell_of(p + vec2i(0, 1))].xyz, colors[cell_of(p + vec2i(1, 1))].xyz, t.x);
    return mix(upper, lower, t.y);
}

// The point where the segment from the history to the new sample enters the box. If the segment misses the box (the
// sample may be outside of a variance box), the history is clipped towards the box's centre.
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

fn blend(p: vec2i, first: vec2i) {
    let at = render_position(p);
    let sample = frame_at(at, first);
    let around = neighbourhood_box(nearest(at) - first);
    let there = reproject(p, around.motion);
    let exposure = exposure_of(next_state);
    let warped = resample(history_pixels, there.at, CATMULL_ROM).cubic.rgb;
    var history = ycocg(tone(sanitize(warped) * exposure));
    let usable = around.usable > 0.0;
    if (usable) { history = clip_to_sample(history, sample, around.box); }
    let known = there.on_screen && history_state.followed != 0.0;
    let given = select(1.0, select(0.0, ALPHA, usable), known);
    var mask = 0.0;
    if (params.has_reactive > 0.0) { mask = usable_mask(reactive_at(nearest(at)), around.usable); }
    let weight = given + (1.0 - given) * mask;
    let mixed = from_ycocg(history + weight * (sample - history));
    let image = bounded(inverse_tone(max(mixed, vec3f(0.0))) / exposure);
    textureStore(next_pixels, p, vec4u(pack_pixel(vec4f(image, 0.0)), 0u, 0u));
    store(p, image, vec2f(1.0 - weight, 0.0));
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(global_invocation_id) id: vec3u,
        @builtin(local_invocation_index) thread: u32) {
    let p = vec2i(id.xy);
    let first = vec2i(floor(render_position(SIDE * vec2i(group.xy)))) - 1;
    load_frame(first, i32(thread));
    workgroupBarrier();
    if (inside(p, display_size())) { blend(p, first); }
}
