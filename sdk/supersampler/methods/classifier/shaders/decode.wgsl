// The last layers of the network at a packed pixel, which is 2x2 display pixels.
// import int8
//
// HIDDEN_WORDS: of the hidden layer; PARAMETERS: blend parameters of a display pixel; DECODER, HIDDEN, BLEND: of
// weights in `network`; LOGITS: first of six bytes of the hidden layer.

const FEATURES = 2u;       // chunks of the decoder's input and output
const HIDDEN_CHUNKS = 6u;  // of the hidden layer's input: four display pixels, and FEATURES

// Bytes of all levels at a packed pixel: 16 + 8 + 4 + 4.
fn feature_chunk(p: vec2i, chunk: u32) -> vec4u {
    if (chunk == 0u) { return textureLoad(kept0, p, 0); }
    let one = textureLoad(kept1, vec2i(p.x / 2 * 2 + (p.y & 1), p.y / 2), 0);
    let two = textureLoad(kept2, p / 4 * 2 + vec2i(p.y & 1, (p.y & 3) >> 1u), 0)[p.x & 3];
    let part = 2 * (p.y & 7) + ((p.x & 7) >> 2u);
    let three = textureLoad(kept3, p / 8 * 4 + vec2i(part & 3, part >> 2u), 0)[p.x & 3];
    let pair = select(one.xy, one.zw, (p.x & 1) == 1);
    return vec4u(pair, two, three);
}

// Bytes of the hidden layer at a packed pixel. All threads read the same weights at the same time.
fn hidden_layer(p: vec2i) -> array<vec4u, 4> {
    var given = array<vec4u, HIDDEN_CHUNKS>();
    /* unroll on hardware */ for (var c = 0u; c < 4u; c++) {
        given[c] = textureLoad(inputs, min(2 * p + vec2i(vec2u(c & 1u, c >> 1u)), display_size() - 1), 0);
    }
    let features = array(feature_chunk(p, 0u), feature_chunk(p, 1u));
    /* unroll on hardware */ for (var group = 0u; group < FEATURES; group++) {
        var sums = array<vec4i, 4>();
        /* unroll on hardware */ for (var c = 0u; c < FEATURES; c++) {
            /* unroll on hardware */ for (var q = 0u; q < 4u; q++) {
                sums[q] += products16(features[c], DECODER + ((4u * group + q) * FEATURES + c) * 4u);
            }
        }
        given[4u + group] = bytes_of(sums, DECODER + 8u * FEATURES * 4u, 8u, 4u * group);
    }
    var hidden = array<vec4u, 4>();
    /* unroll on hardware */ for (var group = 0u; group < 4u; group++) {
        var sums = array<vec4i, 4>();
        /* unroll on hardware */ for (var c = 0u; c < HIDDEN_CHUNKS; c++) {
            /* unroll on hardware */ for (var q = 0u; q < 4u; q++) {
                sums[q] += products16(given[c], HIDDEN + ((4u * group + q) * HIDDEN_CHUNKS + c) * 4u);
            }
        }
        hidden[group] = bytes_of(sums, HIDDEN + 16u * HIDDEN_CHUNKS * 4u, 16u, 4u * group);
    }
    return hidden;
}

// Blend parameters of a display pixel, four by four. corner: which of the packed pixel's four.
fn blend_parameters(hidden: ptr<function, array<vec4u, 4>>, corner: u32) -> array<vec4f, QUADS> {
    var found = array<vec4f, QUADS>();
    let values = BLEND + 4u * QUADS * 16u;
    /* unroll on hardware */ for (var i = 0u; i < QUADS; i++) {
        let quad = corner * QUADS + i;
        var sums = vec4i(0);
        /* unroll on hardware */ for (var c = 0u; c < 4u; c++) {
            sums += products16((*hidden)[c], BLEND + (quad * 4u + c) * 4u);
        }
        found[i] = scaled(sums, values, 4u * QUADS, quad);
    }
    return found;
}

// Class probabilities of a packed pixel, 255 is one: twice a softmax of three. Without history, ghosting is visibility.
fn class_bytes(hidden: ptr<function, array<vec4u, 4>>, known: bool) -> vec2u {
    var likely = array<f32, 6>();
    /* unroll */ for (var i = 0u; i < 6u; i++) {
        let byte = LOGITS + i;
        let value = (*hidden)[byte / 16u][byte / 4u % 4u] >> (8u * (byte % 4u));
        likely[i] = exp(clamp((f32(value & 0xffu) - 128.0) * LOGITS_SCALE, -16.0, 16.0));
    }
    let ghosting = 255.0 / (likely[0] + likely[1] + likely[2]);
    let aliasing = 255.0 / (likely[3] + likely[4] + likely[5]);
    let first = select(vec3f(0.0, 255.0, 0.0), vec3f(likely[0], likely[1], likely[2]) * ghosting, known);
    return vec2u(
        pack4xU8(vec4u(vec4f(first, likely[3] * aliasing) + 0.5)),
        pack4xU8(vec4u(vec4f(vec2f(likely[4], likely[5]) * aliasing + 0.5, 0.0, 0.0))));
}
