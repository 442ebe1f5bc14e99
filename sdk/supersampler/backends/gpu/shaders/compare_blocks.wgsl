// Compare blocks of 4x4 samples with their signatures of this phase, and samples with the mean. Four threads for
// each block, one for each row of it. Same as `signatures_of`, `differing` and `residuals_of`.
// import at_rest
// import block_sums
// import state
// import sanitize
// import frame

const ROWS = 4;          // of a block
const SIDE = 4;          // blocks of a workgroup in either direction
const AROUND = LARGE_WINDOW - SIDE;   // blocks beside a workgroup that are decided by its comparison with the mean
const WIDE = SIDE + 2 * AROUND;
const SHARE = 1.0 / f32(BLOCK * BLOCK);

@group(0) @binding(1) var<storage, read> next_state: State;
@group(0) @binding(2) var history_mean: texture_2d<f32>;   // of static blocks
@group(0) @binding(3) var history_blocks: texture_2d<f32>;
@group(0) @binding(4) var<storage, read> history_signatures: array<vec4f>;      // of 2 phases
@group(0) @binding(5) var<storage, read_write> next_signatures: array<vec4f>;   // of 2 phases
@group(0) @binding(6) var<storage, read_write> block_sums: array<Sums>;   // of static blocks
@group(0) @binding(7) var<storage, read_write> block_marks: array<u32>;

struct Row {
    parts: array<vec4f, 4>,   // signature; Sums
}

var<workgroup> rows: array<Row, SIDE * SIDE * ROWS>;
var<workgroup> awake_near: atomic<u32>;   // 1 where one of these was not frozen
var<workgroup> moving: array<u32, SIDE * SIDE * ROWS>;

fn sample_of(block: vec2i, column: i32, row: i32) -> vec2i {
    return clamped(BLOCK * block + vec2i(column, row), render_size());   // at edges they repeat
}

fn moves(block: vec2i, row: i32) -> bool {
    var square = 0.0;
    var mask = 0.0;
    for (var i = 0; i < BLOCK; i++) {
        let p = sample_of(block, i, row);
        let motion = usable_motion(motion_at(p));
        square = max(square, dot(motion, motion));
        if (params.has_reactive > 0.0) { mask = max(mask, sanitize1(reactive_at(p))); }
    }
    return square > MAX_STATIC_MOTION * MAX_STATIC_MOTION || mask > 0.0;
}

// The mean of a pixel, and 1 where it has enough samples. Where a block has no mean, the texture is not up to date.
fn known_mean(p: vec2i) -> vec4f {
    if (textureLoad(history_blocks, block_of(p, image_size()), 0).x == 0.0) { return vec4f(0.0); }
    let mean = textureLoad(history_mean, p, 0);
    return vec4f(mean.rgb, select(0.0, 1.0, mean.a >= LEAST_WEIGHT));
}

// The mean where a sample is, bilinearly, and how much of it is known.
fn mean_at(sample: vec2i) -> vec4f {
    let at = (vec2f(sample) + 0.5 + params.jitter) * params.display / params.render - 0.5;
    let whole = floor(at);
    let t = at - whole;
    let first = clamped(vec2i(whole), image_size());
    let last = clamped(vec2i(whole) + 1, image_size());
    let upper = mix(known_mean(first), known_mean(vec2i(last.x, first.y)), t.x);
    let lower = mix(known_mean(vec2i(first.x, last.y)), known_mean(last), t.x);
    return mix(upper, lower, t.y);
}

fn order_of(i: i32) -> f32 { return 2.0 * f32(ORDER_FACTOR * i * i * i % ORDER_PRIME) / f32(ORDER_PRIME - 1) - 1.0; }

