// Surfaces that the next frame reads: occluding depth.

@group(0) @binding(4) var next_surface: texture_storage_2d<r32uint, write>;
@group(0) @binding(7) var history_surface: texture_2d<u32>;   // of static blocks

fn store_surface(p: vec2i, depth: f32, occluding: f32) {
    textureStore(next_surface, p, vec4u(bitcast<u32>(occluding)));
}

fn keep_surface(p: vec2i) { textureStore(next_surface, p, textureLoad(history_surface, p, 0)); }
