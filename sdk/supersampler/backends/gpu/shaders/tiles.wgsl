// Tiles of a method's images. In x of `next_tiles`: the distance, in tiles, to the nearest one that is not frozen, at
// most INPUTS_REACH + 1, and HELD; in y of the first one, a count of pixels.
// import params

const DISTANCE = 7u;
const HELD = 8u;    // it was frozen in the previous frame, too

// Tiles around one that is not frozen, on which its image depends: of the network's layers, which reach 30 pixels, and
// of its inputs, which reach 34.
const NETWORK_REACH = IMAGE_REACH + 1;
const INPUTS_REACH = IMAGE_REACH + 2;

fn tiles_size() -> vec2i { return (display_size() + TILE - 1) / TILE; }

fn tile_of(p: vec2i) -> u32 { return index_of(p / TILE, tiles_size()); }

// Whether the method's own history is kept there.
fn rests(tile: vec2u) -> bool { return (tile.x & DISTANCE) > 0u; }

// Whether nothing needs to be computed for images that depend on tiles of this distance.
fn is_left_out(tile: vec2u, reach: i32) -> bool { return params.skips > 0.0 && i32(tile.x & DISTANCE) > reach; }

// Whether the memory that the step writes holds the tile already, because it is that of the step before the last.
fn is_held(tile: vec2u) -> bool { return params.skips > 1.0 && (tile.x & HELD) != 0u; }
