"""Inputs of the label rules: per-pixel statistics over many samples, and the motion between two frames.

A renderer with many samples per pixel keeps only these statistics (computed on the GPU). `statistics_of`
computes the same from samples in numpy.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ArgumentError
from supersampler.frame import Float32

Values = NDArray[np.floating[Any]]
BRIGHTEST = 65504.0  # maximum of half floats; brighter samples are fireflies


class Sample(NamedTuple):
    """One sample of every pixel, at some position in the pixel."""

    color: Values  # (H, W, 3) linear scene RGB, >= 0
    depth: Values  # (H, W) reversed, 0 at the sky
    normal: Values  # (H, W, 3) of the surface without its normal map; unit length, 0 at the sky
    normal_mapped: Values  # (H, W, 3) with its normal map


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelStatistics:
    """Ranges over all samples in each pixel of one frame, at display size (W, H).

    Colours are toned by `toned`, at one exposure for all frames that are compared. The curve rises and
    treats each channel on its own, so a renderer may gather linear ranges and tone them afterwards. Shapes
    and types are checked, values are not.

    Attributes:
        depth_min: (H, W) float32, smallest reversed depth (near / view distance): the farthest sample.
        depth_max: (H, W) float32, largest reversed depth: the closest sample.
        color_min: (H, W, 3) float32, smallest toned value of each channel, [0, 1).
        color_max: (H, W, 3) float32, largest.
        color_mean: (H, W, 3) float32, mean linear scene RGB: the reference image. No label reads it.
        normal_spread: (H, W) float32, largest L1 distance from the first sample's normal, [0, 2 sqrt(3)],
            without normal maps.
        normal_mapped_spread: (H, W) float32, the same with normal maps.

    Raises:
        ArgumentError: an array has the wrong shape or type.
    """

    depth_min: Float32
    depth_max: Float32
    color_min: Float32
    color_max: Float32
    color_mean: Float32
    normal_spread: Float32
    normal_mapped_spread: Float32

    def __post_init__(self) -> None:
        size = (*self.depth_min.shape, 0, 0)[:2]  # depth_min leads: the others must agree with it
        for field in fields(self):
            _check(field.name, getattr(self, field.name), (*size, 3) if "color" in field.name else size)

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        height, width = self.depth_min.shape
        return height, width


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """Inputs of the label rules for one frame, at display size (W, H).

    Attributes:
        pixels: ranges over the samples of each pixel.
        motion: (H, W, 2) float32, display pixels (x right, y down), previous minus current, of what the
            pixel's centre sees. On a cut: motion for a camera that does not move.
        depth_before: (H, W) float32, expected previous depth: the reversed depth which the point that the
            pixel's centre sees had one frame ago, whether or not it was in sight then.
        cut: True on the first frame after a cut, which has no history.

    Raises:
        ArgumentError: an array has the wrong shape or type.
    """

    pixels: PixelStatistics
    motion: Float32
    depth_before: Float32
    cut: bool = False

    def __post_init__(self) -> None:
        _check("motion", self.motion, (*self.pixels.shape, 2))
        _check("depth_before", self.depth_before, self.pixels.shape)


def toned(color: Values, exposure: float = 1.0) -> Values:
    """Exposed linear RGB to [0, 1): c / (1 + c), each channel alone, after a clamp to [0, 65504]."""
    exposed = np.clip(color * exposure, 0.0, BRIGHTEST)
    return np.asarray(exposed / (1.0 + exposed))


def statistics_of(samples: Iterable[Sample], exposure: float = 1.0) -> PixelStatistics:
    """Gather the samples of one frame, one at a time, so that memory does not grow with their number.

    Args:
        samples: at least one; the first gives the normals that the others are compared with.
        exposure: multiplies the colours before they are toned, > 0.

    Raises:
        ArgumentError: there is no sample.
    """
    rest = iter(samples)
    first = next(rest, None)
    if first is None:
        raise ArgumentError("samples", got="none", want="at least one")
    color = toned(first.color, exposure)
    low, high, nearest, farthest = color, color, first.depth, first.depth
    total = np.array(first.color, np.float64)
    spread = mapped_spread = np.zeros(first.depth.shape)
    count = 1
    for sample in rest:
        color = toned(sample.color, exposure)
        low, high = np.minimum(low, color), np.maximum(high, color)
        farthest, nearest = np.minimum(farthest, sample.depth), np.maximum(nearest, sample.depth)
        spread = np.maximum(spread, _distance(first.normal, sample.normal))
        mapped_spread = np.maximum(mapped_spread, _distance(first.normal_mapped, sample.normal_mapped))
        total += sample.color
        count += 1
    return PixelStatistics(
        depth_min=farthest.astype(np.float32),
        depth_max=nearest.astype(np.float32),
        color_min=low.astype(np.float32),
        color_max=high.astype(np.float32),
        color_mean=(total / count).astype(np.float32),
        normal_spread=spread.astype(np.float32),
        normal_mapped_spread=mapped_spread.astype(np.float32),
    )


def _distance(a: Values, b: Values) -> Values:
    """(H, W, 3) each to (H, W), L1."""
    return np.asarray(np.abs(a - b).sum(axis=-1))


def _check(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape or array.dtype != np.float32 or 0 in shape:
        want = "at least one pixel, (H, W) float32" if 0 in shape else f"{shape} float32"
        raise ArgumentError(name, got=f"{array.shape} {array.dtype}", want=want)
