// Layers of the int8 network: sums of products of bytes, and their conversion back to bytes.
// Bytes of pixels are unsigned and weights signed, so that dot4I8Packed takes the former less 128, and `offsets`
// of a layer add what this takes away.
//
// import network
//
// The buffer `network` holds for each layer, from its first vec4u on:
//   weights [outputs / 4][input words]: four outputs, a word of four bytes each; see also `depthwise`
//   scales, biases, offsets [outputs / 4]: of four outputs each

const LESS_128 = 0x80808080u;

fn products(x: u32, weights: vec4u) -> vec4i {
    return vec4i(dot4I8Packed(x, weights.x), dot4I8Packed(x, weights.y),
                 dot4I8Packed(x, weights.z), dot4I8Packed(x, weights.w));
}

// Products of sixteen bytes with the weights of four outputs.
fn products16(x: vec4u, weights: u32) -> vec4i {
    let less = x ^ vec4u(LESS_128);
    return products(less.x, network[weights]) + products(less.y, network[weights + 1u])
         + products(less.z, network[weights + 2u]) + products(less.w, network[weights + 3u]);
}

// Columns of a 4x4 matrix of bytes, whose rows are words.
fn columns(a: u32, b: u32, c: u32, d: u32) -> vec4u {
    const EVEN = 0x00ff00ffu;
    let even = vec2u((a & EVEN) | ((b & EVEN) << 8u), (c & EVEN) | ((d & EVEN) << 8u));
    let odd = vec2u(((a >> 8u) & EVEN) | (b & ~EVEN), ((c >> 8u) & EVEN) | (d & ~EVEN));
    return vec4u((even.x & 0xffffu) | (even.y << 16u), (odd.x & 0xffffu) | (odd.y << 16u),
                 (even.x >> 16u) | (even.y & 0xffff0000u), (odd.x >> 16u) | (odd.y & 0xffff0000u));
}

// A depthwise 3x3 filter of four channels, whose bytes of the nine pixels are words.
//   weights: three vec4u: of the first four pixels, of the next four, and of the last, at the place of its byte
fn depthwise(around: ptr<function, array<u32, 9>>, weights: u32) -> vec4i {
    let first = columns((*around)[0], (*around)[1], (*around)[2], (*around)[3]) ^ vec4u(LESS_128);
    let second = columns((*around)[4], (*around)[5], (*around)[6], (*around)[7]) ^ vec4u(LESS_128);
    let third = (*around)[8] ^ LESS_128;
    let a = network[weights];
    let b = network[weights + 1u];
    return vec4i(dot4I8Packed(first.x, a.x) + dot4I8Packed(second.x, b.x),
                 dot4I8Packed(first.y, a.y) + dot4I8Packed(second.y, b.y),
                 dot4I8Packed(first.z, a.z) + dot4I8Packed(second.z, b.z),
                 dot4I8Packed(first.w, a.w) + dot4I8Packed(second.w, b.w)) + products(third, network[weights + 2u]);
}

// Scale and bias four outputs.
//   values: first vec4u of the layer's scales; quads: its outputs / 4; quad: which four
fn scaled(sums: vec4i, values: u32, quads: u32, quad: u32) -> vec4f {
    let whole = sums + bitcast<vec4i>(network[values + 2u * quads + quad]);
    return vec4f(whole) * bitcast<vec4f>(network[values + quad]) + bitcast<vec4f>(network[values + quads + quad]);
}

// Sixteen outputs as bytes, from the quad `first` on.
fn bytes_of(sums: array<vec4i, 4>, values: u32, quads: u32, first: u32) -> vec4u {
    return vec4u(to_bytes(scaled(sums[0], values, quads, first)), to_bytes(scaled(sums[1], values, quads, first + 1u)),
                 to_bytes(scaled(sums[2], values, quads, first + 2u)),
                 to_bytes(scaled(sums[3], values, quads, first + 3u)));
}

fn to_bytes(values: vec4f) -> u32 { return pack4xU8(vec4u(clamp(values, vec4f(0.0), vec4f(255.0)) + 0.5)); }
