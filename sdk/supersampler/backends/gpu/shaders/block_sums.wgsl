// Means over the samples of a block: output of `compare_blocks`, input of `decide_blocks`.

struct Sums {
    difference: vec4f,   // of samples and mean, RGB; part of the samples that count
    color: vec4f,        // of the samples, RGB; square of the difference
    expected: vec4f,     // of the mean, RGB; square of the colour
    marks: vec4f,        // 1 where the block restarts; 1 where it moves
}
