// Output of `compare_blocks` and input of `decide_blocks`: sums and marks of each block.

struct Sums {            // means over the samples of a block
    difference: vec4f,   // of samples and mean, RGB; part of the samples that count
    color: vec4f,        // of the samples, RGB; square of the difference
    expected: vec4f,     // of the mean, RGB; square of the colour
}

// Bits of a block's marks.
const RESTARTS = 1u;
const MOVES = 2u;
const HAS_SUMS = 4u;     // else its sums are 0, and not written
