// Parameters of a step: sizes, jitter, exposure. Every pass reads them.
// import display

struct Params {
    render: vec2f,            // size of this frame
    display: vec2f,           // size of the image
    previous: vec2f,          // render size of the previous frame
    jitter: vec2f,            // of this frame, render pixels
    exposure: f32,            // given by the engine; 0: measure it
    adds_samples: f32,        // 0 for extrapolated frames, NOISY for path-traced samples
    writes_aux: f32,          // 1 where the auxiliary outputs are written
    pre_exposure: f32,        // factor that the colour contains, and the image gets
    has_reactive: f32,        // 1 where there is a reactive mask, else 0
    skips: f32,               // 1 where the method may skip frozen tiles, 2 where it may leave their memory, else 0
}

@group(0) @binding(0) var<uniform> params: Params;

fn render_size() -> vec2i { return vec2i(params.render); }
fn display_size() -> vec2i { return vec2i(display_extent()); }
fn previous_size() -> vec2i { return vec2i(params.previous); }

fn inside(p: vec2i, size: vec2i) -> bool { return all(p >= vec2i(0)) && all(p < size); }
fn clamped(p: vec2i, size: vec2i) -> vec2i { return clamp(p, vec2i(0), size - 1); }
fn index_of(p: vec2i, size: vec2i) -> u32 { return u32(p.y * size.x + p.x); }
