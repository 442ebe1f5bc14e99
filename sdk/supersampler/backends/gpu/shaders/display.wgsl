// Size of the images that the passes compute: that of the display.

fn display_extent() -> vec2f { return params.display; }
