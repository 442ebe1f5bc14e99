// GGX with height-correlated Smith masking on Lambert, under a sun, a spot, points and an environment.

layout(std140) uniform Lights {
    mat4 world_to_sun;
    mat4 world_to_spot;
    vec4 sun_direction;   // to the light; w: metres per texel of its shadow map
    vec4 sun_color;
    vec4 spot_position;   // w: reach
    vec4 spot_axis;       // from the light; w: texels' size at a distance of 1 m
    vec4 spot_color;      // w: cosine of the inner angle
    vec4 counts;          // x: points, y: cosine of the spot's outer angle
    vec4 panorama;        // x: levels, y: level of a mirror of alpha 1
    vec4 irradiance[9];
    vec4 point_position[MAX_POINTS];  // w: reach
    vec4 point_color[MAX_POINTS];
};

uniform sampler2D environment;
uniform sampler2DShadow sun_shadow;
uniform sampler2DShadow spot_shadow;

const float PI = 3.14159265;

// Where a direction is in the panorama: the middle looks at -z.
vec3 panorama_at(vec3 direction, float level) {
    vec2 uv = vec2(atan(direction.x, -direction.z) / (2.0 * PI) + 0.5, acos(clamp(direction.y, -1.0, 1.0)) / PI);
    return textureLod(environment, uv, level).rgb;
}

vec3 diffuse_environment(vec3 n) {
    vec3 sum = irradiance[0].rgb + irradiance[1].rgb * n.x + irradiance[2].rgb * n.y + irradiance[3].rgb * n.z;
    sum += irradiance[4].rgb * n.x * n.y + irradiance[5].rgb * n.y * n.z;
    sum += irradiance[6].rgb * (3.0 * n.z * n.z - 1.0) + irradiance[7].rgb * n.x * n.z;
    sum += irradiance[8].rgb * (n.x * n.x - n.y * n.y);
    return max(sum, 0.0);
}

// Scale and offset of F0 in the preintegrated environment BRDF: Karis' fit for mobile GPUs.
vec2 environment_brdf(float roughness, float n_v) {
    vec4 r = roughness * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
    float edge = min(r.x * r.x, exp2(-9.28 * n_v)) * r.x + r.y;
    return vec2(-1.04, 1.04) * edge + r.zw;
}

// What the BRDF of one surface, seen from one side, has in common for all lights.
struct Reflector {
    vec3 normal;
    vec3 view;
    vec3 diffuse;
    vec3 f0;
    float a2;
    float n_v;
    float smith;  // of the view
};

Reflector reflector(Shaded s, vec3 f0, float alpha, vec3 v) {
    float a2 = alpha * alpha, n_v = max(dot(s.normal, v), 1e-4);
    vec3 diffuse = (1.0 - s.metallic) / PI * s.base_color;
    return Reflector(s.normal, v, diffuse, f0, a2, n_v, sqrt(n_v * n_v * (1.0 - a2) + a2));
}

// Diffuse and specular BRDF times the cosine, for one direction to a light. Powers by products and the half vector by
// its cosines alone: on a processor this is where a frame's time goes.
vec3 reflected(Reflector r, vec3 l) {
    float n_l = clamp(dot(r.normal, l), 0.0, 1.0);
    float v_l = dot(r.view, l);
    float shorter = inversesqrt(max(2.0 + 2.0 * v_l, 1e-8));  // 1 / |v + l|
    float n_h = clamp((dot(r.normal, r.view) + n_l) * shorter, 0.0, 1.0);
    float lobe = n_h * n_h * (r.a2 - 1.0) + 1.0;
    float smith = n_l * r.smith + r.n_v * sqrt(n_l * n_l * (1.0 - r.a2) + r.a2);
    float d_g = 0.5 * r.a2 / (PI * lobe * lobe * smith);
    float grazing = 1.0 - clamp((1.0 + v_l) * shorter, 0.0, 1.0);
    float squared = grazing * grazing;
    vec3 f = r.f0 + (1.0 - r.f0) * (squared * squared * grazing);
    return ((1.0 - f) * r.diffuse + d_g * f) * n_l;
}

// Fraction of unoccluded light, filtered over 3 x 3 texels. `bias` is in the map's depth.
float lit(sampler2DShadow map, vec4 clip, float bias) {
    vec3 at = clip.xyz / clip.w;
    if (clip.w <= 0.0 || any(greaterThan(abs(at.xy), vec2(1.0))) || at.z > 1.0) {
        return 1.0;
    }
    vec3 p = vec3(0.5 * at.xy + 0.5, at.z - bias);
    vec2 texel = 0.5 / vec2(textureSize(map, 0));
    float sum = texture(map, p + vec3(texel, 0.0)) + texture(map, p - vec3(texel, 0.0));
    sum += texture(map, p + vec3(texel.x, -texel.y, 0.0)) + texture(map, p + vec3(-texel.x, texel.y, 0.0));
    return 0.25 * sum;
}

