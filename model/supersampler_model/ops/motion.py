"""Motion vectors: sanitizing, dilation, reprojection into the previous frame, resampling of the history."""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods import constants
from supersampler_model.ops import images
from supersampler_model.ops.sampling import Extent, Grid, in_row, pair

STEP = 2.0**-24  # between float32 numbers just below 1


def usable_motion(motion: Tensor) -> Tensor:
    """Replace NaN and Inf by zero motion; clamp finite vectors to MAX_MOTION."""
    known = motion.abs() <= constants.FINITE_MOTION
    return torch.where(known, motion.clamp(-constants.MAX_MOTION, constants.MAX_MOTION), 0.0)


def usable_depth(depth: Tensor) -> Tensor:
    """Replace NaN, Inf and negative depth by UNKNOWN_DEPTH."""
    return torch.where((depth >= 0.0) & (depth <= constants.MAX_DEPTH), depth, constants.UNKNOWN_DEPTH)


def dilate_motion_2x2(depth: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Return depth and motion of the closest of each sample and its right, lower and lower right neighbours.

    Edges then move with the foreground, and no pixel takes motion from more than one sample away. At a ratio
    of 2, a 3x3 dilation would move a band of background three display pixels wide with each edge.
    """
    best = torch.cat([depth, motion], dim=1)
    for across, down in ((1, 0), (0, 1)):
        other = images.shifted(best, across, down)
        best = torch.where(other[:, :1] > best[:, :1], other, best)
    return best[:, :1], best[:, 1:]


def morphological_opening(depth: Tensor) -> Tensor:
    """Replace foreground narrower than three samples by its background (3x3 opening of reversed depth)."""
    return images.maximum_3x3(images.minimum_3x3(depth))


def occluding_depth(depth: Tensor, motion: Tensor) -> Tensor:
    """Return the depth that the next frame tests disocclusion against.

    Samples hit thin geometry in one frame and miss it in the next. It must not occlude its own history, so
    its background takes its place (`morphological_opening`). Geometry that moves over its background by
    THIN_MOTION or more leaves its place: in the next frame it occludes the history there, unless another part
    of it moves in, as with a rail that moves along itself. Its motion is assumed to continue.

    Depth, (1, 1, h, w), and motion, (1, 2, h, w) render pixels, are usable.

    Returns:
        (1, 1, h, w): minus the depth where geometry leaves, else the depth of the background, >= 0; 0 where
        it is unknown.
    """
    farthest, behind = _farthest_3x3(depth, motion)
    over = whole_steps(motion - behind)
    w, h = images.size_of(depth)
    x, y = (torch.arange(extent, device=depth.device).to(depth.dtype) for extent in (w, h))
    across, down = images.channels_of(over)
    (left, right), (top, bottom) = (
        (place.floor(), -(-place).floor()) for place in (x + across, y[:, None] + down)
    )  # without ceil, which some graph runtimes lack
    columns = torch.cat([left, right, left, right], dim=2)
    rows = torch.cat([top, top, bottom, bottom], dim=2)
    coming = read(depth, positions_of(columns, rows), mode="nearest").reshape(1, 4, h, w)
    hidden = torch.maximum(coming.amax(dim=1, keepdim=True), farthest)
    moves = (over.abs().amax(dim=1, keepdim=True) > 0.0) & (farthest >= 0.0)
    leaves = moves & (hidden < constants.SAME_THIN_DEPTH * depth)
    return torch.where(leaves, -depth, morphological_opening(depth).clamp(min=0.0))


def whole_steps(motion: Tensor) -> Tensor:
    """Round components shorter than one sample: from THIN_MOTION on to one sample, else to 0."""
    length = motion.abs()
    step = (length >= constants.THIN_MOTION).float()
    return torch.where(length < 1.0, torch.where(motion < 0.0, -step, step), motion)


def _farthest_3x3(depth: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Return depth and motion of the farthest of 3x3 samples; of equal depths, the nearest to the centre."""
    best = torch.cat([depth, motion], dim=1)
    for across, down in ((1, 0), (0, 1)):
        rows = best
        for step in (-1, 1):
            other = images.shifted(rows, step * across, step * down)
            best = torch.where(other[:, :1] < best[:, :1], other, best)
    return best[:, :1], best[:, 1:]


def disocclusion(
    depth: Tensor, history_depth: Tensor, position: Tensor, margin: float, ramp: float
) -> Tensor:
    """Return (1, 1, H, W) in [0, 1]: how far the surface was occluded in the previous frame.

    This is the bilinear mean over the four samples around each position. A sample counts as an occluder if it
    was closer by the relative `margin`, and counts fully from `margin` + `ramp` on.

    Args:
        depth: (1, 1, H, W) of the surface.
        history_depth: (1, 1, h, w) of the previous frame.
        position: (1, H, W, 2) in samples of the previous frame.
        margin: relative depth.
        ramp: relative depth.
    """
    first = position.floor()
    right, below = (part[:, None] for part in (position - first).unbind(dim=3))
    around = images.padded_3x3(history_depth)[:, :, :-1, :-1]  # the edge is repeated beyond the screen
    limit = torch.where(around > 1e-12, 1.0 / (ramp * around.clamp(min=1e-12)), constants.MAX_DEPTH)
    limits = read(torch.cat(images.neighbours_2x2(limit), dim=1), first + 1.0, mode="nearest")
    # ((before - depth) / before - margin) / ramp
    occluded = ((1.0 - margin) / ramp - depth.clamp(min=1e-20) * limits).clamp(0.0, 1.0)
    return _bilinear_of_four(occluded, right, below) * (depth >= 0.0)


def occlusion(depth: Tensor, occluders: Tensor, position: Tensor, margin: float, ramp: float) -> Tensor:
    """Return `disocclusion` by the `occluding_depth` of the previous frame, (1, 1, h, w).

    An occluder that leaves its place counts fully where it is one of the four samples around a position. The
    history there has its colour, as motion is that of the closest of the four (`dilate_motion_2x2`).
    """
    first = position.floor()
    right, below = (part[:, None] for part in (position - first).unbind(dim=3))
    around = images.padded_3x3(occluders)[:, :, :-1, :-1]
    limit = torch.where(
        around.abs() > 1e-12, 1.0 / (ramp * around.abs().clamp(min=1e-12)), constants.MAX_DEPTH
    )
    limit = torch.where(around < 0.0, -limit, limit)
    limits = read(torch.cat(images.neighbours_2x2(limit), dim=1), first + 1.0, mode="nearest")
    occluded = ((1.0 - margin) / ramp - depth.clamp(min=1e-20) * limits.abs()).clamp(0.0, 1.0)
    left = (occluded * (limits < 0.0)).amax(dim=1, keepdim=True)
    return torch.maximum(left, _bilinear_of_four(occluded, right, below)) * (depth >= 0.0)


def _bilinear_of_four(corners: Tensor, right: Tensor, below: Tensor) -> Tensor:
    """Interpolate between the upper left, upper right, lower left and lower right value, (1, 4, H, W)."""
    upper, lower = corners.split_with_sizes([2, 2], dim=1)
    left_part, right_part = images.channels_of(upper + below * (lower - upper))
    return left_part + right * (right_part - left_part)


def relative_depth_change(before: Tensor, depth: Tensor) -> Tensor:
    """Return (before - depth) over the closer depth: > 0 where the previous surface was closer.

    Equation 10 of the supplement of Guo et al. 2022, with reversed depth.
    """
    return (before - depth) / torch.maximum(before, depth).clamp(min=1e-12)


def longest(motion: Tensor) -> Tensor:
    """Return the longest vector of each 3x3 neighbourhood: it tracks the fastest feature (Salvi 2016)."""
    best, chosen = squared_length(motion), motion
    for m in images.neighbours_3x3(motion):
        length = squared_length(m)
        longer = length > best
        best, chosen = torch.where(longer, length, best), torch.where(longer, m, chosen)
    return chosen


def squared_length(vector: Tensor) -> Tensor:
    """Return the squared length of vectors: (1, 2, h, w) -> (1, 1, h, w)."""
    return vector[:, :1] * vector[:, :1] + vector[:, 1:2] * vector[:, 1:2]


class Reprojection(NamedTuple):
    """Position of each display pixel in the previous frame."""

    position: Tensor  # (1, H, W, 2) x and y in pixels of that image; 0 is the centre of the first one
    on_screen: Tensor  # (1, 1, H, W) 1 inside the image, else 0
    motion: Tensor  # (1, H, W, 2) display pixels
    place: Tensor  # (1, H, W, 2) `position` in the coordinates of grid_sample, from `_inside`

    def read(self, image: Tensor) -> Tensor:
        """Read an image of that size bilinearly, clamped at the border."""
        return _bilinear(image, self.place)

    def speed(self) -> Tensor:
        """Return the length of the motion, (1, 1, H, W)."""
        return (self.motion * self.motion).sum(dim=3)[:, None].sqrt()

    def blur(self) -> Tensor:
        """Return the blur of bilinear reads, (1, 1, H, W): 0 on a pixel's centre, 1 on a corner of four."""
        t = self.position - self.position.floor()
        return 2.0 * (t * (1.0 - t)).sum(dim=3)[:, None]


def to_display(motion: Tensor, display: images.Size, render: images.Size | Extent) -> Tensor:
    """Convert motion (1, 2, h, w) in render pixels to (1, h, w, 2) in display pixels."""
    scale = pair(motion, display.width / render.width, display.height / render.height)
    vectors = motion.permute(0, 2, 3, 1)
    return vectors * in_row(scale, vectors)


def reproject(motion: Tensor, display: images.Size, grid: Grid) -> Reprojection:
    """Reproject display pixels by their motion.

    Args:
        motion: (1, H, W, 2) display pixels, previous minus current, see `to_display`.
        display: (width, height) of the previous image.
        grid: grid of the pixels.
    """
    x, y = grid.x.pixel.to(motion.dtype), grid.y.pixel.to(motion.dtype)
    columns = torch.stack([x, 0.0 * x], dim=1)
    rows = torch.stack([0.0 * y, y], dim=1)
    position = motion + (columns + rows[:, None])
    place = _normalised(position, display)
    on_screen = place.abs().amax(dim=3) < 1.0
    return Reprojection(position, on_screen.to(motion.dtype)[:, None], motion, _inside(place, display))


def read(image: Tensor, position: Tensor, mode: str = "bilinear") -> Tensor:
    """Sample an image at positions (1, H, W, 2) in its pixels, clamped at the border."""
    size = images.size_of(image)
    place = _normalised(position, size)
    if mode == "bilinear":
        return _bilinear(image, _inside(place, size))
    return F.grid_sample(image, place, mode=mode, padding_mode="border", align_corners=False)


def positions_of(x: Tensor, y: Tensor) -> Tensor:
    """Join x and y, (n, 1, h, w) each, to positions (n, h, w, 2) for `read`."""
    return torch.cat([x, y], dim=1).permute(0, 2, 3, 1)


def _normalised(position: Tensor, size: images.Size) -> Tensor:
    """Convert positions to the coordinates of grid_sample: exactly -1 and 1 at the image's borders."""
    extent = pair(position, 0.5 * size.width, 0.5 * size.height)
    return (position - in_row(extent - 0.5, position)) / in_row(extent, position)


def _inside(place: Tensor, size: images.Size) -> Tensor:
    """Clamp places to the centres of the border pixels: bilinear reads then involve no pixel beyond them."""
    first, last = _ends(place, size)
    return torch.maximum(torch.minimum(place, last), first)


def _ends(place: Tensor, size: images.Size) -> tuple[Tensor, Tensor]:
    """Return the places of the centres of the first and of the last pixel, (W, 2) each.

    grid_sample adds 1 and multiplies by the size. 2 - 1 / size, rounded to float32, less 1 gives the last
    pixel exactly. No place gives the first pixel exactly; the closest one inside the image also reads 2e-4 of
    the second pixel, at 4K.
    """
    part = 1.0 / pair(place, size.width, size.height)
    return in_row(part - 1.0 + STEP, place), in_row(2.0 - part - 1.0, place)


def _bilinear(image: Tensor, place: Tensor) -> Tensor:
    """Sample at places from `_inside`. ONNX Runtime pads with zeros in half the time that clamping takes."""
    return F.grid_sample(image, place, mode="bilinear", padding_mode="zeros", align_corners=False)


def read_cubic(image: Tensor, position: Tensor, sharpness: float = constants.CATMULL_ROM) -> Tensor:
    """Resample with a cubic (sharpness 0.5: Catmull-Rom) from five bilinear reads.

    The middle two samples of an axis share a read. The four corner reads have small weights: they are left
    out, and the other weights are normalised.

    Args:
        image: (1, c, h, w).
        position: (1, H, W, 2) in its pixels.
        sharpness: minus the slope of the cubic at distance 1.
    """
    size, whole = images.size_of(image), position.floor()
    t = position - whole
    s = 1.0 - t
    product = t * s
    outer = -sharpness * product
    second = t + product * ((2.0 - sharpness) * t - (1.0 - sharpness))  # weight of the second middle sample
    first_weight, middle_weight = outer * s, 1.0 - outer
    weights = first_weight, middle_weight, outer - first_weight
    extent, (lowest, highest) = pair(position, 0.5 * size.width, 0.5 * size.height), _ends(position, size)
    before = (whole - in_row(extent + 0.5, position)) / in_row(extent, position)
    last = torch.minimum(before + in_row(3.0 / extent, position), highest)
    middle = _inside(_normalised(whole + second / middle_weight, size), size)
    first = torch.maximum(before, lowest)
    (first_x, first_y), (middle_x, middle_y), (last_x, last_y) = (
        (weight[..., 0], weight[..., 1]) for weight in weights
    )
    of_x = in_row(torch.tensor([True, False], device=position.device), position)
    taps = [
        (middle_x * middle_y, middle),
        (first_x * middle_y, torch.where(of_x, first, middle)),
        (last_x * middle_y, torch.where(of_x, last, middle)),
        (middle_x * first_y, torch.where(of_x, middle, first)),
        (middle_x * last_y, torch.where(of_x, middle, last)),
    ]
    total = 1.0 - (1.0 - middle_x) * (1.0 - middle_y)
    return images.sum_of([weight * _bilinear(image, place) for weight, place in taps]) / total
