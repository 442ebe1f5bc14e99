// Size of the images that the passes compute: that of the history. It takes the place of display.wgsl.
// import large

const IMAGE_REACH = 1;    // the filter reads pixels beside it

fn display_extent() -> vec2f { return vec2f(large_size()); }
