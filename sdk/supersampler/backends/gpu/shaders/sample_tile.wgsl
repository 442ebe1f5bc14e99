// The samples around the display pixels of a workgroup, toned once, in workgroup memory.
// import params
// import sampling
// import samples
//
// Files that import this define PIXELS_ACROSS and PIXELS_DOWN, the display pixels of a workgroup, and TILE_THREADS, its
// threads. A pixel reads 4x4 samples, and a sample is at least as large as a pixel.

const SAMPLES_ACROSS = PIXELS_ACROSS + 3;
const SAMPLES_DOWN = PIXELS_DOWN + 3;

var<workgroup> sample_tile: array<vec4f, SAMPLES_ACROSS * SAMPLES_DOWN>;   // toned RGB, filled; 1 where usable
var<private> tile_first: vec2i;                                            // its first sample

// Every thread calls this, with the first display pixel of its workgroup, before a barrier.
fn load_samples(origin: vec2i, thread: i32) {
    tile_first = vec2i(floor(render_position(origin))) - 1;
    for (var i = thread; i < SAMPLES_ACROSS * SAMPLES_DOWN; i += TILE_THREADS) {
        let p = clamped(tile_first + vec2i(i % SAMPLES_ACROSS, i / SAMPLES_ACROSS), render_size());
        let sample = textureLoad(samples, p, 0);
        sample_tile[i] = vec4f(tone(sample.rgb), usable_in(sample.a));
    }
}

fn tile_index(p: vec2i) -> i32 {
    let q = clamp(p - tile_first, vec2i(0), vec2i(SAMPLES_ACROSS, SAMPLES_DOWN) - 1);
    return q.y * SAMPLES_ACROSS + q.x;
}

// Toned RGB, filled where the sample is missing; 1 where it is usable.
fn tile_sample(p: vec2i) -> vec4f { return sample_tile[tile_index(p)]; }

// Toned RGB, and 1 where the sample is usable; zeros where it is not.
fn usable_tile_sample(p: vec2i) -> vec4f {
    let sample = tile_sample(p);
    return vec4f(sample.a * sample.rgb, sample.a);
}
