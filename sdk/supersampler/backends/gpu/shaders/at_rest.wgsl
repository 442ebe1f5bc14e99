// Static blocks: their sizes and flags, shared by the passes. Same as ops/at_rest.py.
// import params
//
// Images have the size of the display here, even if a method's own are larger. Constants are those of methods/at_rest.py.

// Flags of a block, in x of `block_states`; y is the part of the mean in its image.
const KEEPS = 1u;       // the mean is kept: it has samples, and nothing moves
const ADDS = 2u;        // this frame's samples are added to it
const HOLDS = 4u;       // there is a mean after this frame; without it nothing is read or written
const STAYS = 8u;       // the image is frozen and stays so
const FREEZES = 16u;    // it is frozen from this frame on
const COMPLETE = 32u;   // the mean has the samples of a whole period
const FREE = 64u;       // nothing moves, and nothing is frozen

fn image_size() -> vec2i { return vec2i(params.display); }

fn blocks_size() -> vec2i { return (render_size() + BLOCK - 1) / BLOCK; }

// The block of a pixel of an image of a size.
fn block_of(p: vec2i, size: vec2i) -> vec2i {
    return min((2 * p + 1) * render_size() / (2 * BLOCK * size), blocks_size() - 1);
}

// The pixel nearest to the centre of a sample.
fn pixel_of(sample: vec2i) -> vec2i {
    return min((2 * sample + 1) * image_size() / (2 * render_size()), image_size() - 1);
}

// Whether blocks and phases of the history have this frame's sizes; if not, they do not count.
fn has_blocks() -> bool { return all(params.previous == params.render); }

fn is_sampled() -> bool { return params.adds_samples >= 1.0; }
fn is_noisy() -> bool { return params.adds_samples >= NOISY; }

fn phase_count() -> i32 {
    let pixels = image_size().x * image_size().y;
    return PHASES_PER_SAMPLE * pixels / (render_size().x * render_size().y) + SPARE_PHASES;
}

fn signature_index(slot: u32, block: vec2i) -> u32 {
    let size = blocks_size();
    return slot * u32(size.x * size.y) + index_of(block, size);
}
