// The reactive mask: minimum weight of this frame. `preprocess` stores it together with the edge of a sample, which is
// in [0, 1], as a number of steps of 2.
// import params
// import sanitize

const MASK_STEPS = 4095.0;

// The mask of a sample, in [0, 1]; 0 where the sample is missing. NaN counts as 0.
fn usable_mask(given: f32, usable: f32) -> f32 { return min(sanitize1(given), 1.0) * usable; }

fn with_mask(edge: f32, mask: f32) -> f32 { return edge + 2.0 * floor(mask * MASK_STEPS + 0.5); }
fn edge_in(packed: f32) -> f32 { return packed - 2.0 * floor(0.5 * packed); }
fn mask_in(packed: f32) -> f32 { return floor(0.5 * packed) / MASK_STEPS; }
