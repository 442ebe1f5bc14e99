// The panorama, where nothing is in front of it. It moves as if infinitely far away.

in vec2 v_clip_plane;

void main() {
    vec3 ray = (clip_to_ray * vec4(v_clip_plane, 1.0, 0.0)).xyz;
#ifdef SAMPLES
    out_color = vec4(min(panorama_at(normalize(ray), 0.0), BRIGHTEST), 0.0);
    out_normals = vec4(octahedral(vec3(0.0)), octahedral(vec3(0.0)));
#elif defined(TRUTH)
    out_truth = vec4(0.0, 0.0, 0.0, 1.0);
#else
    vec3 now = (world_to_clip * vec4(ray, 0.0)).xyw;
    vec3 before = (world_to_clip_before * vec4(ray, 0.0)).xyw;
    out_motion = vec4(motion_of(now, before), 0.0, 0.0);
    out_smooth = vec4(0.0);
    out_normal = vec4(0.0);
    out_base = vec4(0.0);
#ifdef COLOR_AND_SURFACES
    out_color = vec4(min(panorama_at(normalize(ray), 0.0), BRIGHTEST), 1.0);
#endif
#endif
}
