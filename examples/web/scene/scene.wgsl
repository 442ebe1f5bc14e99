// The raster passes of the scene: colour, depth and motion by the conventions of supersampler.

struct Light {
    position: vec4f,
    color: vec4f,
}

struct View {
    clip: mat4x4f,             // world to clip coordinates, without jitter
    previous_clip: mat4x4f,    // the same of the previous frame
    sun_clip: mat4x4f,         // world to the shadow map
    eye: vec4f,                // w: width of a pixel's filter in textures; below 1 is a negative mip bias
    jitter: vec2f,             // of the sample in its pixel: centre + jitter, in pixels
    size: vec2f,               // pixels
    mirror: vec4f,             // x: z of its plane; y: 1 where the view is the reflected one
    right: vec4f,              // a pixel looks along forward + ndc.x right + ndc.y up
    up: vec4f,
    forward: vec4f,
    sun: vec4f,                // unit vector to it
    lights: array<Light, 3>,
}

struct Thing {
    model: mat4x4f,
    previous_model: mat4x4f,
    color: vec4f,              // w: gloss
    surface: vec4f,            // x: number of its kind
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> things: array<Thing>;
@group(0) @binding(2) var shadow_map: texture_depth_2d;
@group(0) @binding(3) var shadow_sampler: sampler_comparison;
@group(0) @binding(4) var reflected: texture_2d<f32>;

struct Vertex {
    @builtin(position) position: vec4f,
    @location(0) world: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) previous: vec4f,
    @location(4) @interpolate(flat) thing: u32,
}

struct Pixel {
    @location(0) color: vec4f,
    @location(1) motion: vec2f,
    @location(2) depth: f32,
}

const SUN_LIGHT = vec3f(2.6, 2.35, 2.0);

@vertex
fn thing_vertex(@location(0) position: vec3f, @location(1) normal: vec3f, @location(2) uv: vec2f,
                @builtin(instance_index) index: u32) -> Vertex {
    let thing = things[index];
    let world = thing.model * vec4f(position, 1.0);
    var clip = view.clip * world;
    // The image moves by minus the jitter; y of clip coordinates points up.
    clip += vec4f(vec2f(-2.0, 2.0) * view.jitter / view.size * clip.w, 0.0, 0.0);
    let previous = view.previous_clip * thing.previous_model * vec4f(position, 1.0);
    return Vertex(clip, world.xyz, (thing.model * vec4f(normal, 0.0)).xyz, uv, previous, index);
}

@vertex
fn shadow_vertex(@location(0) position: vec3f, @builtin(instance_index) index: u32) -> @builtin(position) vec4f {
    return view.sun_clip * things[index].model * vec4f(position, 1.0);
}

@vertex
fn sky_vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

/// Render pixels from where a sample is now to where it was, by its previous clip coordinates.
fn motion_to(previous: vec4f, position: vec4f) -> vec2f {
    let was = (0.5 + vec2f(0.5, -0.5) * previous.xy / previous.w) * view.size;
    return was - (position.xy + view.jitter);
}

fn sky(direction: vec3f) -> vec3f {
    let up = max(direction.y, 0.0);
    let haze = mix(vec3f(0.75, 0.72, 0.68), vec3f(0.16, 0.32, 0.62), sqrt(up));
    let glow = pow(max(dot(direction, view.sun.xyz), 0.0), 64.0);
    return haze + glow * vec3f(1.5, 1.2, 0.8);
}

/// Checks of one unit, averaged over a box of `width`.
fn checks(at: vec2f, width: vec2f) -> f32 {
    let i = 2.0 * (abs(fract((at - 0.5 * width) * 0.5) - 0.5) - abs(fract((at + 0.5 * width) * 0.5) - 0.5)) / width;
    return 0.5 - 0.5 * i.x * i.y;
}

/// Fraction of a box that lies in joints: the first `part` of each unit, in x or in y.
fn joints(at: vec2f, width: vec2f, part: vec2f) -> f32 {
    let a = at + 0.5 * width;
    let b = at - 0.5 * width;
    let covered = (floor(a) * part + min(fract(a), part) - floor(b) * part - min(fract(b), part)) / width;
    return 1.0 - (1.0 - covered.x) * (1.0 - covered.y);
}

