// The image in a texture of the caller.

@group(1) @binding(0) var image: texture_storage_2d<rgba16float, write>;

fn store_image(p: vec2i, color: vec3f) { textureStore(image, p, vec4f(color, 1.0)); }
