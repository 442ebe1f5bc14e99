// Values of this whole frame: its exposure, from the PARTS sums of `measure`, and its jitter in the table of phases.
// import params
// import state
// import phases

@group(0) @binding(1) var<storage, read> measured: array<vec2f>;
@group(0) @binding(2) var<storage, read> history_state: State;
@group(0) @binding(3) var<storage, read_write> next_state: State;

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
        next_state.previous_jitter = history_state.jitter;
        next_state.jitter = params.jitter;
        next_state.rests = 0.0;
        follow_jitter();
    }
}