fn surface_color(thing: Thing, uv: vec2f, width: vec2f) -> vec3f {
    if (thing.surface.x == 1.0) {
        let tiles = mix(0.35, 1.0, checks(uv * 2.0, width * 2.0));
        return thing.color.rgb * mix(tiles, 0.12, joints(uv * 2.0, width * 2.0, vec2f(0.03)));
    }
    if (thing.surface.x == 2.0) {
        let row = floor(uv.y / 0.1);
        let at = vec2f(uv.x / 0.24 + 0.5 * (row % 2.0), uv.y / 0.1);
        let shade = 0.75 + 0.5 * fract(sin(dot(floor(at), vec2f(12.9898, 78.233))) * 43758.547);
        return mix(thing.color.rgb * shade, vec3f(0.45), joints(at, width / vec2f(0.24, 0.1), vec2f(0.05, 0.1)));
    }
    return thing.color.rgb;
}

fn shadow(world: vec3f, normal: vec3f) -> f32 {
    let clip = view.sun_clip * vec4f(world + 0.02 * normal, 1.0);
    let at = 0.5 + vec2f(0.5, -0.5) * clip.xy;
    let lit = textureSampleCompareLevel(shadow_map, shadow_sampler, at, clip.z - 0.001);
    return select(lit, 1.0, any(abs(clip.xy) > vec2f(0.99)));
}

fn shade(vertex: Vertex) -> vec3f {
    let width = view.eye.w * max(abs(dpdx(vertex.uv)), abs(dpdy(vertex.uv))) + 1e-5;
    let thing = things[vertex.thing];
    if (thing.surface.x == 4.0) { return thing.color.rgb; }
    if (thing.surface.x == 3.0) {
        return thing.color.rgb * textureLoad(reflected, vec2u(vertex.position.xy), 0).rgb;
    }
    let to_eye = normalize(view.eye.xyz - vertex.world);
    var normal = normalize(vertex.normal);
    normal = select(-normal, normal, dot(normal, to_eye) > 0.0);
    let gloss = thing.color.w;
    let color = surface_color(thing, vertex.uv, width);
    let shininess = 8.0 + 120.0 * gloss;

    let sunny = SUN_LIGHT * shadow(vertex.world, normal);
    let sun_glint = pow(max(dot(normal, normalize(to_eye + view.sun.xyz)), 0.0), shininess);
    let ambient = mix(vec3f(0.16, 0.15, 0.14), vec3f(0.42, 0.5, 0.62), 0.5 + 0.5 * normal.y);
    var light = color * ambient + sunny * (color * max(dot(normal, view.sun.xyz), 0.0) + gloss * sun_glint);
    for (var i = 0u; i < 3u; i++) {
        let to_light = view.lights[i].position.xyz - vertex.world;
        let direction = normalize(to_light);
        let glint = pow(max(dot(normal, normalize(to_eye + direction)), 0.0), shininess);
        let strength = view.lights[i].color.rgb * (0.12 / (0.05 + dot(to_light, to_light)));
        light += strength * (color * max(dot(normal, direction), 0.0) + gloss * glint);
    }
    let mirrored = reflect(-to_eye, normal);
    let fresnel = gloss * (0.04 + 0.4 * pow(1.0 - max(dot(normal, to_eye), 0.0), 5.0));
    return light + (fresnel + 0.35 * gloss * gloss * color) * sky(mirrored);
}

/// What lies behind the mirror is not reflected.
fn discard_behind_mirror(world: vec3f) {
    if (view.mirror.y == 1.0 && world.z < view.mirror.x) { discard; }
}

@fragment
fn thing_pixel(vertex: Vertex) -> Pixel {
    return Pixel(vec4f(shade(vertex), 1.0), motion_to(vertex.previous, vertex.position), vertex.position.z);
}

@fragment
fn thing_color(vertex: Vertex) -> @location(0) vec4f {
    let color = shade(vertex);
    discard_behind_mirror(vertex.world);
    return vec4f(color, 1.0);
}

fn direction_at(position: vec4f) -> vec3f {
    let ndc = vec2f(2.0, -2.0) * (position.xy + view.jitter) / view.size + vec2f(-1.0, 1.0);
    return view.forward.xyz + ndc.x * view.right.xyz + ndc.y * view.up.xyz;
}

@fragment
fn sky_pixel(@builtin(position) position: vec4f) -> Pixel {
    let direction = direction_at(position);
    let previous = view.previous_clip * vec4f(direction, 0.0);
    return Pixel(vec4f(sky(normalize(direction)), 1.0), motion_to(previous, position), 0.0);
}

@fragment
fn sky_color(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return vec4f(sky(normalize(direction_at(position))), 1.0);
}
