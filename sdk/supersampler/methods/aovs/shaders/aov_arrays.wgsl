// AOVs of the frame in a storage buffer, as an array (h, w, PARTS) of float32, one channel at a time.
// import sanitize

@group(0) @binding(1) var<storage, read> frame_aovs: array<f32>;

alias Value = f32;
const OWN = PARTS;    // values of the frame in this pass

fn aov_at(p: vec2i, part: u32) -> f32 { return frame_aovs[index_of(p, render_size()) * PARTS + part]; }
fn known(value: f32) -> f32 { return select(0.0, 1.0, is_number(value)); }
fn limited_value(value: f32) -> f32 { return limited(value); }
fn show_aov(p: vec2i, value: f32) { }
