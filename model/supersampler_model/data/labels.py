"""Automatic labels of pixels: where history is invalid (ghosting) and where one sample aliases.

The rules are equations 1 to 9 of the supplement of Guo et al. 2022, section 2. docs/data.md lists our choices
where the supplement is silent or contradicts itself.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32
from supersampler.io.display import MAX_HALF
from supersampler.io.shot import ClassMaps

Values = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelStatistics:
    """Ranges over all samples in each pixel of one frame, at display size (W, H).

    Renderers gather linear ranges. For the labels, `toned` converts them, at one exposure for all frames that
    are compared. The curve is monotonic and treats each channel on its own, so ranges remain ranges. The
    spread of normals is the largest L1 distance from the first sample's normal, [0, 2 sqrt(3)].
    """

    depth_min: Float32  # (H, W), smallest reversed depth (near / view distance): the farthest sample
    depth_max: Float32  # (H, W), largest reversed depth: the closest sample
    color_min: Float32  # (H, W, 3), smallest value of each channel; toned: [0, 1)
    color_max: Float32  # (H, W, 3), largest value
    color: Float32  # (H, W, 3), mean linear scene RGB: the reference image; never toned
    normal_spread: Float32  # (H, W), without normal maps
    normal_mapped_spread: Float32  # (H, W), with normal maps

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        height, width = self.depth_min.shape
        return height, width

    def toned(self, exposure: float) -> "PixelStatistics":
        """Return these statistics with toned colour ranges; the own ones are linear."""
        low, high = (toned(color, exposure).astype(np.float32) for color in (self.color_min, self.color_max))
        return replace(self, color_min=low, color_max=high)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelInputs:
    """Inputs of the label rules for one frame, at display size (W, H).

    Motion belongs to the surface at the pixel's centre; after a cut, it is for a static camera.
    """

    pixels: PixelStatistics
    motion: Float32  # (H, W, 2), display pixels (x right, y down), previous minus current
    depth_before: Float32  # (H, W), reversed depth of that surface in the previous frame, visible or not
    cut: bool = False  # True on the first frame after a cut, which has no history


def toned(color: Values, exposure: float = 1.0) -> Values:
    """Convert exposed linear RGB to [0, 1): c / (1 + c) per channel, after a clamp to [0, 65504]."""
    exposed = np.clip(color * exposure, 0.0, MAX_HALF)
    return np.asarray(exposed / (1.0 + exposed))


Mask = NDArray[np.bool_]
Places = tuple[NDArray[np.intp], NDArray[np.intp]]


class Ghost(IntEnum):
    """Why the history of a pixel is invalid."""

    NONE = 0
    VISIBILITY = 1  # occluded, off screen, or before a cut
    SHADING = 2  # the lighting changed


class Alias(IntEnum):
    """Why one sample does not represent a pixel's colour."""

    NONE = 0
    GEOMETRY = 1  # edges of surfaces
    TEXTURE = 2  # detail on one surface: texture, normal map, highlights


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelThresholds:
    """Thresholds of the rules. The paper does not give T_I^G, calibrated on 16 samples, and T_IoU^G."""

    depth_ghost: float = 0.01  # T_D^G of equations 1 and 3, fraction of the closer reversed depth
    velocity: float = 1.0  # T_V^G of equations 2 and 4, square of display pixels a frame
    color_change: float = 0.05  # T_I^G of equation 5, toned colour in [0, 1)
    color_overlap: float = 0.1  # T_IoU^G of equation 6
    box_padding: float = 2.0 / 255.0  # offset of all faces of equation 6's boxes: flat pixels need volume
    openings: int = 2  # number of 3x3 erosions, then dilations, of the mask of (5) and (6)
    depth_alias: float = 0.01  # T_D^A of equation 7, fraction of the closer reversed depth
    normal: float = 0.5  # T_N^A of equation 8, L1 distance of unit vectors
    color_range: float = 0.5  # T_I^A of equation 9, fraction of the brightest sample, linear colour
    darkest: float = 0.02  # toned; equation 9 ignores darker channels, where ratios are unstable
    slope_aware: bool = True
    """Whether the depth tests (1), (3) and (7) allow for the slope of planes. The paper's tests (False) take
    every plane at a grazing angle for an edge."""


DEFAULTS = LabelThresholds()


def label(now: LabelInputs, before: LabelInputs | None, thresholds: LabelThresholds = DEFAULTS) -> ClassMaps:
    """Return the classes of one frame's pixels, values of `Ghost` and `Alias`.

    The previous frame has the same size and is toned at the same exposure; it is None after a cut.
    """
    geometry, aliased = aliasing(now.pixels, thresholds)
    if before is None or now.cut:
        occluded, relit = np.ones_like(geometry), np.zeros_like(geometry)
    else:
        occluded = _visibility_ghosting(now, before, thresholds)
        relit = _shading_ghosting(now, before, thresholds) & ~aliased
    # The paper's "shading ghosting label correction": occluded and aliased pixels are not relit.
    ghost = np.where(occluded, Ghost.VISIBILITY, np.where(relit, Ghost.SHADING, Ghost.NONE))
    alias = np.where(geometry, Alias.GEOMETRY, np.where(aliased, Alias.TEXTURE, Alias.NONE))
    return ClassMaps(ghost.astype(np.uint8), alias.astype(np.uint8))


