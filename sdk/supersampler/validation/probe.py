"""Frames as the checks read them, tests of depth, and the readings of motion and jitter that are tried."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.conventions import Direction, Unit
from supersampler.conventions.encodings import srgb_decoded
from supersampler.errors import FrameError
from supersampler.frame import (
    Array,
    Float32,
    Frame,
    Size,
    as_array,
    checked_pre_exposure,
    checked_reset,
    pair_of,
)
from supersampler.io.display import luminance

PixelGrid = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns (n,) of pixels."""
GRID_PIXELS = 12_000
"""Approximate number of pixels that a check reads."""
DepthOrder = Literal["reversed", "forward", "linear"]
ORDERS: tuple[DepthOrder, ...] = ("reversed", "forward", "linear")
Overrides = dict[str, Any]
"""Fields of `Conventions`."""
MOTION_READINGS: tuple[Overrides, ...] = tuple(
    {"motion_unit": unit, "motion_direction": direction, "motion_flip_y": flip}
    for unit, direction, flip in product(get_args(Unit), get_args(Direction), (False, True))
)
JITTER_READINGS: tuple[Overrides, ...] = tuple(
    {"jitter_unit": unit, "jitter_sign": sign, "jitter_flip_y": flip}
    for unit, sign, flip in product(get_args(Unit), (1, -1), (False, True))
)

_SKY_DISTANCE = 1e6  # minimum linear depth of the sky
_DISTANCE_RATIO = 1.1  # minimum ratio of the distances of two surfaces; an approaching surface changes less
_MIN_PIXELS = 100  # minimum number for a median
_CROP_SIDE = 400  # pixels: side of the central square that `plane_curvature` reads
_ROUNDING = 1e-6  # relative rounding error of float32 depth


