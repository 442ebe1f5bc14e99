"""Motion vectors: sanitizing, dilation, reprojection into the previous frame, resampling of the history."""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model.ops.sampling import (
    Extent,
    channels_of,
    maximum_3x3,
    minimum_3x3,
    neighbours_2x2,
    neighbours_3x3,
    padded_3x3,
    shifted,
)
from supersampler_model.ops.size import Size

LONGEST, FAR = 3e38, 1e6  # pixels: larger motion is not finite; finite motion is clamped to FAR
UNKNOWN_DEPTH = -1.0  # below the sky's 0: never the closest, never disoccluded


def usable_motion(motion: Tensor) -> Tensor:
    """Replace NaN and Inf by zero motion; clamp finite vectors to FAR."""
    known = motion.abs() <= LONGEST
    return torch.where(known, motion.clamp(-FAR, FAR), 0.0)


def usable_depth(depth: Tensor) -> Tensor:
    """Replace NaN, Inf and negative depth by UNKNOWN_DEPTH."""
    return torch.where((depth >= 0.0) & (depth <= 1e30), depth, UNKNOWN_DEPTH)


def dilate_motion_2x2(depth: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Return depth and motion of the closest of each sample and its right, lower and lower right neighbours.

    Edges then move with the foreground, and no pixel takes motion from more than one sample away. At a ratio
    of 2, a 3x3 dilation would move a band of background three display pixels wide with each edge.
    """
    best = torch.cat([depth, motion], dim=1)
    for across, down in ((1, 0), (0, 1)):
        other = shifted(best, across, down)
        best = torch.where(other[:, :1] > best[:, :1], other, best)
    return best[:, :1], best[:, 1:]


def morphological_opening(depth: Tensor) -> Tensor:
    """Depth with foreground narrower than three samples replaced by its background (3x3 opening)."""
    eroded = minimum_3x3(depth)  # reversed: the smallest is the farthest
    return maximum_3x3(eroded)


def disocclusion(
    depth: Tensor, history_depth: Tensor, x: Tensor, y: Tensor, margin: float, ramp: float
) -> Tensor:
    """Return (1, 1, H, W) in [0, 1]: the degree of occlusion of the surface at `depth` in the previous frame.

    The bilinear mean over the four samples around (x, y). A sample counts as an occluder if it was closer by
    the relative `margin`, and counts fully from `margin` + `ramp` on.
    """
    left, top = x.floor(), y.floor()
    across, down = x - left, y - top
    around = padded_3x3(history_depth)[:, :, :-1, :-1]  # so that both samples beside an edge are the edge's
    limit = torch.where(around > 1e-12, 1.0 / (ramp * around.clamp(min=1e-12)), 1e30)
    limits = read(torch.cat(neighbours_2x2(limit), dim=1), left + 1.0, top + 1.0, mode="nearest")
    # the relative change (before - depth) / before less the margin, over the ramp
    occluded = ((1.0 - margin) / ramp - depth.clamp(min=1e-20) * limits).clamp(0.0, 1.0)
    upper, lower = occluded.split_with_sizes([2, 2], dim=1)
    left_part, right_part = channels_of(upper + down * (lower - upper))
    return (left_part + across * (right_part - left_part)) * (depth >= 0.0)


def relative_depth_change(before: Tensor, depth: Tensor) -> Tensor:
    """Return (before - depth) over the closer depth: > 0 where the previous surface was closer.

    Equation 10 of the supplement of Guo et al. 2022, with reversed depth.
    """
    return (before - depth) / torch.maximum(before, depth).clamp(min=1e-12)


def longest(motion: Tensor) -> Tensor:
    """Longest motion vector of each 3x3 neighbourhood, which tracks the fastest feature (Salvi 2016)."""
    best, chosen = squared_length(motion), motion
    for m in neighbours_3x3(motion):
        length = squared_length(m)
        longer = length > best
        best, chosen = torch.where(longer, length, best), torch.where(longer, m, chosen)
    return chosen


def squared_length(vector: Tensor) -> Tensor:
    """(1, 2, h, w) -> (1, 1, h, w)."""
    return vector[:, :1] * vector[:, :1] + vector[:, 1:2] * vector[:, 1:2]


class Reprojection(NamedTuple):
    """Where each display pixel was in the previous frame, in pixels of that image (0 is a pixel's centre)."""

    x: Tensor  # (1, 1, H, W)
    y: Tensor
    on_screen: Tensor  # 1 inside the image, else 0
    motion: Tensor  # (1, 2, H, W) display pixels


def reproject(motion: Tensor, display: Size, render: Size | Extent) -> Reprojection:
    """Reproject display pixels by `motion`, (1, 2, H, W) in render pixels, previous minus current."""
    across = motion[:, :1] * display.width / render.width
    down = motion[:, 1:2] * display.height / render.height
    x = torch.arange(display.width, device=motion.device) + across
    y = torch.arange(display.height, device=motion.device)[:, None] + down
    right, bottom = display.width - 0.5, display.height - 0.5
    on_screen = (x > -0.5) & (x < right) & (y > -0.5) & (y < bottom)
    return Reprojection(
        x.clamp(-2.0, right + 1.5),
        y.clamp(-2.0, bottom + 1.5),
        on_screen.float(),
        torch.cat([across, down], 1),
    )


def read(image: Tensor, x: Tensor, y: Tensor, mode: str = "bilinear") -> Tensor:
    """Sample `image` at pixel positions (1, 1, H, W), clamped at the border."""
    w, h = image.shape[3], image.shape[2]
    return _sampled(image, _normalised(x, w), _normalised(y, h), mode)


def _normalised(position: Tensor, size: int) -> Tensor:
    """Positions along an axis as grid_sample reads them: -1 and 1 are the borders of the image."""
    return position * (2.0 / size) + (1.0 / size - 1.0)


def _sampled(image: Tensor, x: Tensor, y: Tensor, mode: str = "bilinear") -> Tensor:
    grid = torch.cat([x, y], dim=1).permute(0, 2, 3, 1)
    return F.grid_sample(image, grid, mode=mode, padding_mode="border", align_corners=False)


def read_cubic(image: Tensor, x: Tensor, y: Tensor, sharpness: float = 0.5) -> Tensor:
    """Resample with a cubic (sharpness 0.5: Catmull-Rom) from five bilinear reads.

    The middle two samples of an axis share a read. The four corner reads have small weights; they are
    skipped, and the remaining weights are normalised.
    """
    across, down = _cubic_reads(x, image.shape[3], sharpness), _cubic_reads(y, image.shape[2], sharpness)
    row = across.middle * _sampled(image, across.at, down.at)
    for at, weight in ((across.first_at, across.first), (across.last_at, across.last)):
        row = row + weight * _sampled(image, at, down.at)
    column = down.first * _sampled(image, across.at, down.first_at)
    column = column + down.last * _sampled(image, across.at, down.last_at)
    skipped = (1.0 - across.middle) * (1.0 - down.middle)
    return (down.middle * row + across.middle * column) / (1.0 - skipped)


class _CubicReads(NamedTuple):
    """Three bilinear reads along one axis: normalised positions and weights; the weights sum to 1."""

    first_at: Tensor
    at: Tensor  # of the middle two samples
    last_at: Tensor
    first: Tensor
    middle: Tensor
    last: Tensor


def _cubic_reads(position: Tensor, size: int, sharpness: float) -> _CubicReads:
    whole = position.floor()
    t = position - whole
    s = 1.0 - t
    product = t * s
    outer = -sharpness * product
    first = outer * s
    second = t + product * ((2.0 - sharpness) * t - (1.0 - sharpness))  # weight of the sample after
    middle = 1.0 - outer
    sample = whole * (2.0 / size)
    return _CubicReads(
        sample + (-1.0 / size - 1.0),
        _normalised(whole + second / middle, size),
        sample + (5.0 / size - 1.0),
        first,
        middle,
        outer - first,
    )