def _visibility_ghosting(now: LabelInputs, before: LabelInputs, thresholds: LabelThresholds) -> Mask:
    """Return R_G, (H, W): the surface was occluded by a closer one of another velocity, or off screen."""
    previous, on_screen = reprojected(now.motion)
    closest = before.pixels.depth_max[previous]
    slope = _allowance(before.pixels, thresholds)[previous]  # for the spread of the samples, and rounding
    occluded = _closer(closest, now.depth_before, slope, thresholds.depth_ghost)  # (1)
    occluded &= _differs(now.motion, before.motion[previous], thresholds.velocity)  # (2)
    return _dilated(occluded | ~on_screen, now, thresholds)


def _dilated(ghosts: Mask, now: LabelInputs, thresholds: LabelThresholds) -> Mask:
    """Extend the mask to neighbours (of 8) that are behind the labelled pixel and move differently.

    Upscalers dilate motion: such a neighbour reads its history where the labelled surface was.
    """
    depth, slope = now.pixels.depth_max, _allowance(now.pixels, thresholds)
    spread = ghosts.copy()
    for source, target in _neighbours():
        behind = _closer(depth[source], depth[target], slope[source], thresholds.depth_ghost)  # (3)
        moves = _differs(now.motion[source], now.motion[target], thresholds.velocity)  # (4)
        spread[target] |= ghosts[source] & behind & moves
    return spread


def _shading_ghosting(now: LabelInputs, before: LabelInputs, thresholds: LabelThresholds) -> Mask:
    """Return R_S before its correction, (H, W): the lighting changed, on screen, not in isolated pixels."""
    previous, on_screen = reprojected(now.motion)
    low, high = now.pixels.color_min, now.pixels.color_max
    low_before, high_before = before.pixels.color_min[previous], before.pixels.color_max[previous]
    changed = _any_channel(np.abs(high - high_before) > thresholds.color_change)  # (5)
    overlap = box_overlap(low, high, low_before, high_before, thresholds.box_padding)
    return opened(on_screen & changed & (overlap < thresholds.color_overlap), thresholds.openings)  # (6)


def aliasing(pixels: PixelStatistics, thresholds: LabelThresholds = DEFAULTS) -> tuple[Mask, Mask]:
    """Return A_G and A, (H, W) each: geometry aliasing, and all aliasing."""
    slope = _allowance(pixels, thresholds)
    depth = _closer(pixels.depth_max, pixels.depth_min, slope, thresholds.depth_alias)  # (7)
    geometry = depth | (pixels.normal_spread > thresholds.normal)  # (8), without normal maps
    detail = pixels.normal_mapped_spread > thresholds.normal  # (8), with them
    return geometry, geometry | detail | color_varies(pixels, thresholds)


def color_varies(pixels: PixelStatistics, thresholds: LabelThresholds = DEFAULTS) -> Mask:
    """Return where equation 9 holds, (H, W), for linear colour: the result is independent of exposure.

    Pixels darker than `thresholds.darkest` never vary.
    With toned t = c / (1 + c), (c_max - c_min) / c_max is (t_max - t_min) / (t_max (1 - t_min)).
    """
    low, high = pixels.color_min, pixels.color_max
    varies = high - low > thresholds.color_range * high * (1.0 - low)  # (9), without a division
    return _any_channel(varies & (high > thresholds.darkest))


def reprojected(motion: Float32) -> tuple[Places, Mask]:
    """Return (rows, columns) of the nearest pixel in the previous frame, and where it is on screen, (H, W).

    Off screen, and where the motion is NaN, the position is row 0, column 0.
    """
    height, width = motion.shape[:2]
    x = np.arange(width) + 0.5 + motion[..., 0]
    y = np.arange(height)[:, None] + 0.5 + motion[..., 1]
    on_screen = (x > 0) & (x < width) & (y > 0) & (y < height)  # as in the methods, borders are off screen
    columns, rows = (np.where(on_screen, v, 0.0).astype(np.intp) for v in (x, y))
    return (rows, columns), on_screen


