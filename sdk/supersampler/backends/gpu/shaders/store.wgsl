// Write the image of a pixel, with pre-exposure, and, where they are wanted, its auxiliary outputs (weight, converged).
// import params
// import image

fn store(p: vec2i, color: vec3f, maps: vec2f) {
    store_image(p, color * params.pre_exposure);
    if (params.writes_aux > 0.0) { aux[index_of(p, display_size())] = maps; }
}
