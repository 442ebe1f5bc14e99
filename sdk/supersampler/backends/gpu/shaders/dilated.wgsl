// The closest of a sample and of its right and lower neighbours, as `preprocess` writes it for each sample in two words:
// its motion as half floats; its depth in 24 bits, and the relative range of depth around in a byte.

struct Closest {
    motion: vec2f,    // render pixels
    depth: f32,       // UNKNOWN_DEPTH where it is unknown
    edge: f32,        // range of depth of 3x3 samples over the closest, [0, 1]
}

const UNKNOWN_BITS = 0xffffff00u;

fn pack_closest(closest: Closest) -> vec2u {
    let depth = select(UNKNOWN_BITS, (bitcast<u32>(closest.depth) << 1u) & UNKNOWN_BITS, closest.depth >= 0.0);
    return vec2u(pack2x16float(closest.motion), depth | u32(closest.edge * 255.0 + 0.5));
}

fn unpack_closest(words: vec2u) -> Closest {
    let depth = words.y & UNKNOWN_BITS;
    return Closest(unpack2x16float(words.x),
                   select(bitcast<f32>(depth >> 1u), UNKNOWN_DEPTH, depth == UNKNOWN_BITS),
                   f32(words.y & 0xffu) / 255.0);
}

fn closest_at(dilated: texture_2d<u32>, p: vec2i) -> Closest { return unpack_closest(textureLoad(dilated, p, 0).xy); }
