// A fragment of a mesh.

in vec3 v_world;
in vec3 v_normal;
in vec4 v_tangent;
in vec2 v_uv;
in vec3 v_clip;
in vec3 v_clip_before;

const float MAX_STEPS = 4.0;  // of anisotropic filtering

// Footprint of a display pixel in a texture, grid.z pixels of this grid wide, in steps along its longer axis. A mip
// bias does not change the length of that axis in a driver's own anisotropic filter, so frames of other sizes would
// not average to the same image.
struct Footprint {
    vec2 along;  // one step
    vec2 beside;
    int steps;
};

Footprint footprint() {
    vec2 across = dFdx(v_uv) * grid.z, down = dFdy(v_uv) * grid.z;
    bool swap = dot(across, across) < dot(down, down);
    vec2 along = swap ? down : across, beside = swap ? across : down;
    float ratio = sqrt(dot(along, along) / max(dot(beside, beside), 1e-20));
    float steps = clamp(ceil(ratio - 0.5), 1.0, MAX_STEPS);
    return Footprint(along / steps, beside, int(steps));
}

vec4 filtered(sampler2D map, Footprint f) {
    vec4 sum = vec4(0.0);
    for (int i = 0; i < f.steps; i++) {
        vec2 at = v_uv + (float(i) - 0.5 * float(f.steps - 1)) * f.along;
        sum += textureGrad(map, at, f.along, f.beside);
    }
    return sum / float(f.steps);
}

Shaded surface() {
    Shaded s;
    Footprint print = footprint();
    vec4 base = vec4(base_color.rgb, 1.0);
    if (has_maps.x > 0.5) {
        base *= filtered(base_color_map, print);
        if (base.a < material.w) {
            discard;
        }
    }
    float side = gl_FrontFacing ? 1.0 : -1.0;
    s.world = v_world;
    s.base_color = base.rgb;
    s.smooth_normal = side * normalize(v_normal);
    s.normal = s.smooth_normal;
    if (has_maps.y > 0.5) {
        vec3 n = 2.0 * filtered(normal_map, print).rgb - 1.0;
        vec3 t = normalize(v_tangent.xyz - s.smooth_normal * dot(s.smooth_normal, v_tangent.xyz));
        vec3 b = side * v_tangent.w * cross(s.smooth_normal, t);
        s.normal = normalize(n.x * t + n.y * b + n.z * s.smooth_normal);
    }
    s.occlusion = 1.0;
    s.roughness = material.x;
    s.metallic = material.y;
    s.specular = material.z;
    if (has_maps.z > 0.5) {
        vec3 orm = filtered(orm_map, print).rgb;
        s.occlusion = orm.r;
        s.roughness *= orm.g;
        s.metallic *= orm.b;
    }
    s.emission = emissive.rgb * draw.x;
    if (has_maps.w > 0.5) {
        s.emission *= filtered(emissive_map, print).rgb;
    }
    return s;
}

void main() {
    Shaded s = surface();
    float depth = eye.w / v_clip.z;
#ifdef SAMPLES
    out_color = vec4(min(radiance(s), BRIGHTEST), depth);
    out_normals = vec4(octahedral(s.smooth_normal), octahedral(s.normal));
#elif defined(TRUTH)
    out_truth = vec4(draw.yzw, unshadowed(s));
#else
    out_motion = vec4(motion_of(v_clip, v_clip_before), depth, eye.w / max(v_clip_before.z, eye.w));
    out_smooth = vec4(s.smooth_normal, s.specular);
    out_normal = vec4(s.normal, s.roughness);
    out_base = vec4(s.base_color, s.metallic);
#ifdef COLOR_AND_SURFACES
    out_color = vec4(min(radiance(s), BRIGHTEST), 1.0);
#endif
#endif
}
