// Colours of this frame and of its surface's history at a display pixel, from the samples around.
// import edges
// import current_frame
// import warped_history
// import frame

// Every thread calls this before a barrier.
fn load_colors(origin: vec2i, thread: i32) {}

fn frame_at(p: vec2i, now: CurrentFrame) -> vec3f { return now.frame; }

fn visibility_at(p: vec2i, at: vec2f, there: Reprojection) -> f32 {
    return gather_surface(there, closest_at(dilated, upper_left(at)).depth).visibility;
}

// Toned colour of the history at the pixel's own motion.
fn own_history(p: vec2i) -> vec3f {
    let motion = usable_motion(motion_at(nearest(render_position(p))));
    return toned_history(resample_linear(history_pixels, reproject(p, motion).at).rgb, exposure_of(next_state));
}

// The 3x3 samples around under a learned kernel: sum of weighted colours and of weights.
fn filter_frame(p: vec2i, at: vec2f, blend: ptr<function, array<vec4f, QUADS>>) -> Sum {
    let center = nearest(at);
    var sum = Sum(vec3f(0.0), 0.0);
    /* unroll */ for (var k = 0; k < 9; k++) {
        let q = center + vec2i(k % 3, k / 3) - 1;
        let distance = vec2f(q) - at;
        let initial = gaussian1(distance.x, KERNEL_SIGMA) * gaussian1(distance.y, KERNEL_SIGMA) + MIN_KERNEL_WEIGHT;
        let tap = usable_tile_sample(q);
        sum = add(sum, tap.a * initial * exp(parameter(blend, KERNEL_AT + u32(k))), tap.rgb);
    }
    return sum;
}

// Whether one of these samples is usable.
fn is_sampled_at(p: vec2i, filtered: Sum) -> bool { return filtered.weight > 0.0; }

// The network's image of one frame, its luma averaged with that upsampled along edges.
fn frame_alone(color: vec3f, at: vec2f) -> vec3f {
    let luma = upsample_along_edges(at);
    let averaged = color + 0.5 * (luma - ycocg(color).x);
    return clamp(averaged * dimming_to_samples(averaged, at), vec3f(0.0), vec3f(MAX_TONED));
}
