// The history of a pixel's own surface with its current reflectance, and what `gather` keeps of a pixel for `compose`.
// import warped_history

@group(0) @binding(20) var history_reflectance: texture_2d<u32>;   // three bytes, 255 is one

struct GuidedPixel {
    frame: vec3f,         // light of this frame times the pixel's reflectance, toned RGB
    sampled: bool,        // whether one of 3x3 samples is usable
    motion: vec2f,        // of the surface, render pixels
    reflectance: vec3f,
    visibility: f32,
}

fn pack_guided(pixel: GuidedPixel) -> vec4u {
    return vec4u(pack2x16unorm(pixel.frame.rg), pack2x16unorm(vec2f(pixel.frame.b, select(0.0, 1.0, pixel.sampled))),
                 pack2x16float(pixel.motion), pack4x8unorm(vec4f(pixel.reflectance, pixel.visibility)));
}

fn unpack_guided(words: vec4u) -> GuidedPixel {
    let blue = unpack2x16unorm(words.y);
    let bytes = unpack4x8unorm(words.w);
    return GuidedPixel(vec3f(unpack2x16unorm(words.x), blue.x), blue.y > 0.0, unpack2x16float(words.z), bytes.rgb, bytes.a);
}

fn reflectance_at(p: vec2i) -> vec3f {
    return unpack4x8unorm(textureLoad(history_reflectance, clamped(p, display_size()), 0).x).rgb;
}

// Colour of the history where the surface was, relit, toned.
fn relit_history(there: Reprojection, reflectance: vec3f) -> vec3f {
    if (!there.on_screen) { return vec3f(0.0); }
    let p = vec2i(floor(there.at));
    let t = fract(there.at);
    let before = mix(mix(reflectance_at(p), reflectance_at(p + vec2i(1, 0)), t.x),
                     mix(reflectance_at(p + vec2i(0, 1)), reflectance_at(p + vec2i(1, 1)), t.x), t.y);
    let light = sanitize(resample_linear(history_pixels, there.at).rgb);
    return toned_history(light * reflectance / max(before, vec3f(0.5 * MIN_REFLECTANCE)), exposure_of(next_state));
}
