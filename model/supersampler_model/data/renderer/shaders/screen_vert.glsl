// One triangle that covers the picture, infinitely far away.

out vec2 v_clip_plane;  // clip.xy / clip.w without jitter

void main() {
    vec2 p = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
    v_clip_plane = (p - window.zw) / window.xy;
    gl_Position = vec4(p, 0.0, 1.0);
}
