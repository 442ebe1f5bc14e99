// Shows two views side by side: exposure, tone curve and sRGB as supersampler.io.display has them.

const INPUT = 0u;
const BILINEAR = 1u;
const OURS = 2u;

struct Shown {
    origin: vec2f,       // image pixel at the canvas' corner
    zoom: f32,           // canvas pixels for one of the image
    split: f32,          // canvas pixels
    jitter: vec2f,       // of the input
    exposure: f32,
    left: u32,
    right: u32,
}

@group(0) @binding(0) var<uniform> shown: Shown;
@group(0) @binding(1) var input: texture_2d<f32>;
@group(0) @binding(2) var ours: texture_2d<f32>;
@group(0) @binding(3) var truth: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn texel(image: texture_2d<f32>, at: vec2i) -> vec3f {
    let last = vec2i(textureDimensions(image)) - 1;
    return textureLoad(image, clamp(at, vec2i(0), last), 0).rgb;
}

fn bilinear(at: vec2f) -> vec3f {
    let low = floor(at);
    let part = at - low;
    let corner = vec2i(low);
    let top = mix(texel(input, corner), texel(input, corner + vec2i(1, 0)), part.x);
    let bottom = mix(texel(input, corner + vec2i(0, 1)), texel(input, corner + vec2i(1, 1)), part.x);
    return mix(top, bottom, part.y);
}

fn view_at(view: u32, pixel: vec2f) -> vec3f {
    let in_input = (floor(pixel) + 0.5) * vec2f(textureDimensions(input)) / vec2f(textureDimensions(ours));
    switch (view) {
        case INPUT: { return texel(input, vec2i(floor(in_input))); }
        case BILINEAR: { return bilinear(in_input - 0.5 - shown.jitter); }
        case OURS: { return texel(ours, vec2i(floor(pixel))); }
        default: { return texel(truth, vec2i(floor(pixel))); }
    }
}

fn srgb(linear: vec3f) -> vec3f {
    return select(1.055 * pow(linear, vec3f(1.0 / 2.4)) - 0.055, 12.92 * linear, linear <= vec3f(0.0031308));
}

@fragment
fn fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let distance = position.x - shown.split;
    let view = select(shown.right, shown.left, distance < 0.0);
    let exposed = max(view_at(view, shown.origin + position.xy / shown.zoom), vec3f(0.0)) * shown.exposure;
    let toned = exposed / (1.0 + max(exposed.r, max(exposed.g, exposed.b)));
    return vec4f(srgb(toned), 1.0);
}
