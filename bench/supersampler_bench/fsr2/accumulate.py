"""Pass 5, reproject and accumulate: blends the history with this frame at each display pixel."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array
from supersampler.io.display import MAX_HALF
from supersampler_bench.fsr2.buffers import EPSILON, View, lerp, saturate
from supersampler_bench.fsr2.color import from_ycocg, inverse_tonemap, prepared, to_ycocg, tonemap
from supersampler_bench.fsr2.depth_clip import Clip
from supersampler_bench.fsr2.locks import aged, update_locks
from supersampler_bench.fsr2.rectify import luma_instability, rectify
from supersampler_bench.fsr2.sampling import bilinear, centres, lanczos
from supersampler_bench.fsr2.upsample import upsample

Bool = NDArray[np.bool_]


class History(NamedTuple):
    """What goes from frame to frame at display size.

    Attributes:
        color: (H, W, 4) linear RGB without exposure, and the reactive factor, negative where it moved.
        locks: (H, W, 2), see `locks`.
        lumas: (H, W, 4), see `Instability`.
    """

    color: Array
    locks: Array
    lumas: Array


class Passed(NamedTuple):
    """What the passes before have of this frame.

    Attributes:
        color: (h, w, 3) linear RGB.
        motion: (h, w, 2), dilated, render pixels.
        clip: of pass 3.
        made: (H, W), new locks.
        shading: (H, W), see `shading_luma`.
        exposure: of the frame.
    """

    color: Array
    motion: Array
    clip: Clip
    made: Bool
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


def accumulate(passed: Passed, history: History | None, view: View) -> History:
    """Run the pass; the image is the first three channels of the colour that it returns."""
    pixels = _pixels(passed, history is None, view)
    warped = _reprojected(history, pixels, view)
    reactive = saturate(np.abs(warped.color[..., 3]))
    made = passed.made & ~pixels.is_new
    locks = update_locks(warped.locks, made, passed.shading, reactive, pixels.mask, pixels.disoccluded)
    color = to_ycocg(prepared(passed.color, passed.exposure))
    kernel_reactive = np.maximum(locks.reactive, pixels.is_new)
    now = upsample(color, kernel_reactive, pixels.disoccluded, pixels.speed, view)
    steady = np.maximum(np.maximum(pixels.disoccluded, pixels.mask), locks.change) < 0.1
    lumas = np.where(steady[..., None], warped.lumas, np.float32(0.0))
    instability = luma_instability(now.box, lumas, locks.reactive, pixels.mask)
    weight = _base_accumulation(pixels, locks.reactive, warped.color[..., 3] < 0.0, now.weight)
    before, weight = rectify(
        to_ycocg(prepared(warped.color[..., :3], passed.exposure)),
        weight,
        now.box,
        np.maximum(instability.factor, locks.contribution),
        view,
        untrusted=np.maximum(pixels.disoccluded, pixels.mask),
        speed=pixels.speed,
    )
    blended = _blended(before, now.color, now.weight / np.maximum(EPSILON, weight + now.weight))
    image = np.where(pixels.is_new[..., None], from_ycocg(now.color), blended) / np.float32(passed.exposure)
    image = np.clip(image, np.float32(0.0), np.float32(MAX_HALF))
    return History(
        np.concatenate([image, _next_reactive(pixels, locks.reactive)[..., None]], axis=-1),
        aged(locks, now.weight, pixels.stays, view),
        instability.lumas,
    )


def _pixels(passed: Passed, is_reset: bool, view: View) -> _Pixels:
    x, y = centres(view.display)
    render_x, render_y = x / view.upscale[0], y / view.upscale[1]
    motion = passed.motion[render_y.astype(np.int64), render_x.astype(np.int64)] * view.upscale
    before_x, before_y = x + motion[..., 0], y + motion[..., 1]
    is_new = np.logical_not(_inside(before_x, before_y, view)) | is_reset
    clip = bilinear(np.stack(passed.clip, axis=-1), render_x - view.jitter[0], render_y - view.jitter[1])
    return _Pixels(
        x=before_x,
        y=before_y,
        speed=np.hypot(motion[..., 0], motion[..., 1]),
        is_new=is_new,
        stays=_inside(x - motion[..., 0], y - motion[..., 1], view),
        disoccluded=saturate(clip[..., 0]),
        mask=clip[..., 1],
    )


def _inside(x: Array, y: Array, view: View) -> Bool:
    width, height = view.display
    return np.asarray((x >= 0.0) & (x <= width) & (y >= 0.0) & (y <= height))


def _reprojected(history: History | None, pixels: _Pixels, view: View) -> History:
    """Return the history where each pixel was; 0 where it is new."""
    width, height = view.display
    if history is None:
        return History(*(np.zeros((height, width, n), np.float32) for n in (4, 2, 4)))
    sampled = (
        lanczos(history.color, pixels.x, pixels.y),
        bilinear(history.locks, pixels.x, pixels.y),
        bilinear(history.lumas, pixels.x, pixels.y),
    )
    return History(*(np.where(pixels.is_new[..., None], np.float32(0.0), part) for part in sampled))


def _base_accumulation(pixels: _Pixels, reactive: Array, moved: Bool, weight: Array) -> Array:
    """Return the weight of the history: at most 1, less where it is doubtful or moves."""
    inside = np.logical_not(pixels.is_new)
    base = inside * (1.0 - reactive) * (1.0 - pixels.disoccluded)
    slow = np.maximum(moved, saturate(pixels.speed * 10.0))
    base = np.minimum(base, lerp(base, weight * 10.0, slow))
    return np.asarray(np.minimum(base, lerp(base, weight, saturate(pixels.speed / np.float32(20.0)))))


def _blended(before: Array, now: Array, alpha: Array) -> Array:
    """Blend YCoCg after the tone curve; returns linear RGB."""
    dark, bright = (to_ycocg(tonemap(from_ycocg(color))) for color in (before, now))
    return inverse_tonemap(from_ycocg(lerp(dark, bright, alpha[..., None])))


def _next_reactive(pixels: _Pixels, reactive: Array) -> Array:
    """Return the reactive factor for the next frame: squared, and negative where the pixel moves."""
    factor = np.minimum(reactive, 0.99)
    factor = np.maximum(factor, lerp(factor, 0.4, saturate(pixels.speed)))
    factor = np.maximum(factor * factor, pixels.disoccluded * 0.1)
    factor = np.where(pixels.is_new, np.float32(1.0), factor)
    return np.where(pixels.speed * 10.0 >= 1.0, -np.maximum(factor, EPSILON), factor)
