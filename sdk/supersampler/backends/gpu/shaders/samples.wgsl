// The samples of this frame, as `preprocess` writes them to `samples`: exposed linear RGB, filled where a sample is
// missing, and in alpha 1 where it is usable, plus 2 where one of 3x3 samples glares, plus 4 times the reactive mask in
// MASK_STEPS steps.
// import params
// import colors

const MASK_STEPS = 255.0;    // halves hold all values of alpha

// Toned RGB, and 1 where the sample is usable; zeros where it is not.
fn toned_sample(samples: texture_2d<f32>, p: vec2i) -> vec4f {
    let sample = textureLoad(samples, clamped(p, render_size()), 0);
    let usable = usable_in(sample.a);
    return vec4f(usable * tone(sample.rgb), usable);
}

fn usable_in(alpha: f32) -> f32 { return f32(u32(alpha) & 1u); }
fn glares_in(alpha: f32) -> bool { return (u32(alpha) & 2u) != 0u; }
fn mask_in(alpha: f32) -> f32 { return f32(u32(alpha) >> 2u) / MASK_STEPS; }

// Mean and deviation of luma from sums over 3x3 samples: luma, its square; 1 where usable.
fn shade_of(sums: vec3f) -> vec2f {
    let mean = sums.xy / max(sums.z, 1.0);
    let deviation = sqrt(max(mean.y - mean.x * mean.x, 0.0));
    return vec2f(mean.x, select(1.0, deviation, sums.z > 0.0));
}
