// The image in a texture of the caller, whose largest value is 65504.

@group(1) @binding(4) var image: texture_storage_2d<rgba16float, write>;

fn store_image(p: vec2i, color: vec3f) { textureStore(image, p, vec4f(min(color, vec3f(MAX_HALF)), 1.0)); }
