// The sampling grid, display pixel p reads (p + 0.5) / r - 0.5 - jitter, and filters.
// Same as ops/sampling.py.
// import params

fn render_position(p: vec2i) -> vec2f {
    return (vec2f(p) + 0.5) * params.render / display_extent() - 0.5 - params.jitter;
}

// The sample nearest to a position, ties upwards.
fn nearest(position: vec2f) -> vec2i { return clamped(vec2i(floor(position + 0.5)), render_size()); }

// The upper left one of the four samples around a position.
fn upper_left(position: vec2f) -> vec2i { return clamped(vec2i(floor(floor(position) + 0.5)), render_size()); }

fn gaussian(distance: vec4f, sigma: f32) -> vec4f { return exp(distance * distance * (-0.5 / (sigma * sigma))); }

fn gaussian1(distance: f32, sigma: f32) -> f32 { return exp(distance * distance * (-0.5 / (sigma * sigma))); }

fn catmull_rom(distance: vec4f) -> vec4f {
    let d = abs(distance);
    let near = (1.5 * d - 2.5) * d * d + 1.0;
    let far = ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0;
    return select(select(vec4f(0.0), far, d < vec4f(2.0)), near, d < vec4f(1.0));
}
