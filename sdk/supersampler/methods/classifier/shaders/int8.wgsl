// Layers of the int8 network: sums of products of bytes, and their conversion back to bytes.
// Bytes of pixels are unsigned and weights signed, so that dot4I8Packed takes the former less 128, and `offsets`
// of a layer add what this takes away.
//
// import network
//
// The buffer `network` holds for each layer, from its first vec4u on:
//   weights [outputs / 4][input words]: four outputs, a word of four bytes each
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
