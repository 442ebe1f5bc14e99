// Sums of logarithms of luminance for the exposure, and numbers of lit samples, for each of PARTS workgroups.
// import params
// import sanitize
// import colors
// import exposure
// import frame

const THREADS = 256u;

@group(0) @binding(1) var<storage, read_write> measured: array<vec2f>;

var<workgroup> sums: array<vec2f, THREADS>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3u) {
    let size = render_size();
    let count = select(u32(size.x * size.y), 0u, is_given());
    var sum = vec2f(0.0);
    for (var i = group.x * THREADS + thread; i < count; i += THREADS * PARTS) {
        let color = color_at(vec2i(i32(i) % size.x, i32(i) / size.x));
        let light = luminance(scene_color(color));
        if (all_valid(color) && light > DARKEST) { sum += vec2f(log(light), 1.0); }
    }
    sums[thread] = sum;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (thread < half) { sums[thread] += sums[thread + half]; }
    }
    if (thread == 0u) { measured[group.x] = sums[0]; }
}