// Fades to nothing at the light's reach, else by the square of the distance.
float attenuation(float distance, float reach) {
    float x = distance / reach;
    float window = clamp(1.0 - x * x * x * x, 0.0, 1.0);
    return window * window / max(distance * distance, 1e-4);
}

// A processor runs both sides of a branch, so lights that a scene lacks are left out of its programs.
#ifdef SUN
// Fraction of the sun's light that reaches a surface facing it.
float sun_share(Shaded s) {
    float slope = 1.0 - dot(s.smooth_normal, sun_direction.xyz);
    vec3 beside = s.world + s.smooth_normal * sun_direction.w * (1.0 + 2.0 * slope);
    return lit(sun_shadow, world_to_sun * vec4(beside, 1.0), 1e-4);
}
#endif
#ifdef SPOT
// Fraction of the spot's light that reaches a surface facing it, in direction l at this distance.
float spot_share(Shaded s, vec3 l, float distance) {
    float slope = 1.0 - dot(s.smooth_normal, l);
    vec3 beside = s.world + s.smooth_normal * spot_axis.w * distance * (1.0 + 2.0 * slope);
    return lit(spot_shadow, world_to_spot * vec4(beside, 1.0), 1e-5);
}
#endif

#ifdef TRUTH
// Unshadowed fraction of the light of sun and spot; 1 where neither reaches.
float unshadowed(Shaded s) {
    float arriving = 0.0, whole = 0.0;
#ifdef SUN
    float sun = max(dot(s.smooth_normal, sun_direction.xyz), 0.0) * dot(sun_color.rgb, vec3(1.0));
    if (sun > 0.0) {
        arriving += sun * sun_share(s);
        whole += sun;
    }
#endif
#ifdef SPOT
    vec3 to_spot = spot_position.xyz - s.world;
    float distance = length(to_spot);
    vec3 l = to_spot / distance;
    float cone = smoothstep(counts.y, spot_color.w, dot(-l, spot_axis.xyz));
    float spot = cone * max(dot(s.smooth_normal, l), 0.0) * attenuation(distance, spot_position.w);
    spot *= dot(spot_color.rgb, vec3(1.0));
    if (spot > 0.0) {
        arriving += spot * spot_share(s, l, distance);
        whole += spot;
    }
#endif
    return whole > 0.0 ? arriving / whole : 1.0;
}
#endif

vec3 radiance(Shaded s) {
    vec3 v = normalize(eye.xyz - s.world);
    float alpha = max(s.roughness * s.roughness, 2e-3);
    vec3 f0 = mix(vec3(0.08 * s.specular), s.base_color, s.metallic);
    float n_v = clamp(dot(s.normal, v), 0.0, 1.0);

    Reflector r = reflector(s, f0, alpha, v);
    vec3 mirrored = reflect(-v, s.normal);
    float level = clamp(panorama.y + log2(alpha), 0.0, panorama.x - 1.0);
    vec2 brdf = environment_brdf(s.roughness, n_v);
    vec3 diffuse = r.diffuse * diffuse_environment(s.normal);
    vec3 sum = s.emission + s.occlusion * (diffuse + panorama_at(mirrored, level) * (f0 * brdf.x + brdf.y));

#ifdef SUN
    if (dot(s.smooth_normal, sun_direction.xyz) > 0.0) {
        sum += sun_share(s) * sun_color.rgb * reflected(r, sun_direction.xyz);
    }
#endif
#ifdef SPOT
    vec3 to_spot = spot_position.xyz - s.world;
    float distance = length(to_spot);
    vec3 l = to_spot / distance;
    float cone = smoothstep(counts.y, spot_color.w, dot(-l, spot_axis.xyz));
    if (cone > 0.0 && dot(s.smooth_normal, l) > 0.0) {
        float arriving = spot_share(s, l, distance) * cone * attenuation(distance, spot_position.w);
        sum += arriving * spot_color.rgb * reflected(r, l);
    }
#endif
    for (int i = 0; i < int(counts.x); i++) {
        vec3 to = point_position[i].xyz - s.world;
        float distance = length(to);
        if (distance < point_position[i].w) {
            float arriving = attenuation(distance, point_position[i].w);
            sum += arriving * point_color[i].rgb * reflected(r, to / max(distance, 1e-4));
        }
    }
    return sum;
}
