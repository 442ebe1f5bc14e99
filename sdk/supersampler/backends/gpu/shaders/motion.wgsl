// Reprojection into the previous frame and resampling of the history. Same as ops/motion.py.
// import params
// import sanitize
// import history_pixel

struct Reprojection {
    at: vec2f,        // in the previous image, display pixels
    on_screen: bool,
    motion: vec2f,    // display pixels
}

fn reproject(p: vec2i, motion: vec2f) -> Reprojection {
    let moved = motion * display_extent() / params.render;
    let at = vec2f(p) + moved;
    let edge = display_extent() - 0.5;
    let on_screen = all(at > vec2f(-0.5)) && all(at < edge);
    return Reprojection(clamp(at, vec2f(-2.0), edge + 1.5), on_screen, moved);
}

// A position in the previous image, in samples of the previous frame, which had this jitter.
fn previous_render_position(at: vec2f, jitter: vec2f) -> vec2f {
    return (at + 0.5) * params.previous / display_extent() - 0.5 - jitter;
}

// (before - depth) over the closer depth (equation 10 of the supplement of Guo et al. 2022).
fn relative_depth_change(before: f32, depth: f32) -> f32 {
    return (before - depth) / max(max(before, depth), 1e-12);
}

// Weights of the four samples of a cubic along one axis; the middle two share a bilinear read.
fn cubic_weights(t: f32, sharpness: f32) -> vec4f {
    let s = 1.0 - t;
    let before = -sharpness * t * s * s;
    let after = -sharpness * s * t * t;
    let second = (((sharpness - 2.0) * t + 3.0 - 2.0 * sharpness) * t + sharpness) * t;
    return vec4f(before, 1.0 - before - after - second, second, after);
}

struct Resampled {
    cubic: vec4f,
    linear: vec4f,
}

// Resample with a cubic from twelve reads, and bilinearly from four of them. The four corners have small
// weights; they are skipped, and the others are normalised. Positions are clamped at the border.
fn resample(history: texture_2d<u32>, at: vec2f, sharpness: f32) -> Resampled {
    let whole = floor(at);
    let t = at - whole;
    let across = cubic_weights(t.x, sharpness);
    let down = cubic_weights(t.y, sharpness);
    let mix_x = vec4f(0.0, 1.0 - t.x, t.x, 0.0);
    let mix_y = vec4f(0.0, 1.0 - t.y, t.y, 0.0);
    let first = vec2i(whole) - 1;
    var cubic = vec4f(0.0);
    var linear = vec4f(0.0);
    var total = 0.0;
    /* unroll */ for (var j = 0; j < 4; j++) {
        /* unroll */ for (var i = 0; i < 4; i++) {
            let is_corner = (i == 0 || i == 3) && (j == 0 || j == 3);
            if (!is_corner) {
                let value = pixel_at(history, clamped(first + vec2i(i, j), display_size()));
                let weight = across[i] * down[j];
                cubic += weight * value;
                total += weight;
                linear += mix_x[i] * mix_y[j] * value;
            }
        }
    }
    return Resampled(cubic / total, linear);
}

// Bilinear read of the history, clamped at the border.
fn resample_linear(history: texture_2d<u32>, at: vec2f) -> vec4f {
    let whole = floor(at);
    let t = at - whole;
    let p = vec2i(whole);
    let size = display_size();
    let upper = mix(pixel_at(history, clamped(p, size)), pixel_at(history, clamped(p + vec2i(1, 0), size)), t.x);
    let lower = mix(pixel_at(history, clamped(p + vec2i(0, 1), size)),
                    pixel_at(history, clamped(p + vec2i(1, 1), size)), t.x);
    return mix(upper, lower, t.y);
}
