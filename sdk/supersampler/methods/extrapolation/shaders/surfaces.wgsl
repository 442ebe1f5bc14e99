// Surfaces by which samples are compared, in four words each. Same as `surface_of` and `reflectance` in torch.
// import sanitize

struct Surface {
    base_color: vec3f,
    normal: vec3f,
    depth: f32,    // its logarithm, in standard deviations
}

fn all_finite(v: vec3f) -> bool { return all((bitcast<vec3u>(v) & vec3u(~SIGN)) <= vec3u(MAX_HALF_BITS)); }

// NaN, Inf and values beyond half floats become 0.
fn finite(v: vec3f) -> vec3f {
    return select(vec3f(0.0), v, (bitcast<vec3u>(v) & vec3u(~SIGN)) <= vec3u(MAX_HALF_BITS));
}

fn is_known(base_color: vec3f, normal: vec3f, depth: f32) -> bool {
    return all_finite(base_color) && all_finite(normal) && usable_depth(depth) >= 0.0;
}

//   known: whether the sample is valid; else its depth is far from all others
fn surface_of(base_color: vec3f, normal: vec3f, depth: f32, known: bool) -> Surface {
    let log_depth = log(max(usable_depth(depth), SKY_DEPTH)) / DEPTH_SIGMA;    // its differences are relative
    return Surface(
        clamp(finite(base_color), vec3f(0.0), vec3f(1.0)),
        clamp(finite(normal), vec3f(-1.0), vec3f(1.0)),
        select(INVALID_DEPTH, log_depth, known),
    );
}

fn packed(s: Surface) -> vec4u {
    let second = vec2f(s.base_color.b, s.normal.x);
    return vec4u(pack2x16float(s.base_color.rg), pack2x16float(second), pack2x16float(s.normal.yz), bitcast<u32>(s.depth));
}

fn unpacked(words: vec4u) -> Surface {
    let second = unpack2x16float(words.y);
    return Surface(
        vec3f(unpack2x16float(words.x), second.x), vec3f(second.y, unpack2x16float(words.z)), bitcast<f32>(words.w)
    );
}

// 1 at the sky.
fn reflectance(s: Surface) -> vec3f {
    return select(s.base_color + LEAST, vec3f(1.0), dot(s.normal, s.normal) < MIN_NORMAL);
}

// Squared difference of surfaces in standard deviations.
fn difference(one: Surface, other: Surface) -> f32 {
    let color = (one.base_color - other.base_color) / SURFACE_SIGMA;
    let normal = (one.normal - other.normal) / SURFACE_SIGMA;
    let depth = one.depth - other.depth;
    return dot(color, color) + dot(normal, normal) + depth * depth;
}
