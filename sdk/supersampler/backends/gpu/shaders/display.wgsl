// Size of the images that the passes compute: that of the display.

const IMAGE_REACH = 0;    // tiles around one that is not frozen, whose images are computed, too

fn display_extent() -> vec2f { return params.display; }
