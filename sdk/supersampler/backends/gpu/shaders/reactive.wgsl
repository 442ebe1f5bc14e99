// The reactive mask: how much of the image is this frame alone.
// import params
// import sanitize
// import frame

// At a sample, in [0, 1]; 0 without a mask. NaN counts as 0.
fn reactive_of(sample: vec2i) -> f32 {
    if (params.has_reactive <= 0.0) { return 0.0; }
    return min(sanitize1(reactive_at(sample)), 1.0);
}
