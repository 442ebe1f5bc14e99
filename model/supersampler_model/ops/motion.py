"""Motion vectors: sanitizing, dilation, reprojection into the previous frame, resampling of the history."""

import itertools
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model.ops.sampling import Extent, extreme, neighbours_2x2, neighbours_3x3, sum_of
from supersampler_model.ops.size import Size

LONGEST, FAR = 3e38, 1e6  # pixels: larger motion is not finite; finite motion is clamped to FAR
UNKNOWN_DEPTH = -1.0  # below the sky's 0: never the closest, never disoccluded


def usable_motion(motion: Tensor) -> Tensor:
    """Replace NaN and Inf by zero motion; clamp finite vectors to FAR."""
    known = motion.abs() <= LONGEST
    return torch.where(known, motion.clamp(-FAR, FAR), torch.zeros_like(motion))


def usable_depth(depth: Tensor) -> Tensor:
    """Replace NaN, Inf and negative depth by UNKNOWN_DEPTH."""
    return torch.where((depth >= 0.0) & (depth <= 1e30), depth, torch.full_like(depth, UNKNOWN_DEPTH))


def dilate_motion_2x2(depth: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Return depth and motion of the closest of each sample and its right, lower and lower right neighbours.

    Edges then move with the foreground, and no pixel takes motion from more than one sample away. At a ratio
    of 2, a 3x3 dilation would move a band of background three display pixels wide with each edge.
    """
    best, chosen = depth, motion
    for d, m in zip(neighbours_2x2(depth), neighbours_2x2(motion), strict=True):
        closer = d > best
        best, chosen = torch.where(closer, d, best), torch.where(closer, m, chosen)
    return best, chosen


def morphological_opening(depth: Tensor) -> Tensor:
    """Depth with foreground narrower than three samples replaced by its background (3x3 opening)."""
    eroded = extreme(depth, torch.minimum)  # reversed: the smallest is the farthest
    return extreme(eroded, torch.maximum)


def disocclusion(
    depth: Tensor, history_depth: Tensor, x: Tensor, y: Tensor, margin: float, ramp: float
) -> Tensor:
    """Return (1, 1, H, W) in [0, 1]: the degree of occlusion of the surface at `depth` in the previous frame.

    The bilinear mean over the four samples around (x, y). A sample counts as an occluder if it was closer by
    the relative `margin`, and counts fully from `margin` + `ramp` on.
    """
    left, top = x.floor(), y.floor()
    columns, rows = [(0.0, left + 1.0 - x), (1.0, x - left)], [(0.0, top + 1.0 - y), (1.0, y - top)]
    occluded = []
    for (across, wx), (down, wy) in itertools.product(columns, rows):
        before = read(history_depth, left + across, top + down, mode="nearest")
        closer = relative_depth_change(before, depth)
        occluded.append(wx * wy * ((closer - margin) / ramp).clamp(0.0, 1.0))
    return sum_of(occluded) * (depth >= 0.0)


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
    grid = torch.cat([(2.0 * x + 1.0) / w - 1.0, (2.0 * y + 1.0) / h - 1.0], dim=1).permute(0, 2, 3, 1)
    return F.grid_sample(image, grid, mode=mode, padding_mode="border", align_corners=False)


def read_cubic(image: Tensor, x: Tensor, y: Tensor, sharpness: float = 0.5) -> Tensor:
    """Resample with a cubic (sharpness 0.5: Catmull-Rom) from five bilinear reads.

    The middle two samples of an axis share a read. The four corner reads have small weights; they are
    skipped, and the remaining weights are normalised.
    """
    columns, rows = _cubic_reads(x, sharpness), _cubic_reads(y, sharpness)
    cross = [(columns[i], rows[j]) for i, j in ((1, 1), (0, 1), (2, 1), (1, 0), (1, 2))]
    weights = [wx * wy for (_, wx), (_, wy) in cross]
    reads = [read(image, at_x, at_y) for (at_x, _), (at_y, _) in cross]
    return sum_of([w * r for w, r in zip(weights, reads, strict=True)]) / sum_of(weights)


def _cubic_reads(position: Tensor, sharpness: float) -> list[tuple[Tensor, Tensor]]:
    """(position, weight) of three bilinear reads along one axis."""
    whole = position.floor()
    t = position - whole
    s = 1.0 - t
    before, after = -sharpness * t * s * s, -sharpness * s * t * t
    second = (((sharpness - 2.0) * t + 3.0 - 2.0 * sharpness) * t + sharpness) * t
    middle = 1.0 - before - after
    return [(whole - 1.0, before), (whole + second / middle, middle), (whole + 2.0, after)]
