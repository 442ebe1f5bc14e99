// Colour: tone curve, YCoCg, glare. Same as ops/color.py.

fn largest(color: vec3f) -> f32 { return max(max(color.r, color.g), color.b); }

fn luminance(color: vec3f) -> f32 { return BT709_WEIGHTS.r * color.r + BT709_WEIGHTS.g * color.g + BT709_WEIGHTS.b * color.b; }

// Exposed linear RGB [0, inf) to [0, 1): keeps hue, reduces the weight of fireflies.
fn tone(color: vec3f) -> vec3f { return color / (1.0 + largest(color)); }

fn inverse_tone(color: vec3f) -> vec3f { return color / max(1.0 - largest(color), 1.0 / MAX_HALF); }

// The factor that limits the largest channel of a toned colour to `limit`.
fn dimming(toned: vec3f, limit: f32) -> f32 { return limit / max(limit, largest(toned)); }

fn ycocg(c: vec3f) -> vec3f {
    return vec3f(0.25 * (c.r + c.b) + 0.5 * c.g, 0.5 * (c.r - c.b), 0.5 * c.g - 0.25 * (c.r + c.b));
}

fn from_ycocg(c: vec3f) -> vec3f { return vec3f(c.x + c.y - c.z, c.x + c.z, c.x - c.y - c.z); }

// Frames with glare in a history value, and the value without them.
fn glare_of(value: f32) -> f32 { return floor(value / GLARE + 0.5); }
fn without_glare(value: f32) -> f32 { return max(value - GLARE * glare_of(value), 0.0); }
