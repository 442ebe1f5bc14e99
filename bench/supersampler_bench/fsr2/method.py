"""`fsr2-like`: pass 5 of FSR2, reproject and accumulate, and the step through all passes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from supersampler.conventions.jitter import jitter_phase_count
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.display import MAX_HALF, usable_exposure
from supersampler_bench.fsr2 import passes
from supersampler_bench.fsr2.images import (
    EPSILON,
    FrameSizes,
    bilinear,
    buffers_of,
    centres,
    from_ycocg,
    inverse_tonemap,
    lanczos,
    lerp,
    prepared,
    saturate,
    to_ycocg,
    tonemap,
)
from supersampler_bench.fsr2.passes import Bool, ColorBox, DepthClip

FSR2_LIKE = "fsr2-like"
"""Name of the method in `bench quality`."""
_AVERAGE_WEIGHT = 0.74 * passes.UPSAMPLE_WEIGHT_SCALE  # that one frame adds to a pixel
_STEP = 1.0 / 255.0  # of the lumas, which FSR2 keeps in 8 bits


class Fsr2History(NamedTuple):
    """History tensors at display size.

    Attributes:
        color: (H, W, 4) linear RGB without exposure, and the reactive factor, negative where it moved.
        locks: (H, W, 2) lifetime and luma. A lifetime of 0 is no lock, one above 1 an active lock; the luma
            is that of the shading at the time of the lock.
        lumas: (H, W, 4), lumas of four frames, the latest first.
    """

    color: Array
    locks: Array
    lumas: Array


class Prepared(NamedTuple):
    """Results of the passes before accumulation.

    Attributes:
        color: (h, w, 3) linear RGB.
        motion: (h, w, 2), dilated, render pixels.
        clip: of pass 3.
        locked: (H, W), new locks.
        shading: (H, W), see `passes.shading_luma`.
        exposure: of the frame.
    """

    color: Array
    motion: Array
    clip: DepthClip
    locked: Bool
    shading: Array
    exposure: float


@dataclass(frozen=True)
class _Pixels:
    """Display pixels, (H, W) each: position in the previous frame, speed in display pixels, and masks."""

    x: Array
    y: Array
    speed: Array
    is_new: Bool
    stays: Bool
    disoccluded: Array
    mask: Array


class LockUpdate(NamedTuple):
    """Locks after this frame's shading, (H, W) each.

    Attributes:
        lifetime: of the lock.
        luma: of the lock.
        contribution: fraction of the history that the lock keeps from rectification.
        change: of the shading, 0 to 1.
        reactive: the reactive factor, raised where the shading changed.
    """

    lifetime: Array
    luma: Array
    contribution: Array
    change: Array
    reactive: Array


def accumulate(frame: Prepared, history: Fsr2History | None, sizes: FrameSizes) -> Fsr2History:
    """Run pass 5; the image is the first three channels of the colour that it returns."""
    pixels = _pixels(frame, history is None, sizes)
    warped = _reprojected(history, pixels, sizes)
    reactive = saturate(np.abs(warped.color[..., 3]))
    locked = frame.locked & ~pixels.is_new
    locks = update_locks(warped.locks, locked, frame.shading, reactive, pixels.mask, pixels.disoccluded)
    color = to_ycocg(prepared(frame.color, frame.exposure))
    kernel_reactive = np.maximum(locks.reactive, pixels.is_new)
    now = passes.upsample(color, kernel_reactive, pixels.disoccluded, pixels.speed, sizes)
    steady = np.maximum(np.maximum(pixels.disoccluded, pixels.mask), locks.change) < 0.1
    known_lumas = np.where(steady[..., None], warped.lumas, np.float32(0.0))
    unstable, lumas = luma_instability(now.box, known_lumas, locks.reactive, pixels.mask)
    before, weight = rectify(
        to_ycocg(prepared(warped.color[..., :3], frame.exposure)),
        _base_accumulation(pixels, locks.reactive, warped.color[..., 3] < 0.0, now.weight),
        now.box,
        np.maximum(unstable, locks.contribution),
        sizes,
        untrusted=np.maximum(pixels.disoccluded, pixels.mask),
        speed=pixels.speed,
    )
    alpha = now.weight / np.maximum(EPSILON, weight + now.weight)
    toned_before, toned_now = (to_ycocg(tonemap(from_ycocg(c))) for c in (before, now.color))
    blended = inverse_tonemap(from_ycocg(lerp(toned_before, toned_now, alpha[..., None])))
    image = np.where(pixels.is_new[..., None], from_ycocg(now.color), blended) / np.float32(frame.exposure)
    image = np.clip(image, np.float32(0.0), np.float32(MAX_HALF))
    return Fsr2History(
        np.concatenate([image, _next_reactive(pixels, locks.reactive)[..., None]], axis=-1),
        aged(locks, now.weight, pixels.stays, sizes),
        lumas,
    )


def _pixels(frame: Prepared, is_reset: bool, sizes: FrameSizes) -> _Pixels:
    x, y = centres(sizes.display)
    render_x, render_y = x / sizes.upscale[0], y / sizes.upscale[1]
    motion = frame.motion[render_y.astype(np.int64), render_x.astype(np.int64)] * sizes.upscale
    before_x, before_y = x + motion[..., 0], y + motion[..., 1]
    clip = bilinear(np.stack(frame.clip, axis=-1), render_x - sizes.jitter[0], render_y - sizes.jitter[1])
    return _Pixels(
        x=before_x,
        y=before_y,
        speed=np.hypot(motion[..., 0], motion[..., 1]),
        is_new=np.logical_not(_inside(before_x, before_y, sizes)) | is_reset,
        stays=_inside(x - motion[..., 0], y - motion[..., 1], sizes),
        disoccluded=saturate(clip[..., 0]),
        mask=clip[..., 1],
    )


def _inside(x: Array, y: Array, sizes: FrameSizes) -> Bool:
    width, height = sizes.display
    return np.asarray((x >= 0.0) & (x <= width) & (y >= 0.0) & (y <= height))


def _reprojected(history: Fsr2History | None, pixels: _Pixels, sizes: FrameSizes) -> Fsr2History:
    """Return the history where each pixel was; 0 where it is new."""
    width, height = sizes.display
    if history is None:
        return Fsr2History(*(np.zeros((height, width, n), np.float32) for n in (4, 2, 4)))
    samplers = lanczos, bilinear, bilinear
    sampled = (sample(part, pixels.x, pixels.y) for sample, part in zip(samplers, history, strict=True))
    return Fsr2History(*(np.where(pixels.is_new[..., None], np.float32(0.0), part) for part in sampled))


def _base_accumulation(pixels: _Pixels, reactive: Array, moved: Bool, weight: Array) -> Array:
    """Return the weight of the history: at most 1, less where it is doubtful or moves."""
    base = np.logical_not(pixels.is_new) * (1.0 - reactive) * (1.0 - pixels.disoccluded)
    slow = np.maximum(moved, saturate(pixels.speed * 10.0))
    base = np.minimum(base, lerp(base, weight * 10.0, slow))
    return np.asarray(np.minimum(base, lerp(base, weight, saturate(pixels.speed / np.float32(20.0)))))


def _next_reactive(pixels: _Pixels, reactive: Array) -> Array:
    """Return the reactive factor for the next frame: squared, and negative where the pixel moves."""
    factor = np.minimum(reactive, 0.99)
    factor = np.maximum(factor, lerp(factor, 0.4, saturate(pixels.speed)))
    factor = np.maximum(factor * factor, pixels.disoccluded * 0.1)
    factor = np.where(pixels.is_new, np.float32(1.0), factor)
    return np.where(pixels.speed * 10.0 >= 1.0, -np.maximum(factor, EPSILON), factor)


def update_locks(
    locks: Array, locked: Bool, shading: Array, reactive: Array, mask: Array, disoccluded: Array
) -> LockUpdate:
    """Update the reprojected locks (H, W, 2) by new ones and by the shading; all (H, W)."""
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


def aged(update: LockUpdate, weight: Array, stays: Bool, sizes: FrameSizes) -> Array:
    """Return the locks (H, W, 2) for the next frame; those about to leave the screen end."""
    phases = jitter_phase_count(sizes.display[0] / sizes.render[0])
    older = np.maximum(update.lifetime - weight / np.float32(phases * _AVERAGE_WEIGHT), 0.0)
    return np.stack([np.where(stays, older, np.float32(0.0)), update.luma], axis=-1)


def _min_over_max(a: Array, b: Array) -> Array:
    low, high = np.minimum(a, b), np.maximum(a, b)
    return np.where(high != 0.0, low / np.where(high != 0.0, high, np.float32(1.0)), np.float32(0.0))


def luma_instability(box: ColorBox, lumas: Array, reactive: Array, mask: Array) -> tuple[Array, Array]:
    """Find pixels whose luma is nearer to that of an older frame than to the last one's.

    Args:
        box: of this frame.
        lumas: (H, W, 4) of the previous frames, reprojected; 0 where they are not known.
        reactive: (H, W).
        mask: (H, W), of diverging motion.

    Returns:
        Instability (H, W), and the lumas for the next frame.
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
    shifted = np.concatenate([luma[..., None], lumas[..., :3]], axis=-1)
    return np.where(flickers & known, trusted, np.float32(0.0)), shifted


