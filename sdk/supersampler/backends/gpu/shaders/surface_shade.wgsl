// Surfaces that the next frame reads: depth, occluding depth, and mean and
// deviation of luma.

@group(0) @binding(4) var next_surface: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var history_surface: texture_2d<f32>;   // of static blocks

fn store_surface(p: vec2i, depth: f32, occluding: f32, shade: vec2f) {
    textureStore(next_surface, p, vec4f(depth, occluding, shade));
}

fn keep_surface(p: vec2i) { textureStore(next_surface, p, textureLoad(history_surface, p, 0)); }
