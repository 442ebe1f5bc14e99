// Changes of exposure and contrast from frame to frame.
// import state

// Ratio of the exposures of this frame and the previous one; 1 without one.
fn exposure_change(before: State, now: State) -> f32 {
    let known = exposure_of(before);
    return exposure_of(now) / select(exposure_of(now), known, known > 0.0);
}

// Whether a square deviation is more than that of previous frames explains.
fn exceeds(contrast: f32, before: f32) -> bool { return contrast > FLASH * before + LEAST_FLASH; }
