// This frame at a display pixel. Same as `Classifier.gather_current`.
// import params
// import colors
// import sample_tile

struct CurrentFrame {       // colours are toned RGB
    frame: vec3f,           // cubic upsampling
    sample: vec3f,          // mean of the samples near the pixel
    confidence: f32,        // sum of their weights
    first: vec3f,           // E[c] of a neighbourhood, YCoCg
    second: vec3f,          // E[c^2]
}

fn gather_current(at: vec2f) -> CurrentFrame {
    let scale = display_extent() / params.render;
    let start = floor(at) - 1.0;
    let dx = start.x + vec4f(0.0, 1.0, 2.0, 3.0) - at.x;
    let dy = start.y + vec4f(0.0, 1.0, 2.0, 3.0) - at.y;
    let near_x = gaussian(dx * scale.x, SAMPLE_SIGMA);
    let near_y = gaussian(dy * scale.y, SAMPLE_SIGMA);
    let sharp_x = catmull_rom(dx);
    let sharp_y = catmull_rom(dy);
    let box_x = gaussian(dx, MOMENT_SIGMA);
    let box_y = gaussian(dy, MOMENT_SIGMA);
    var near = vec4f(0.0);
    var sharp = vec4f(0.0);
    var moment = vec4f(0.0);
    var square = vec3f(0.0);
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let tap = usable_tile_sample(vec2i(start) + vec2i(i, j));
            let color = ycocg(tap.rgb);
            near += near_x[i] * near_y[j] * tap;
            sharp += sharp_x[i] * sharp_y[j] * tap;
            moment += box_x[i] * box_y[j] * vec4f(color, tap.a);
            square += box_x[i] * box_y[j] * color * color;
        }
    }
    let total = max(moment.w, 1e-6);
    let first = moment.xyz / total;
    let second = select(vec3f(1.0), square / total, moment.w > MIN_WEIGHT);
    // with missing samples the negative weights of the cubic dominate
    var frame = select(from_ycocg(first), sharp.rgb / max(sharp.w, 1e-6), sharp.w > MIN_CUBIC_WEIGHT);
    if (moment.w <= MIN_WEIGHT) { frame = tile_sample(nearest(at)).rgb; }
    return CurrentFrame(
        clamp(frame, vec3f(0.0), vec3f(MAX_TONED)),
        clamp(near.rgb / max(near.w, 1e-6), vec3f(0.0), vec3f(MAX_TONED)),
        min(near.w, 1.0),
        first,
        second);
}
