// The image of `taau` and its next history, one thread for each display pixel.
// Same as supersampler_model.methods.taau.
// import params
// import sanitize
// import colors
// import motion
// import disocclusion
// import variance_box
// import edges
// import dilated
// import changes
// import tiles
// import show

@group(0) @binding(2) var<storage, read> next_state: State;
@group(0) @binding(3) var samples: texture_2d<f32>;
@group(0) @binding(4) var dilated: texture_2d<u32>;
@group(0) @binding(5) var history_surface: texture_2d<u32>;    // occluding depth
@group(0) @binding(7) var history_pixels: texture_2d<u32>;     // linear RGB, number of samples
@group(0) @binding(8) var<storage, read> history_power: array<f32>;
@group(0) @binding(9) var next_pixels: texture_storage_2d<rg32uint, write>;
@group(0) @binding(10) var<storage, read_write> next_power: array<f32>;
@group(0) @binding(11) var<storage, read> next_tiles: array<vec2u>;
@group(0) @binding(12) var<storage, read_write> aux: array<vec2f>;   // weight, converged
@group(0) @binding(13) var kept_samples: texture_2d<f32>;            // x: of the history, by block

const PIXELS_ACROSS = 32;
const PIXELS_DOWN = 4;
const TILE_THREADS = PIXELS_ACROSS * PIXELS_DOWN;

struct Current {          // this frame; colours are toned YCoCg
    sample: vec3f,        // mean of the samples near the pixel
    confidence: f32,      // sum of their weights
    center: vec3f,        // mean of the samples around, luma by the plane through them
    found: bool,          // whether a sample is around
    variance: vec3f,      // about `center`
    fit: f32,             // how well 3x3 samples fit that plane, 0 to 1
    shade: vec2f,         // mean and deviation of luma over 3x3 samples
    glares: bool,
    reactive: f32,        // mask
}

struct Warped {           // the history
    light: vec3f,         // linear RGB
    color: vec3f,         // toned YCoCg
    samples: f32,
    power: f32,           // mean square of sample - history
    glare: f32,           // consecutive frames with glare nearby
    unchanged: f32,       // 0 where light changed
    surface: f32,         // 0 where disoccluded
    speed: f32,
    blur: f32,
}

struct Line {             // filters that fit a line to four samples
    mean: vec4f,          // weights that sum to 1
    slope: vec4f,         // per standard deviation of the positions
    shift: f32,           // mean position in these standard deviations
}

fn line_filters(distance: vec4f, sigma: f32) -> Line {
    let window = gaussian(distance, sigma);
    let weights = window / dot(window, vec4f(1.0));
    let mean = dot(weights, distance);
    let deviation = sqrt(dot(weights, distance * distance) - mean * mean);
    return Line(weights, (distance - mean) * weights / deviation, mean / deviation);
}

