// The frame in textures of the caller.

@group(1) @binding(0) var frame_color: texture_2d<f32>;
@group(1) @binding(1) var frame_depth: texture_2d<f32>;
@group(1) @binding(2) var frame_motion: texture_2d<f32>;
@group(1) @binding(3) var frame_reactive: texture_2d<f32>;

fn color_at(p: vec2i) -> vec3f { return textureLoad(frame_color, p, 0).rgb; }
fn depth_at(p: vec2i) -> f32 { return textureLoad(frame_depth, p, 0).x; }
fn motion_at(p: vec2i) -> vec2f { return textureLoad(frame_motion, p, 0).xy; }
fn reactive_at(p: vec2i) -> f32 { return textureLoad(frame_reactive, p, 0).x; }
