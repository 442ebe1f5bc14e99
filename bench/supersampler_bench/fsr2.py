"""`fsr2-like`: FSR 2.2 without sharpening and reactive masks, by its published formulas and constants.

Arrays are float32: (h, w, ...) at render size, (H, W, ...) at display size. Positions are in texels, with the
centre of the first one at 0.5; reads beyond the edge clamp. docs/quality.md lists the differences from FSR2.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions.jitter import jitter_phase_count
from supersampler.errors import FrameError
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.display import BT709, MAX_HALF, usable_exposure

Bool = NDArray[np.bool_]
Indices = NDArray[np.int64]
FSR2_LIKE = "fsr2-like"
"""Name of the method in `bench quality`."""
EPSILON = 1e-3  # FSR2_EPSILON
_CELL = 32  # pixels a side of mip 4 of half the render size, FFX_FSR2_SHADING_CHANGE_MIP_LEVEL
_MIN_BILINEAR_WEIGHT = 0.01  # fReconstructedDepthBilinearWeightThreshold: smaller weights do not count
UPSAMPLE_WEIGHT_SCALE = 1.0 / 12.0  # fUpsampleLanczosWeightScale
_AVERAGE_WEIGHT = 0.74 * UPSAMPLE_WEIGHT_SCALE  # added to a pixel per frame
_DILATE_MIN_SPEED, _CLIP_MIN_SPEED = 0.1, 0.01  # display pixels; less motion counts as none
_FIELD_OF_VIEW = math.radians(60.0)  # vertical; an input of FSR2 that `Frame` does not have
_SEPARATION = 1.37e-5
_FAR = float(np.finfo(np.float32).eps)  # added to depth by FSR2, so that the sky has a distance
_FULL_SIZE = math.hypot(1920.0, 1080.0)
_SIMILAR = 1.05  # ratio of lumas below which neighbours are alike
_STEP = 1.0 / 255.0  # of lumas, which FSR2 stores in 8 bits
_DILATION = ((1, 0), (0, 1), (0, -1), (-1, 0), (-1, 1), (1, 1), (-1, -1), (1, -1))
_CORNERS = (
    ((-1, -1), (0, -1), (-1, 0)),
    ((0, -1), (1, -1), (1, 0)),
    ((-1, 0), (-1, 1), (0, 1)),
    ((1, 0), (0, 1), (1, 1)),
)
_TO_YCOCG = np.array([[0.25, 0.5, 0.25], [0.5, 0.0, -0.5], [-0.25, 0.5, -0.25]], np.float32)
_FROM_YCOCG = np.array([[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]], np.float32)


@dataclass(frozen=True)
class FrameSizes:
    """Sizes (width, height) and jitter of a frame: samples are at pixel centre + jitter, render pixels."""

    render: Size
    display: Size
    jitter: tuple[float, float]

    @property
    def upscale(self) -> Array:
        """Display size / render size, (x, y)."""
        return np.divide(self.display, self.render, dtype=np.float32)

    def of_image(self, motion: Array) -> Array:
        """Convert motion (..., 2) from render pixels to fractions of the image's size, FSR2's unit."""
        return np.divide(motion, self.render, dtype=np.float32)

    def speed(self, motion: Array) -> Array:
        """Return the length (...), display pixels, of motion (..., 2), render pixels."""
        return length(motion * self.upscale)


class ColorBox(NamedTuple):
    """Mean, standard deviation, minimum and maximum, (H, W, 3) YCoCg each, of the samples around a pixel."""

    centre: Array
    deviation: Array
    low: Array
    high: Array


class Prepared(NamedTuple):
    """Results of the passes before accumulation."""

    color: Array  # (h, w, 3) linear RGB
    motion: Array  # (h, w, 2), dilated, render pixels
    clip: Array  # (h, w, 2) in [0, 1]: disocclusion, divergence of motion
    locked: Bool  # (H, W), new locks
    shading: Array  # (H, W), see `shading_luma`
    exposure: float


class LockUpdate(NamedTuple):
    """Locks after this frame's shading, (H, W) each."""

    lifetime: Array
    luma: Array
    contribution: Array  # fraction of the history that the lock protects from rectification
    change: Array  # of the shading, 0 to 1
    reactive: Array  # the reactive factor, raised where the shading changed


