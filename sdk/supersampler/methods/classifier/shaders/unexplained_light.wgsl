// Light over white that rises over all samples of the history; see `unexplained_light` of the torch method.

// import warped_history

fn light_rises(luma: f32, before: WarpedHistory, visibility: f32) -> bool {
    return luma > WHITE && luma > before.range.y + RISE && before.samples * visibility > 0.0;
}
