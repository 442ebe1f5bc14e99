// Flags of a sample and its own motion in two words: the flags are in the lowest bits of the motion, whose
// relative error is 2^-20.

const GLARES_3X3 = 1u;
const MOVES_2X2 = 2u;
const OPENED_5X5 = 4u;
const DOUBTED_5X5 = 8u;   // or opened
const ALL_FLAGS = 15u;

fn pack_flags(found: u32, motion: vec2f) -> vec4u {
    let bits = bitcast<vec2u>(motion);
    return vec4u((bits.x & ~ALL_FLAGS) | found, bits.y, 0u, 0u);
}

fn motion_of(flags: texture_2d<u32>, sample: vec2i) -> vec2f {
    let bits = textureLoad(flags, sample, 0).xy;
    return bitcast<vec2f>(vec2u(bits.x & ~ALL_FLAGS, bits.y));
}

fn has_flag(flags: texture_2d<u32>, sample: vec2i, flag: u32) -> bool {
    return (textureLoad(flags, sample, 0).x & flag) != 0u;
}
