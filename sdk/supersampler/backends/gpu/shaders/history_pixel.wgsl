// A pixel of the history in two words: linear RGB in 14 bits each with a shared exponent of six, and its number of
// samples as a half float. Three halves would stall where this frame's weight is small: they have 11 bits.

fn pack_pixel(pixel: vec4f) -> vec2u {
    let most = max(max(pixel.r, pixel.g), pixel.b);
    let exponent = clamp(bitcast<u32>(most) >> 23u, PIXEL_EXPONENT, PIXEL_EXPONENT + 63u) - PIXEL_EXPONENT;
    let scale = bitcast<f32>((267u - PIXEL_EXPONENT - exponent) << 23u);
    let parts = min(vec3u(pixel.rgb * scale + 0.5), vec3u(16383u));
    let samples = pack2x16float(vec2f(0.0, pixel.a)) & 0xffff0000u;
    return vec2u(parts.r | (parts.g << 14u) | (exponent << 28u), parts.b | ((exponent >> 4u) << 14u) | samples);
}

fn unpack_pixel(words: vec2u) -> vec4f {
    let exponent = (words.x >> 28u) | ((words.y >> 10u) & 0x30u);
    let scale = bitcast<f32>((PIXEL_EXPONENT - 13u + exponent) << 23u);
    let parts = vec3u(words.x, words.x >> 14u, words.y) & vec3u(0x3fffu);
    return vec4f(vec3f(parts) * scale, unpack2x16float(words.y).y);
}

fn pixel_at(history: texture_2d<u32>, p: vec2i) -> vec4f { return unpack_pixel(textureLoad(history, p, 0).xy); }
