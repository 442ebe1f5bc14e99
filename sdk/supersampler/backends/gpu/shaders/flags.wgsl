// Flags of each sample for the display pixels near it (glare, motion, and opened means of neighbourhoods), and
// its own motion.
// import convergence
// import sample_flags

@group(0) @binding(1) var samples: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> own_motion: array<vec2f>;
@group(0) @binding(3) var next_opening: texture_2d<f32>;
@group(0) @binding(4) var flags: texture_storage_2d<rg32uint, write>;   // see sample_flags.wgsl

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    if (!inside(p, render_size())) { return; }
    var found = 0u;
    /* unroll */ for (var j = -2; j <= 2; j++) {
        /* unroll */ for (var i = -2; i <= 2; i++) {
            let q = clamped(p + vec2i(i, j), render_size());
            let opens = textureLoad(next_opening, q, 0).w;
            if (opens > DOUBTED) { found |= OPENED_5X5; }
            if (opens > 0.0) { found |= DOUBTED_5X5; }
            if (abs(i) <= 1 && abs(j) <= 1 && textureLoad(samples, q, 0).a < 0.0) { found |= GLARES_3X3; }
            if (i >= 0 && i <= 1 && j >= 0 && j <= 1 && is_moving(own_motion[index_of(q, render_size())])) {
                found |= MOVES_2X2;
            }
        }
    }
    textureStore(flags, p, pack_flags(found, own_motion[index_of(p, render_size())]));
}
