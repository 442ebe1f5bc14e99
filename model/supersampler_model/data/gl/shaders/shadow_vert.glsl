// A vertex of a mesh, seen from a light.

in vec3 position;
in vec2 uv;
out vec2 v_uv;
uniform mat4 world_to_light;

#ifdef SKINNED
in uvec4 joints;
in vec4 weights;

layout(std140) uniform Palettes {
    mat4 palette[MAX_JOINTS];
    mat4 palette_before[MAX_JOINTS];
};
#endif

void main() {
    vec4 local = vec4(position, 1.0);
#ifdef SKINNED
    mat4 pose = mat4(0.0);
    for (int i = 0; i < 4; i++) {
        pose += weights[i] * palette[joints[i]];
    }
    local = pose * local;
#endif
    v_uv = uv;
    gl_Position = world_to_light * (model * local);
}
