// The samples of this frame, as `preprocess` writes them to `samples`: exposed linear RGB, and in alpha 0 where a
// sample is not usable, -1 where it glares, else the factor that darkens fireflies in the mean.
// import params
// import colors

// Toned RGB, and 1 where the sample is usable; zeros where it is not.
fn toned_sample(samples: texture_2d<f32>, p: vec2i) -> vec4f {
    let sample = textureLoad(samples, clamped(p, render_size()), 0);
    return vec4f(tone(sample.rgb), select(0.0, 1.0, sample.a != 0.0));
}

// Exposed RGB for the mean, and 1 where the sample is in it; zeros where it is not.
fn mean_sample(samples: texture_2d<f32>, p: vec2i) -> vec4f {
    let sample = textureLoad(samples, clamped(p, render_size()), 0);
    return select(vec4f(0.0), vec4f(sample.rgb * sample.a, 1.0), sample.a > 0.0);
}
