// A vertex of a mesh, seen from a light.

in vec3 position;
in vec2 uv;
out vec2 v_uv;
uniform mat4 world_to_light;

void main() {
    v_uv = uv;
    gl_Position = world_to_light * (model * (pose() * vec4(position, 1.0)));
}
