// Invalid values, by bit pattern: WGSL lets an implementation assume that NaN and Inf do not occur,
// so that comparisons of floats may not find them. Patterns of positive floats have the order of the floats.
// import params

const SIGN = 0x80000000u;
const INFINITY_BITS = 0x7f800000u;

// Whether no channel is NaN.
fn all_valid(color: vec3f) -> bool {
    return all((bitcast<vec3u>(color) & vec3u(~SIGN)) <= vec3u(INFINITY_BITS));
}

fn is_number(value: f32) -> bool { return (bitcast<u32>(value) & ~SIGN) <= INFINITY_BITS; }

// Clamp to [-65504, 65504], infinity included.
fn limited(value: f32) -> f32 {
    let bits = bitcast<u32>(value);
    return select(value, bitcast<f32>((bits & SIGN) | MAX_HALF_BITS), (bits & ~SIGN) > MAX_HALF_BITS);
}

// Clamp to [0, 65504], infinity included; NaN becomes 0.
fn sanitize(color: vec3f) -> vec3f { return vec3f(sanitize1(color.r), sanitize1(color.g), sanitize1(color.b)); }

// Sanitized colour of a frame, without pre-exposure.
fn scene_color(given: vec3f) -> vec3f { return sanitize(given / params.pre_exposure); }

fn sanitize1(value: f32) -> f32 {
    let bits = bitcast<u32>(value);   // negative values have the largest patterns
    return select(select(value, MAX_HALF, bits > MAX_HALF_BITS), 0.0, bits > INFINITY_BITS);
}

// NaN and Inf become zero motion.
fn usable_motion(motion: vec2f) -> vec2f {
    let known = (bitcast<vec2u>(motion) & vec2u(~SIGN)) <= vec2u(FINITE_MOTION_BITS);
    return select(vec2f(0.0), clamp(motion, vec2f(-MAX_MOTION), vec2f(MAX_MOTION)), known);
}

// NaN, Inf and negative depth become UNKNOWN_DEPTH.
fn usable_depth(depth: f32) -> f32 {
    let bits = bitcast<u32>(depth);
    return select(UNKNOWN_DEPTH, depth, bits <= MAX_DEPTH_BITS || bits == SIGN);
}

// The last operation on every image: [0, 65504], and black where it is almost black or not a number.
fn bounded(color: vec3f) -> vec3f { return vec3f(bounded1(color.r), bounded1(color.g), bounded1(color.b)); }

fn bounded1(value: f32) -> f32 {
    let bits = bitcast<u32>(value);   // negative values have the largest patterns
    if (bits > INFINITY_BITS || bits < DARKNESS_BITS) { return 0.0; }
    return select(value, MAX_HALF, bits > MAX_HALF_BITS);
}
