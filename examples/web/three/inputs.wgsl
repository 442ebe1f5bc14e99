// What three.js' passes hold, in the units of supersampler: depth and motion, one thread a pixel.

struct Frame {
    to_previous: mat4x4f,   // clip coordinates of this frame to those of the previous one, without jitter
    size: vec2f,            // pixels
    jitter: vec2f,          // of the samples: pixel centre + jitter
    near_over_far: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var z_buffer: texture_depth_2d;
@group(0) @binding(2) var velocity: texture_2d<f32>;
@group(0) @binding(3) var depth: texture_storage_2d<r32float, write>;
@group(0) @binding(4) var motion: texture_storage_2d<rg32float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= textureDimensions(z_buffer))) { return; }
    let z = textureLoad(z_buffer, id.xy, 0);
    let is_sky = z >= 1.0;

    // three's z is 0 at the near plane and 1 at the far one; ours is near / view distance, and 0 at the sky.
    let near_over_distance = 1.0 - z * (1.0 - frame.near_over_far);
    textureStore(depth, id.xy, vec4f(select(near_over_distance, 0.0, is_sky), 0.0, 0.0, 0.0));

    // three's velocity is current minus previous, in units of half the image with y up, and 0 at the sky, which moves
    // with the camera.
    let ndc = vec2f(2.0, -2.0) * (vec2f(id.xy) + 0.5 + frame.jitter) / frame.size + vec2f(-1.0, 1.0);
    let previous = frame.to_previous * vec4f(ndc, 1.0, 1.0);
    let sky_velocity = ndc - previous.xy / previous.w;
    let moved = select(textureLoad(velocity, id.xy, 0).xy, sky_velocity, is_sky);
    textureStore(motion, id.xy, vec4f(vec2f(-0.5, 0.5) * frame.size * moved, 0.0, 0.0));
}
