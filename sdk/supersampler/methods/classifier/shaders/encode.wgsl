// A level of the encoder on a tile: 1x1, depthwise 3x3, 1x1, then 2x2 maximum of what the next level takes. A thread
// computes four channels of a pixel at a time; its neighbours compute the same channels, and so read the same weights.
// import params
// import level
//
// Files that import this define input_chunk(p, c): chunk c of the input at pixel p.

const THREADS = 128u;
const CELLS_ACROSS = TILE_X;
const CELLS = TILE_X * TILE_Y;
const WIDE_X = TILE_X + 2;              // a tile with one pixel around
const WIDE_CELLS = WIDE_X * (TILE_Y + 2);

var<workgroup> features: array<u32, WIDE_CELLS * CHANNEL_QUADS>;   // of the first layer, then what is pooled; by quad
var<workgroup> spatial: array<u32, CELLS * CHANNEL_QUADS>;         // of the depthwise layer

fn first_layer(p: vec2i, quad: u32) -> u32 {
    var sums = vec4i(0);
    for (var c = 0u; c < INPUTS; c++) { sums += products16(input_chunk(p, c), FIRST + (quad * INPUTS + c) * 4u); }
    return to_bytes(scaled(sums, FIRST + CHANNEL_QUADS * INPUTS * 4u, CHANNEL_QUADS, quad));
}

//   cell: of the upper left of the nine pixels
fn spatial_layer(cell: u32, quad: u32) -> u32 {
    var around = array<u32, 9>();
    /* unroll */ for (var k = 0u; k < 9u; k++) {
        around[k] = features[quad * WIDE_CELLS + cell + k / 3u * WIDE_X + k % 3u];
    }
    let sums = depthwise(&around, SPATIAL + 3u * quad);
    return to_bytes(scaled(sums, SPATIAL + 3u * CHANNEL_QUADS, CHANNEL_QUADS, quad));
}

fn last_layer(cell: u32, quad: u32) -> u32 {
    var sums = vec4i(0);
    for (var c = 0u; c < CHANNELS; c++) {
        let first = 4u * c * CELLS + cell;
        let given = vec4u(spatial[first], spatial[first + CELLS], spatial[first + 2u * CELLS], spatial[first + 3u * CELLS]);
        sums += products16(given, LAST + (quad * CHANNELS + c) * 4u);
    }
    return to_bytes(scaled(sums, LAST + OUTPUT_QUADS * CHANNELS * 4u, OUTPUT_QUADS, quad));
}

// Store a chunk of what the level keeps, and leave one of what it pools in `features`.
fn store_chunk(p: vec2i, cell: u32, chunk: u32) {
    var words = vec4u();
    for (var q = 0u; q < 4u; q++) {
        let word = last_layer(cell, 4u * chunk + q);
        if (chunk >= KEPT) { features[(4u * (chunk - KEPT) + q) * CELLS + cell] = word; }
        words = vec4u(words.yzw, word);
    }
    if (chunk < KEPT && inside(p, level_size(LEVEL))) {
        let part = vec2i(vec2u(chunk % KEPT_ACROSS, chunk / KEPT_ACROSS));
        textureStore(kept, p * vec2i(KEPT_ACROSS, KEPT / KEPT_ACROSS) + part, words);
    }
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let origin = vec2i(group.xy) * vec2i(TILE_X, TILE_Y);
    if (nothing_depends_on(origin, vec2i(TILE_X, TILE_Y))) { return; }
    for (var i = thread; i < WIDE_CELLS * CHANNEL_QUADS; i += THREADS) {
        let cell = i % WIDE_CELLS;
        let p = origin - 1 + vec2i(vec2u(cell % WIDE_X, cell / WIDE_X));
        var word = 0u;
        if (inside(p, level_size(LEVEL))) { word = first_layer(p, i / WIDE_CELLS); }
        features[i] = word;
    }
    workgroupBarrier();
    for (var i = thread; i < CELLS * CHANNEL_QUADS; i += THREADS) {
        let cell = i % CELLS;
        spatial[i] = spatial_layer(cell / TILE_X * WIDE_X + cell % TILE_X, i / CELLS);
    }
    workgroupBarrier();
    for (var i = thread; i < CELLS * (KEPT + POOLED); i += THREADS) {
        let cell = i % CELLS;
        store_chunk(origin + vec2i(vec2u(cell % TILE_X, cell / TILE_X)), cell, i / CELLS);
    }
    workgroupBarrier();
    for (var i = thread; i < CELLS / 4u * POOLED; i += THREADS) {
        let place = vec2u(i % (CELLS / 4u) % (TILE_X / 2u), i % (CELLS / 4u) / (TILE_X / 2u));
        pool(origin / 2 + vec2i(place), 2u * place.y * TILE_X + 2u * place.x, i / (CELLS / 4u));
    }
}
