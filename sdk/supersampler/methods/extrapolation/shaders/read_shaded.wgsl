// Pack the surfaces of the shaded frame, and find out whether any of its depths is valid.
// import params
// import warp_params
// import sanitize
// import surfaces

struct Surfaces {
    has_depth: atomic<u32>,     // 0 before this pass
    samples: array<vec4u>,
}

@group(0) @binding(2) var<storage, read_write> shaded_surfaces: Surfaces;
@group(0) @binding(3) var<storage, read> history_color: array<f32>;
@group(0) @binding(4) var<storage, read> history_base_color: array<f32>;
@group(0) @binding(5) var<storage, read> history_normal: array<f32>;
@group(0) @binding(6) var<storage, read> history_depth: array<f32>;

var<workgroup> tile_has_depth: atomic<u32>;

fn read_surface(index: u32) -> Surface {
    let i = 3u * index;
    let color = vec3f(history_color[i], history_color[i + 1u], history_color[i + 2u]);
    let base_color = vec3f(history_base_color[i], history_base_color[i + 1u], history_base_color[i + 2u]);
    let normal = vec3f(history_normal[i], history_normal[i + 1u], history_normal[i + 2u]);
    let known = is_known(base_color, normal, history_depth[index]) && all_valid(color);
    if (known) { atomicStore(&tile_has_depth, 1u); }
    return surface_of(base_color, normal, history_depth[index], known);
}

@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) thread: u32) {
    let p = vec2i(id.xy);
    if (thread == 0u) { atomicStore(&tile_has_depth, 0u); }
    workgroupBarrier();
    if (inside(p, shaded_size())) {
        let index = index_of(p, shaded_size());
        shaded_surfaces.samples[index] = packed(read_surface(index));
    }
    workgroupBarrier();
    if (thread == 0u && atomicLoad(&tile_has_depth) == 1u) { atomicStore(&shaded_surfaces.has_depth, 1u); }
}
