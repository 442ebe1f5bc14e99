// Show what stands still in place of a method's image.
// import rest
// import store

//   weight: of the history, an auxiliary output
fn show(p: vec2i, image: vec3f, weight: f32) {
    let rested = rest(p, image, next_state.period);
    store(p, rested.image, vec2f(weight, rested.frozen));
}

// Show a frozen pixel.
//   held: whether the next mean holds it already
fn show_frozen(p: vec2i, held: bool) {
    let mean = textureLoad(history_mean, p, 0);
    if (!held) { textureStore(next_mean, p, mean); }
    store(p, mean.rgb, vec2f(0.0, 1.0));
}
