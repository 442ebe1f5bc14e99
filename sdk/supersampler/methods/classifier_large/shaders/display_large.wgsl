// Size of the images that the passes compute: that of the history. It takes the place of display.wgsl.
// import large

fn display_extent() -> vec2f { return vec2f(large_size()); }
