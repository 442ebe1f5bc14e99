// The colour of an unshaded frame, from samples of the shaded one whose surfaces are most similar. Same as `GuidedWarp`.
// import params
// import warp_params
// import sanitize
// import frame
// import image
// import surfaces

struct Surfaces {
    has_depth: u32,
    samples: array<vec4u>,
}

@group(0) @binding(2) var<storage, read> shaded_surfaces: Surfaces;
@group(0) @binding(3) var<storage, read> history_color: array<f32>;
@group(0) @binding(4) var<storage, read> history_motion: array<vec2f>;     // from the previous frame to the shaded one
@group(0) @binding(5) var<storage, read_write> next_motion: array<vec2f>;  // from this frame to the shaded one
@group(0) @binding(6) var frame_gbuffer_base_color: texture_2d<f32>;
@group(0) @binding(7) var frame_gbuffer_normal: texture_2d<f32>;

// Position to which a motion leads, among the samples of another frame; 0 is its first sample.
fn place(p: vec2i, motion: vec2f, size: vec2f, jitter: vec2f) -> vec2f {
    return (vec2f(p) + motion + (params.jitter + 0.5)) * size / params.render - (jitter + 0.5);
}

fn earlier_motion(p: vec2i) -> vec2f {
    return usable_motion(history_motion[index_of(clamped(p, previous_size()), previous_size())]);
}

// The motion to the shaded frame through the previous one; same as `back_to_shaded`.
fn back_to_shaded(p: vec2i) -> vec2f {
    let motion = usable_motion(motion_at(p));
    let at = clamp(place(p, motion, params.previous, warp.previous_jitter), vec2f(0.0), params.previous - 1.0);
    let first = vec2i(floor(at));
    let t = at - floor(at);
    let upper = mix(earlier_motion(first), earlier_motion(first + vec2i(1, 0)), t.x);
    let lower = mix(earlier_motion(first + vec2i(0, 1)), earlier_motion(first + vec2i(1, 1)), t.x);
    let rest = mix(upper, lower, t.y) * params.render / params.previous;
    return clamp(motion + rest, vec2f(-MAX_MOTION), vec2f(MAX_MOTION));
}

// The surface of a pixel and its position in the shaded frame, by which samples are selected. Same as `Guide` in torch.
struct Guide {
    surface: Surface,
    position: vec2f,
    nearest: vec2f,    // the sample nearest to it
}

struct Candidate {
    index: u32,
    surface: Surface,
    cost: f32,        // -log of its weight
}

fn candidate(guide: Guide, number: u32) -> Candidate {
    let position = guide.nearest + warp.offsets[number].xy;
    let index = index_of(clamped(vec2i(position), shaded_size()), shaded_size());
    let surface = unpacked(shaded_surfaces.samples[index]);
    let offset = (position - guide.position) / DISTANCE_SIGMA;
    return Candidate(index, surface, 0.5 * (difference(guide.surface, surface) + dot(offset, offset)));
}

// A key of a candidate holds its cost in steps and, in its lower digits, its number. Keys of the least cost are kept in order.
const NO_KEY = KEY_INDICES * (MAX_KEY + 1.0);    // greater than all keys

fn with_candidate(keys: vec4f, guide: Guide, number: u32) -> vec4f {
    let key = min(floor(candidate(guide, number).cost * KEY_STEPS), MAX_KEY) * KEY_INDICES + f32(number);
    let is_less = vec4f(key) < keys;
    let kept = select(vec4f(key), vec4f(0.0, keys.xyz), vec4<bool>(false, is_less.xyz));
    return select(keys, kept, is_less);
}

// Keys of the four nearest candidates. Rings that are too far away for any surface are left out.
fn find_nearest(guide: Guide) -> vec4f {
    let to_nearest = max(abs(guide.nearest.x - guide.position.x), abs(guide.nearest.y - guide.position.y));
    var keys = with_candidate(vec4f(NO_KEY), guide, 0u);
    for (var first = 1u; first <= 8u * RINGS; first += 8u) {
        let stride = max(abs(warp.offsets[first].x), abs(warp.offsets[first].y));
        let gap = (stride - to_nearest) / DISTANCE_SIGMA;
        if (floor(gap * gap * (0.5 * RING_MARGIN * KEY_STEPS)) * KEY_INDICES >= keys.w) { break; }
        for (var k = 0u; k < 8u; k++) { keys = with_candidate(keys, guide, first + k); }
    }
    return keys;
}

// The light of usable samples, and the sum of their weights.
fn mean_light(guide: Guide, keys: vec4f) -> vec4f {
    let numbers = vec4u(keys - floor(keys / KEY_INDICES) * KEY_INDICES);
    var candidates: array<Candidate, 4>;
    /* unroll */ for (var i = 0; i < 4; i++) {
        candidates[i] = candidate(guide, numbers[i]);
    }
    let least = min(min(candidates[0].cost, candidates[1].cost), min(candidates[2].cost, candidates[3].cost));
    var sum = vec4f(0.0);
    /* unroll */ for (var i = 0; i < 4; i++) {
        let k = 3u * candidates[i].index;
        let color = vec3f(history_color[k], history_color[k + 1u], history_color[k + 2u]);
        let weight = select(0.0, exp(least - candidates[i].cost), all_valid(color));
        sum += weight * vec4f(sanitize(color) / reflectance(candidates[i].surface), 1.0);
    }
    return vec4f(sum.rgb / max(sum.a, MIN_LIGHT_WEIGHT), sum.a);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    if (!inside(p, render_size())) { return; }
    let motion = back_to_shaded(p);
    let at = clamp(place(p, motion, warp.shaded, warp.shaded_jitter), vec2f(0.0), warp.shaded - 1.0);
    let base_color = textureLoad(frame_gbuffer_base_color, p, 0).rgb;
    let normal = textureLoad(frame_gbuffer_normal, p, 0).xyz;
    let known = shaded_surfaces.has_depth != 0u && is_known(base_color, normal, depth_at(p));
    let surface = unpacked(packed(surface_of(base_color, normal, depth_at(p), known)));
    let guide = Guide(surface, at, floor(at + 0.5));
    let light = mean_light(guide, find_nearest(guide));
    let color = bounded(light.rgb * reflectance(surface)) * params.pre_exposure;
    store_image(p, select(vec3f(warp.missing), color, light.a >= MIN_LIGHT_WEIGHT));
    next_motion[index_of(p, render_size())] = motion;
}
