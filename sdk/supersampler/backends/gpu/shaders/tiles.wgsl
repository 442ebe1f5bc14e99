// Tiles of a method's images: in x of `tiles` 1 where one rests; in y of the first one a count of pixels.
// import params

fn tiles_size() -> vec2i { return (display_size() + TILE - 1) / TILE; }

fn tile_of(p: vec2i) -> u32 { return index_of(p / TILE, tiles_size()); }
