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

void main() {
    mat4 posed = pose();
    vec4 now = posed * vec4(position, 1.0);
    vec4 before = pose_before() * vec4(position, 1.0);
    vec4 world = model * now;
    vec4 clip = world_to_clip * world;
    vec4 clip_before = world_to_clip_before * (model_before * before);

    v_world = world.xyz;
    v_normal = mat3(normal_model) * (mat3(posed) * normal);
    v_tangent = vec4(mat3(model) * (mat3(posed) * tangent.xyz), tangent.w);
    v_uv = uv;
    v_clip = clip.xyw;
    v_clip_before = clip_before.xyw;
    gl_Position = vec4(clip.xy * window.xy + clip.w * window.zw, clip.zw);
}
