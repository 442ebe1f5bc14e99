// Surfaces that the next frame reads: depth, and occluding depth.

@group(0) @binding(4) var next_surface: texture_storage_2d<rg32float, write>;
@group(0) @binding(7) var history_surface: texture_2d<f32>;   // of static blocks

fn store_surface(p: vec2i, depth: f32, occluding: f32) {
    textureStore(next_surface, p, vec4f(depth, occluding, 0.0, 0.0));
}

fn keep_surface(p: vec2i) { textureStore(next_surface, p, textureLoad(history_surface, p, 0)); }