def rectify(
    history: Array,
    accumulation: Array,
    box: ColorBox,
    kept: Array,
    sizes: FrameSizes,
    *,
    untrusted: Array,
    speed: Array,
) -> tuple[Array, Array]:
    """Clamp the history to the box, and shorten its accumulation where it was outside.

    Args:
        history: (H, W, 3) YCoCg.
        accumulation: (H, W), weight of the history.
        box: of this frame.
        kept: (H, W), fraction of the history that locks and flicker keep as it is.
        sizes: of the frame.
        untrusted: (H, W), the larger of disocclusion and diverging motion.
        speed: (H, W) display pixels.
    """
    widest = min(20.0, float(sizes.upscale[0] * sizes.upscale[1]) ** 3)
    scale = lerp(widest, 1.0, np.maximum(untrusted, saturate(speed / np.float32(20.0))))[..., None]
    low = np.maximum(box.low, box.centre - scale * box.deviation)
    high = np.minimum(box.high, box.centre + scale * box.deviation)
    outside = np.asarray(((history < low) | (history > high)).any(axis=-1))
    clamped = np.where(outside[..., None], np.clip(history, low, high), history)
    shortened = np.where(outside, np.minimum(accumulation, 0.1), accumulation)
    kept = saturate(kept)
    return lerp(clamped, history, kept[..., None]), lerp(shortened, accumulation, kept)


