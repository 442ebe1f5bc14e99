// The image in a storage buffer, as an array (H, W, 3) of float32.

@group(1) @binding(4) var<storage, read_write> image: array<f32>;

fn store_image(p: vec2i, color: vec3f) {
    let i = 3u * index_of(p, display_size());
    image[i] = color.r;
    image[i + 1u] = color.g;
    image[i + 2u] = color.b;
}
