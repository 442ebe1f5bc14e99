// Show what stands still in place of a method's image.
// import rest
// import tiles
// import store

//   weight: of the history, an auxiliary output
fn show(p: vec2i, image: vec3f, weight: f32) {
    let rested = rest(p, image, next_state.period);
    store(p, rested.image, vec2f(weight, rested.frozen));
}

// Whether the method is left out at a pixel: its own history is kept, and the image is frozen.
fn is_left_out(tile: vec2u) -> bool { return tile.x * u32(params.skips) > 0u; }
