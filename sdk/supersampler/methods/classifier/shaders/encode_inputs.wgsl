// The first level of the encoder: reads the network inputs. Pixels are 2x2 display pixels.
// import encode
// import half_inputs

@group(0) @binding(4) var inputs: texture_2d<u32>;
@group(0) @binding(5) var dilated: texture_2d<f32>;
@group(0) @binding(6) var<storage, read> history_classes: array<vec2u>;
@group(0) @binding(7) var<storage, read> differences: array<u32>;

// Chunks 0 to 3: the display pixels; chunk 4: the inputs at half display size.
fn input_chunk(p: vec2i, chunk: u32) -> vec4u {
    let size = (display_size() + 1) / 2;
    let q = min(p, size - 1);
    if (chunk == 4u) {
        let classes = warp_classes(q, size);
        return vec4u(classes.x, classes.y | difference_means(q, size), 0u, 0u);
    }
    return textureLoad(inputs, min(2 * q + vec2i(vec2u(chunk & 1u, chunk >> 1u)), display_size() - 1), 0);
}
