// The history at a display pixel. Same as `Classifier.gather_history`.
// import params
// import sanitize
// import colors
// import motion
// import disocclusion
// import ranges
// import sampling
// import dilated
//
// Files that import this declare the textures `dilated` and `history_surface`, and `next_state`.

struct WarpedHistory {
    color: vec3f,           // toned RGB
    detail: vec3f,          // cubic minus bilinear resampling
    samples: f32,           // number of accumulated samples; 0 without history
    range: vec2f,           // minimum and maximum luma of the samples
    glare: f32,             // consecutive frames with glare nearby
}

struct WarpedSurface {
    difference: f32,        // relative difference of depth, equation 10, in [-1, 1]
    visibility: f32,        // 0 where the surface was occluded
}

fn toned_history(linear: vec3f, exposure: f32) -> vec3f { return tone(sanitize(linear) * exposure); }

fn gather_history(pixels: texture_2d<u32>, there: Reprojection, exposure: f32) -> WarpedHistory {
    if (!there.on_screen) { return WarpedHistory(vec3f(0.0), vec3f(0.0), 0.0, vec2f(0.0), 0.0); }
    let history = resample(pixels, there.at, HISTORY_SHARPNESS);
    let color = toned_history(history.cubic.rgb, exposure);
    let range = read_range(there.at);
    return WarpedHistory(color, color - toned_history(history.linear.rgb, exposure), history.linear.w,
                         vec2f(range.x, without_glare(range.y)), glare_of(range.y));
}

// The toned colour alone.
fn warped_color(pixels: texture_2d<u32>, there: Reprojection, exposure: f32) -> vec3f {
    if (!there.on_screen) { return vec3f(0.0); }
    return toned_history(resample(pixels, there.at, HISTORY_SHARPNESS).cubic.rgb, exposure);
}

fn occluding_at(p: vec2i) -> f32 { return textureLoad(history_surface, p, 0).y; }

//   depth: of the pixel
fn gather_surface(there: Reprojection, depth: f32) -> WarpedSurface {
    let at = previous_render_position(there.at, next_state.previous_jitter);
    let visible = visibility(depth, at, DEPTH_MARGIN, DEPTH_RAMP);
    let sample = textureLoad(history_surface, clamped(vec2i(floor(at + 0.5)), previous_size()), 0).x;
    let change = relative_depth_change(select(0.0, sample, there.on_screen), depth);
    return WarpedSurface(select(clamp(change, -1.0, 1.0), 0.0, depth < 0.0), select(0.0, visible, there.on_screen));
}

// Where a display pixel was in the previous frame, by the motion of the closest sample around it.
fn previous_position(p: vec2i) -> Reprojection {
    return reproject(p, closest_at(dilated, upper_left(render_position(p))).motion);
}
