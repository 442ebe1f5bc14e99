// Compare the samples with the mean where they are: which samples open their pixels, because they differ from
// it in another way than before. Twin of `measure_residuals`.
// import convergence
// import samples
// import state

const COVERED = 0.999;    // of four bilinear weights
const DARK = 0.002;
const LEARNED = 12.0;
const MARGIN = 1.5 / 255.0;
const MARGIN_LEARNING = 8.0 / 255.0;
const SPREADS = 1.5;
const MOST_LEARNING = 48.0 / 255.0;
const LEAST_CONTRAST = 9.0 / 255.0;
const LEAST_RELATIVE_CONTRAST = 0.05;
const FOLLOWS = -0.1;
const FOLLOWS_DOUBTED = 0.3;
const PATTERN_READY = 2.5;
const UNBOUNDED = 4.0;
const SIDE = 16;
const WIDE = SIDE + 4;

@group(0) @binding(1) var<storage, read> next_state: State;
@group(0) @binding(2) var samples: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> own_motion: array<vec2f>;
@group(0) @binding(4) var history_still: texture_2d<f32>;   // 4 a thread
@group(0) @binding(5) var history_opening: texture_2d<f32>;
@group(0) @binding(6) var next_opening: texture_storage_2d<rgba16float, write>;   // low, high, learned, opens

var<workgroup> residuals: array<vec3f, WIDE * WIDE>;   // difference, luma of the mean, 1 where it counts
// 1 where there is a mean; part of it that is doubted; part of it of few samples
var<workgroup> known: array<vec3f, WIDE * WIDE>;

fn shown_luma(exposed: vec3f) -> f32 {
    let luma = luminance(exposed);
    return sqrt(luma / (1.0 + luma) + DARK);
}

struct Mean {
    color: vec3f,
    ready: f32,      // part of the four pixels with a mean
    doubted: f32,    // part of them opened or doubted by the previous frame
    young: f32,      // part of them of few samples
}

fn mean_at(sample: vec2i) -> Mean {
    let at = (vec2f(sample) + 0.5 + params.jitter) * display_extent() / params.render - 0.5;
    let first = floor(at);
    var mean = Mean(vec3f(0.0), 0.0, 0.0, 0.0);
    /* unroll */ for (var k = 0; k < 4; k++) {
        let q = first + vec2f(f32(k & 1), f32(k >> 1));
        let weight = tent(q.x - at.x) * tent(q.y - at.y);
        let pixel = textureLoad(history_still, clamped(vec2i(q), display_size()), 0);
        mean.color += weight * pixel.rgb;
        mean.ready += select(0.0, weight, abs(pixel.a) > READY);
        mean.doubted += select(0.0, weight, pixel.a < 0.0);
        mean.young += select(0.0, weight, abs(pixel.a) < PATTERN_READY);
    }
    return mean;
}

fn compare(sample: vec2i, i: i32) {
    residuals[i] = vec3f(0.0);
    known[i] = vec3f(0.0);
    if (!inside(sample, render_size()) || is_moving(own_motion[index_of(sample, render_size())])) { return; }
    let mean = mean_at(sample);
    if (mean.ready <= COVERED) { return; }
    let color = mean_sample(samples, sample);
    let expected = shown_luma(mean.color * exposure_of(next_state));
    known[i] = vec3f(1.0, mean.doubted, mean.young);
    residuals[i] = select(vec3f(0.0), vec3f(shown_luma(color.rgb) - expected, expected, 1.0), color.a > 0.0);
}

struct Residual {
    mean: f32,
    spread: f32,
    contrast: f32,     // variance of the luma of the mean, 0 where it is too low
    covariance: f32,   // of that luma and the differences: the slope of the samples is 1 + covariance / contrast
}

fn residual_near(cell: vec2i) -> Residual {
    var sums = vec3f(0.0);
    var products = vec3f(0.0);
    /* unroll */ for (var j = 0; j < 5; j++) {
        /* unroll */ for (var i = 0; i < 5; i++) {
            let r = residuals[(cell.y + j) * WIDE + cell.x + i];
            sums += r;
            products += vec3f(r.x * r.x, r.y * r.y, r.x * r.y);
        }
    }
    let mean = sums.xy / max(sums.z, 1e-6);
    let central = products / max(sums.z, 1e-6) - vec3f(mean * mean, mean.x * mean.y);
    let variance = max(central.x, 0.0);
    let least = LEAST_RELATIVE_CONTRAST * variance + LEAST_CONTRAST * LEAST_CONTRAST;
    return Residual(mean.x, sqrt(variance), select(0.0, central.y, central.y > least), central.z);
}

@compute @workgroup_size(SIDE, SIDE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u,
        @builtin(local_invocation_index) index: u32) {
    let origin = SIDE * vec2i(group.xy);
    for (var i = i32(index); i < WIDE * WIDE; i += SIDE * SIDE) {
        compare(origin - 2 + vec2i(i % WIDE, i / WIDE), i);
    }
    workgroupBarrier();
    let p = origin + vec2i(local.xy);
    if (!inside(p, render_size())) { return; }
    let cell = vec2i(local.xy);
    let here = known[(cell.y + 2) * WIDE + cell.x + 2];
    if (here.x == 0.0) {
        textureStore(next_opening, p, vec4f(0.0));
        return;
    }
    let residual = residual_near(cell);
    var before = vec3f(0.0);
    if (all(params.previous == params.render)) { before = textureLoad(history_opening, p, 0).xyz; }
    let learning = before.z < LEARNED;
    let margin = select(MARGIN, min(MARGIN_LEARNING + SPREADS * residual.spread, MOST_LEARNING), learning);
    let below = residual.mean < before.x - margin;
    let above = residual.mean > before.y + margin;
    let slope = select(FOLLOWS, FOLLOWS_DOUBTED, here.y > 0.0);
    let follows = residual.contrast + residual.covariance >= residual.contrast * slope;
    let other_pattern = params.counts > 0.0 && here.z <= 0.0 && residual.contrast > 0.0 && !follows;
    let opens = select(select(0.0, DOUBTED, other_pattern), 1.0, below || above);
    let learns = learning && opens == 0.0;
    let low = select(select(before.x, min(before.x, residual.mean), learns), -UNBOUNDED, above);
    let high = select(select(before.y, max(before.y, residual.mean), learns), UNBOUNDED, below);
    let step = params.render.x * params.render.y / (display_extent().x * display_extent().y);
    let learned = min(before.z + select(0.0, step * params.counts, learns), LEARNED);
    let keeps = select(0.0, 1.0, here.y * params.counts <= 0.0);
    textureStore(next_opening, p, vec4f(keeps * vec3f(low, high, learned), opens));
}
