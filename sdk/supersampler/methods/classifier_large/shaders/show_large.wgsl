// Write a pixel of the larger image, and the weight of the history to its alpha channel. It takes the place of show.wgsl.
// import params

@group(1) @binding(4) var large_image: texture_storage_2d<rgba32float, write>;

fn show(p: vec2i, image: vec3f, weight: f32) { textureStore(large_image, p, vec4f(image, weight)); }

// A tile that rests is left out only where all do: the filter reads it for pixels beside it.
fn is_left_out(tile: vec2u) -> bool { return next_state.rests * params.skips > 0.0; }