fn gather_current(p: vec2i) -> Current {
    let at = render_position(p);
    let scale = display_extent() / params.render;
    let first = floor(at) - 1.0;
    let dx = first.x + vec4f(0.0, 1.0, 2.0, 3.0) - at.x;
    let dy = first.y + vec4f(0.0, 1.0, 2.0, 3.0) - at.y;
    let near_x = gaussian(dx * scale.x, SAMPLE_SIGMA);
    let near_y = gaussian(dy * scale.y, SAMPLE_SIGMA);
    let line_x = line_filters(dx, MOMENT_SIGMA);
    let line_y = line_filters(dy, MOMENT_SIGMA);
    var near = vec4f(0.0);
    var moment = vec4f(0.0);
    var square = vec3f(0.0);
    var slope = vec2f(0.0);
    let sample = nearest(at);
    var steps = vec2f(0.0);    // luma of 3x3 samples: right minus left, below minus above
    var around = vec3f(0.0);   // sums over these, see `shade_of`
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let tap = usable_tile_sample(vec2i(first) + vec2i(i, j));
            let color = ycocg(tap.rgb);
            let value = vec4f(color, tap.a);
            near += near_x[i] * near_y[j] * value;
            moment += line_x.mean[i] * line_y.mean[j] * value;
            square += line_x.mean[i] * line_y.mean[j] * color * color;
            slope += vec2f(line_x.slope[i] * line_y.mean[j], line_x.mean[i] * line_y.slope[j]) * color.x;
            let away = vec2i(first) + vec2i(i, j) - sample;
            if (all(abs(away) <= vec2i(1))) {
                steps += vec2f(away) * color.x;
                around += vec3f(color.x, color.x * color.x, tap.a);
            }
        }
    }
    var center = moment.xyz / max(moment.w, 1e-6);
    var variance = max(square / max(moment.w, 1e-6) - center * center, vec3f(0.0));
    let shade = shade_of(around);
    let alpha = textureLoad(samples, sample, 0).a;
    let whole = moment.w > FULL_WEIGHT && around.z > 9.0 * FULL_WEIGHT;
    let explained = dot(steps, steps) * (6.0 / 9.0 / 36.0) / max(shade.y * shade.y, 1e-7);
    let fit = select(0.0, clamp((explained - UNFIT) / (FIT - UNFIT), 0.0, 1.0), whole);
    center.x -= fit * dot(slope, vec2f(line_x.shift, line_y.shift));
    variance.x = max(variance.x - fit * dot(slope, slope), 0.0);
    return Current(
        near.xyz / max(near.w, 1e-6),
        min(near.w, 1.0),
        center,
        moment.w > MIN_WEIGHT,
        select(vec3f(1.0), variance, moment.w > MIN_WINDOW_WEIGHT),
        fit,
        shade,
        glares_in(alpha),
        mask_in(alpha));
}

// This frame alone: luma upsampled along edges, mean chroma of the samples around.
fn frame_alone(p: vec2i, now: Current) -> vec3f {
    let at = render_position(p);
    var chroma = now.center.yz;
    if (!now.found) { chroma = ycocg(tile_sample(nearest(at)).rgb).yz; }
    let frame = vec3f(upsample_along_edges(at), chroma);
    return frame * dimming_to_samples(from_ycocg(frame), at);
}

fn occluding_at(p: vec2i) -> f32 { return bitcast<f32>(textureLoad(history_surface, p, 0).x); }

fn power_at(p: vec2i) -> f32 { return history_power[index_of(clamped(p, display_size()), display_size())]; }

fn gather_history(p: vec2i) -> Warped {
    let closest = closest_at(dilated, upper_left(render_position(p)));
    let there = reproject(p, closest.motion);
    let at = previous_render_position(there.at, next_state.previous_jitter);
    let same = select(0.0, visibility(closest.depth, at, DEPTH_MARGIN, DEPTH_RAMP), there.on_screen);
    let history = resample(history_pixels, there.at, HISTORY_SHARPNESS);
    let light = sanitize(history.cubic.rgb);
    let t = fract(there.at);
    let q = vec2i(floor(there.at));
    let power = mix(mix(power_at(q), power_at(q + vec2i(1, 0)), t.x),
                    mix(power_at(q + vec2i(0, 1)), power_at(q + vec2i(1, 1)), t.x), t.y);
    return Warped(
        light,
        ycocg(tone(light * exposure_of(next_state))),
        min(history.linear.w, textureLoad(kept_samples, block_of(p, image_size()), 0).x),
        without_glare(power),
        glare_of(power),
        1.0 - change_at(p),
        same,
        length(there.motion),
        2.0 * (t.x * (1.0 - t.x) + t.y * (1.0 - t.y)));
}

struct Blend {
    history: vec3f,       // rectified
    weight: f32,          // of this frame's sample
    samples: f32,         // effective number in the history
    holds: f32,           // 1 where the spread of the history is still valid
    trusted: f32,         // fraction of the history that is kept where this frame adds no sample
    kept: f32,            // number of samples in the history there
    unconfirmed: bool,    // whether this frame adds no sample
}

