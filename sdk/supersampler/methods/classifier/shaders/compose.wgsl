// The image of `classifier` and its next history: the last layers of the network, then the compositor.
// Same as `Classifier.finish`.
// import params
// import state
// import current_frame
// import warped_history
// import unexplained_light
// import variance_box
// import decode
// import frame_colors
// import tiles
// import show

const SIDE = 8;          // packed pixels of a workgroup in either direction, one for each thread
const PIXELS_ACROSS = 2 * SIDE;
const PIXELS_DOWN = 2 * SIDE;
const TILE_THREADS = SIDE * SIDE;

@group(0) @binding(3) var<storage, read> next_state: State;
@group(0) @binding(4) var samples: texture_2d<f32>;
@group(0) @binding(5) var dilated: texture_2d<u32>;
@group(0) @binding(7) var history_surface: texture_2d<f32>;
@group(0) @binding(8) var history_pixels: texture_2d<u32>;
@group(0) @binding(9) var<storage, read> history_classes: array<vec2u>;   // of static blocks
@group(0) @binding(10) var inputs: texture_2d<u32>;
@group(0) @binding(11) var kept0: texture_2d<u32>;
@group(0) @binding(12) var kept1: texture_2d<u32>;
@group(0) @binding(13) var kept2: texture_2d<u32>;
@group(0) @binding(14) var kept3: texture_2d<u32>;
@group(0) @binding(15) var<storage, read> next_tiles: array<vec2u>;
@group(0) @binding(16) var next_pixels: texture_storage_2d<rg32uint, write>;
@group(0) @binding(17) var next_ranges: texture_storage_2d<r32uint, write>;
@group(0) @binding(18) var<storage, read_write> next_classes: array<vec2u>;
@group(0) @binding(19) var<storage, read_write> aux: array<vec2f>;   // weight, converged

struct Sum {
    color: vec3f,
    weight: f32,
}

fn add(sum: Sum, weight: f32, color: vec3f) -> Sum { return Sum(sum.color + weight * color, sum.weight + weight); }

fn parameter(blend: ptr<function, array<vec4f, QUADS>>, i: u32) -> f32 {
    return clamp((*blend)[i / 4u][i % 4u], -MAX_LOG_FACTOR, MAX_LOG_FACTOR);
}

// The history with detail added.
fn sharpened(before: WarpedHistory, blend: ptr<function, array<vec4f, QUADS>>) -> vec3f {
    let detail = clamp(parameter(blend, SHARPNESS_AT), 0.0, MAX_SHARPNESS) * before.detail;
    return clamp(before.color + detail, vec3f(0.0), vec3f(MAX_TONED));
}

fn blend_history(p: vec2i, now: CurrentFrame, before: WarpedHistory, visibility: f32,
                 blend: ptr<function, array<vec4f, QUADS>>) -> Sum {
    if (before.samples * visibility <= 0.0) { return Sum(vec3f(0.0), 0.0); }
    let color = sharpened(before, blend);
    let other = OTHER_PRIOR * before.samples + MIN_PRIOR;
    let first = (before.samples * visibility + MIN_PRIOR) * exp(parameter(blend, 0u));
    var sum = Sum(first * color, first);
    if (RECTIFIED) {
        let box = variance_box(now.first, now.second, GAMMA);
        let clipped = clamp(from_ycocg(clip_to_center(ycocg(color), box)), vec3f(0.0), vec3f(MAX_TONED));
        sum = add(sum, other * exp(parameter(blend, 1u)), clipped);
    }
    if (OWN_MOTION) {
        sum = add(sum, other * exp(parameter(blend, COLORS - 4u)), own_history(p));
    }
    return sum;
}

// Range of luma after this frame's sample, and the number of frames with glare.
fn next_range(luma: f32, now: CurrentFrame, before: WarpedHistory, odds: f32, is_sampled: bool, glared: f32) -> u32 {
    let known = before.samples > 0.0;
    let trust = select(0.0, min(HALF_COUNT * odds / max(before.samples, 1e-6), 1.0), known);
    let rate = now.confidence * CONTRACTION;
    let least = select(before.range.x, min(before.range.x, luma), is_sampled);
    let low = least + rate * max(luma - before.range.x, 0.0);
    let high = max(before.range.y, luma) - rate * max(before.range.y - luma, 0.0);
    return pack_range(luma + trust * (low - luma), luma + trust * (high - luma), glared);
}

