// Exposure of a frame: given, or 0.18 over the log-average luminance, adapted. Same as `exposure_for`.
// import params

fn is_given() -> bool { return params.exposure >= MIN_EXPOSURE && params.exposure <= MAX_EXPOSURE; }

fn is_outlier(exposure: f32, known: f32) -> bool {
    return exposure > known * EXPOSURE_OUTLIER || exposure * EXPOSURE_OUTLIER < known;
}

// Signed exposure for the history: negative until a second frame confirms it.
//   measured: sum of the logarithms, and number of lit samples; before: of the previous frame, 0 without one
fn exposure_after(measured: vec2f, before: f32) -> f32 {
    let target_exposure = EXPOSURE_KEY * exp(-measured.x / max(measured.y, 1.0));
    let known = abs(before);
    let has_history = known > 0.0;
    let seen = measured.y > 0.0;
    let smoothed = pow(max(known, 1e-8), 1.0 - EXPOSURE_ADAPTATION) * pow(target_exposure, EXPOSURE_ADAPTATION);
    let adapted = select(target_exposure, select(known, smoothed, seen), has_history);
    let followed = select(adapted, params.exposure, is_given());
    let wanted = select(select(target_exposure, known, has_history && !seen), params.exposure, is_given());
    let confirmed = select(followed, select(-known, wanted, before < 0.0), has_history && is_outlier(wanted, known));
    return select(-followed, confirmed, has_history);
}

// Whether a measured exposure is an outlier: the light of the whole frame is unconfirmed.
fn is_flash(followed: f32, before: f32) -> bool {
    let known = abs(before);
    return !is_given() && known > 0.0 && (followed < 0.0 || is_outlier(abs(followed), known));
}
