// A level of the encoder on a tile: 1x1, depthwise 3x3, 1x1, then 2x2 maximum of what the next level takes.
// import params
// import level
//
// Files that import this define input_chunk(p, c): chunk c of the input at pixel p.

const THREADS = 128u;
const WIDE_X = TILE_X + 2;
const WIDE_Y = TILE_Y + 2;
const OUTPUTS = KEPT + POOLED;

var<workgroup> features: array<vec4u, WIDE_X * WIDE_Y * CHANNELS>;   // of the first layer, one pixel around
var<workgroup> spatial: array<vec4u, TILE_X * TILE_Y * CHANNELS>;    // of the depthwise layer

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
    /* unroll */ for (var q = 0u; q < 4u; q++) {
        var around = array<u32, 9>();
        /* unroll */ for (var k = 0u; k < 9u; k++) {
            around[k] = features[((cell.y + k / 3u) * WIDE_X + cell.x + k % 3u) * CHANNELS + chunk][q];
        }
        sums[q] = depthwise(&around, SPATIAL + 3u * (4u * chunk + q));
    }
    return bytes_of(sums, SPATIAL + 12u * CHANNELS, 4u * CHANNELS, 4u * chunk);
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

fn largest_chunk(a: vec4u, b: vec4u) -> vec4u {
    return vec4u(largest_bytes(a.x, b.x), largest_bytes(a.y, b.y), largest_bytes(a.z, b.z), largest_bytes(a.w, b.w));
}

fn pool(origin: vec2i, thread: u32) {
    let size = level_size(LEVEL + 1u);
    for (var i = thread; i < TILE_X * TILE_Y / 4u * POOLED; i += THREADS) {
        let chunk = i % max(POOLED, 1u);   // the deepest level pools nothing
        let q = i / max(POOLED, 1u);
        let cell = vec2u(q % (TILE_X / 2u), q / (TILE_X / 2u));
        let p = origin / 2 + vec2i(cell);
        let first = (2u * cell.y * TILE_X + 2u * cell.x) * POOLED + chunk;
        let upper = largest_chunk(features[first], features[first + POOLED]);
        let lower = largest_chunk(features[first + TILE_X * POOLED], features[first + (TILE_X + 1u) * POOLED]);
        if (inside(p, size)) { pooled[index_of(p, size) * POOLED + chunk] = largest_chunk(upper, lower); }
    }
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let origin = vec2i(group.xy) * vec2i(TILE_X, TILE_Y);
    if (nothing_depends_on(origin, vec2i(TILE_X, TILE_Y))) { return; }
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
