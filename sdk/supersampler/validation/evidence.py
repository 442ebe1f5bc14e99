"""`Evidence`: one frame's luminance, depth, motion and jitter for checks and detection, and sample grids."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.encodings import srgb_decoded
from supersampler.conventions.fields import Direction, Unit, jitter_factor, motion_factor
from supersampler.errors import FrameError
from supersampler.frame import Array, Float32, Frame, Size, as_array
from supersampler.io.display import BT709

Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns (n,) of pixels."""
PLACES = 12_000
"""About how many pixels a check reads."""
Overrides = dict[str, Any]

MOTIONS: tuple[Overrides, ...] = tuple(
    {"motion_unit": unit, "motion_direction": direction, "motion_flip_y": flip}
    for unit, direction, flip in product(get_args(Unit), get_args(Direction), (False, True))
)
JITTERS: tuple[Overrides, ...] = tuple(
    {"jitter_unit": unit, "jitter_sign": sign, "jitter_flip_y": flip}
    for unit, sign, flip in product(get_args(Unit), (1, -1), (False, True))
)


def reading_text(field: Literal["motion", "jitter"], reading: Conventions) -> str:
    """Return a reading of motion or jitter as text: "uv, current minus previous, y flipped"."""
    if field == "jitter":
        sign = "centre + jitter" if reading.jitter_sign == 1 else "centre - jitter"
        return f"{reading.jitter_unit}, {sign}{', y flipped' if reading.jitter_flip_y else ''}"
    unit = reading.motion_unit if reading.motion_scale == (1.0, 1.0) else "display pixels"
    flip = ", y flipped" if reading.motion_flip_y else ""
    jitter = ", with jitter in it" if reading.motion_jittered else ""
    return f"{unit}, {reading.motion_direction.replace('_', ' ')}{flip}{jitter}"


DepthOrder = Literal["reversed", "forward", "linear"]
ORDERS: tuple[DepthOrder, ...] = ("reversed", "forward", "linear")

_SKY = {"reversed": 0.0, "forward": 1.0}
_SKY_DISTANCE = 1e6  # from here on linear depth is sky
_DISTANCE_RATIO = 1.1  # of distances that separates two surfaces; one that approaches changes less in a frame
_MIN_PLACES = 100  # minimum number of places for a median
_CROP_SIDE = 400  # side in pixels of the square in the middle that `bend` reads
_ROUNDING = 1e-6  # relative rounding error of float32 depth


def inverse_distance(depth: Array, order: DepthOrder) -> NDArray[np.float64]:
    """Return 1 / distance up to a factor and, for a finite far plane, an offset; NaN at the sky."""
    values = depth.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        if order == "linear":
            inverse = np.where(values < _SKY_DISTANCE, 1 / values, np.nan)
        else:
            inverse = values if order == "reversed" else 1 - values
        return np.where((inverse > 0) & np.isfinite(inverse), inverse, np.nan)


