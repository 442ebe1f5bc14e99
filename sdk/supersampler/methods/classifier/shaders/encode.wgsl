// One level of the encoder on a tile: 1x1, depthwise 3x3, 1x1, then 2x2 maximum of what the next level takes.
// Chunks are sixteen bytes, the channels of a pixel side by side.
// import params
// import int8
// import state
//
// Files that import this define input_chunk(p, c): chunk c of the input at pixel p.
// Constants of a level: LEVEL; TILE_X, TILE_Y; INPUTS, CHANNELS, KEPT, POOLED: chunks of the input, of the
// channels between the layers, and of the two outputs; KEPT_ACROSS: texels of a pixel in a row of `kept`;
// FIRST, SPATIAL, LAST: of weights in `network`.

@group(0) @binding(2) var kept: texture_storage_2d<rgba32uint, write>;
@group(0) @binding(3) var<storage, read_write> pooled: array<vec4u>;
@group(0) @binding(8) var<storage, read> next_state: State;

const THREADS = 128u;
const WIDE_X = TILE_X + 2;
const WIDE_Y = TILE_Y + 2;
const OUTPUTS = KEPT + POOLED;

var<workgroup> features: array<vec4u, WIDE_X * WIDE_Y * CHANNELS>;   // of the first layer, one pixel around
var<workgroup> spatial: array<vec4u, TILE_X * TILE_Y * CHANNELS>;    // of the depthwise layer

// Size of a level: the deepest one has 1/8 of the first, which repeats its last row and column.
fn level_size(level: u32) -> vec2i { return (((display_size() + 1) / 2 + 7) / 8 * 8) >> vec2u(level); }

fn first_layer(p: vec2i, chunk: u32) -> vec4u {
    var sums = array<vec4i, 4>();
    for (var c = 0u; c < INPUTS; c++) {
        let x = input_chunk(p, c);
        /* unroll */ for (var q = 0u; q < 4u; q++) {
            sums[q] += products16(x, FIRST + ((4u * chunk + q) * INPUTS + c) * 4u);
        }
    }
    let values = FIRST + 4u * CHANNELS * INPUTS * 4u;
    return bytes_of(sums, values, 4u * CHANNELS, 4u * chunk);
}

fn spatial_layer(cell: vec2u, chunk: u32) -> vec4u {
    var sums = array<vec4i, 4>();
    /* unroll */ for (var k = 0u; k < 9u; k++) {
        let weights = network[SPATIAL + k * CHANNELS + chunk];
        let x = features[((cell.y + k / 3u) * WIDE_X + cell.x + k % 3u) * CHANNELS + chunk];
        /* unroll */ for (var q = 0u; q < 4u; q++) { sums[q] += vec4i(unpack4xU8(x[q])) * unpack4xI8(weights[q]); }
    }
    return bytes_of(sums, SPATIAL + 9u * CHANNELS, 4u * CHANNELS, 4u * chunk);
}

fn last_layer(cell: u32, chunk: u32) -> vec4u {
    var sums = array<vec4i, 4>();
    for (var c = 0u; c < CHANNELS; c++) {
        let x = spatial[cell * CHANNELS + c];
        /* unroll */ for (var q = 0u; q < 4u; q++) {
            sums[q] += products16(x, LAST + ((4u * chunk + q) * CHANNELS + c) * 4u);
        }
    }
    let values = LAST + 4u * OUTPUTS * CHANNELS * 4u;
    return bytes_of(sums, values, 4u * OUTPUTS, 4u * chunk);
}

fn largest_bytes(a: vec4u, b: vec4u) -> vec4u {
    return vec4u(pack4xU8(max(unpack4xU8(a.x), unpack4xU8(b.x))), pack4xU8(max(unpack4xU8(a.y), unpack4xU8(b.y))),
                 pack4xU8(max(unpack4xU8(a.z), unpack4xU8(b.z))), pack4xU8(max(unpack4xU8(a.w), unpack4xU8(b.w))));
}

fn pool(origin: vec2i, thread: u32) {
    let size = level_size(LEVEL + 1u);
    for (var i = thread; i < TILE_X * TILE_Y / 4u * POOLED; i += THREADS) {
        let chunk = i % max(POOLED, 1u);   // the deepest level pools nothing
        let q = i / max(POOLED, 1u);
        let cell = vec2u(q % (TILE_X / 2u), q / (TILE_X / 2u));
        let p = origin / 2 + vec2i(cell);
        let first = (2u * cell.y * TILE_X + 2u * cell.x) * POOLED + chunk;
        let upper = largest_bytes(features[first], features[first + POOLED]);
        let lower = largest_bytes(features[first + TILE_X * POOLED], features[first + (TILE_X + 1u) * POOLED]);
        if (inside(p, size)) { pooled[index_of(p, size) * POOLED + chunk] = largest_bytes(upper, lower); }
    }
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    if (next_state.rests * params.skips > 0.0) { return; }   // nothing is read of it
    let origin = vec2i(group.xy) * vec2i(TILE_X, TILE_Y);
    let size = level_size(LEVEL);
    for (var i = thread; i < WIDE_X * WIDE_Y * CHANNELS; i += THREADS) {
        let cell = i % (WIDE_X * WIDE_Y);   // threads of a subgroup have one chunk, and so the same weights
        let chunk = i / (WIDE_X * WIDE_Y);
        let p = origin - 1 + vec2i(vec2u(cell % WIDE_X, cell / WIDE_X));
        var bytes = vec4u();
        if (inside(p, size)) { bytes = first_layer(p, chunk); }
        features[cell * CHANNELS + chunk] = bytes;
    }
    workgroupBarrier();
    for (var i = thread; i < TILE_X * TILE_Y * CHANNELS; i += THREADS) {
        let cell = i % (TILE_X * TILE_Y);
        let chunk = i / (TILE_X * TILE_Y);
        spatial[cell * CHANNELS + chunk] = spatial_layer(vec2u(cell % TILE_X, cell / TILE_X), chunk);
    }
    workgroupBarrier();
    for (var i = thread; i < TILE_X * TILE_Y * OUTPUTS; i += THREADS) {
        let cell = i % (TILE_X * TILE_Y);
        let chunk = i / (TILE_X * TILE_Y);
        let bytes = last_layer(cell, chunk);
        let p = origin + vec2i(vec2u(cell % TILE_X, cell / TILE_X));
        if (chunk >= KEPT) {
            features[cell * POOLED + chunk - KEPT] = bytes;
        } else if (inside(p, size)) {
            let part = vec2i(vec2u(chunk % KEPT_ACROSS, chunk / KEPT_ACROSS));
            textureStore(kept, p * vec2i(KEPT_ACROSS, KEPT / KEPT_ACROSS) + part, bytes);
        }
    }
    workgroupBarrier();
    pool(origin, thread);
}
