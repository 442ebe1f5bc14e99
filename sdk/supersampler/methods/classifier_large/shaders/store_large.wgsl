// Write a pixel of the larger image, and its auxiliary outputs (weight, converged) to the alpha channel.
// import packed_maps

@group(1) @binding(0) var large_image: texture_storage_2d<rgba32float, write>;

fn store(p: vec2i, color: vec3f, maps: vec2f) { textureStore(large_image, p, vec4f(color, pack_maps(maps))); }
