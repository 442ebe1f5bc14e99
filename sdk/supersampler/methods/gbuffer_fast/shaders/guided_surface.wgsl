// The surface of a display pixel, from G-buffers. It replaces pixel_surface.wgsl.
// Light of this frame is resampled from 3x3 samples by the agreement of surfaces. Same as `guide` and `gather_guided`.
// import current_frame
// import gbuffers
// import relit
// import frame

@group(0) @binding(21) var next_reflectance: texture_storage_2d<r32uint, write>;
@group(0) @binding(22) var guided: texture_storage_2d<rgba32uint, write>;   // see relit.wgsl

var<workgroup> surface_tile: array<vec4u, SAMPLES_ACROSS * SAMPLES_DOWN>;   // of samples: see pack_surface
var<workgroup> depth_tile: array<f32, WIDE * WIDE>;                         // of display pixels

struct PixelSurface {
    frame: vec3f,             // colour of this frame, toned RGB
    surface: WarpedSurface,
    edge: f32,                // relative range of depth around
    further: vec2f,           // two inputs of the network: difference of the relit history and this frame; agreement
}

fn pack_surface(surface: Surface) -> vec4u {
    return vec4u(pack2x16float(surface.base_color.rg), pack2x16float(vec2f(surface.base_color.b, surface.normal.x)),
                 pack2x16float(surface.normal.yz), bitcast<u32>(surface.depth));
}

fn unpack_surface(words: vec4u) -> Surface {
    let middle = unpack2x16float(words.y);
    return Surface(vec3f(unpack2x16float(words.x), middle.x), vec3f(middle.y, unpack2x16float(words.z)),
                   bitcast<f32>(words.w));
}

// Every thread calls this after `load_samples`, before a barrier.
fn load_surfaces(origin: vec2i, thread: i32) {
    for (var i = thread; i < SAMPLES_ACROSS * SAMPLES_DOWN; i += TILE_THREADS) {
        let p = clamped(tile_first + vec2i(i % SAMPLES_ACROSS, i / SAMPLES_ACROSS), render_size());
        var surface = sample_surface(p);
        surface.depth = usable_depth(depth_at(p));
        surface_tile[i] = pack_surface(surface);
    }
    for (var i = thread; i < WIDE * WIDE; i += TILE_THREADS) {
        depth_tile[i] = display_depth(clamped(origin - 1 + vec2i(i % WIDE, i / WIDE), display_size()));
    }
}

// Toned light times reflectance, toned.
fn lit(light: vec3f, reflected: vec3f) -> vec3f {
    let color = light * reflected;
    return clamp(color / (max(1.0 - largest(light), 1.0 / MAX_HALF) + largest(color)), vec3f(0.0), vec3f(MAX_TONED));
}

struct Light {
    color: vec3f,       // toned RGB over reflectance
    agreement: f32,     // sum of the samples' weights, about 1 where a similar surface was sampled
    sampled: bool,
    motion: vec2f,      // of the sample whose depth is most similar
}

fn guide(at: vec2f, own: Surface) -> Light {
    let center = nearest(at);
    var sum = vec4f(0.0);
    var similar = 0.0;
    var known = 0.0;
    var lowest = f32(MAX_DEPTH);
    var chosen = center;
    /* unroll */ for (var k = 0; k < 9; k++) {
        let q = center + vec2i(k % 3, k / 3) - 1;
        let there = unpack_surface(surface_tile[tile_index(q)]);
        let tap = tile_sample(q);
        let away = vec2f(q) - at;
        let apart = abs(there.depth - own.depth) / max(max(there.depth, own.depth), 1e-12);
        let turned = there.normal - own.normal;
        let recolored = there.base_color - own.base_color;
        let cost = min(apart * apart * (0.5 / (DEPTH_SIGMA * DEPTH_SIGMA)), MAX_DEPTH_COST)
            + NORMAL_FALLOFF * dot(turned, turned) + BASE_COLOR_FALLOFF * dot(recolored, recolored);
        let similarity = exp(-cost);
        let distance = (gaussian1(away.x, GUIDE_SIGMA) * gaussian1(away.y, GUIDE_SIGMA) + MIN_SIMILARITY) * tap.a;
        let weight = distance * (similarity + MIN_SIMILARITY);
        sum += weight * vec4f(lit(tap.rgb, 1.0 / reflectance(there)), 1.0);
        similar += distance * similarity;
        known += distance;
        let steps = vec2i(k % 3, k / 3) - 1;
        let moved = apart + STEP_COST * f32(steps.x * steps.x + steps.y * steps.y);
        if (moved < lowest) {
            lowest = moved;
            chosen = q;
        }
    }
    var color = sum.rgb / max(sum.a, 1e-9);
    if (sum.a <= 0.0) {
        color = lit(tile_sample(center).rgb, 1.0 / reflectance(unpack_surface(surface_tile[tile_index(center)])));
    }
    let motion = usable_motion(motion_at(clamped(chosen, render_size())));
    return Light(color, min(similar, 1.0), known > 0.0, motion);
}

// Relative range of depth in 3x3 pixels.
fn edge_at(p: vec2i, origin: vec2i) -> f32 {
    let cell = p - origin + 1;
    var closest = depth_tile[cell.y * WIDE + cell.x];
    var farthest = closest;
    /* unroll */ for (var j = -1; j <= 1; j++) {
        /* unroll */ for (var i = -1; i <= 1; i++) {
            let depth = depth_tile[(cell.y + j) * WIDE + cell.x + i];
            closest = max(closest, depth);
            farthest = min(farthest, depth);
        }
    }
    return clamp((closest - max(farthest, 0.0)) / max(closest, 1e-12), 0.0, 1.0);
}

fn pixel_surface(p: vec2i, origin: vec2i, at: vec2f, now: CurrentFrame, there: Reprojection,
                 before: WarpedHistory) -> PixelSurface {
    let own = display_surface(p);
    let light = guide(at, own);
    var pixel = GuidedPixel(lit(light.color, reflectance(own)), light.sampled, light.motion, reflectance(own), 0.0);
    pixel = unpack_guided(pack_guided(pixel));    // as `compose` reads it
    let own_place = reproject(p, pixel.motion);
    let surface = gather_surface(own_place, own.depth);
    pixel.visibility = surface.visibility;
    textureStore(guided, p, pack_guided(pixel));
    if (rests(own_tile())) {
        keep_pixel(p);
    } else {
        textureStore(next_reflectance, p, vec4u(pack4x8unorm(vec4f(pixel.reflectance, 0.0)), 0u, 0u, 0u));
    }
    let relit = relit_history(own_place, pixel.reflectance);
    let difference = largest(abs(roots(relit) - roots(pixel.frame)));
    return PixelSurface(pixel.frame, surface, edge_at(p, origin), vec2f(difference, light.agreement));
}

fn keep_pixel(p: vec2i) { textureStore(next_reflectance, p, textureLoad(history_reflectance, p, 0)); }
