"""The passes of `fsr2-like` before it accumulates: luminance, dilation, depth clip, new locks, upsampling."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array
from supersampler_bench.fsr2.images import (
    EPSILON,
    FrameBuffers,
    FrameSizes,
    Indices,
    bilinear,
    centres,
    lanczos2_of_square,
    length,
    lerp,
    luma,
    neighbours,
    perceived_luma,
    prepared,
    saturate,
    shifted,
    tonemap,
)

Bool = NDArray[np.bool_]

# Pass 1, luminance pyramid: log luminance in cells of 32x32 pixels, and the exposure.
# exposure = 1 / Lmax,  Lmax = 78 / (0.65 S) 2^log2(Lavg S / K),  S = 100,  K = 12.5

_CELL = 32  # pixels a side of mip 4 of half the render size, FFX_FSR2_SHADING_CHANGE_MIP_LEVEL


def log_luma(color: Array, sizes: FrameSizes) -> Array:
    """Return ln of the luminance (h, w), sampled where pixel centres are without jitter."""
    x, y = centres(sizes.render)
    return np.log(np.maximum(luma(bilinear(color, x - sizes.jitter[0], y - sizes.jitter[1])), EPSILON))


def shading_grid(logs: Array) -> Array:
    """Return the mean of each whole cell, (max(h // 32, 1), max(w // 32, 1)); off screen counts as 0."""
    rows, columns = (max(side // _CELL, 1) for side in logs.shape)
    whole = np.zeros((rows * _CELL, columns * _CELL), np.float32)
    inside = logs[: rows * _CELL, : columns * _CELL]
    whole[: inside.shape[0], : inside.shape[1]] = inside
    return np.asarray(whole.reshape(rows, _CELL, columns, _CELL).mean(axis=(1, 3)))


def followed_average(logs: Array, before: float | None, seconds: float) -> float:
    """Return the mean log luminance as the exposure follows it; `before` is that of the previous frame."""
    mean = float(logs.mean(dtype=np.float64))
    return mean if before is None else before + (mean - before) * (1.0 - math.exp(-seconds))


def auto_exposure(average_log: float) -> float:
    """Return the exposure for a mean log luminance, the response of film of ISO 100."""
    speed, calibration, vignetting = 100.0, 12.5, 0.65
    return vignetting * speed / 78.0 / (math.exp(average_log) * speed / calibration)


def shading_luma(grid: Array, exposure: float, sizes: FrameSizes) -> Array:
    """Return the luma that reveals shading changes, (H, W): sixth root of exposed luminance of the grid.

    The grid, stretched to the display as FSR2 does it, lacks what is right of and below its last whole cell.
    """
    x, y = centres(sizes.display)
    rows, columns = grid.shape
    across, down = x / sizes.display[0] * columns, y / sizes.display[1] * rows
    logs = bilinear(grid[..., None], across, down)[..., 0]
    return np.power(np.float32(exposure) * np.exp(logs), np.float32(1.0 / 6.0))


# Pass 2, reconstruct and dilate: depth and motion of the nearest neighbour, and the depth that the previous
# frame had at these pixels.

BILINEAR_THRESHOLD = 0.01
"""fReconstructedDepthBilinearWeightThreshold: texels of a smaller bilinear weight count as untouched."""
_DILATE_MIN_SPEED, _CLIP_MIN_SPEED = 0.1, 0.01  # display pixels; less motion counts as none
_ORDER = ((1, 0), (0, 1), (0, -1), (-1, 0), (-1, 1), (1, 1), (-1, -1), (1, -1))


class Dilated(NamedTuple):
    """Depth (h, w) and motion (h, w, 2) of the closest of 3x3, and the reconstructed previous depth (h, w).

    The previous depth is 0 where no pixel of this frame came from.
    """

    depth: Array
    motion: Array
    previous: Array


def dilate(depth: Array, motion: Array, sizes: FrameSizes) -> Dilated:
    """Run the pass on a frame's depth and motion."""
    near_depth, near_motion = depth, motion
    for dx, dy in _ORDER:
        other = shifted(depth, dx, dy)
        closer = other > near_depth
        near_depth = np.where(closer, other, near_depth)
        near_motion = np.where(closer[..., None], shifted(motion, dx, dy), near_motion)
    previous = np.zeros_like(near_depth)
    for row, column, _, counts in _texels_around(near_motion, sizes, _DILATE_MIN_SPEED):
        np.maximum.at(previous, (row[counts], column[counts]), near_depth[counts])
    return Dilated(near_depth, near_motion, previous)


def _texels_around(
    motion: Array, sizes: FrameSizes, min_speed: float
) -> Sequence[tuple[Indices, Indices, Array, Bool]]:
    """Return row, column, weight and validity of four previous texels around each pixel plus its motion.

    Indices are clamped.
    """
    width, height = sizes.render
    motion = motion * (sizes.speed(motion) > min_speed)[..., None]
    x, y = (centre + motion[..., axis] - np.float32(0.5) for axis, centre in enumerate(centres(sizes.render)))
    left, top = np.floor(x), np.floor(y)
    found = []
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = (1.0 - np.abs(left + dx - x)) * (1.0 - np.abs(top + dy - y))
        on_screen = (left + dx >= 0) & (left + dx < width) & (top + dy >= 0) & (top + dy < height)
        row = np.clip(top + dy, 0, height - 1).astype(np.int64)
        column = np.clip(left + dx, 0, width - 1).astype(np.int64)
        found.append((row, column, weight, on_screen & (weight > BILINEAR_THRESHOLD)))
    return found


# Pass 3, depth clip: disocclusion, and diverging motion, where the history is not valid. Separation of
# depths: Akeley and Su, Minimum Triangle Separation for Correct Z-Buffer Occlusion, 2006.

_FIELD_OF_VIEW = math.radians(60.0)  # vertical: an input of FSR2 that frames here do not have
_SEPARATION = 1.37e-5
_FAR = float(np.finfo(np.float32).eps)  # FSR2 adds it to depth so that the sky has a distance
_FULL_SIZE = math.hypot(1920.0, 1080.0)


class DepthClip(NamedTuple):
    """Results of the pass, (h, w) each, in [0, 1].

    Attributes:
        disoccluded: 1 where the surface was occluded in the previous frame.
        mask: 1 where motion of neighbours, or of two frames, diverges.
    """

    disoccluded: Array
    mask: Array


def depth_clip(
    buffers: FrameBuffers, dilated: Dilated, previous_motion: Array, sizes: FrameSizes
) -> DepthClip:
    """Run the pass; `previous_motion` is dilated, in fractions of the image (`FrameSizes.of_image`)."""
    seen = _disoccluded(dilated, sizes) * _is_surface(dilated.previous)
    turned = _temporal_divergence(dilated.motion, previous_motion, sizes) - _depth_divergence(dilated.depth)
    return DepthClip(seen, np.maximum(saturate(turned), _motion_divergence(buffers.motion, sizes)))


def _distance(depth: Array) -> Array:
    return np.float32(1.0) / (depth + np.float32(_FAR))  # only ratios of distances are used


def _disoccluded(dilated: Dilated, sizes: FrameSizes) -> Array:
    now = _distance(dilated.depth)
    width, height = sizes.render
    tangent = math.tan(_FIELD_OF_VIEW / 2.0)
    corner = math.hypot(1.0, tangent, tangent * width / height)  # length of its ray; the centre's is 1
    separation = _SEPARATION * corner * math.hypot(width, height)
    power = 1.0 + 2.0 * min(math.hypot(width, height) / _FULL_SIZE, 1.0)
    same, total = np.zeros_like(now), np.zeros_like(now)
    for row, column, weight, valid in _texels_around(dilated.motion, sizes, _CLIP_MIN_SPEED):
        before = _distance(dilated.previous[row, column])
        behind = now - before
        counts = valid & (behind > 0.0)
        near = saturate(separation * np.maximum(now, before) / np.where(counts, behind, np.float32(1.0)))
        same += np.where(counts, np.power(near, np.float32(power)) * weight, np.float32(0.0))
        total += np.where(counts, weight, np.float32(0.0))
    clip = 1.0 - same / np.where(total > 0.0, total, np.float32(1.0))
    return np.where(total > 0.0, saturate(clip), np.float32(0.0))


def _is_surface(previous: Array) -> Array:
    """Return 0 where the depth of the previous frame falls by a hundredth twice downwards, else 1."""
    padded = np.pad(previous, ((1, 1), (0, 0)))
    above, here, below = (_distance(padded[row : row + len(previous)]) for row in range(3))
    slope = (above - here > here * 0.01) & (here - below > below * 0.01)
    return np.where(slope, np.float32(0.0), np.float32(1.0))


def _motion_divergence(motion: Array, sizes: FrameSizes) -> Array:
    """Return the divergence of 3x3 neighbours' motion (render pixels) from a moving pixel's own."""
    vectors = sizes.of_image(motion)
    fastest = length(vectors)
    moves = length(motion) > 1e-2
    convergence = np.ones_like(fastest)
    for _, other in neighbours(vectors):
        fastest = np.maximum(fastest, length(other))  # of the neighbours so far, in FSR2's order
        along = (other * vectors).sum(axis=-1) / np.where(moves, fastest * fastest, np.float32(1.0))
        convergence = np.minimum(convergence, np.where(moves, along, np.float32(1.0)))
    return saturate(1.0 - convergence) * saturate(fastest / np.float32(0.01))


def _temporal_divergence(motion: Array, previous: Array, sizes: FrameSizes) -> Array:
    """Return how much slower the previous frame was; it counts in full from 20 display pixels on."""
    h, w = previous.shape[:2]
    x, y = centres(sizes.render)
    across = (x + motion[..., 0]) / sizes.render[0] * w  # the previous render size may be another one
    down = (y + motion[..., 1]) / sizes.render[1] * h
    before = length(bilinear(previous, across, down))
    now, speed = length(sizes.of_image(motion)), sizes.speed(motion)
    fast = speed > 1.0
    slower = 1.0 - saturate(before / np.where(fast, now, np.float32(1.0)))
    return np.where(fast, lerp(0.0, slower, saturate((speed / np.float32(20.0)) ** 3)), np.float32(0.0))


def _depth_divergence(depth: Array) -> Array:
    """Return 1 - closest / farthest of 3x3: 1 along the border, 0 beside the sky."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(_distance(depth), 1), (3, 3))
    closest, farthest = windows.min(axis=(2, 3)), windows.max(axis=(2, 3))
    has_sky = (windows == _distance(np.zeros(1, np.float32))).any(axis=(2, 3))
    return np.where(has_sky, np.float32(0.0), 1.0 - closest / farthest)


# Pass 4, create locks. Locked pixels, of thin features, skip rectification.

_SIMILAR = 1.05  # quotient of lumas below which neighbours belong together
_CORNERS = (
    ((-1, -1), (0, -1), (-1, 0)),
    ((0, -1), (1, -1), (1, 0)),
    ((-1, 0), (-1, 1), (0, 1)),
    ((1, 0), (0, 1), (1, 1)),
)


def lock_luma(color: Array, exposure: float) -> Array:
    """Return the luma (h, w) that locks compare: the sixth root of the perceived one."""
    return np.power(perceived_luma(tonemap(prepared(color, exposure))), np.float32(1.0 / 6.0))


def thin_features(plane: Array) -> Bool:
    """Return where a pixel is a ridge: above or below all unlike neighbours, and in no 2x2 of like ones."""
    like, lowest, highest = {}, np.full_like(plane, np.inf), np.zeros_like(plane)
    for offset, other in neighbours(plane):
        if offset == (0, 0):
            continue
        low, high = np.minimum(plane, other), np.maximum(plane, other)
        like[offset] = (low > 0.0) & (high < _SIMILAR * low)
        lowest = np.where(like[offset], lowest, np.minimum(lowest, other))
        highest = np.where(like[offset], highest, np.maximum(highest, other))
    thick = np.logical_or.reduce([np.logical_and.reduce([like[o] for o in corner]) for corner in _CORNERS])
    return np.asarray(((plane > highest) | (plane < lowest)) & ~thick)


def new_locks(plane: Array, sizes: FrameSizes) -> Bool:
    """Return the display pixels (H, W) that the samples of thin features fell into."""
    width, height = sizes.display
    locked = np.zeros((height, width), bool)
    rows, columns = np.nonzero(thin_features(plane))
    x, y = (centre.ravel() for centre in centres(sizes.render))
    column = np.floor((x[columns] + sizes.jitter[0]) * sizes.upscale[0]).astype(np.int64)
    row = np.floor((y[rows] + sizes.jitter[1]) * sizes.upscale[1]).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    locked[row[inside], column[inside]] = True
    return locked


# Pass 5, first part: this frame's colour at display pixels, and the box of its 3x3 samples; YCoCg.

UPSAMPLE_WEIGHT_SCALE = 1.0 / 12.0
"""fUpsampleLanczosWeightScale."""


class ColorBox(NamedTuple):
    """Mean, standard deviation, minimum and maximum, (H, W, 3) each, of the samples around a pixel."""

    centre: Array
    deviation: Array
    low: Array
    high: Array


class Upsampled(NamedTuple):
    """Colour (H, W, 3) of this frame, the weight (H, W) of its samples, and their box."""

    color: Array
    weight: Array
    box: ColorBox


def upsample(color: Array, reactive: Array, disoccluded: Array, speed: Array, sizes: FrameSizes) -> Upsampled:
    """Sample a frame by Lanczos2 over 3x3 samples.

    Args:
        color: (h, w, 3) prepared YCoCg.
        reactive: (H, W), 1 where there is no history: the wider the kernel.
        disoccluded: (H, W).
        speed: (H, W) display pixels: the faster, the narrower the box.
        sizes: of the frame.
    """
    narrow = np.float32(min(1.99, float(sizes.upscale[0]))) * (1.0 - reactive)
    wide = np.maximum(1.0, (1.0 + narrow) * 0.3)
    bias = lerp(
        narrow, wide, np.maximum(0.25 * disoccluded, reactive)
    )  # above 1: narrower than a render pixel
    curve = lerp(-2.0, -3.0, saturate(speed / np.float32(50.0)))
    columns = _axis(sizes.render[0], sizes.display[0], sizes.jitter[0])
    rows = _axis(sizes.render[1], sizes.display[1], sizes.jitter[1])
    total = np.zeros((*speed.shape, 4), np.float32)
    moments = np.zeros((*speed.shape, 7), np.float32)
    samples = []
    for row, y, row_inside in rows:
        for column, x, column_inside in columns:
            sample = color[row][:, column]
            squared = y[:, None] ** 2 + x[None] ** 2
            inside = row_inside[:, None] & column_inside[None]
            weight = (lanczos2_of_square(squared * bias * bias) * inside)[..., None]
            total += weight * np.concatenate([sample, np.ones_like(weight)], axis=-1)
            box_weight = np.exp(curve * squared)[..., None]
            ones = np.ones_like(box_weight)
            moments += box_weight * np.concatenate([sample, sample * sample, ones], axis=-1)
            samples.append(sample)
    box, weight = _box(moments, samples), total[..., 3:]
    counts = weight > EPSILON  # elsewhere the colour does not count
    found = np.clip(total[..., :3] / np.where(counts, weight, np.float32(1.0)), box.low, box.high)
    scaled = np.where(counts, weight * np.float32(UPSAMPLE_WEIGHT_SCALE), np.float32(0.0))
    return Upsampled(found, scaled[..., 0], box)


def _axis(render: int, display: int, jitter: float) -> list[tuple[Indices, Array, Bool]]:
    """Return index, offset in render pixels, and whether on screen, of three samples around each pixel."""
    centre = centres((display, 1))[0][0] * np.float32(render / display)
    nearest = np.floor(centre).astype(np.int64)
    return [
        (
            np.clip(nearest + k, 0, render - 1),
            (nearest + k + np.float32(0.5 + jitter) - centre).astype(np.float32),
            (nearest + k >= 0) & (nearest + k < render),
        )
        for k in (-1, 0, 1)
    ]


def _box(moments: Array, samples: list[Array]) -> ColorBox:
    weight = moments[..., 6:]
    weight = np.where(np.abs(weight) > EPSILON, weight, np.float32(1.0))
    centre, square = moments[..., :3] / weight, moments[..., 3:6] / weight
    deviation = np.sqrt(np.abs(square - centre * centre))
    return ColorBox(centre, deviation, np.minimum.reduce(samples), np.maximum.reduce(samples))