fn compose(p: vec2i, corner: u32, thread: u32, rests: bool) {
    var blend = blend_parameters(thread, corner);
    let at = render_position(p);
    let there = previous_position(p);
    let exposure = exposure_of(next_state);
    let now = gather_current(at);
    let before = gather_history(history_pixels, there, exposure);
    let visibility = visibility_at(p, at, there);
    let frame = frame_at(p, now);
    if (corner == 0u && !rests) {
        next_classes[index_of(p / 2, (display_size() + 1) / 2)] = class_bytes(thread, before.samples > 0.0);
    }

    var history = blend_history(p, now, before, visibility, &blend);
    let filtered = filter_frame(p, at, &blend);
    let learned = select(frame, filtered.color / max(filtered.weight, 1e-12), filtered.weight > 1e-9);
    let is_sampled = is_sampled_at(p, filtered);
    let sampled_here = select(0.0, 1.0, is_sampled);
    let sampled = sampled_here * (now.confidence + MIN_PRIOR);
    var current = Sum(vec3f(0.0), 0.0);
    current = add(current, sampled * exp(parameter(&blend, COLORS - 3u)), now.sample);
    current = add(current, FRAME_PRIOR * sampled_here * exp(parameter(&blend, COLORS - 2u)), frame);
    current = add(current, FRAME_PRIOR * sampled_here * exp(parameter(&blend, COLORS - 1u)), learned);
    let alpha = textureLoad(samples, nearest(at), 0).a;
    let reactive = mask_in(alpha);
    if (reactive > 0.0) {
        let present = max(current.weight, 1e-12);
        let kept = (1.0 - reactive) * (present / (present + reactive * history.weight));
        history = Sum(history.color * kept, history.weight * kept);
    }
    let weights = history.weight + current.weight;
    let total = max(weights, 1e-12);
    var toned = select(frame, (history.color + current.color) / total, weights > 0.0);
    if (before.samples * visibility <= 0.0) { toned = frame_alone(toned, at); }
    let image = bounded(inverse_tone(toned) / exposure);

    var odds = history.weight / max(current.weight, 1e-12) * (sampled + 2.0 * FRAME_PRIOR * sampled_here);
    if (!is_sampled) { odds = history.weight / total * before.samples; }   // all that is known
    let luma = luminance(now.sample);
    let glares = glares_in(alpha);
    let bright = (glares && (before.samples > 0.0 || before.glare > 0.0)) || (luma > WHITE && before.glare > 0.0);
    let flash_fraction = f32(next_tiles[0].y) / (display_extent().x * display_extent().y);
    let rises = flash_fraction > FLASH_FRACTION && light_rises(luma, before, visibility);
    let unconfirmed = (bright || rises) && before.glare < CONFIRMED - 1.0;
    let count = min(min(odds, before.samples), SAMPLES) + now.confidence;
    let glared = select(select(0.0, CONFIRMED, glares), before.glare + 1.0, unconfirmed);
    if (rests) {
        keep_history(p, corner);
    } else {
        textureStore(next_ranges, p, vec4u(next_range(luma, now, before, odds, is_sampled, glared), 0u, 0u, 0u));
        let kept = select(count, 0.0, unconfirmed || next_state.flash > 0.0);
        textureStore(next_pixels, p, vec4u(pack_pixel(vec4f(image, kept)), 0u, 0u));
    }
    show(p, image, history.weight / total);
}

fn keep_history(p: vec2i, corner: u32) {
    textureStore(next_pixels, p, textureLoad(history_pixels, p, 0));
    textureStore(next_ranges, p, textureLoad(history_ranges, p, 0));
    if (corner == 0u) {
        let packed = index_of(p / 2, (display_size() + 1) / 2);
        next_classes[packed] = history_classes[packed];
    }
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(global_invocation_id) id: vec3u,
        @builtin(local_invocation_index) thread: u32) {
    let origin = vec2i(PIXELS_ACROSS, PIXELS_DOWN) * vec2i(group.xy);
    let first = 2 * vec2i(id.xy);
    let tile = next_tiles[tile_of(origin)];
    if (is_left_out(tile, IMAGE_REACH)) {
        for (var corner = 0u; corner < 4u; corner++) {
            let p = first + vec2i(vec2u(corner & 1u, corner >> 1u));
            if (inside(p, display_size())) {
                if (!is_held(tile)) { keep_history(p, corner); }
                show_frozen(p, is_held(tile));
            }
        }
        return;
    }
    load_samples(origin, i32(thread));
    load_colors(origin, i32(thread));
    workgroupBarrier();
    if (!inside(first, display_size())) { return; }
    hide(first / 2, thread);
    for (var corner = 0u; corner < 4u; corner++) {
        let p = first + vec2i(vec2u(corner & 1u, corner >> 1u));
        if (inside(p, display_size())) { compose(p, corner, thread, rests(tile)); }
    }
}