def plane_slope(pixels: PixelStatistics) -> Float32:
    """Return the change (H, W) of a plane's reversed depth over one pixel: |dD/dx| + |dD/dy|.

    A plane's reversed depth is linear on the screen, so the result is exact for planes. Along each axis the
    slope is the smallest of four steps: to both sides, of the closest and of the farthest samples. An edge
    changes some of the four, not all, and is thus excluded. Where the steps to both sides have opposite
    signs, the slope is 0, which excludes specks.
    """
    slope = np.zeros(pixels.shape, np.float32)
    for axis in (0, 1):
        if pixels.shape[axis] == 1:
            continue
        by_closest, by_farthest = (np.diff(d, axis=axis) for d in (pixels.depth_max, pixels.depth_min))
        step = np.where(np.abs(by_closest) < np.abs(by_farthest), by_closest, by_farthest)
        first, last = np.take(step, [0], axis), np.take(step, [-1], axis)  # borders have one side only
        one, other = np.concatenate([first, step], axis), np.concatenate([step, last], axis)
        slope += np.where((one > 0) == (other > 0), np.minimum(np.abs(one), np.abs(other)), 0.0)
    return slope


def box_overlap(low: Float32, high: Float32, low2: Float32, high2: Float32, padding: float) -> Float32:
    """Return the intersection over union (H, W), by volume, of colour boxes (H, W, 3) after padding."""
    sides = np.minimum(high, high2) - np.maximum(low, low2) + 2.0 * padding
    common = _volume(np.maximum(sides, 0.0))
    volume, volume2 = (_volume(b - a + 2.0 * padding) for a, b in ((low, high), (low2, high2)))
    return np.asarray(common / (volume + volume2 - common))


def opened(mask: Mask, times: int) -> Mask:
    """Erode and then dilate by 3x3, `times` times each: removes regions narrower than 2 `times` + 1 pixels.

    Pixels beyond the border have no influence.
    """
    for _ in range(times):
        mask = ~_max_around(~mask, (-1, 0, 1))
    for _ in range(times):
        mask = _max_around(mask, (-1, 0, 1))
    return mask


def _neighbours() -> Iterator[tuple[tuple[slice, slice], tuple[slice, slice]]]:
    """Yield (source, target) of 8 directions: all pixels with a neighbour there, and these neighbours."""
    all_, but_first, but_last = slice(None), slice(1, None), slice(None, -1)
    steps = ((but_first, but_last), (all_, all_), (but_last, but_first))  # by -1, 0, 1
    for (rows, rows_there), (columns, columns_there) in product(steps, steps):
        if rows is not all_ or columns is not all_:
            yield (rows, columns), (rows_there, columns_there)


def _closer(front: Float32, back: Float32, slope: Float32, threshold: float) -> Mask:
    """Return where `front` is closer than `back` by more than the slope plus `threshold` times `front`."""
    return np.asarray(front - back - slope > threshold * front)


def _differs(velocity: Float32, other: Float32, threshold: float) -> Mask:
    """Return where the squared distance of velocities (..., 2) is above `threshold`."""
    squared = np.square(velocity - other)
    return np.asarray(squared[..., 0] + squared[..., 1] > threshold)


# Written out, because numpy is slow to reduce a last axis of two or three elements.


def _any_channel(mask: Mask) -> Mask:
    return np.asarray(mask[..., 0] | mask[..., 1] | mask[..., 2])


def _volume(sides: Float32) -> Float32:
    return np.asarray(sides[..., 0] * sides[..., 1] * sides[..., 2])


def _allowance(pixels: PixelStatistics, thresholds: LabelThresholds) -> Float32:
    return plane_slope(pixels) if thresholds.slope_aware else np.zeros(pixels.shape, np.float32)


_REACH = 2  # maximum distance from a surface's corner of >= 90 degrees to its nearest solid square, pixels
_CLOSER = 0.01  # fraction of the closer reversed depth, as T_D^A of equation 7


def thin(pixels: PixelStatistics) -> Mask:
    """Return where a pixel contains part of an object less than about two pixels wide, (H, W).

    Two display pixels are one render pixel at a ratio of 2. A square of 2x2 pixels is solid if all its
    samples hit one surface. At any angle, a bar wider than four pixels has solid squares, and a bar narrower
    than two has none. A pixel is thin if its closest sample is in front of all solid squares within `_REACH`
    pixels, by more than 1 % and by more than the slope of a plane explains, as in the other labels.
    """
    solid = -_max_around(-pixels.depth_min, (0, 1))  # depth of the square whose first pixel this is
    nearest = _max_around(solid, range(-_REACH - 1, _REACH + 1))
    reach = range(-_REACH, _REACH + 1)
    slope = (_REACH + 2) * _max_around(plane_slope(pixels), reach)  # to the far side of the square
    return np.asarray(pixels.depth_max - nearest - slope > _CLOSER * pixels.depth_max)


def _max_around(values: NDArray[Any], offsets: Sequence[int]) -> NDArray[Any]:
    """Return the maximum at these offsets from each pixel, along both axes; borders are repeated."""
    for axis in (0, 1):
        places = np.arange(values.shape[axis])
        shifted = (np.take(values, places + offset, axis, mode="clip") for offset in offsets)
        values = np.maximum.reduce(list(shifted))
    return values
