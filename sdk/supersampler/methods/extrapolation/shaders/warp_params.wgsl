// The last shaded frame, and the frame before this one, as parameters. In `params`, `previous` is the size of the motion
// that leads from that frame back to the shaded one.

struct WarpParams {
    shaded: vec2f,            // size of the shaded frame
    shaded_jitter: vec2f,
    previous_jitter: vec2f,   // of the previous frame, shaded or not
    missing: f32,             // NaN, which WGSL has no constant for
    unused: f32,
    offsets: array<vec4f, 8 * RINGS + 1>,    // x, y of the samples among which a pixel chooses: the nearest one, then rings of eight
}

@group(0) @binding(1) var<uniform> warp: WarpParams;

fn shaded_size() -> vec2i { return vec2i(warp.shaded); }
