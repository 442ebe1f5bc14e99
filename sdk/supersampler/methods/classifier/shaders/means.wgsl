// The two inputs of the network that say how history and frame differ around: means under a 5x5 tent at half
// display size, as bytes 6 and 7 of `half_inputs`.
// import params

@group(0) @binding(1) var<storage, read> differences: array<u32>;
@group(0) @binding(2) var<storage, read_write> half_inputs: array<vec2u>;

// How often the mean of three, taken twice around `at`, counts each of five along an axis, of nine times: the
// border repeats before each of the two.
fn tent_weights(at: i32, size: i32) -> array<f32, 5> {
    var weights = array<f32, 5>();
    for (var first = -1; first <= 1; first++) {
        let middle = clamp(at + first, 0, size - 1);
        for (var second = -1; second <= 1; second++) {
            weights[clamp(middle + second, 0, size - 1) - at + 2] += 1.0;
        }
    }
    return weights;
}

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    let size = (display_size() + 1) / 2;
    if (!inside(p, size)) { return; }
    var across = tent_weights(p.x, size.x);
    var down = tent_weights(p.y, size.y);
    var sums = vec2f(0.0);
    for (var j = 0; j < 5; j++) {
        for (var i = 0; i < 5; i++) {
            let q = clamped(p + vec2i(i, j) - 2, size);
            sums += across[i] * down[j] * unpack2x16float(differences[index_of(q, size)]);
        }
    }
    let means = sqrt(max(abs(sums) / 81.0, vec2f(1e-6)));
    let i = index_of(p, size);
    half_inputs[i].y |= pack4x8unorm(vec4f(0.0, 0.0, means));
}
