// A level of the encoder: its outputs, and its size. Chunks are sixteen bytes, the channels of a pixel side by side;
// quads are four.
// import params
// import int8
// import tiles
//
// Constants of a level: LEVEL; TILE_X, TILE_Y; INPUTS, CHANNELS, KEPT, POOLED: chunks of the input, of the channels
// between the layers, and of the two outputs; CHANNEL_QUADS, OUTPUT_QUADS: quads of channels and outputs; KEPT_ACROSS:
// texels of a pixel in a row of `kept`; FIRST, SPATIAL, LAST: of weights in `network`.
//
// Files that import this define CELLS, CELLS_ACROSS: pixels of a workgroup's tile, and in a row of it; and `features`, words of
// these cells by quad.

@group(0) @binding(2) var kept: texture_storage_2d<rgba32uint, write>;
@group(0) @binding(3) var<storage, read_write> pooled: array<vec4u>;
@group(0) @binding(8) var<storage, read> next_tiles: array<vec2u>;

// Size of a level: the deepest one has 1/8 of the first, which repeats its last row and column.
fn level_size(level: u32) -> vec2i { return (((display_size() + 1) / 2 + 7) / 8 * 8) >> vec2u(level); }

fn largest_bytes(a: u32, b: u32) -> u32 { return pack4xU8(max(unpack4xU8(a), unpack4xU8(b))); }

// Pool a chunk of 2x2 pixels, whose bytes are in `features`.
//   p: pixel of the next level; cell: of the upper left pixel
fn pool(p: vec2i, cell: u32, chunk: u32) {
    var words = vec4u();
    for (var q = 0u; q < 4u; q++) {
        let first = (4u * chunk + q) * CELLS + cell;
        let upper = largest_bytes(features[first], features[first + 1u]);
        let lower = largest_bytes(features[first + CELLS_ACROSS], features[first + CELLS_ACROSS + 1u]);
        words = vec4u(words.yzw, largest_bytes(upper, lower));
    }
    let size = level_size(LEVEL + 1u);
    if (inside(p, size)) { pooled[index_of(p, size) * POOLED + chunk] = words; }
}

// Whether no image is computed that depends on these pixels of the level.
fn nothing_depends_on(origin: vec2i, extent: vec2i) -> bool {
    const PIXELS = 2 << LEVEL;    // of the display, along an axis
    let size = tiles_size();
    let first = clamped(PIXELS * origin / TILE, size);
    let last = clamped((PIXELS * (origin + extent) - 1) / TILE, size);
    for (var j = first.y; j <= last.y; j++) {
        for (var i = first.x; i <= last.x; i++) {
            if (!is_left_out(next_tiles[index_of(vec2i(i, j), size)], NETWORK_REACH)) { return false; }
        }
    }
    return true;
}
