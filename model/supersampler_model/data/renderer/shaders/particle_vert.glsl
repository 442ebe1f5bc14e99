// A square that faces the camera.

in vec4 sphere;    // centre, radius
in vec4 particle;  // premultiplied colour
out vec2 v_corner;
out vec4 v_particle;

void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    vec4 clip = world_to_clip * vec4(sphere.xyz + sphere.w * (corner.x * right.xyz + corner.y * up.xyz), 1.0);
    v_corner = corner;
    v_particle = particle;
    gl_Position = vec4(clip.xy * window.xy + clip.w * window.zw, clip.zw);
}
