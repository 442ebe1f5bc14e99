// The reactive mask: minimum weight of this frame.
// import sanitize

// The mask of a sample, in [0, 1]; 0 where the sample is missing. NaN counts as 0.
fn usable_mask(given: f32, usable: f32) -> f32 { return min(sanitize1(given), 1.0) * usable; }
