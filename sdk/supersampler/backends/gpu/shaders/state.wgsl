// Values of a whole frame in the history.
// import exposure

struct State {
    followed: f32,    // signed exposure, see `exposure_after`; 0: no history
    flash: f32,       // 1 where the light of this whole frame is unconfirmed
    light: vec4f,     // history.light of `taau`
}

fn exposure_of(state: State) -> f32 { return abs(state.followed); }
