// The exposure of this frame, from the PARTS sums of `measure`.
// import params
// import state

@group(0) @binding(1) var<storage, read> measured: array<vec2f>;
@group(0) @binding(2) var<storage, read> history_state: State;
@group(0) @binding(3) var<storage, read_write> next_state: State;
@group(0) @binding(4) var<storage, read_write> rising: array<u32>;   // counted by a later pass

var<workgroup> sums: array<vec2f, PARTS>;

@compute @workgroup_size(PARTS)
fn main(@builtin(local_invocation_index) thread: u32) {
    sums[thread] = measured[thread];
    for (var half = PARTS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (thread < half) { sums[thread] += sums[thread + half]; }
    }
    if (thread == 0u) {
        let before = history_state.followed;
        let followed = exposure_after(sums[0], before);
        next_state.followed = followed;
        next_state.flash = select(0.0, 1.0, is_flash(followed, before));
        rising[0] = 0u;
    }
}
