// Network inputs of `classifier`, sixteen bytes for each display pixel, and the differences of which the two inputs
// at half display size are means. Same as classifier_inputs.py.
// import params
// import state
// import current_frame
// import warped_history
// import unexplained_light
// import tiles
// import pixel_surface

const SIDE = 16;
const PIXELS_ACROSS = SIDE;
const PIXELS_DOWN = SIDE;
const TILE_THREADS = PIXELS_ACROSS * PIXELS_DOWN;
const WIDE = SIDE + 2;

@group(0) @binding(2) var<storage, read> next_state: State;
@group(0) @binding(3) var samples: texture_2d<f32>;
@group(0) @binding(4) var dilated: texture_2d<u32>;
@group(0) @binding(5) var history_surface: texture_2d<f32>;
@group(0) @binding(6) var history_pixels: texture_2d<u32>;
@group(0) @binding(7) var inputs: texture_storage_2d<rgba32uint, write>;
@group(0) @binding(8) var<storage, read_write> differences: array<u32>;    // of history and frame: mean, absolute
@group(0) @binding(9) var<storage, read_write> next_tiles: array<atomic<u32>>;   // see tiles.wgsl; two words a tile

var<workgroup> history_luma: array<f32, WIDE * WIDE>;
var<workgroup> apart: array<f32, SIDE * SIDE>;
var<workgroup> tile_word: u32;    // of the tile that the workgroup is in

// Square roots space dark values like bright ones; their slope is bounded.
fn root(value: f32) -> f32 { return sqrt(max(value, 1e-6)); }
fn roots(color: vec3f) -> vec3f { return sqrt(max(color, vec3f(1e-6))); }

fn own_tile() -> vec2u { return vec2u(tile_word, 0u); }

fn luma_index(p: vec2i, origin: vec2i) -> i32 {
    let q = clamped(p, display_size()) - origin + 1;
    return q.y * WIDE + q.x;
}

// Range of the luma of the warped history in 3x3 pixels.
fn history_contrast(p: vec2i, origin: vec2i) -> vec2f {
    var range = vec2f(1.0, 0.0);
    /* unroll */ for (var j = -1; j <= 1; j++) {
        /* unroll */ for (var i = -1; i <= 1; i++) {
            let luma = history_luma[luma_index(p + vec2i(i, j), origin)];
            range = vec2f(min(range.x, luma), max(range.y, luma));
        }
    }
    return range;
}

// Write the inputs of a pixel; return the difference of the luma of history and frame.
//   there, before: of the pixel in the previous frame
fn write_inputs(p: vec2i, origin: vec2i, there: Reprojection, before: WarpedHistory) -> f32 {
    let at = render_position(p);
    let now = gather_current(at);
    let seen = pixel_surface(p, origin, at, now, there, before);

    let luma_now = luminance(now.sample);
    if (luma_now > now.first.x + CONTRAST && light_rises(luma_now, before, seen.surface.visibility)) {
        if (!rests(own_tile())) { atomicAdd(&next_tiles[1], 1u); }
    }
    let frame = roots(seen.frame);
    let sample = roots(now.sample);
    let history = roots(before.color);
    let luma = luminance(sample);
    let history_luma_here = luminance(history);
    let around = history_contrast(p, origin);
    let contrast = largest(now.second - now.first * now.first);
    textureStore(inputs, p, vec4u(
        pack4x8unorm(vec4f(luminance(frame), luma, history_luma_here, largest(abs(history - sample)))),
        pack4x8unorm(vec4f(largest(abs(history - frame)), root(root(contrast)), around.y - around.x,
                           max(max(around.x - luma, luma - around.y), 0.0))),
        pack4x8unorm(vec4f(seen.further, root(largest(abs(before.detail))), now.confidence)),
        pack4x8unorm(vec4f(before.samples / (before.samples + HALF_COUNT), seen.surface.difference * 0.5 + 0.5,
                           seen.surface.visibility, seen.edge))));
    return history_luma_here - luminance(frame);
}

// Mean of the differences of 2x2 pixels and of their absolute values; an odd last row or column repeats.
fn write_difference(p: vec2i, origin: vec2i) {
    var sums = vec2f(0.0);
    /* unroll */ for (var k = 0; k < 4; k++) {
        let q = min(p + vec2i(k & 1, k >> 1), display_size() - 1) - origin;
        let difference = apart[q.y * SIDE + q.x];
        sums += 0.25 * vec2f(difference, abs(difference));
    }
    differences[index_of(p / 2, (display_size() + 1) / 2)] = pack2x16float(sums);
}

// Cells of the border around a tile, in the wide tile: its first and last row, then its columns between them.
fn border_cell(i: i32) -> vec2i {
    if (i < 2 * WIDE) { return vec2i(i % WIDE, i / WIDE * (WIDE - 1)); }
    let j = i - 2 * WIDE;
    return vec2i(j / SIDE * (WIDE - 1), j % SIDE + 1);
}

// The luma of the history around a tile; that inside of it is known of its pixels.
fn load_border(origin: vec2i, thread: i32) {
    if (thread >= 2 * WIDE + 2 * SIDE) { return; }
    let cell = border_cell(thread);
    let there = previous_position(clamped(origin - 1 + cell, display_size()));
    let color = warped_color(history_pixels, there, exposure_of(next_state));
    history_luma[cell.y * WIDE + cell.x] = luminance(roots(color));
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u,
        @builtin(local_invocation_index) index: u32) {
    let origin = SIDE * vec2i(group.xy);
    let p = origin + vec2i(local.xy);
    if (index == 0u) { tile_word = atomicLoad(&next_tiles[2u * tile_of(origin)]); }
    let tile = vec2u(workgroupUniformLoad(&tile_word), 0u);
    if (is_left_out(tile, INPUTS_REACH)) {
        if (inside(p, display_size()) && !is_held(tile)) { keep_pixel(p); }
        return;
    }
    load_samples(origin, i32(index));
    load_surfaces(origin, i32(index));
    let there = previous_position(clamped(p, display_size()));
    let before = gather_history(history_pixels, there, exposure_of(next_state));
    history_luma[(local.y + 1u) * u32(WIDE) + local.x + 1u] = luminance(roots(before.color));
    load_border(origin, i32(index));
    workgroupBarrier();
    if (inside(p, display_size())) { apart[index] = write_inputs(p, origin, there, before); }
    workgroupBarrier();
    if (inside(p, display_size()) && all((p & vec2i(1)) == vec2i(0))) { write_difference(p, origin); }
}
