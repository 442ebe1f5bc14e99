// Planes of display size, one after another.
// import params

fn plane_index(plane: u32, p: vec2i) -> u32 {
    let size = display_size();
    return plane * u32(size.x * size.y) + index_of(p, size);
}
