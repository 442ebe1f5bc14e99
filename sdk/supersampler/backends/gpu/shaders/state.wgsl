// Values of a whole frame in the history.
// import exposure

struct State {
    followed: f32,            // signed exposure, see `exposure_after`; 0: no history
    flash: f32,               // 1 where the light of this whole frame is unconfirmed
    jitter: vec2f,            // of the surfaces in the history
    light: vec4f,             // history.light of `taau`
    // of one step, for its later passes
    previous_jitter: vec2f,   // `jitter` of the previous step
    slot: u32,                // row of this frame's jitter in the table of phases
    last_slot: u32,           // that of the previous step
    cycle: f32,               // frames since this jitter was last seen; 0 if it is new
    period: f32,              // frames of a jitter period; 0 while it is unknown
    counts: f32,              // 1 where the frame adds a phase
    rests: f32,               // 1 where the whole frame is frozen, 2 where the previous one was, too
}

fn exposure_of(state: State) -> f32 { return abs(state.followed); }
