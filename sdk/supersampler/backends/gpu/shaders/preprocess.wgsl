// This frame at render size: sanitized and exposed samples; depth, dilated motion and shade of neighbourhoods.
// import params
// import sanitize
// import colors
// import state
// import reactive
// import dilated
// import samples
// import frame
// import missing
// import surface

const SIDE = 16;
const DEPTHS = SIDE + 4;   // side of the tile with two samples around
const WIDE = SIDE + 2;     // with one sample around

@group(0) @binding(1) var<storage, read> next_state: State;
@group(0) @binding(2) var samples: texture_storage_2d<rgba16float, write>;       // see samples.wgsl
@group(0) @binding(3) var dilated: texture_storage_2d<rg32uint, write>;
@group(0) @binding(6) var<storage, read_write> light: array<vec2f>;           // sums of shade, by workgroup

var<workgroup> depths: array<f32, DEPTHS * DEPTHS>;
var<workgroup> eroded: array<f32, WIDE * WIDE>;
var<workgroup> near: array<vec3f, WIDE * WIDE>;   // luma, 1 where usable, 1 where it glares
var<workgroup> shades: array<vec2f, SIDE * SIDE>;

struct Sample {
    exposed: vec3f,   // linear RGB, filled where not usable
    usable: f32,
    glares: bool,
}

fn sample_at(p: vec2i) -> Sample {
    let exposure = exposure_of(next_state);
    let found = sample_of_frame(p, exposure);
    let exposed = min(found.color * exposure, vec3f(MAX_HALF));
    return Sample(exposed, found.usable, largest(exposed) * found.usable > GLARE_EXPOSED);
}

// Erosion of the depth at a sample inside the image.
fn erode(p: vec2i, origin: vec2i) -> f32 {
    var farthest = f32(MAX_DEPTH);
    /* unroll */ for (var j = -1; j <= 1; j++) {
        /* unroll */ for (var i = -1; i <= 1; i++) { farthest = min(farthest, depth_near(p + vec2i(i, j), origin)); }
    }
    return farthest;
}

fn depth_near(p: vec2i, origin: vec2i) -> f32 {
    let q = clamped(p, render_size()) - origin + 2;
    return depths[q.y * DEPTHS + q.x];
}

fn wide_index(p: vec2i, origin: vec2i) -> i32 {
    let q = clamped(p, render_size()) - origin + 1;
    return q.y * WIDE + q.x;
}

fn load_tile(origin: vec2i, thread: i32) {
    for (var i = thread; i < DEPTHS * DEPTHS; i += SIDE * SIDE) {
        let p = clamped(origin - 2 + vec2i(i % DEPTHS, i / DEPTHS), render_size());
        depths[i] = usable_depth(depth_at(p));
    }
    for (var i = thread; i < WIDE * WIDE; i += SIDE * SIDE) {
        let s = sample_at(clamped(origin - 1 + vec2i(i % WIDE, i / WIDE), render_size()));
        near[i] = vec3f(ycocg(tone(s.exposed)).x * s.usable, s.usable, select(0.0, 1.0, s.glares));
    }
}

// Motion and depth of the closest of a sample and its right and lower neighbours; relative range of depth around.
fn dilate(p: vec2i, origin: vec2i) -> Closest {
    var best = p;
    /* unroll */ for (var k = 1; k < 4; k++) {
        let q = clamped(p + vec2i(k & 1, k >> 1), render_size());
        if (depth_near(q, origin) > depth_near(best, origin)) { best = q; }
    }
    var closest = depth_near(p, origin);
    var farthest = closest;
    /* unroll */ for (var j = -1; j <= 1; j++) {
        /* unroll */ for (var i = -1; i <= 1; i++) {
            let depth = depth_near(p + vec2i(i, j), origin);
            closest = max(closest, depth);
            farthest = min(farthest, depth);
        }
    }
    let edge = clamp((closest - max(farthest, 0.0)) / max(closest, 1e-12), 0.0, 1.0);
    return Closest(usable_motion(motion_at(best)), depth_near(best, origin), edge);
}