def bend(depth: Array, order: DepthOrder) -> float:
    """Return how curved 1 / distance is in screen space: it is linear along a plane.

    The median second difference divided by the first, beyond rounding errors, in the middle of the image; NaN
    where no neighbours differ.
    """
    height, width = depth.shape
    top, left = max(0, height // 2 - _CROP_SIDE // 2), max(0, width // 2 - _CROP_SIDE // 2)
    inverse = inverse_distance(depth[top : top + _CROP_SIDE, left : left + _CROP_SIDE], order)
    scale = np.ones_like(inverse) if order == "forward" else inverse
    parts = []
    for axis in (0, 1):
        first = np.diff(inverse, axis=axis)
        before, after = (np.delete(first, end, axis=axis) for end in (-1, 0))
        slope = np.abs(before) + np.abs(after)
        rounding = _ROUNDING * np.take(scale, range(1, scale.shape[axis] - 1), axis=axis)
        excess = np.abs(after - before) - rounding
        known = slope > 20 * rounding  # False where NaN
        parts.append(np.maximum(excess[known], 0) / slope[known])
    values = np.concatenate(parts)
    return float(np.median(values)) if values.size else float("nan")


def sky_share(depth: Array, order: DepthOrder) -> float:
    """Return the fraction of pixels with the sky's value in this order."""
    if order == "linear":
        return float(np.mean(depth >= _SKY_DISTANCE))
    return float(np.mean(depth == _SKY[order]))


def disoccluded(
    now: Array, before: Array, order: DepthOrder, places: Places, offset: NDArray[np.floating[Any]]
) -> tuple[int, int]:
    """Count disoccluded places whose occluder in the previous frame is (closer, farther) than themselves.

    With the right depth order, occluders are closer.

    Args:
        now: (h, w) depth.
        before: (h, w) depth of the previous frame.
        order: order of both.
        places: rows and columns (n,) of this frame.
        offset: (n, 2) pixels from each place to its place in the previous frame.
    """
    height, width = now.shape
    rows, columns = places
    inside = np.isfinite(offset).all(axis=1)
    offset = np.where(inside[:, None], offset, 0)
    previous_rows = np.rint(rows + offset[:, 1]).astype(np.intp)
    previous_columns = np.rint(columns + offset[:, 0]).astype(np.intp)
    inside &= (previous_rows >= 0) & (previous_rows < height)
    inside &= (previous_columns >= 0) & (previous_columns < width)
    lowest, highest = _range(now, order, rows, columns)
    previous_lowest, previous_highest = _range(before, order, previous_rows, previous_columns)
    ratio = lowest[inside] / previous_lowest[inside]
    if np.isfinite(ratio).sum() >= _MIN_PLACES:  # a camera that moves ahead brings everything closer
        scale = np.nanmedian(ratio)
        previous_lowest, previous_highest = scale * previous_lowest, scale * previous_highest
    with np.errstate(invalid="ignore"):
        closer = inside & (previous_lowest > _DISTANCE_RATIO * highest)
        farther = inside & (lowest > _DISTANCE_RATIO * previous_highest)
    return int(closer.sum()), int(farther.sum())


def _range(
    depth: Array, order: DepthOrder, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the minimum and maximum 1 / distance of each place's 3 x 3 pixels; NaN with sky in them."""
    height, width = depth.shape
    near = [
        depth[np.clip(rows + dy, 0, height - 1), np.clip(columns + dx, 0, width - 1)]
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
    ]
    inverse = inverse_distance(np.stack(near), order)
    return inverse.min(axis=0), inverse.max(axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """One frame with row 0 on top and linear luminance; depth, motion and jitter are not converted.

    Attributes:
        light: (h, w) luminance without pre-exposure; None where the frame was not shaded.
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
    def of_frame(cls, frame: Frame) -> "Evidence":
        """Return the evidence of a `Frame`; its arrays are not copied."""
        light = None if frame.color is None else luminance(frame.color)
        if light is not None and frame.pre_exposure != 1.0:
            light = light / np.float32(frame.pre_exposure)
        return cls(light, frame.depth, frame.motion, frame.jitter, frame.reset, frame.motion_next)

    @classmethod
    def of_raw(cls, raw: RawFrame, stated: Conventions) -> "Evidence":
        """Return the evidence of a `RawFrame`, with rows and sRGB as stated; FrameError for wrong shapes."""
        depth, motion = _rows("depth", raw.depth, stated), _rows("motion", raw.motion, stated)
        if depth.ndim != 2 or motion.ndim != 3 or motion.shape[2] != 2:
            shapes = f"depth {depth.shape}, motion {motion.shape}"
            raise FrameError("motion", got=shapes, want="depth (h, w), motion (h, w, 2)")
        light = None
        if raw.color is not None:
            color = _rows("color", raw.color, stated)
            light = luminance(srgb_decoded(color) if stated.srgb else color) / np.float32(raw.pre_exposure)
        return cls(light, depth, motion, raw.jitter or (0.0, 0.0), raw.reset)

    @property
    def size(self) -> Size:
        """Render size (width, height)."""
        return self.depth.shape[1], self.depth.shape[0]

    def copied(self) -> "Evidence":
        """Return a copy for the comparison with the next frame: engines reuse their buffers."""
        following = None if self.motion_next is None else self.motion_next.copy()
        return replace(self, depth=self.depth.copy(), motion=self.motion.copy(), motion_next=following)

    def jitter_pixels(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return the jitter (x, y) in render pixels, interpreted by these conventions."""
        return np.multiply(self.jitter, jitter_factor(conventions, self.size))

    def vectors(self, conventions: Conventions, places: Places, *, swapped: bool = False) -> Float32:
        """Return (n, 2) motion in render pixels, interpreted by these conventions, with its jitter.

        Args:
            conventions: conventions of the motion.
            places: rows and columns of render pixels.
            swapped: exchange x and y.
        """
        own_height, own_width = self.motion.shape[:2]
        rows = (places[0] * 2 + 1) * own_height // (2 * self.size[1])
        columns = (places[1] * 2 + 1) * own_width // (2 * self.size[0])
        vectors = self.motion[rows, columns].astype(np.float32)
        factor = np.array(motion_factor(conventions, self.size, (own_width, own_height)), np.float32)
        result: Float32 = (vectors[:, ::-1] if swapped else vectors) * factor
        return result


def _rows(name: str, value: object, stated: Conventions) -> NDArray[Any]:
    array = as_array(name, value)
    return array[::-1] if stated.bottom_up else array


def luminance(color: Array) -> Float32:
    """Return (h, w) luminance of linear (h, w, 3) colour, as a new array."""
    with np.errstate(invalid="ignore", over="ignore"):  # NaN and Inf stay; `FramePair` skips them
        values: Float32 = color.astype(np.float32, copy=False) @ BT709
    return values


def grid(size: tuple[int, int], places: int) -> Places:
    """Return rows and columns (n,) of an even grid of about `places` pixels at most in (width, height)."""
    step = max(1, int(np.ceil(np.sqrt(size[0] * size[1] / places))))
    rows, columns = np.meshgrid(
        np.arange(step // 2, size[1], step), np.arange(step // 2, size[0], step), indexing="ij"
    )
    return rows.ravel(), columns.ravel()
