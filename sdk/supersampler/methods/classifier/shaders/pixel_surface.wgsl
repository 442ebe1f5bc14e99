// The surface of a display pixel, as far as the samples around it show.
// import warped_history
// import current_frame

struct PixelSurface {
    frame: vec3f,             // colour of this frame, toned RGB
    surface: WarpedSurface,
    edge: f32,                // relative range of depth around
    further: vec2f,           // two inputs of the network: minimum and maximum luma of the history
}

// Every thread calls this before a barrier.
fn load_surfaces(origin: vec2i, thread: i32) {}

fn pixel_surface(p: vec2i, origin: vec2i, at: vec2f, now: CurrentFrame, there: Reprojection,
                 before: WarpedHistory) -> PixelSurface {
    let surface = gather_surface(there, closest_at(dilated, upper_left(at)).depth);
    let edge = closest_at(dilated, nearest(at)).edge;
    return PixelSurface(now.frame, surface, edge, vec2f(root(before.range.x), root(before.range.y)));
}

// Called instead of `pixel_surface` where nothing is computed.
fn keep_pixel(p: vec2i) {}
