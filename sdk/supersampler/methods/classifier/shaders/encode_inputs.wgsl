// The first level of the encoder: reads the network inputs. Pixels are 2x2 display pixels.
// import encode

@group(0) @binding(4) var inputs: texture_2d<u32>;
@group(0) @binding(5) var<storage, read> half_inputs: array<vec2u>;

// Chunks 0 to 3: the display pixels; chunk 4: the inputs at half display size.
fn input_chunk(p: vec2i, chunk: u32) -> vec4u {
    let size = (display_size() + 1) / 2;
    let q = min(p, size - 1);
    if (chunk == 4u) { return vec4u(half_inputs[index_of(q, size)], 0u, 0u); }
    return textureLoad(inputs, min(2 * q + vec2i(vec2u(chunk & 1u, chunk >> 1u)), display_size() - 1), 0);
}
