// Where light changed: samples are compared with the history where they were. Same as `Taau.change_of_light`.
// import params
// import samples
// import dilated
// import history_pixel
// import state
//
// Files that import this define PIXELS_ACROSS, PIXELS_DOWN and TILE_THREADS, see sample_tile.wgsl, and declare
// `samples`, `dilated`, `history_pixels`, `next_state` and `power_at`. A cell is of 2x2 samples; a pixel reads 2x2 cells.

const CHANGES_ACROSS = PIXELS_ACROSS / 2 + 2;
const CHANGES_DOWN = PIXELS_DOWN / 2 + 2;
const SUMS_ACROSS = CHANGES_ACROSS + 2;   // with one cell around
const SUMS_DOWN = CHANGES_DOWN + 2;

var<workgroup> sums: array<vec3f, SUMS_ACROSS * SUMS_DOWN>;   // of samples - history; squares, with earlier ones; number
var<workgroup> changes: array<f32, CHANGES_ACROSS * CHANGES_DOWN>;
var<private> first_cell: vec2i;                               // of `changes`

fn cells_size() -> vec2i { return (render_size() + 1) / 2; }

// Position of a display pixel in cells.
fn cell_position(p: vec2i) -> vec2f { return 0.5 * render_position(p) - 0.25; }

// Every thread calls this, with the first display pixel of its workgroup, before a barrier.
fn compare_cells(origin: vec2i, thread: i32) {
    first_cell = vec2i(floor(cell_position(origin)));
    let last = vec2i(floor(cell_position(origin + vec2i(PIXELS_ACROSS, PIXELS_DOWN) - 1))) + 2;
    for (var i = thread; i < SUMS_ACROSS * SUMS_DOWN; i += TILE_THREADS) {
        let cell = first_cell - 1 + vec2i(i % SUMS_ACROSS, i / SUMS_ACROSS);
        if (all(cell <= last)) {
            let first = 2 * clamped(cell, cells_size());
            sums[i] = compared(first) + compared(min(first + 1, render_size() - 1));
        }
    }
}

fn compared(p: vec2i) -> vec3f {
    let moved = vec2f(p) + 0.5 + params.jitter + closest_at(dilated, p).motion;
    let at = moved * display_extent() / params.render - 0.5;
    let sample = toned_sample(samples, p);
    if (sample.a == 0.0 || any(at <= vec2f(-0.5)) || any(at >= display_extent() - 0.5)) { return vec3f(0.0); }
    let nearest = clamped(vec2i(floor(at + ROUNDING)), display_size());
    let history = pixel_at(history_pixels, nearest).rgb;
    let difference = ycocg(sample.rgb).x - ycocg(tone(history * exposure_of(next_state))).x;
    let square = difference * difference + CHANGE_SPREAD * without_glare(power_at(nearest));
    return vec3f(difference, square, 1.0);
}

// Every thread calls this between barriers.
fn find_changes(thread: i32) {
    for (var i = thread; i < CHANGES_ACROSS * CHANGES_DOWN; i += TILE_THREADS) {
        let cell = clamped(first_cell + vec2i(i % CHANGES_ACROSS, i / CHANGES_ACROSS), cells_size()) - first_cell;
        let first = cell.y * SUMS_ACROSS + cell.x;
        var window = vec3f(0.0);
        /* unroll */ for (var j = 0; j < 3; j++) {
            /* unroll */ for (var k = 0; k < 3; k++) { window += sums[first + j * SUMS_ACROSS + k]; }
        }
        let mean = window.xy / max(window.z, 1.0);
        let noise = CHANGE_DEVIATION * sqrt(max(mean.y - mean.x * mean.x, 0.0)) + LEAST_CHANGE;
        let change = clamp(abs(mean.x) / noise - 1.0, 0.0, 1.0);
        changes[i] = select(0.0, change, window.z > 18.0 * MIN_WINDOW_WEIGHT);
    }
}

fn change_at(p: vec2i) -> f32 {
    let at = cell_position(p);
    let t = fract(at);
    let cell = vec2i(floor(at)) - first_cell;
    let i = cell.y * CHANGES_ACROSS + cell.x;
    return mix(mix(changes[i], changes[i + 1], t.x),
               mix(changes[i + CHANGES_ACROSS], changes[i + CHANGES_ACROSS + 1], t.x), t.y);
}
