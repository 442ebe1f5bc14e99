// Whether the surface of a pixel was visible in the previous frame.
// import motion
//
// Files that import this define occluding_at(p): the occluding depth of a sample of the previous frame.

// Visibility in [0, 1]: 1 - twice the bilinear mean over the four samples around of how far each was closer by
// the relative `margin`, fully from `margin` + `ramp` on. An occluder that leaves counts fully.
//   depth: of the pixel
fn visibility(depth: f32, at: vec2f, margin: f32, ramp: f32) -> f32 {
    if (depth < 0.0) { return 1.0; }
    let first = floor(at);
    let t = at - first;
    var occluded = 0.0;
    var left = 0.0;
    /* unroll */ for (var k = 0; k < 4; k++) {
        let corner = vec2f(f32(k & 1), f32(k >> 1));
        let before = occluding_at(clamped(vec2i(first + corner), previous_size()));
        let weights = mix(1.0 - t, t, corner);
        let closer = clamp((relative_depth_change(abs(before), depth) - margin) / ramp, 0.0, 1.0);
        occluded += weights.x * weights.y * closer;
        if (before < 0.0) { left = max(left, closer); }
    }
    return max(1.0 - 2.0 * max(occluded, left), 0.0);
}
