// The first level of the encoder: 1x1, depthwise 3x3, 1x1, then 2x2 maximum of what the next level takes. Pixels are
// 2x2 display pixels. It has most of the network's pixels, so that a thread has one, and all threads read the same
// weights at the same time; threads around a tile compute the first layer alone. It keeps one chunk of a pixel.
// import params
// import level
// import half_inputs

@group(0) @binding(4) var inputs: texture_2d<u32>;
@group(0) @binding(5) var dilated: texture_2d<u32>;
@group(0) @binding(6) var<storage, read> history_classes: array<vec2u>;
@group(0) @binding(7) var<storage, read> differences: array<u32>;

const SIDE = 16u;             // pixels of a workgroup in either direction: a tile with one pixel around
const CELLS_ACROSS = SIDE;
const CELLS = SIDE * SIDE;

var<workgroup> features: array<u32, CELLS * CHANNEL_QUADS>;   // of the first layer, then what is pooled; by quad
var<workgroup> spatial: array<u32, CELLS * CHANNEL_QUADS>;    // of the depthwise layer

// Chunks 0 to 3: the display pixels; chunk 4: the inputs at half display size.
fn given_inputs(p: vec2i) -> array<vec4u, INPUTS> {
    let size = (display_size() + 1) / 2;
    let q = min(p, size - 1);
    let last = display_size() - 1;
    let classes = warp_classes(q, size);
    return array(
        textureLoad(inputs, 2 * q, 0),
        textureLoad(inputs, min(2 * q + vec2i(1, 0), last), 0),
        textureLoad(inputs, min(2 * q + vec2i(0, 1), last), 0),
        textureLoad(inputs, min(2 * q + vec2i(1, 1), last), 0),
        vec4u(classes.x, classes.y | difference_means(q, size), 0u, 0u));
}

fn first_layer(p: vec2i, cell: u32) {
    var given = given_inputs(p);
    for (var quad = 0u; quad < CHANNEL_QUADS; quad++) {
        var sums = vec4i(0);
        /* unroll */ for (var c = 0u; c < INPUTS; c++) {
            sums += products16(given[c], FIRST + (quad * INPUTS + c) * 4u);
        }
        let values = FIRST + CHANNEL_QUADS * INPUTS * 4u;
        features[quad * CELLS + cell] = to_bytes(scaled(sums, values, CHANNEL_QUADS, quad));
    }
}

fn spatial_layer(cell: u32) {
    for (var quad = 0u; quad < CHANNEL_QUADS; quad++) {
        var around = array<u32, 9>();
        /* unroll */ for (var k = 0u; k < 9u; k++) {
            around[k] = features[quad * CELLS + cell + (k / 3u) * SIDE + k % 3u - SIDE - 1u];
        }
        let sums = depthwise(&around, SPATIAL + 3u * quad);
        spatial[quad * CELLS + cell] = to_bytes(scaled(sums, SPATIAL + 3u * CHANNEL_QUADS, CHANNEL_QUADS, quad));
    }
}

// Four outputs of the last layer.
fn last_layer(cell: u32, quad: u32) -> u32 {
    var sums = vec4i(0);
    /* unroll */ for (var c = 0u; c < CHANNELS; c++) {
        let first = 4u * c * CELLS + cell;
        let given = vec4u(spatial[first], spatial[first + CELLS], spatial[first + 2u * CELLS], spatial[first + 3u * CELLS]);
        sums += products16(given, LAST + (quad * CHANNELS + c) * 4u);
    }
    return to_bytes(scaled(sums, LAST + OUTPUT_QUADS * CHANNELS * 4u, OUTPUT_QUADS, quad));
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) cell: u32) {
    let origin = vec2i(group.xy) * (i32(SIDE) - 2);
    if (nothing_depends_on(origin, vec2i(i32(SIDE) - 2))) { return; }
    let place = vec2i(vec2u(cell % SIDE, cell / SIDE)) - 1;
    let p = origin + place;
    let exists = inside(p, level_size(LEVEL));
    if (exists) {
        first_layer(p, cell);
    } else {
        for (var quad = 0u; quad < CHANNEL_QUADS; quad++) { features[quad * CELLS + cell] = 0u; }
    }
    workgroupBarrier();
    let computes = exists && inside(place, vec2i(i32(SIDE) - 2));
    if (computes) { spatial_layer(cell); }
    workgroupBarrier();    // before others' features are replaced
    if (computes) {
        var parts = vec4u();
        for (var quad = 0u; quad < OUTPUT_QUADS; quad++) {
            let word = last_layer(cell, quad);
            if (quad < 4u) {
                parts = vec4u(parts.yzw, word);
            } else {
                features[(quad - 4u) * CELLS + cell] = word;
            }
        }
        textureStore(kept, p, parts);
    }
    workgroupBarrier();
    if (computes && all((place & vec2i(1)) == vec2i(0))) {
        for (var chunk = 0u; chunk < POOLED; chunk++) { pool(p / 2, cell, chunk); }
    }
}
