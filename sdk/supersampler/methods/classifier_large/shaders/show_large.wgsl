// Write a pixel of the larger image, and the weight of the history to its alpha channel. It takes the place of show.wgsl.
// import params

@group(1) @binding(4) var large_image: texture_storage_2d<rgba32float, write>;

fn show(p: vec2i, image: vec3f, weight: f32) { textureStore(large_image, p, vec4f(image, weight)); }

// Frozen pixels are shown by `downsample`.
fn show_frozen(p: vec2i, held: bool) {}
