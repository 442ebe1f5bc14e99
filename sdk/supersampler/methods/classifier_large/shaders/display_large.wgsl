// Size of the images that the passes compute: that of the history.
// import large

fn display_extent() -> vec2f { return vec2f(large_size()); }