class Fsr2Like:
    """FSR 2.2 without sharpening and reactive masks; see docs/quality.md.

    Args:
        display_size: (width, height) of the images.
        frame_seconds: between two frames, by which the measured exposure follows the light.
    """

    def __init__(self, display_size: Size, frame_seconds: float = 1.0 / 60.0) -> None:
        self._display, self._seconds = display_size, frame_seconds
        self._reset()

    def _reset(self) -> None:
        self._history: Fsr2History | None = None
        self._motion: Array | None = None  # (h, w, 2), dilated, fractions of the image
        self._average_log: float | None = None

    def step(self, frame: Frame) -> Float32:
        """Return the image (H, W, 3), linear RGB in [0, 65504].

        Raises:
            FrameError: the frame has no colour.
        """
        buffers = buffers_of(frame)
        if frame.reset:
            self._reset()
        sizes = FrameSizes(frame.size, self._display, frame.jitter)
        logs = passes.log_luma(buffers.color, sizes)
        self._average_log = passes.followed_average(logs, self._average_log, self._seconds)
        exposure = usable_exposure(frame.exposure) or passes.auto_exposure(self._average_log)
        dilated = passes.dilate(buffers.depth, buffers.motion, sizes)
        motion = sizes.of_image(dilated.motion)
        before = np.zeros_like(motion) if self._motion is None else self._motion
        ready = Prepared(
            color=buffers.color,
            motion=dilated.motion,
            clip=passes.depth_clip(buffers, dilated, before, sizes),
            locked=passes.new_locks(passes.lock_luma(buffers.color, exposure), sizes),
            shading=passes.shading_luma(passes.shading_grid(logs), exposure, sizes),
            exposure=exposure,
        )
        self._history, self._motion = accumulate(ready, self._history, sizes), motion
        return np.ascontiguousarray(self._history.color[..., :3], np.float32)
