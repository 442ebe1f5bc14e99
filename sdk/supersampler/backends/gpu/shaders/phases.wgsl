// The table of phases, for methods whose history has one. Same as `follow_jitter` in torch.
// import at_rest
// import state

@group(1) @binding(10) var history_phases: texture_2d<f32>;   // jitter, frames since it was seen and between its last two
@group(1) @binding(11) var next_phases: texture_storage_2d<rgba32float, write>;
@group(1) @binding(12) var<storage, read_write> awake: array<u32>;   // 1 where a later pass finds a block not frozen

fn phase_at(row: i32) -> vec4f {
    return select(vec4f(0.0), textureLoad(history_phases, vec2i(row, 0), 0), has_blocks());
}

// Find the frame's jitter in the table, or replace the least recently used row.
fn follow_jitter() {
    let count = phase_count();
    var highest = -OLDEST;
    var slot = 0;
    var age = 0.0;
    var latest = 0.0;
    for (var row = 0; row < count; row++) {
        let phase = phase_at(row);
        let apart = abs(phase.xy - params.jitter);
        let same = phase.z > 0.0 && apart.x + apart.y < 1e-6;
        let rank = select(select(2.0 * OLDEST, phase.z, phase.z > 0.0), 4.0 * OLDEST, same) - f32(row);
        if (rank > highest) {
            highest = rank;
            slot = row;
            age = select(0.0, phase.z, same);
        }
        latest += select(0.0, phase.w, phase.z == 1.0);
    }
    let counts = is_sampled() && (age != 1.0 || is_noisy());
    let period = select(latest, age, age > 0.0 && counts);
    for (var row = 0; row < count; row++) {
        var phase = phase_at(row);
        if (counts) {
            phase.z = min(phase.z + select(0.0, 1.0, phase.z > 0.0), OLDEST);
            if (row == slot) { phase = vec4f(params.jitter, 1.0, period); }
        }
        textureStore(next_phases, vec2i(row, 0), phase);
    }
    next_state.last_slot = history_state.slot;
    next_state.slot = u32(slot);
    next_state.cycle = age;
    next_state.period = period;
    next_state.counts = select(0.0, 1.0, counts);
    awake[0] = 0u;
}