class Fsr2History(NamedTuple):
    """History tensors at display size."""

    color: Array  # (H, W, 4) linear RGB without exposure; the reactive factor, negative where it moved
    locks: Array  # (H, W, 2) lifetime (0: none, above 1: active), shading luma when it was locked
    lumas: Array  # (H, W, 4), lumas of the last four frames, the latest first


class Fsr2Like:
    """Steps frames in order; a measured exposure adapts by the seconds between two frames."""

    def __init__(self, display_size: Size, frame_seconds: float = 1.0 / 60.0) -> None:
        self._display, self._seconds = display_size, frame_seconds
        self._reset()

    def _reset(self) -> None:
        self._history: Fsr2History | None = None
        self._motion: Array | None = None  # (h, w, 2), dilated, fractions of the image
        self._average_log: float | None = None

    def step(self, frame: Frame) -> Float32:
        """Return the image (H, W, 3), linear RGB in [0, 65504] times the pre-exposure; NaN counts as 0.

        Raises:
            FrameError: the frame has no colour.
        """
        if frame.color is None:
            raise FrameError("color", got=None, want="a shaded frame")
        if frame.reset:
            self._reset()
        color = _finite(frame.color / np.float32(frame.pre_exposure), 0.0, MAX_HALF)
        depth = _finite(frame.depth, 0.0, float(np.finfo(np.float32).max))
        motion = _finite(frame.motion, -MAX_HALF, MAX_HALF)
        sizes = FrameSizes(frame.size, self._display, frame.jitter)
        logs = log_luma(color, sizes)
        self._average_log = followed_average(logs, self._average_log, self._seconds)
        exposure = usable_exposure(frame.exposure) or auto_exposure(self._average_log)
        near_depth, near_motion = dilate(depth, motion)
        before = reconstructed_depth(near_depth, near_motion, sizes)
        vectors = sizes.of_image(near_motion)
        previous = np.zeros_like(vectors) if self._motion is None else self._motion
        occluded = disocclusion(near_depth, near_motion, before, sizes) * _is_surface(before)
        change = temporal_divergence(near_motion, previous, sizes) - _depth_divergence(near_depth)
        divergence = np.maximum(saturate(change), motion_divergence(motion, sizes))
        ready = Prepared(
            color=color,
            motion=near_motion,
            clip=np.stack([occluded, divergence], axis=-1),
            locked=new_locks(lock_luma(color, exposure), sizes),
            shading=shading_luma(logs, exposure, sizes),
            exposure=exposure,
        )
        self._history, self._motion = accumulate(ready, self._history, sizes), vectors
        return self._history.color[..., :3] * np.float32(frame.pre_exposure)


def _finite(array: Array, low: float, high: float) -> Array:
    return np.clip(np.nan_to_num(array.astype(np.float32), nan=0.0), np.float32(low), np.float32(high))


# Pass 1, luminance pyramid: log luminance in cells of 32x32 pixels, and the exposure.
# exposure = 1 / Lmax,  Lmax = 78 / (0.65 S) 2^log2(Lavg S / K),  S = 100,  K = 12.5


def log_luma(color: Array, sizes: FrameSizes) -> Array:
    """Return ln of the luminance (h, w), resampled at pixel centres, without jitter."""
    x, y = centres(sizes.render)
    luma = bilinear(color, x - sizes.jitter[0], y - sizes.jitter[1]) @ BT709
    return np.log(np.maximum(luma, EPSILON))


def followed_average(logs: Array, before: float | None, seconds: float) -> float:
    """Return the mean log luminance, adapted from `before`, the result of the previous frame."""
    mean = float(logs.mean(dtype=np.float64))
    return mean if before is None else before + (mean - before) * (1.0 - math.exp(-seconds))


