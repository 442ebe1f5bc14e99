// Writes depth only; discards holes.

in vec2 v_uv;

void main() {
    if (has_maps.x > 0.5 && texture(base_color_map, v_uv).a < material.w) {
        discard;
    }
}
