// G-buffers of the samples and of the display pixels, in textures.
// import sanitize

@group(1) @binding(13) var frame_gbuffer_base_color: texture_2d<f32>;
@group(1) @binding(14) var frame_gbuffer_normal: texture_2d<f32>;
@group(1) @binding(15) var frame_gbuffer_display_base_color: texture_2d<f32>;
@group(1) @binding(16) var frame_gbuffer_display_normal: texture_2d<f32>;
@group(1) @binding(17) var frame_gbuffer_display_depth: texture_2d<f32>;

struct Surface {
    base_color: vec3f,   // in [0, 1]
    normal: vec3f,       // unit length; 0 at the sky
    depth: f32,          // UNKNOWN_DEPTH where invalid
}

// Values in [0, 1]; others become 0, by bit pattern.
fn fraction1(value: f32) -> f32 { return select(0.0, value, bitcast<u32>(value) <= bitcast<u32>(1.0)); }
fn fractions(v: vec3f) -> vec3f { return vec3f(fraction1(v.x), fraction1(v.y), fraction1(v.z)); }

// Values in [-1, 1]; others become 0.
fn usable_normal(v: vec3f) -> vec3f {
    let inside_unit = (bitcast<vec3u>(v) & vec3u(~SIGN)) <= vec3u(bitcast<u32>(1.0));
    return select(vec3f(0.0), v, inside_unit);
}

// The surface of a sample, without its depth.
fn sample_surface(p: vec2i) -> Surface {
    return Surface(fractions(textureLoad(frame_gbuffer_base_color, p, 0).rgb),
                   usable_normal(textureLoad(frame_gbuffer_normal, p, 0).xyz), UNKNOWN_DEPTH);
}

fn display_surface(p: vec2i) -> Surface {
    return Surface(fractions(textureLoad(frame_gbuffer_display_base_color, p, 0).rgb),
                   usable_normal(textureLoad(frame_gbuffer_display_normal, p, 0).xyz), display_depth(p));
}

fn display_depth(p: vec2i) -> f32 { return usable_depth(textureLoad(frame_gbuffer_display_depth, p, 0).x); }

// Base colour, raised to MIN_REFLECTANCE at black; 1 at the sky.
fn reflectance(surface: Surface) -> vec3f {
    if (dot(surface.normal, surface.normal) < MIN_NORMAL) { return vec3f(1.0); }
    return MIN_REFLECTANCE + (1.0 - MIN_REFLECTANCE) * surface.base_color;
}
