// Tiles of the method's images whose blocks are all frozen; its own history is kept there. Where all of the frame is
// frozen, so are the values of the whole frame. Same as `StaticBlocks.resting` and `kept_frame`.
// import at_rest
// import tiles
// import state

const SIDE = 8;                            // tiles of a workgroup in either direction
const WIDE = SIDE + 2 * INPUTS_REACH;      // with those around

@group(0) @binding(1) var block_states: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> awake: array<u32>;
@group(0) @binding(3) var<storage, read> history_state: State;
@group(0) @binding(4) var<storage, read_write> next_state: State;
@group(0) @binding(5) var<storage, read> history_tiles: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> next_tiles: array<vec2u>;

var<workgroup> awake_tiles: array<u32, WIDE * WIDE>;   // 1 where a tile is not frozen

fn is_frozen(tile: vec2i) -> bool {
    let size = display_size();
    let first = block_of(TILE * tile, size);
    let last = block_of(min(TILE * tile + TILE, size) - 1, size);
    for (var j = first.y; j <= last.y; j++) {
        for (var i = first.x; i <= last.x; i++) {
            if ((textureLoad(block_states, vec2i(i, j), 0).x & STAYS) == 0u) { return false; }
        }
    }
    return true;
}

// Distance of the nearest tile that is not frozen, in either direction.
fn distance_of(cell: vec2i) -> i32 {
    var least = INPUTS_REACH + 1;
    for (var j = -INPUTS_REACH; j <= INPUTS_REACH; j++) {
        for (var i = -INPUTS_REACH; i <= INPUTS_REACH; i++) {
            if (awake_tiles[(cell.y + j) * WIDE + cell.x + i] > 0u) { least = min(least, max(abs(i), abs(j))); }
        }
    }
    return least;
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u,
        @builtin(local_invocation_index) index: u32) {
    let origin = SIDE * vec2i(group.xy);
    for (var i = i32(index); i < WIDE * WIDE; i += SIDE * SIDE) {
        let tile = origin - INPUTS_REACH + vec2i(i % WIDE, i / WIDE);
        awake_tiles[i] = 0u;
        if (inside(tile, tiles_size()) && !is_frozen(tile)) { awake_tiles[i] = 1u; }
    }
    workgroupBarrier();
    let tile = origin + vec2i(local.xy);
    if (!inside(tile, tiles_size())) { return; }
    let here = index_of(tile, tiles_size());
    var word = u32(distance_of(vec2i(local.xy) + INPUTS_REACH));
    if (word > 0u && rests(history_tiles[here])) { word |= HELD; }
    next_tiles[here] = vec2u(word, 0u);
    if (here == 0u && awake[0] == 0u) {
        next_state.rests = select(1.0, 2.0, history_state.rests > 0.0);
        next_state.followed = history_state.followed;
        next_state.jitter = history_state.jitter;
        next_state.light = history_state.light;
    }
}