fn sums_of(block: vec2i, row: i32, has_mean: bool) -> Row {
    var found = Row();
    for (var i = 0; i < BLOCK; i++) {
        let p = sample_of(block, i, row);
        let given = color_at(p);
        if (!all_valid(given)) { continue; }
        let color = scene_color(given);
        let roots = sqrt(sqrt(color));
        let place = row * BLOCK + i;
        let order = vec3f(order_of(place), order_of(place + BLOCK * BLOCK), order_of(place + 2 * BLOCK * BLOCK));
        found.parts[0] += SHARE * vec4f(roots, dot(roots, order));
        if (!has_mean) { continue; }
        let mean = mean_at(p);
        if (mean.a <= FULL_WEIGHT) { continue; }
        let difference = color - mean.rgb;
        found.parts[1] += SHARE * vec4f(difference, 1.0);
        found.parts[2] += SHARE * vec4f(color, dot(difference, difference));
        found.parts[3] += SHARE * vec4f(mean.rgb, dot(color, color));
    }
    return found;
}

fn differs(signature: vec4f, reference: vec4f) -> bool {
    let most = max(signature.rgb, reference.rgb);
    let level = max(max(max(most.r, most.g), most.b), sqrt(sqrt(DARK / exposure_of(next_state))));
    let apart = abs(signature - reference);
    return max(max(apart.x, apart.y), max(apart.z, apart.w)) > TOLERANCE * level;
}

fn was_frozen(block: vec2i) -> bool { return has_blocks() && textureLoad(history_blocks, block, 0).x < 0.0; }

@compute @workgroup_size(SIDE * SIDE * ROWS)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) index: u32) {
    let thread = i32(index);
    let cell = thread / ROWS;
    let row = thread % ROWS;
    let block = SIDE * vec2i(group.xy) + vec2i(cell % SIDE, cell / SIDE);
    let exists = inside(block, blocks_size());
    var before = 0.0;
    if (exists && has_blocks()) { before = textureLoad(history_blocks, block, 0).x; }
    moving[thread] = 0u;
    if (exists && moves(block, row)) { moving[thread] = 1u; }
    if (thread == 0) { atomicStore(&awake_near, 0u); }
    workgroupBarrier();
    for (var i = thread; i < WIDE * WIDE; i += SIDE * SIDE * ROWS) {
        let near = SIDE * vec2i(group.xy) - AROUND + vec2i(i % WIDE, i / WIDE);
        if (inside(near, blocks_size()) && !was_frozen(near)) { atomicStore(&awake_near, 1u); }
    }
    workgroupBarrier();
    let has_mean = before != 0.0 && (is_noisy() || atomicLoad(&awake_near) > 0u);
    let first = cell * ROWS;
    let is_moving = moving[first] + moving[first + 1] + moving[first + 2] + moving[first + 3] > 0u;
    if (exists && (before != 0.0 || !is_moving)) {
        rows[thread] = sums_of(block, row, has_mean);
    } else {
        rows[thread] = Row();
    }
    workgroupBarrier();
    if (!exists || row > 0) { return; }
    var sums = array<vec4f, 4>();
    /* unroll */ for (var i = 0; i < ROWS; i++) {
        /* unroll */ for (var part = 0; part < 4; part++) { sums[part] += rows[first + i].parts[part]; }
    }
    // A block that moves and had no mean is not compared before its signature of this phase is written again.
    let known = next_state.cycle > 0.0 && next_state.cycle <= abs(before) && is_sampled() && !is_noisy();
    let here = signature_index(next_state.slot, block);
    var marks = select(0u, MOVES, is_moving);
    if (known) {
        if (differs(sums[0], history_signatures[here])) { marks |= RESTARTS; }
    } else if (is_sampled() && before < 0.0) {
        marks |= RESTARTS;
    }
    if (has_blocks() && next_state.last_slot != next_state.slot) {
        let last = signature_index(next_state.last_slot, block);   // the other set lacks it
        next_signatures[last] = history_signatures[last];
    }
    next_signatures[here] = sums[0];
    let place = index_of(block, blocks_size());
    if (has_mean) {
        block_sums[place] = Sums(sums[1], sums[2], sums[3]);
        marks |= HAS_SUMS;
    }
    block_marks[place] = marks;
}
