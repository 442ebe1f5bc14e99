// The frame in storage buffers, as arrays (h, w, channels) of float32.

@group(1) @binding(0) var<storage, read> frame_color: array<f32>;
@group(1) @binding(1) var<storage, read> frame_depth: array<f32>;
@group(1) @binding(2) var<storage, read> frame_motion: array<f32>;
@group(1) @binding(3) var<storage, read> frame_reactive: array<f32>;

fn color_at(p: vec2i) -> vec3f {
    let i = 3u * index_of(p, render_size());
    return vec3f(frame_color[i], frame_color[i + 1u], frame_color[i + 2u]);
}

fn depth_at(p: vec2i) -> f32 { return frame_depth[index_of(p, render_size())]; }

fn motion_at(p: vec2i) -> vec2f {
    let i = 2u * index_of(p, render_size());
    return vec2f(frame_motion[i], frame_motion[i + 1u]);
}

fn reactive_at(p: vec2i) -> f32 { return frame_reactive[index_of(p, render_size())]; }
