// Tiles of the method's images whose blocks are all frozen; its own history is kept there. Where all of the frame is
// frozen, so are the values of the whole frame. Same as `StaticBlocks.resting` and `kept_frame`.
// import at_rest
// import tiles
// import state

@group(0) @binding(1) var block_states: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> awake: array<u32>;
@group(0) @binding(3) var<storage, read> history_state: State;
@group(0) @binding(4) var<storage, read_write> next_state: State;
@group(0) @binding(5) var<storage, read_write> tiles: array<vec2u>;

fn rests(tile: vec2i) -> bool {
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

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let tile = vec2i(id.xy);
    if (!inside(tile, tiles_size())) { return; }
    tiles[index_of(tile, tiles_size())] = vec2u(select(0u, 1u, rests(tile)), 0u);
    if (all(id.xy == vec2u(0u)) && awake[0] == 0u) {
        next_state.rests = 1.0;
        next_state.followed = history_state.followed;
        next_state.jitter = history_state.jitter;
        next_state.light = history_state.light;
    }
}
