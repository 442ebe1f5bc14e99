// Surfaces that the next frame reads: occluding depth; mean and deviation of luma, as half floats.

@group(0) @binding(4) var next_surface: texture_storage_2d<rg32uint, write>;
@group(0) @binding(7) var history_surface: texture_2d<u32>;   // of static blocks

fn store_surface(p: vec2i, depth: f32, occluding: f32, shade: vec2f) {
    textureStore(next_surface, p, vec4u(bitcast<u32>(occluding), pack2x16float(shade), 0u, 0u));
}

fn keep_surface(p: vec2i) { textureStore(next_surface, p, textureLoad(history_surface, p, 0)); }