fn decide(now: Current, before: Warped) -> Blend {
    let spread = sqrt(before.power) * before.unchanged;
    let gamma = GAMMA_STILL + (GAMMA_MOVING - GAMMA_STILL) * min(before.speed / GAMMA_SPEED, 1.0);
    let reach = gamma * sqrt(now.variance) + GAMMA_TIME * spread;
    let box = Box(now.center - reach, now.center + reach);
    let within = 1.0 - clamp(FORGET * (overshoot(before.color, box) - 1.0), 0.0, 1.0);
    let limit = SAMPLES / (1.0 + BLUR_COST * before.blur * before.blur + SPEED_COST * before.speed);
    let holds = before.surface * before.unchanged;
    let count = min(before.samples * holds * within, limit);
    let weight = now.confidence / max(count + now.confidence, 1e-6);
    let glares = now.glares && before.glare < CONFIRMED - 1.0;
    let trusted = select(holds, before.surface, glares);
    let kept = min(before.samples * trusted, limit);
    let unconfirmed = (glares || next_state.light.w > 0.0) && kept > MIN_SAMPLES;
    return Blend(clip_to_center(before.color, box), weight, count, holds, trusted, kept, unconfirmed);
}

// The next spread: mean square of sample - history; see `Taau.finish`.
fn power_after(now: Current, before: Warped, blend: Blend, known: bool) -> f32 {
    let reach = sqrt(before.power) + SPREAD_STEP;
    var contrast = abs(now.sample.x - now.shade.x);
    contrast = mix(contrast, min(contrast, abs(now.sample.x - now.center.x)), now.fit);
    let error = min(min(abs(now.sample.x - before.color.x), reach), contrast);
    let counted = min(blend.samples, SPREAD_SAMPLES) + now.confidence;
    let rate = now.confidence / max(counted, 1e-6);
    let power = max(before.power + rate * (error * error - before.power) - DARKNESS, 0.0);
    return select(0.0, blend.holds, known) * power;
}

fn store_history(p: vec2i, pixel: vec2u, power: f32) {
    textureStore(next_pixels, p, vec4u(pixel, 0u, 0u));
    next_power[index_of(p, display_size())] = power;
}

fn blend(p: vec2i, rests: bool) {
    let now = gather_current(p);
    let before = gather_history(p);
    var mixed = decide(now, before);
    let reactive = now.reactive;
    let settled_part = min(mixed.samples / SETTLED, 1.0);
    var frame = now.sample;
    if (settled_part < 1.0 || reactive > 0.0) { frame = frame_alone(p, now); }
    let sample = now.sample + (1.0 - settled_part) * (frame - now.sample);
    var color = mixed.history + mixed.weight * (sample - mixed.history);
    let known = mixed.samples > MIN_SAMPLES;
    if (!known) { color = frame; }
    color += reactive * (frame - color);
    mixed.samples *= 1.0 - reactive;
    let exposure = exposure_of(next_state);
    let linear = bounded(inverse_tone(max(from_ycocg(color), vec3f(0.0))) / exposure);

    var pixel = vec4f(linear, mixed.samples + now.confidence);
    var power = power_after(now, before, mixed, known) + select(0.0, GLARE * CONFIRMED, now.glares);
    if (mixed.unconfirmed) {
        let glare = min(before.glare + select(0.0, 1.0, now.glares), CONFIRMED);
        pixel = vec4f(before.light, mixed.kept);
        power = mixed.trusted * before.power + GLARE * glare;
    }
    if (rests) {
        store_history(p, textureLoad(history_pixels, p, 0).xy, power_at(p));
    } else {
        store_history(p, pack_pixel(pixel), power);
    }
    show(p, linear, select(0.0, 1.0 - mixed.weight, known) * (1.0 - reactive));
}

@compute @workgroup_size(PIXELS_ACROSS, PIXELS_DOWN)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(global_invocation_id) id: vec3u,
        @builtin(local_invocation_index) thread: u32) {
    let p = vec2i(id.xy);
    let origin = vec2i(PIXELS_ACROSS, PIXELS_DOWN) * vec2i(group.xy);
    let tile = next_tiles[tile_of(origin)];
    if (is_left_out(tile, IMAGE_REACH)) {
        if (inside(p, display_size())) {
            if (!is_held(tile)) { store_history(p, textureLoad(history_pixels, p, 0).xy, power_at(p)); }
            show_frozen(p, is_held(tile));
        }
        return;
    }
    load_samples(origin, i32(thread));
    compare_cells(origin, i32(thread));
    workgroupBarrier();
    find_changes(i32(thread));
    workgroupBarrier();
    if (inside(p, display_size())) { blend(p, rests(tile)); }
}
