// Neighbourhoods of each sample for `taa`: box of colours, longest motion. Same as `Taa.neighbourhood_box`.
// import params
// import sanitize
// import colors
// import state
// import variance_box
// import reactive
// import frame
// import missing

const SIDE = 16;
const WIDE = SIDE + 2;

@group(0) @binding(1) var<storage, read> next_state: State;
@group(0) @binding(2) var tones: texture_storage_2d<rgba32float, write>;     // toned YCoCg
@group(0) @binding(3) var lows: texture_storage_2d<rgba32float, write>;      // corners of the box, YCoCg
@group(0) @binding(4) var highs: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var longest: texture_storage_2d<rgba32float, write>;   // motion; 1 where all are usable; reactive mask

var<workgroup> colors: array<vec4f, WIDE * WIDE>;    // toned YCoCg, 1 where usable
var<workgroup> motions: array<vec2f, WIDE * WIDE>;

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u,
        @builtin(local_invocation_index) index: u32) {
    let origin = SIDE * vec2i(group.xy);
    for (var i = i32(index); i < WIDE * WIDE; i += SIDE * SIDE) {
        let q = clamped(origin - 1 + vec2i(i % WIDE, i / WIDE), render_size());
        let found = sample_of_frame(q, exposure_of(next_state));
        colors[i] = vec4f(ycocg(tone(found.color * exposure_of(next_state))), found.usable);
        motions[i] = usable_motion(motion_at(q));
    }
    workgroupBarrier();
    let p = origin + vec2i(local.xy);
    if (!inside(p, render_size())) { return; }
    let center = i32(local.y + 1u) * WIDE + i32(local.x) + 1;
    var first = vec3f(0.0);
    var second = vec3f(0.0);
    var extent = Box(colors[center].xyz, colors[center].xyz);
    var usable = 1.0;
    var motion = motions[center];
    /* unroll */ for (var j = -1; j <= 1; j++) {
        /* unroll */ for (var i = -1; i <= 1; i++) {
            let color = colors[center + j * WIDE + i];
            first += color.xyz;
            second += color.xyz * color.xyz;
            extent = Box(min(extent.low, color.xyz), max(extent.high, color.xyz));
            usable = min(usable, color.w);
            let other = motions[center + j * WIDE + i];
            if (dot(other, other) > dot(motion, motion)) { motion = other; }
        }
    }
    let box = variance_box(first / 9.0, second / 9.0, GAMMA);
    textureStore(tones, p, vec4f(colors[center].xyz, 0.0));
    textureStore(lows, p, vec4f(max(box.low, extent.low), 0.0));
    textureStore(highs, p, vec4f(min(box.high, extent.high), 0.0));
    var mask = 0.0;
    if (params.has_reactive > 0.0) { mask = usable_mask(reactive_at(p), usable); }
    textureStore(longest, p, vec4f(motion, usable, mask));
}
