// Blended AOVs: PARTS values of type `Value` a pixel, of which this pass blends those from FIRST on.
// import params
// import aovs

fn value_index(part: u32, p: vec2i) -> u32 { return index_of(p, display_size()) * PARTS + FIRST + part; }
