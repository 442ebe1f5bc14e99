// Pack two values of [0, 1] into one float: the first as a number of steps, the second in the fraction.

const STEPS = 2047.0;

fn pack_maps(maps: vec2f) -> f32 { return floor(maps.x * STEPS + 0.5) + 0.5 * maps.y; }

fn unpack_maps(packed: f32) -> vec2f { return vec2f(floor(packed) / STEPS, 2.0 * fract(packed)); }
