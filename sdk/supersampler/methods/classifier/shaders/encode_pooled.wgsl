// A deeper level of the encoder: reads what the level above has pooled.
// import encode

@group(0) @binding(4) var<storage, read> pooled_above: array<vec4u>;

fn input_chunk(p: vec2i, chunk: u32) -> vec4u {
    return pooled_above[index_of(p, level_size(LEVEL)) * INPUTS + chunk];
}