def auto_exposure(average_log: float) -> float:
    """Return the exposure for a mean log luminance, by the response of ISO 100 film."""
    speed, calibration, vignetting = 100.0, 12.5, 0.65
    return vignetting * speed / 78.0 / (math.exp(average_log) * speed / calibration)


def shading_luma(logs: Array, exposure: float, sizes: FrameSizes) -> Array:
    """Return the luma (H, W) that reveals shading changes: sixth root of exposed luminance in 32x32 cells.

    Pixels off screen count as 0. As in FSR2, whole cells are stretched to the display, although they do not
    cover the pixels right of and below the last one.
    """
    rows, columns = (max(side // _CELL, 1) for side in logs.shape)
    whole = np.zeros((rows * _CELL, columns * _CELL), np.float32)
    inside = logs[: rows * _CELL, : columns * _CELL]
    whole[: inside.shape[0], : inside.shape[1]] = inside
    cells = whole.reshape(rows, _CELL, columns, _CELL).mean(axis=(1, 3))
    x, y = centres(sizes.display)
    across, down = x / sizes.display[0] * columns, y / sizes.display[1] * rows
    stretched = bilinear(cells[..., None], across, down)[..., 0]
    return np.power(np.float32(exposure) * np.exp(stretched), np.float32(1.0 / 6.0))


# Pass 2, reconstruct and dilate: depth and motion of the closest neighbour, and the previous frame's depth.


def dilate(depth: Array, motion: Array) -> tuple[Array, Array]:
    """Return depth and motion of the closest of 3x3 pixels."""
    near_depth, near_motion = depth, motion
    for dx, dy in _DILATION:
        other = shifted(depth, dx, dy)
        closer = other > near_depth
        near_depth = np.where(closer, other, near_depth)
        near_motion = np.where(closer[..., None], shifted(motion, dx, dy), near_motion)
    return near_depth, near_motion


def reconstructed_depth(depth: Array, motion: Array, sizes: FrameSizes) -> Array:
    """Return the previous frame's depth (h, w) from dilated depth and motion; 0 where it is unknown."""
    previous = np.zeros_like(depth)
    for row, column, _, counts in _texels_around(motion, sizes, _DILATE_MIN_SPEED):
        np.maximum.at(previous, (row[counts], column[counts]), depth[counts])
    return previous


def _texels_around(
    motion: Array, sizes: FrameSizes, min_speed: float
) -> Iterator[tuple[Indices, Indices, Array, Bool]]:
    """Yield row and column (clamped), weight and validity of the four texels around the previous position."""
    width, height = sizes.render
    motion = motion * (sizes.speed(motion) > min_speed)[..., None]
    x, y = (centre + motion[..., axis] - np.float32(0.5) for axis, centre in enumerate(centres(sizes.render)))
    left, top = np.floor(x), np.floor(y)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = (1.0 - np.abs(left + dx - x)) * (1.0 - np.abs(top + dy - y))
        on_screen = (left + dx >= 0) & (left + dx < width) & (top + dy >= 0) & (top + dy < height)
        row = np.clip(top + dy, 0, height - 1).astype(np.int64)
        column = np.clip(left + dx, 0, width - 1).astype(np.int64)
        yield row, column, weight, on_screen & (weight > _MIN_BILINEAR_WEIGHT)


# Pass 3, depth clip: disocclusion and diverging motion, which invalidate the history. Depth separation:
# Akeley and Su, Minimum Triangle Separation for Correct Z-Buffer Occlusion, 2006.


def _distance(depth: Array) -> Array:
    return np.float32(1.0) / (depth + np.float32(_FAR))  # only ratios of distances are used


def disocclusion(depth: Array, motion: Array, previous: Array, sizes: FrameSizes) -> Array:
    """Return 1 where the surface was occluded in the previous frame (h, w), from dilated depth and motion."""
    now = _distance(depth)
    width, height = sizes.render
    tangent = math.tan(_FIELD_OF_VIEW / 2.0)
    corner = math.hypot(1.0, tangent, tangent * width / height)  # length of its ray; the centre's is 1
    separation = _SEPARATION * corner * math.hypot(width, height)
    power = 1.0 + 2.0 * min(math.hypot(width, height) / _FULL_SIZE, 1.0)
    same, total = np.zeros_like(now), np.zeros_like(now)
    for row, column, weight, valid in _texels_around(motion, sizes, _CLIP_MIN_SPEED):
        before = _distance(previous[row, column])
        behind = now - before
        counts = valid & (behind > 0.0)
        near = saturate(separation * np.maximum(now, before) / np.where(counts, behind, np.float32(1.0)))
        same += np.where(counts, np.power(near, np.float32(power)) * weight, np.float32(0.0))
        total += np.where(counts, weight, np.float32(0.0))
    clip = 1.0 - same / np.where(total > 0.0, total, np.float32(1.0))
    return np.where(total > 0.0, saturate(clip), np.float32(0.0))


def _is_surface(previous: Array) -> Array:
    """Return 0 where the previous distance falls by 1 % per row over three rows, downwards; else 1."""
    padded = np.pad(previous, ((1, 1), (0, 0)))
    above, here, below = (_distance(padded[row : row + len(previous)]) for row in range(3))
    slope = (above - here > here * 0.01) & (here - below > below * 0.01)
    return np.where(slope, np.float32(0.0), np.float32(1.0))


def motion_divergence(motion: Array, sizes: FrameSizes) -> Array:
    """Return the divergence between the motion of a moving pixel and of its 3x3 neighbours."""
    vectors = sizes.of_image(motion)
    fastest = length(vectors)
    moves = length(motion) > 1e-2
    convergence = np.ones_like(fastest)
    for _, other in neighbours(vectors):
        fastest = np.maximum(fastest, length(other))  # of the neighbours so far, in FSR2's order
        along = (other * vectors).sum(axis=-1) / np.where(moves, fastest * fastest, np.float32(1.0))
        convergence = np.minimum(convergence, np.where(moves, along, np.float32(1.0)))
    return saturate(1.0 - convergence) * saturate(fastest / np.float32(0.01))


def temporal_divergence(motion: Array, previous: Array, sizes: FrameSizes) -> Array:
    """Return by which fraction the previous motion was slower, weighted by speed up to 20 display pixels.

    `previous` is dilated motion in fractions of the image (`FrameSizes.of_image`), of any render size.
    """
    h, w = previous.shape[:2]
    x, y = centres(sizes.render)
    across = (x + motion[..., 0]) / sizes.render[0] * w
    down = (y + motion[..., 1]) / sizes.render[1] * h
    before = length(bilinear(previous, across, down))
    now, speed = length(sizes.of_image(motion)), sizes.speed(motion)
    fast = speed > 1.0
    slower = 1.0 - saturate(before / np.where(fast, now, np.float32(1.0)))
    return np.where(fast, lerp(0.0, slower, saturate((speed / np.float32(20.0)) ** 3)), np.float32(0.0))


def _depth_divergence(depth: Array) -> Array:
    """Return 1 - closest / farthest distance of 3x3: 1 along the border, 0 beside the sky."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(_distance(depth), 1), (3, 3))
    closest, farthest = windows.min(axis=(2, 3)), windows.max(axis=(2, 3))
    has_sky = (windows == _distance(np.zeros(1, np.float32))).any(axis=(2, 3))
    return np.where(has_sky, np.float32(0.0), 1.0 - closest / farthest)


# Pass 4, create locks: pixels of thin features, which skip rectification.


def lock_luma(color: Array, exposure: float) -> Array:
    """Return the luma (h, w) for locks: the sixth root of CIE lightness / 100."""
    y = tonemap(prepared(color, exposure)) @ BT709
    lightness = np.where(y <= 216.0 / 24389.0, y * (24389.0 / 27.0), np.cbrt(y) * 116.0 - 16.0)
    return np.asarray(np.power(lightness.astype(np.float32) * np.float32(0.01), np.float32(1.0 / 6.0)))


def thin_features(plane: Array) -> Bool:
    """Return the ridges: pixels above or below all unlike neighbours, and in no 2x2 block of like pixels."""
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
    """Return the display pixels (H, W) that contain samples of thin features."""
    width, height = sizes.display
    locked = np.zeros((height, width), bool)
    rows, columns = np.nonzero(thin_features(plane))
    x, y = (centre.ravel() for centre in centres(sizes.render))
    column = np.floor((x[columns] + sizes.jitter[0]) * sizes.upscale[0]).astype(np.int64)
    row = np.floor((y[rows] + sizes.jitter[1]) * sizes.upscale[1]).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    locked[row[inside], column[inside]] = True
    return locked


# Pass 5, reproject and accumulate.


def accumulate(frame: Prepared, history: Fsr2History | None, sizes: FrameSizes) -> Fsr2History:
    """Run pass 5; the image is the first three channels of the colour that it returns."""
    (width, height), (x, y) = sizes.display, centres(sizes.display)
    render_x, render_y = x / sizes.upscale[0], y / sizes.upscale[1]
    motion = frame.motion[render_y.astype(np.int64), render_x.astype(np.int64)] * sizes.upscale
    speed = np.hypot(motion[..., 0], motion[..., 1])  # display pixels
    before_x, before_y = x + motion[..., 0], y + motion[..., 1]
    is_new = ~_inside(before_x, before_y, sizes) | (history is None)
    clip = bilinear(frame.clip, render_x - sizes.jitter[0], render_y - sizes.jitter[1])
    disoccluded, mask = saturate(clip[..., 0]), clip[..., 1]

    if history is None:
        warped = Fsr2History(*(np.zeros((height, width, n), np.float32) for n in (4, 2, 4)))
    else:
        read = zip((lanczos, bilinear, bilinear), history, strict=True)
        sampled = (sample(part, before_x, before_y) for sample, part in read)
        warped = Fsr2History(*(np.where(is_new[..., None], np.float32(0.0), part) for part in sampled))
    reactive = saturate(np.abs(warped.color[..., 3]))
    locks = update_locks(warped.locks, frame.locked & ~is_new, frame.shading, reactive, mask, disoccluded)
    color = prepared(frame.color, frame.exposure) @ _TO_YCOCG.T
    now, now_weight, box = upsample(color, np.maximum(locks.reactive, is_new), disoccluded, speed, sizes)
    steady = np.maximum(np.maximum(disoccluded, mask), locks.change) < 0.1
    known_lumas = np.where(steady[..., None], warped.lumas, np.float32(0.0))
    unstable, lumas = luma_instability(box, known_lumas, locks.reactive, mask)

    # the weight of the history: at most 1, less where it is uncertain or moves
    base = np.logical_not(is_new) * (1.0 - locks.reactive) * (1.0 - disoccluded)
    slow = np.maximum(warped.color[..., 3] < 0.0, saturate(speed * 10.0))
    base = np.minimum(base, lerp(base, now_weight * 10.0, slow))
    base = np.minimum(base, lerp(base, now_weight, saturate(speed / np.float32(20.0))))
    widest = min(20.0, float(sizes.upscale[0] * sizes.upscale[1]) ** 3)
    doubt = np.maximum(np.maximum(disoccluded, mask), saturate(speed / np.float32(20.0)))
    before, weight = rectify(
        prepared(warped.color[..., :3], frame.exposure) @ _TO_YCOCG.T,
        np.asarray(base),
        box,
        scale=lerp(widest, 1.0, doubt),
        kept=saturate(np.maximum(unstable, locks.contribution)),
    )
    alpha = now_weight / np.maximum(EPSILON, weight + now_weight)
    toned_before, toned_now = (tonemap(c @ _FROM_YCOCG.T) @ _TO_YCOCG.T for c in (before, now))
    blended = inverse_tonemap(lerp(toned_before, toned_now, alpha[..., None]) @ _FROM_YCOCG.T)
    image = np.where(is_new[..., None], now @ _FROM_YCOCG.T, blended) / np.float32(frame.exposure)
    image = np.clip(image, np.float32(0.0), np.float32(MAX_HALF))

    # the reactive factor for the next frame: squared, and negative where the pixel moves
    factor = np.minimum(locks.reactive, 0.99)
    factor = np.maximum(factor, lerp(factor, 0.4, saturate(speed)))
    factor = np.maximum(factor * factor, disoccluded * 0.1)
    factor = np.where(is_new, np.float32(1.0), factor)
    factor = np.where(speed * 10.0 >= 1.0, -np.maximum(factor, EPSILON), factor)
    # locks age by one per jitter period, and end if they are about to leave the screen
    phases = jitter_phase_count(width / sizes.render[0])
    lifetime = np.maximum(locks.lifetime - now_weight / np.float32(phases * _AVERAGE_WEIGHT), 0.0)
    stays = _inside(x - motion[..., 0], y - motion[..., 1], sizes)
    aged = np.stack([np.where(stays, lifetime, np.float32(0.0)), locks.luma], axis=-1)
    return Fsr2History(np.concatenate([image, factor[..., None]], axis=-1), aged, lumas)


def _inside(x: Array, y: Array, sizes: FrameSizes) -> Bool:
    width, height = sizes.display
    return np.asarray((x >= 0.0) & (x <= width) & (y >= 0.0) & (y <= height))


def update_locks(
    locks: Array, locked: Bool, shading: Array, reactive: Array, mask: Array, disoccluded: Array
) -> LockUpdate:
    """Update the reprojected locks (H, W, 2) with new ones and the shading; other arrays are (H, W)."""
    lifetime, kept = locks[..., 0], locks[..., 1]
    before = np.where(kept == 0.0, shading, kept)
    change = 1.0 - _min_over_max(before, shading)
    weak = lifetime <= 1.0
    luma = np.where(locked, shading, np.where(weak, lerp(before, shading, 0.5), before))
    again = np.where(lifetime != 0.0, np.float32(2.0), np.float32(1.0))
    held = np.where(weak | (change <= 0.1), lifetime, np.float32(0.0))
    lifetime = np.where(locked, again, held)
    reactive = np.maximum(reactive, saturate((change - 0.1) * 10.0))
    lifetime = lifetime * (1.0 - reactive) * saturate(1.0 - mask) * (disoccluded < 0.1)
    contribution = saturate(saturate(lifetime - 1.0) * 4.0) * saturate(_min_over_max(luma, shading))
    return LockUpdate(lifetime, luma, contribution, change, reactive)


def _min_over_max(a: Array, b: Array) -> Array:
    low, high = np.minimum(a, b), np.maximum(a, b)
    return np.where(high != 0.0, low / np.where(high != 0.0, high, np.float32(1.0)), np.float32(0.0))


def luma_instability(box: ColorBox, lumas: Array, reactive: Array, mask: Array) -> tuple[Array, Array]:
    """Return the instability (H, W): 1 where luma is closer to an older frame than to the last one.

    `lumas` are (H, W, 4), reprojected, 0 where they are unknown; `mask` (H, W) is the divergence of motion.
    The second result has the lumas for the next frame.
    """
    bright = box.centre[..., 0]
    luma = np.rint(bright / (1.0 + np.maximum(bright, 0.0)) * 255.0).astype(np.float32) / np.float32(255.0)
    differences = luma[..., None] - lumas
    last, older = differences[..., 0], differences[..., 1:]
    same_side = np.sign(older) == np.sign(last)[..., None]
    closest = np.where(same_side, np.abs(older), np.float32(np.inf)).min(axis=-1)
    size = saturate(box.deviation[..., 0] / np.float32(0.1)) ** 6
    flickers = (np.abs(last) >= _STEP) & (closest < np.abs(last)) & (size > _STEP)
    trusted = 1.0 - np.maximum(mask, np.power(reactive, np.float32(1.0 / 6.0)))
    known = lumas[..., 2] != 0.0  # the oldest of the four lumas that are stored below
    after = np.concatenate([luma[..., None], lumas[..., :3]], axis=-1)
    return np.where(flickers & known, trusted, np.float32(0.0)), after


def rectify(
    history: Array, accumulation: Array, box: ColorBox, *, scale: Array, kept: Array
) -> tuple[Array, Array]:
    """Clamp the history (H, W, 3) YCoCg to the box, and reduce its weight (H, W) where it was outside.

    `scale` (H, W) is half the side of the box in standard deviations, `kept` (H, W) the fraction of the
    history that locks and instability leave unchanged.
    """
    low = np.maximum(box.low, box.centre - scale[..., None] * box.deviation)
    high = np.minimum(box.high, box.centre + scale[..., None] * box.deviation)
    outside = np.asarray(((history < low) | (history > high)).any(axis=-1))
    clamped = np.where(outside[..., None], np.clip(history, low, high), history)
    shortened = np.where(outside, np.minimum(accumulation, 0.1), accumulation)
    return lerp(clamped, history, kept[..., None]), lerp(shortened, accumulation, kept)


def upsample(
    color: Array, reactive: Array, disoccluded: Array, speed: Array, sizes: FrameSizes
) -> tuple[Array, Array, ColorBox]:
    """Upsample exposed YCoCg (h, w, 3) by Lanczos2 of 3x3 samples; return colour, weight and box of samples.

    `reactive` is 1 where there is no history, and widens the kernel; `speed`, display pixels, narrows the
    window of the box.
    """
    narrow = np.float32(min(1.99, float(sizes.upscale[0]))) * (1.0 - reactive)
    wide = np.maximum(1.0, (1.0 + narrow) * 0.3)
    bias = lerp(narrow, wide, np.maximum(0.25 * disoccluded, reactive))  # above 1: below a render pixel
    curve = lerp(-2.0, -3.0, saturate(speed / np.float32(50.0)))
    columns, rows = (_axis(*axis) for axis in zip(sizes.render, sizes.display, sizes.jitter, strict=True))
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
    box_weight, weight = moments[..., 6:], total[..., 3:]
    box_weight = np.where(np.abs(box_weight) > EPSILON, box_weight, np.float32(1.0))
    centre, square = moments[..., :3] / box_weight, moments[..., 3:6] / box_weight
    deviation = np.sqrt(np.abs(square - centre * centre))
    box = ColorBox(centre, deviation, np.minimum.reduce(samples), np.maximum.reduce(samples))
    counts = weight > EPSILON  # elsewhere the colour has no weight
    found = np.clip(total[..., :3] / np.where(counts, weight, np.float32(1.0)), box.low, box.high)
    scaled = np.where(counts, weight * np.float32(UPSAMPLE_WEIGHT_SCALE), np.float32(0.0))
    return found, scaled[..., 0], box


def _axis(render: int, display: int, jitter: float) -> list[tuple[Indices, Array, Bool]]:
    """Return the index, offset (render pixels) and on-screen flag of three samples around each pixel."""
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


# Colours and texture reads.


def length(vectors: Array) -> Array:
    """Return the lengths (...) of vectors (..., n)."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def lerp(a: Array | float, b: Array | float, t: Array | float) -> Array:
    """Interpolate from a (t = 0) to b (t = 1)."""
    return np.asarray(a + (b - a) * t)


def saturate(values: Array) -> Array:
    """Clamp to [0, 1]."""
    return np.clip(values, np.float32(0.0), np.float32(1.0))


def prepared(rgb: Array, exposure: float) -> Array:
    """Expose scene-linear RGB, and clamp it to [0, 65504]."""
    return np.asarray(np.clip(rgb * np.float32(exposure), 0.0, MAX_HALF))


def tonemap(rgb: Array) -> Array:
    """Divide by 1 + the largest component, or by 1 where all are negative."""
    return np.asarray(rgb / (np.maximum(rgb.max(axis=-1, keepdims=True), 0.0) + 1.0))


def inverse_tonemap(rgb: Array) -> Array:
    """Undo `tonemap`."""
    return np.asarray(rgb / np.maximum(1.0 - rgb.max(axis=-1, keepdims=True), 1.0 / MAX_HALF))


def centres(size: Size) -> tuple[Array, Array]:
    """Return the pixel centres x (1, w) and y (h, 1) of an image of (w, h)."""
    x, y = (np.arange(side, dtype=np.float32) + np.float32(0.5) for side in size)
    return x[None], y[:, None]


def shifted(image: Array, dx: int, dy: int) -> Array:
    """Return the image whose pixel (x, y) is the input's (x + dx, y + dy)."""
    h, w = image.shape[:2]
    rows, columns = np.clip(np.arange(h) + dy, 0, h - 1), np.clip(np.arange(w) + dx, 0, w - 1)
    return image[rows][:, columns]


def neighbours(image: Array) -> Iterator[tuple[tuple[int, int], Array]]:
    """Yield (dx, dy) and the shifted image, row by row, for the 3x3 neighbourhood."""
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            yield (dx, dy), shifted(image, dx, dy)


def bilinear(image: Array, x: Array, y: Array) -> Array:
    """Sample an image (h, w, c) at positions that broadcast to (H, W)."""
    (left, right), fx = _footprint(x, image.shape[1], 1)
    (top, bottom), fy = _footprint(y, image.shape[0], 1)
    above = lerp(image[top, left], image[top, right], fx)
    below = lerp(image[bottom, left], image[bottom, right], fx)
    return lerp(above, below, fy)


def lanczos(image: Array, x: Array, y: Array) -> Array:
    """Sample like `bilinear`, with 4x4 texels of Lanczos2, clamped to the range of the central 2x2."""
    columns, fx = _footprint(x, image.shape[1], 2)
    rows, fy = _footprint(y, image.shape[0], 2)
    texels = [[image[row, column] for column in columns] for row in rows]
    sampled = _weighted([_weighted(line, fx) for line in texels], fy)
    inner = [texels[i][j] for i in (1, 2) for j in (1, 2)]
    return np.clip(sampled, np.minimum.reduce(inner), np.maximum.reduce(inner))


def lanczos2_of_square(squared: Array) -> Array:
    """Return FSR1's approximation of Lanczos2 for a squared distance; 0 from distance 2 on."""
    x2 = np.minimum(squared, np.float32(4.0))
    a, b = 2.0 / 5.0 * x2 - 1.0, 1.0 / 4.0 * x2 - 1.0
    return (25.0 / 16.0 * a * a - (25.0 / 16.0 - 1.0)) * (b * b)


def _footprint(position: Array, side: int, reach: int) -> tuple[list[Indices], Array]:
    """Return the indices of 2 `reach` texels around positions, and the distance from the inner left one."""
    first = np.floor(position - np.float32(0.5))
    fraction = (position - np.float32(0.5) - first)[..., None]
    offsets = range(1 - reach, reach + 1)
    return [np.clip(first.astype(np.int64) + k, 0, side - 1) for k in offsets], fraction


def _weighted(texels: list[Array], fraction: Array) -> Array:
    distances = [np.minimum(np.abs(k - fraction), np.float32(2.0)) for k in (-1.0, 0.0, 1.0, 2.0)]
    weights = [
        np.where(x < EPSILON, 1.0, np.sinc(x) * np.sinc(x / 2.0)).astype(np.float32) for x in distances
    ]
    total = sum(weight * texel for weight, texel in zip(weights, texels, strict=True))
    return np.asarray(total / np.sum(weights, axis=0), np.float32)