// Depth without thin geometry; minus the depth where geometry leaves: see `occluding_depth` of the torch methods.
fn occluding(p: vec2i, origin: vec2i) -> f32 {
    var opened = -f32(MAX_DEPTH);
    /* unroll */ for (var j = -1; j <= 1; j++) {
        /* unroll */ for (var i = -1; i <= 1; i++) { opened = max(opened, eroded[wide_index(p + vec2i(i, j), origin)]); }
    }
    opened = max(opened, 0.0);
    let depth = depth_near(p, origin);
    let farthest = eroded[wide_index(p, origin)];
    if (farthest < 0.0 || farthest >= SAME_THIN_DEPTH * depth) { return opened; }
    let background = farthest_near(p, origin);
    let over = whole_steps(usable_motion(motion_at(p)) - usable_motion(motion_at(background)));
    if (all(over == vec2f(0.0)) || closest_around(vec2f(p) + over) >= SAME_THIN_DEPTH * depth) { return opened; }
    return -depth;
}

// Motion with components below one sample rounded: to one from THIN_MOTION on, else to 0.
fn whole_steps(motion: vec2f) -> vec2f {
    let steps = sign(motion) * step(vec2f(THIN_MOTION), abs(motion));
    return select(motion, steps, abs(motion) < vec2f(1.0));
}

// Maps 0, 1, 2 to 0, -1, 1.
fn outward(k: i32) -> i32 {
    return select(2 * k - 3, 0, k == 0);
}

// The farthest of 3x3 samples: of equals, the one nearest to the centre.
fn farthest_near(p: vec2i, origin: vec2i) -> vec2i {
    var found = clamped(p, render_size());
    /* unroll */ for (var j = 0; j < 3; j++) {
        /* unroll */ for (var i = 0; i < 3; i++) {
            let q = clamped(p + vec2i(outward(i), outward(j)), render_size());
            if (depth_near(q, origin) < depth_near(found, origin)) { found = q; }
        }
    }
    return found;
}

// Depth of the closest of the four samples around a place.
fn closest_around(place: vec2f) -> f32 {
    let p = clamp(place, vec2f(0.0), vec2f(render_size() - 1));
    let first = vec2i(floor(p));
    let last = vec2i(ceil(p));
    return max(max(usable_depth(depth_at(first)), usable_depth(depth_at(vec2i(last.x, first.y)))),
               max(usable_depth(depth_at(vec2i(first.x, last.y))), usable_depth(depth_at(last))));
}

// Mean and deviation of luma, and 1 where one of 3x3 samples glares.
fn shade(p: vec2i, origin: vec2i) -> vec3f {
    var sums = vec3f(0.0);
    var glares = 0.0;
    /* unroll */ for (var j = -1; j <= 1; j++) {
        /* unroll */ for (var i = -1; i <= 1; i++) {
            let n = near[wide_index(p + vec2i(i, j), origin)];
            sums += vec3f(n.x, n.x * n.x, n.y);
            glares = max(glares, n.z);
        }
    }
    return vec3f(shade_of(sums), glares);
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
        @builtin(local_invocation_id) local: vec3u, @builtin(local_invocation_index) index: u32) {
    let origin = SIDE * vec2i(group.xy);
    let p = origin + vec2i(local.xy);
    let thread = i32(index);
    if (next_state.rests * params.skips > 0.0) {   // later passes read nothing else
        let held = next_state.rests > 1.0 && params.skips > 1.0;
        if (inside(p, render_size()) && !held) { keep_surface(p); }
        return;
    }
    load_tile(origin, thread);
    workgroupBarrier();
    for (var i = thread; i < WIDE * WIDE; i += SIDE * SIDE) {
        eroded[i] = erode(clamped(origin - 1 + vec2i(i % WIDE, i / WIDE), render_size()), origin);
    }
    workgroupBarrier();
    shades[index] = vec2f(0.0);
    if (inside(p, render_size())) {
        let s = sample_at(p);
        let shaded = shade(p, origin);
        var mask = 0.0;
        if (params.has_reactive > 0.0) { mask = floor(usable_mask(reactive_at(p), s.usable) * MASK_STEPS + 0.5); }
        textureStore(samples, p, vec4f(s.exposed, s.usable + 2.0 * shaded.z + 4.0 * mask));
        textureStore(dilated, p, vec4u(pack_closest(dilate(p, origin)), 0u, 0u));
        if (next_state.rests > 0.0) {
            keep_surface(p);
        } else {
            store_surface(p, depth_near(p, origin), occluding(p, origin));
        }
        shades[index] = vec2f(shaded.x, shaded.y * shaded.y);
    }
    for (var half = SIDE * SIDE / 2; half > 0; half /= 2) {
        workgroupBarrier();
        if (thread < half) { shades[thread] += shades[thread + half]; }
    }
    if (thread == 0) { light[group.y * groups.x + group.x] = shades[0]; }
}
