// Outputs of a fragment, chosen by COLOR_AND_SURFACES, SURFACES, SAMPLES or TRUTH.

const float BRIGHTEST = 60000.0;  // half floats end at 65504

#ifdef SAMPLES
layout(location = 0) out vec4 out_color;     // rgb, depth
layout(location = 1) out vec4 out_normals;   // octahedral: smooth, mapped
#elif defined(TRUTH)
layout(location = 0) out vec4 out_truth;     // thin and still, thin and moving, moving otherwise: 0 or 1; unshadowed
#else
layout(location = 0) out vec4 out_motion;    // motion xy in pixels, depth, previous depth
layout(location = 1) out vec4 out_smooth;    // smooth normal, specular
layout(location = 2) out vec4 out_normal;    // normal, roughness
layout(location = 3) out vec4 out_base;      // base colour, metallic
#ifdef COLOR_AND_SURFACES
layout(location = 4) out vec4 out_color;     // rgb
#endif
#endif

// A unit vector as two numbers in [-1, 1]; 0, the sky's normal, as (2, 2).
vec2 octahedral(vec3 n) {
    float size = abs(n.x) + abs(n.y) + abs(n.z);
    if (size == 0.0) {
        return vec2(2.0);
    }
    vec2 p = n.xy / size;
    vec2 folded = (1.0 - abs(p.yx)) * vec2(p.x < 0.0 ? -1.0 : 1.0, p.y < 0.0 ? -1.0 : 1.0);
    return n.z < 0.0 ? folded : p;
}

// Motion in pixels, previous minus current; off screen if the point was behind the camera.
vec2 motion_of(vec3 clip, vec3 clip_before) {
    if (clip_before.z <= 0.0) {
        return 2.0 * grid.xy;
    }
    vec2 ndc = clip_before.xy / clip_before.z - clip.xy / clip.z;
    return clamp(0.5 * ndc, -2.0, 2.0) * grid.xy;
}
