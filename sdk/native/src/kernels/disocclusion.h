// Depth for disocclusion tests: the occluding depth that the next frame reads, and positions in the previous frame.
#pragma once

#include "frame.h"
#include "warp.h"

namespace ss::SS_ISA {

// Motion relative to the farthest of 3x3 samples, and the depth of that one. Of equally far ones, it is the one that
// `_farthest_3x3` takes.
SS_INLINE F motion_over_background(const Samples& s, int y, int x, F& across, F& down) {
    const ptrdiff_t here = static_cast<ptrdiff_t>(y) * s.pitch + PAD + x;
    const ptrdiff_t rows[] = {here, here - (y > 0 ? s.pitch : 0), here + (y < s.height - 1 ? s.pitch : 0)};
    const int columns[] = {0, -1, 1};
    F farthest = load(s.depth + here), mx = load(s.motion_x + here), my = load(s.motion_y + here);
    for (ptrdiff_t row : rows)
        for (int column : columns) {
            F other = load(s.depth + row + column);
            I farther = other < farthest;
            farthest = select(farther, other, farthest);
            mx = select(farther, load(s.motion_x + row + column), mx);
            my = select(farther, load(s.motion_y + row + column), my);
        }
    across = load(s.motion_x + here) - mx;
    down = load(s.motion_y + here) - my;
    return farthest;
}

// Depth of the closest of the four samples around positions, clamped to the frame.
SS_INLINE F closest_around(const Samples& s, F x, F y) {
    x = clamped(x, 0.0f, static_cast<float>(s.width - 1));
    y = clamped(y, 0.0f, static_cast<float>(s.height - 1));
    const I columns[] = {to_int(floor(x)), to_int(0.0f - floor(0.0f - x))};
    const I rows[] = {to_int(floor(y)), to_int(0.0f - floor(0.0f - y))};
    F closest = spread(-1.0f);
    for (I row : rows)
        for (I column : columns) closest = maximum(gather(s.depth, row * s.pitch + PAD + column), closest);
    return closest;
}

// Rounds components shorter than one sample: to one from THIN_MOTION on, otherwise to 0.
SS_INLINE F whole_steps(F motion) {
    F length = absolute(motion), step = select(length >= THIN_MOTION, 1.0f, F{});
    return select(length < 1.0f, select(motion < 0.0f, -step, step), motion);
}

// Occluding depth of W samples, negative where thin geometry leaves; same as `occluding_depth` of the torch module.
[[maybe_unused]] static F occluding_at(const Samples& s, int y, int x) {
    const ptrdiff_t here = static_cast<ptrdiff_t>(y) * s.pitch + PAD + x;
    const auto eroded = [&](int row) { return s.eroded_depth + s.place(row) * s.pitch + PAD + x; };
    F own = load(eroded(y)), opened = own;
    for (int row = max(y - 1, 0); row <= min(y + 1, s.height - 1); row++) {
        const float* at = eroded(row);
        for (int k = -1; k <= 1; k++) opened = maximum(load(at + k), opened);
    }
    opened = maximum(opened, 0.0f);
    F depth = load(s.depth + here);
    if (all(own >= SAME_THIN_DEPTH * depth)) return opened;
    F across, down, farthest = motion_over_background(s, y, x, across, down);
    across = whole_steps(across), down = whole_steps(down);
    I apart = (farthest >= 0.0f) & (farthest < SAME_THIN_DEPTH * depth);
    F steps = select(apart, maximum(absolute(across), absolute(down)), 0.0f);
    if (all(steps <= 0.0f)) return opened;
    F follows = closest_around(s, across + to_float(ramp() + x), down + static_cast<float>(y));
    return select((steps > 0.0f) & (follows < SAME_THIN_DEPTH * depth), -depth, opened);
}

// Positions in samples of the previous frame.
struct Previous {
    F x, y;
};
SS_INLINE Previous previous_of(const PreviousFrame& p, F px, F py, Size display) {
    const float width = static_cast<float>(display.width), height = static_cast<float>(display.height);
    return {(px + 0.5f) * static_cast<float>(p.width) / width - 0.5f - p.jitter[0],
            (py + 0.5f) * static_cast<float>(p.height) / height - 0.5f - p.jitter[1]};
}

}  // namespace ss::SS_ISA
