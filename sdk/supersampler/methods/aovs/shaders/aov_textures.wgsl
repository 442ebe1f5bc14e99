// AOVs of the frame, and blended AOVs, in textures of the caller: four channels at once.
// import sanitize

@group(0) @binding(1) var frame_aovs: texture_2d<f32>;
@group(0) @binding(5) var aovs: texture_storage_2d<rgba16float, write>;

alias Value = vec4f;
const OWN = 1u;       // values of the frame in this pass

fn aov_at(p: vec2i, part: u32) -> vec4f { return textureLoad(frame_aovs, p, 0); }

fn known(value: vec4f) -> vec4f {
    return select(vec4f(0.0), vec4f(1.0), (bitcast<vec4u>(value) & vec4u(~SIGN)) <= vec4u(INFINITY_BITS));
}

fn limited_value(value: vec4f) -> vec4f {
    return vec4f(limited(value.x), limited(value.y), limited(value.z), limited(value.w));
}

fn show_aov(p: vec2i, value: vec4f) { textureStore(aovs, p, value); }
