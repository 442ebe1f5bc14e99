// A vertex of a mesh, where it is and where it was.

in vec3 position;
in vec3 normal;
in vec4 tangent;
in vec2 uv;
out vec3 v_world;
out vec3 v_normal;
out vec4 v_tangent;
out vec2 v_uv;
out vec3 v_clip;         // x, y, w: divided in the fragment, never here
out vec3 v_clip_before;

#ifdef SKINNED
in uvec4 joints;
in vec4 weights;

layout(std140) uniform Palettes {
    mat4 palette[MAX_JOINTS];
    mat4 palette_before[MAX_JOINTS];
};
#endif

void main() {
#ifdef SKINNED
    mat4 pose = mat4(0.0);
    mat4 pose_before = mat4(0.0);
    for (int i = 0; i < 4; i++) {
        pose += weights[i] * palette[joints[i]];
        pose_before += weights[i] * palette_before[joints[i]];
    }
    vec4 now = pose * vec4(position, 1.0);
    vec4 before = pose_before * vec4(position, 1.0);
    vec3 posed_normal = mat3(pose) * normal;
    vec3 posed_tangent = mat3(pose) * tangent.xyz;
#else
    vec4 now = vec4(position, 1.0);
    vec4 before = now;
    vec3 posed_normal = normal;
    vec3 posed_tangent = tangent.xyz;
#endif
    vec4 world = model * now;
    vec4 clip = world_to_clip * world;
    vec4 clip_before = world_to_clip_before * (model_before * before);

    v_world = world.xyz;
    v_normal = mat3(normal_model) * posed_normal;
    v_tangent = vec4(mat3(model) * posed_tangent, tangent.w);
    v_uv = uv;
    v_clip = clip.xyw;
    v_clip_before = clip_before.xyw;
    gl_Position = vec4(clip.xy * window.xy + clip.w * window.zw, clip.zw);
}
