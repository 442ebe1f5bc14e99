// The last layers of the network at a packed pixel, which is 2x2 display pixels.
// import int8
//
// DECODER, HIDDEN_WEIGHTS, BLEND: of weights in `network`; QUADS: of a display pixel's blend parameters; LOGITS: first of
// six bytes of the hidden layer. Files that import this define TILE_THREADS, the threads of a workgroup.

const FEATURES = 2u;         // chunks of the decoder's input and output
const HIDDEN = 4u;           // of the hidden layer
const HIDDEN_INPUTS = 6u;    // of its input: four display pixels, and FEATURES

var<workgroup> hidden: array<u32, TILE_THREADS * 4u * HIDDEN>;   // of the decoder, then of the hidden layer; by quad

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

// Write the bytes of the hidden layer at a packed pixel. All threads read the same weights at the same time.
fn hide(p: vec2i, thread: u32) {
    let last = display_size() - 1;
    let given = array(textureLoad(inputs, 2 * p, 0), textureLoad(inputs, min(2 * p + vec2i(1, 0), last), 0),
                      textureLoad(inputs, min(2 * p + vec2i(0, 1), last), 0),
                      textureLoad(inputs, min(2 * p + vec2i(1, 1), last), 0));
    let features = array(feature_chunk(p, 0u), feature_chunk(p, 1u));
    for (var quad = 0u; quad < 4u * FEATURES; quad++) {
        var sums = vec4i(0);
        /* unroll */ for (var c = 0u; c < FEATURES; c++) {
            sums += products16(features[c], DECODER + (quad * FEATURES + c) * 4u);
        }
        hidden[quad * TILE_THREADS + thread] = to_bytes(scaled(sums, DECODER + 8u * FEATURES * 4u, 8u, quad));
    }
    let decoded = array(hidden_chunk(0u, thread), hidden_chunk(1u, thread));
    for (var quad = 0u; quad < 4u * HIDDEN; quad++) {
        let weights = HIDDEN_WEIGHTS + quad * HIDDEN_INPUTS * 4u;
        var sums = products16(decoded[0], weights + 16u) + products16(decoded[1], weights + 20u);
        /* unroll */ for (var c = 0u; c < 4u; c++) { sums += products16(given[c], weights + 4u * c); }
        let values = HIDDEN_WEIGHTS + 4u * HIDDEN * HIDDEN_INPUTS * 4u;
        hidden[quad * TILE_THREADS + thread] = to_bytes(scaled(sums, values, 4u * HIDDEN, quad));
    }
}

fn hidden_chunk(chunk: u32, thread: u32) -> vec4u {
    let first = 4u * chunk * TILE_THREADS + thread;
    return vec4u(hidden[first], hidden[first + TILE_THREADS], hidden[first + 2u * TILE_THREADS], hidden[first + 3u * TILE_THREADS]);
}

// Blend parameters of a display pixel, four by four. corner: which of the packed pixel's four.
fn blend_parameters(thread: u32, corner: u32) -> array<vec4f, QUADS> {
    var sums = array<vec4i, QUADS>();
    for (var c = 0u; c < HIDDEN; c++) {
        let given = hidden_chunk(c, thread);
        /* unroll */ for (var i = 0u; i < QUADS; i++) {
            sums[i] += products16(given, BLEND + ((corner * QUADS + i) * HIDDEN + c) * 4u);
        }
    }
    var found = array<vec4f, QUADS>();
    let values = BLEND + 4u * QUADS * 16u;
    /* unroll */ for (var i = 0u; i < QUADS; i++) { found[i] = scaled(sums[i], values, 4u * QUADS, corner * QUADS + i); }
    return found;
}

// Class probabilities of a packed pixel, 255 is one: twice a softmax of three. Without history, ghosting is visibility.
fn class_bytes(thread: u32, known: bool) -> vec2u {
    var likely = array<f32, 6>();
    /* unroll */ for (var i = 0u; i < 6u; i++) {
        let byte = LOGITS + i;
        let value = hidden[byte / 4u * TILE_THREADS + thread] >> (8u * (byte % 4u));
        likely[i] = exp(clamp((f32(value & 0xffu) - 128.0) * LOGITS_SCALE, -16.0, 16.0));
    }
    let ghosting = 255.0 / (likely[0] + likely[1] + likely[2]);
    let aliasing = 255.0 / (likely[3] + likely[4] + likely[5]);
    let first = select(vec3f(0.0, 255.0, 0.0), vec3f(likely[0], likely[1], likely[2]) * ghosting, known);
    return vec2u(
        pack4xU8(vec4u(vec4f(first, likely[3] * aliasing) + 0.5)),
        pack4xU8(vec4u(vec4f(vec2f(likely[4], likely[5]) * aliasing + 0.5, 0.0, 0.0))));
}
