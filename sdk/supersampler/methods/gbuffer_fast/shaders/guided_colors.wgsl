// Colours of this frame and of its surface's history at a display pixel, from G-buffers. It replaces
// frame_colors.wgsl.
// import current_frame
// import relit
// import frame

@group(0) @binding(21) var guided: texture_2d<u32>;   // see relit.wgsl

const COLORS_ACROSS = PIXELS_ACROSS + 2;
const COLORS_DOWN = PIXELS_DOWN + 2;

var<workgroup> color_tile: array<vec2u, COLORS_ACROSS * COLORS_DOWN>;   // the first two words, one pixel around

fn load_colors(origin: vec2i, thread: i32) {
    for (var i = thread; i < COLORS_ACROSS * COLORS_DOWN; i += TILE_THREADS) {
        let p = clamped(origin - 1 + vec2i(i % COLORS_ACROSS, i / COLORS_ACROSS), display_size());
        color_tile[i] = textureLoad(guided, p, 0).xy;
    }
}

fn guided_at(p: vec2i) -> GuidedPixel { return unpack_guided(textureLoad(guided, p, 0)); }

fn frame_at(p: vec2i, now: CurrentFrame) -> vec3f { return guided_at(p).frame; }

fn visibility_at(p: vec2i, at: vec2f, there: Reprojection) -> f32 { return guided_at(p).visibility; }

// Colour of the history by the surface's motion, relit, toned.
fn own_history(p: vec2i) -> vec3f {
    let pixel = guided_at(p);
    return relit_history(reproject(p, pixel.motion), pixel.reflectance);
}

// The 3x3 pixels around under a learned kernel: sum of weighted colours and of weights.
fn filter_frame(p: vec2i, at: vec2f, blend: ptr<function, array<vec4f, QUADS>>) -> Sum {
    let initial = array<f32, 3>(NEIGHBOUR_CENTER, NEIGHBOUR_SIDE, NEIGHBOUR_CORNER);
    let first = p % vec2i(PIXELS_ACROSS, PIXELS_DOWN);
    var sum = Sum(vec3f(0.0), 0.0);
    /* unroll */ for (var k = 0; k < 9; k++) {
        let words = color_tile[(first.y + k / 3) * COLORS_ACROSS + first.x + k % 3];
        let color = vec3f(unpack2x16unorm(words.x), unpack2x16unorm(words.y).x);
        let weight = initial[abs(k % 3 - 1) + abs(k / 3 - 1)];
        sum = add(sum, weight * exp(parameter(blend, KERNEL_AT + u32(k))), color);
    }
    return sum;
}

// Whether one of the 3x3 samples around is usable.
fn is_sampled_at(p: vec2i, filtered: Sum) -> bool { return guided_at(p).sampled; }

// The guided colour has the edges of the G-buffers.
fn frame_alone(color: vec3f, at: vec2f) -> vec3f { return color; }
