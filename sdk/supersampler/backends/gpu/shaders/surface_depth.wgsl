// What the next frame needs of this one's surfaces: depth, and occluding depth.

@group(0) @binding(4) var next_surface: texture_storage_2d<rg32float, write>;

fn store_surface(p: vec2i, depth: f32, occluding: f32, shade: vec2f) {
    textureStore(next_surface, p, vec4f(depth, occluding, 0.0, 0.0));
}
