// Missing samples of a frame; same as `filled` in torch.
// import params
// import sanitize
// import state
// import frame

struct Found {
    color: vec3f,    // linear RGB, filled where the sample is missing
    usable: f32,     // 0 where the sample is missing, else 1
}

fn sample_of_frame(p: vec2i, exposure: f32) -> Found {
    let given = color_at(p);
    if (all_valid(given)) { return Found(scene_color(given), 1.0); }
    return Found(mean_of_window(p / FILL_WINDOW * FILL_WINDOW, exposure), 0.0);
}

// The square of the mean of square roots over a window; where it is empty, grey.
fn mean_of_window(first: vec2i, exposure: f32) -> vec3f {
    var sum = vec4f(0.0);
    for (var i = 0; i < FILL_WINDOW * FILL_WINDOW; i++) {
        let given = color_at(clamped(first + vec2i(i % FILL_WINDOW, i / FILL_WINDOW), render_size()));
        if (all_valid(given)) { sum += vec4f(sqrt(scene_color(given)), 1.0); }
    }
    sum /= f32(FILL_WINDOW * FILL_WINDOW);
    let mean = (sum.rgb + GREY_SHARE * sqrt(EXPOSURE_KEY / exposure)) / (sum.a + GREY_SHARE);
    return mean * mean;
}
