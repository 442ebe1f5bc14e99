// Densest in the middle, nothing at the rim.

in vec2 v_corner;
in vec4 v_particle;
layout(location = COLOR) out vec4 out_color;

void main() {
    float inside = max(1.0 - dot(v_corner, v_corner), 0.0);
    out_color = inside * inside * v_particle;
}