@dataclass(frozen=True, slots=True, eq=False)
class FrameProbe:
    """One frame with row 0 on top and linear luminance; depth, motion and jitter are not converted.

    Attributes:
        light: (h, w) luminance without pre-exposure; None for an unshaded frame.
        depth: (h, w).
        motion: (h, w, 2), or (H, W, 2) at display size.
        jitter: (x, y).
        reset: as in `Frame`.
        motion_next: (h, w, 2) of a `Frame`, or None.
    """

    light: Float32 | None
    depth: Array
    motion: Array
    jitter: tuple[float, float]
    reset: bool
    motion_next: Array | None = None

    @classmethod
    def of_frame(cls, frame: Frame) -> "FrameProbe":
        """Return the probe of a `Frame`; depth and motion are not copied."""
        light = None if frame.color is None else _luminance(frame.color, frame.pre_exposure)
        return cls(light, frame.depth, frame.motion, frame.jitter, frame.reset, frame.motion_next)

    @classmethod
    def of_raw(cls, raw: RawFrame, stated: Conventions) -> "FrameProbe":
        """Return the probe of a `RawFrame`, with rows and sRGB as stated; FrameError for a bad input."""

        def rows(name: str, value: object) -> NDArray[Any]:
            array = as_array(name, value)
            return array[::-1] if stated.bottom_up else array

        depth, motion = rows("depth", raw.depth), rows("motion", raw.motion)
        if depth.ndim != 2 or 0 in depth.shape:
            raise FrameError("depth", got=f"of shape {depth.shape}", want="(h, w), at least one pixel")
        if motion.ndim != 3 or motion.shape[2] != 2 or np.less(motion.shape[:2], depth.shape).any():
            want = f"({depth.shape[0]}, {depth.shape[1]}, 2), or larger at display size"
            raise FrameError("motion", got=f"of shape {motion.shape}", want=want)
        light = None
        if raw.color is not None:
            color = rows("color", raw.color)
            if color.shape != (*depth.shape, 3):
                want = f"{(*depth.shape, 3)}, the size of depth"
                raise FrameError("color", got=f"of shape {color.shape}", want=want)
            pre_exposure = checked_pre_exposure(raw.pre_exposure)
            light = _luminance(srgb_decoded(color) if stated.srgb else color, pre_exposure)
        jitter = (0.0, 0.0) if raw.jitter is None else pair_of(raw.jitter)
        return cls(light, depth, motion, jitter, checked_reset(raw.reset))

    @property
    def size(self) -> Size:
        """Render size (width, height)."""
        return self.depth.shape[1], self.depth.shape[0]

    def copied(self) -> "FrameProbe":
        """Return a copy to compare with the next frame: engines reuse their buffers."""
        following = None if self.motion_next is None else self.motion_next.copy()
        return replace(self, depth=self.depth.copy(), motion=self.motion.copy(), motion_next=following)

    def jitter_pixels(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return the jitter (x, y) in render pixels, interpreted by these conventions."""
        return np.multiply(self.jitter, conventions.jitter_factor(self.size))

    def vectors(self, conventions: Conventions, pixels: PixelGrid, *, swapped: bool = False) -> Float32:
        """Return (n, 2) motion of these pixels in render pixels, interpreted by these conventions.

        Jitter in the vectors is not removed. `swapped` exchanges x and y.
        """
        height, width = self.motion.shape[:2]
        rows = (pixels[0] * 2 + 1) * height // (2 * self.size[1])
        columns = (pixels[1] * 2 + 1) * width // (2 * self.size[0])
        vectors = self.motion[rows, columns].astype(np.float32)
        factor = np.array(conventions.motion_factor(self.size, (width, height)), np.float32)
        result: Float32 = (vectors[:, ::-1] if swapped else vectors) * factor
        return result


def _luminance(color: Array, pre_exposure: float) -> Float32:
    values = luminance(color.astype(np.float32, copy=False))  # `FramePair` skips NaN and Inf
    return values / np.float32(pre_exposure)


def tone_mapped(light: Float32, like: Float32) -> Float32:
    """Return luminance in [0, 1], 0.5 at the median of lit pixels of `like`; NaN where it is not finite."""
    values = like[pixel_grid((like.shape[1], like.shape[0]))]
    lit = values[np.isfinite(values) & (values > 0)]
    tone = np.maximum(light, 0)
    tone /= tone + np.float32(np.median(lit) if lit.size else np.inf)  # Inf / Inf is NaN
    return tone


def pixel_grid(size: tuple[int, int], count: int = GRID_PIXELS) -> PixelGrid:
    """Return a regular grid of about `count` pixels at most in an image of (width, height)."""
    step = max(1, int(np.ceil(np.sqrt(size[0] * size[1] / count))))
    columns, rows = (np.arange(step // 2 if step // 2 < extent else 0, extent, step) for extent in size)
    return rows.repeat(len(columns)), np.tile(columns, len(rows))


def reading_text(field: Literal["motion", "jitter"], reading: Conventions) -> str:
    """Return a reading of motion or jitter as text: "uv, current minus previous, y flipped"."""
    if field == "jitter":
        sign = "centre + jitter" if reading.jitter_sign == 1 else "centre - jitter"
        return f"{reading.jitter_unit}, {sign}{', y flipped' if reading.jitter_flip_y else ''}"
    unit = reading.motion_unit if reading.motion_scale == (1.0, 1.0) else "display pixels"
    flip = ", y flipped" if reading.motion_flip_y else ""
    jitter = ", with jitter in it" if reading.motion_jittered else ""
    return f"{unit}, {reading.motion_direction.replace('_', ' ')}{flip}{jitter}"


def _inverse_distance(depth: Array, order: DepthOrder) -> NDArray[np.float64]:
    """Return 1 / distance up to a factor and, for a finite far plane, an offset; NaN at the sky."""
    values = depth.astype(np.float64)
    if order == "linear":
        inverse = np.where(values < _SKY_DISTANCE, 1 / values, np.nan)
    else:
        inverse = values if order == "reversed" else 1 - values
    return np.where((inverse > 0) & np.isfinite(inverse), inverse, np.nan)


def plane_curvature(depth: Array, order: DepthOrder) -> float:
    """Return how curved 1 / distance is in screen space; along a plane it is linear.

    The value is the median ratio of second to first differences, beyond rounding errors, in the middle of the
    image; NaN if no neighbours differ.
    """
    top, left = (max(0, extent // 2 - _CROP_SIDE // 2) for extent in depth.shape)
    inverse = _inverse_distance(depth[top : top + _CROP_SIDE, left : left + _CROP_SIDE], order)
    scale = np.ones_like(inverse) if order == "forward" else inverse
    parts = []
    for lines, scales in ((inverse.T, scale.T), (inverse, scale)):  # along columns, then rows
        first = np.diff(lines)
        before, after = first[:, :-1], first[:, 1:]
        slope, rounding = np.abs(before) + np.abs(after), _ROUNDING * scales[:, 1:-1]
        known = slope > 20 * rounding  # False where NaN
        parts.append(np.maximum(np.abs(after - before) - rounding, 0)[known] / slope[known])
    values = np.concatenate(parts)
    return float(np.median(values)) if values.size else float("nan")


def sky_fraction(depth: Array, order: DepthOrder) -> float:
    """Return the fraction of pixels with the sky's value in this order."""
    if order == "linear":
        return float(np.mean(depth >= _SKY_DISTANCE))
    return float(np.mean(depth == (0.0 if order == "reversed" else 1.0)))


def count_disoccluded(
    now: Array, before: Array, order: DepthOrder, pixels: PixelGrid, offset: NDArray[np.floating[Any]]
) -> tuple[int, int]:
    """Count disoccluded pixels whose occluder in the previous frame is (closer, farther) than the pixel.

    With the right depth order, occluders are closer. `now` and `before` are (h, w) depths of this and the
    previous frame; `offset` is (n, 2) pixels from each pixel to its place in the previous frame.
    """
    height, width = now.shape
    rows, columns = pixels
    inside = np.isfinite(offset).all(axis=1)
    offset = np.where(inside[:, None], offset, 0)
    previous_rows = np.rint(rows + offset[:, 1]).astype(np.intp)
    previous_columns = np.rint(columns + offset[:, 0]).astype(np.intp)
    inside &= (previous_rows >= 0) & (previous_rows < height)
    inside &= (previous_columns >= 0) & (previous_columns < width)
    low, high = _range_3x3(now, order, rows, columns)
    previous_low, previous_high = _range_3x3(before, order, previous_rows, previous_columns)
    ratio = low[inside] / previous_low[inside]
    if np.isfinite(ratio).sum() >= _MIN_PIXELS:  # a camera that moves forward scales all distances
        scale = np.nanmedian(ratio)
        previous_low, previous_high = scale * previous_low, scale * previous_high
    closer = inside & (previous_low > _DISTANCE_RATIO * high)
    farther = inside & (low > _DISTANCE_RATIO * previous_high)
    return int(closer.sum()), int(farther.sum())


def _range_3x3(
    depth: Array, order: DepthOrder, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the minimum and maximum 1 / distance of 3 x 3 pixels; NaN if one of them is sky."""
    height, width = depth.shape
    near_rows = [np.clip(rows + step, 0, height - 1) for step in (-1, 0, 1)]
    near_columns = [np.clip(columns + step, 0, width - 1) for step in (-1, 0, 1)]
    inverse = _inverse_distance(np.stack([depth[y, x] for y in near_rows for x in near_columns]), order)
    return inverse.min(axis=0), inverse.max(axis=0)
