"""The temporal filter: a mean over neighbouring frames, each gathered once by composed motion.

Every image is (1, channels, height, width), at the size of the result. The input colours are denoised frame
by frame. Each pixel follows its motion through up to REACH previous and REACH following frames. The filter
averages the colours at these positions, in the light of the frame. The weight of a neighbouring frame falls
with the differences in albedo, normal and patches of colour, and with its distance in time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from supersampler.denoising import spec
from supersampler_model.ops.images import neighbours_3x3, size_of
from supersampler_model.ops.motion import positions_of, read, read_cubic, usable_motion

COSTS = spec.Weights._fields[1:]
"""Names of the costs, in the order of `distances`; all but that of age, the last one, are per sample."""
MANTISSA = 2.0**-23  # value of the last bit of a float's mantissa


@dataclass(frozen=True)
class WindowFrame:
    """One frame of a window.

    Motion to the neighbouring frames, in pixels, is the result of `nearest_motion`. It is None at a cut, and
    at the ends of the window.
    """

    color: Tensor  # (1, 4, h, w) linear RGB, and 1 where it is known, 0 where a sample is missing
    albedo: Tensor  # (1, 3, h, w) in [0, 1]
    normal: Tensor  # (1, 3, h, w)
    to_previous: Tensor | None  # (1, 2, h, w)
    to_next: Tensor | None  # (1, 2, h, w)
    aovs: Tensor | None = None  # (1, k, h, w) other channels
    noisy: Tensor | None = None  # (1, 4, h, w) before denoising, averaged in place of `color`


@dataclass(frozen=True)
class Gathered:
    """One neighbour of a frame, gathered along its motion."""

    color: Tensor  # (1, 4, h, w) from `sharp`
    averaged: Tensor  # (1, 4, h, w) the same, or of the noisy colour
    albedo: Tensor  # (1, 3, h, w), bilinear
    normal: Tensor  # (1, 3, h, w), bilinear
    aovs: Tensor | None  # (1, k, h, w) from `sharp`
    known: Tensor  # (1, 1, h, w), 1 where the path stays on the screen and ends at known samples, else 0
    age: int  # distance in time, frames


class TemporalFilter(nn.Module):
    """Averages a frame and its neighbours, by weights that fall with their distance.

    The weights are OF_DENOISED, or OF_NOISY for frames with noisy colour.
    """

    def __init__(self, weights: spec.Weights = spec.OF_DENOISED) -> None:
        super().__init__()
        self.log_weight = nn.Parameter(torch.tensor(weights.log_weight))
        self.log_costs = nn.Parameter(torch.tensor(weights[1:]).log())

    def weight(self, distances: Tensor, samples: float) -> Tensor:
        """Return the weights (n, 1, h, w) of neighbours at these distances (n, len(COSTS), h, w)."""
        costs = torch.cat(
            [self.log_costs[:-1].exp() * min(samples, spec.MAX_SAMPLES), self.log_costs[-1:].exp()]
        )
        return torch.exp(self.log_weight - (distances * costs[:, None, None]).sum(dim=1, keepdim=True))

    def forward(
        self,
        frame: WindowFrame,
        previous: Sequence[WindowFrame],
        following: Sequence[WindowFrame],
        exposure: float = 1.0,
        samples: float = spec.DEFAULT_SAMPLES,
    ) -> tuple[Tensor, Tensor | None]:
        """Return the mean of colour, (1, 3, h, w), and of the AOVs.

        Args:
            frame: the frame, whose own weight is 1.
            previous: frames before it, the nearest one first.
            following: frames after it, the nearest one first.
            exposure: > 0, multiplies colour before its logarithm.
            samples: > 0, samples per pixel of the renderer.
        """
        known = frame.color[:, 3:]
        color, aovs, total = averaged_of(frame)[:, :3] * known, frame.aovs, known
        if aovs is not None:
            aovs = aovs * known
        for other in (*gathered(frame, previous, "to_previous"), *gathered(frame, following, "to_next")):
            weight = self.weight(distances(frame, other, exposure), samples) * other.known
            color = color + weight * relit(frame, other, exposure, samples)
            if aovs is not None and other.aovs is not None:
                aovs = aovs + weight * other.aovs
            total = total + weight
        divisor = torch.where(total > 0.0, total, 1.0)
        return color / divisor, None if aovs is None else aovs / divisor


def gathered(frame: WindowFrame, others: Sequence[WindowFrame], motion: str) -> list[Gathered]:
    """Gather neighbours in one direction; `motion` is the name of the field with the motion to the next one.

    The position in the next frame is the position in a frame plus the motion of the nearest pixel.
    """
    size = size_of(frame.color)
    x = torch.arange(size.width, dtype=torch.float32)[None, None, :].expand(1, size.height, -1)
    y = torch.arange(size.height, dtype=torch.float32)[None, :, None].expand(1, -1, size.width)
    known = torch.ones_like(x)
    found, last = [], frame
    for age, other in enumerate(others[: spec.REACH], start=1):
        step = getattr(last, motion)
        if step is None:
            break
        column = (x + 0.5).floor().long().clamp(0, size.width - 1)
        row = (y + 0.5).floor().long().clamp(0, size.height - 1)
        x = (x + step[0, 0][row, column]).clamp(-2.0, size.width + 1.0)
        y = (y + step[0, 1][row, column]).clamp(-2.0, size.height + 1.0)
        known = known * ((x > -0.5) & (x < size.width - 0.5) & (y > -0.5) & (y < size.height - 0.5))
        place = positions_of(x[:, None], y[:, None])
        albedo, normal = read(other.albedo, place), read(other.normal, place)
        aovs = None if other.aovs is None else sharp(other.aovs, place)
        complete = known[:, None] * (read(other.color[:, 3:], place) > spec.KNOWN_SHARE)
        color = sharp(other.color, place)
        averaged = color if other.noisy is None else sharp(other.noisy, place)
        found.append(Gathered(color, averaged, albedo, normal, aovs, complete, age))
        last = other
    return found


def averaged_of(frame: WindowFrame) -> Tensor:
    """Return the colour that is averaged, (1, 4, h, w)."""
    return frame.color if frame.noisy is None else frame.noisy


def sharp(image: Tensor, place: Tensor) -> Tensor:
    """Read with a Catmull-Rom filter, clamped to the smallest and the largest of the four pixels around."""
    (width, height), first = size_of(image), place[0].floor().long()
    columns = [(first[..., 0] + across).clamp(0, width - 1) for across in (0, 1)]
    rows = [(first[..., 1] + down).clamp(0, height - 1) for down in (0, 1)]
    four = torch.stack([image[:, :, row, column] for row in rows for column in columns])
    return read_cubic(image, place).clamp(four.amin(dim=0), four.amax(dim=0))


def distances(frame: WindowFrame, other: Gathered, exposure: float) -> Tensor:
    """Return the distances of a neighbour, (1, len(COSTS), h, w), in the order of COSTS."""

    def logs(image: Tensor) -> Tensor:
        return log2(image[:, :3] * exposure + spec.LOG_OFFSET)

    difference = logs(other.color) - logs(frame.color)
    color = squared(difference) / 3.0
    shift = box(difference.mean(dim=1, keepdim=True), 4).square()
    normal = squared(other.normal - frame.normal)
    albedo = squared(other.albedo - frame.albedo)
    age = torch.full_like(color, float(other.age))
    return torch.cat(
        [color, box(color, 1), box(color, 2), normal, box(normal, 1), albedo, box(albedo, 1), shift, age],
        dim=1,
    )


def relit(frame: WindowFrame, other: Gathered, exposure: float, samples: float) -> Tensor:
    """Return a neighbour's colour, (1, 3, h, w), in the light of the frame.

    The change of light is the mean relative difference of the denoised colours over 9x9 pixels, 0 where one
    is unknown. What may be noise of so many samples is left, because the average of the frames removes it.
    """
    own, found = (image[:, :3] * exposure + spec.LOG_OFFSET for image in (frame.color, other.color))
    change = (2.0 * (own - found) / (own + found)).clamp(-spec.LIGHT_LIMIT, spec.LIGHT_LIMIT)
    change = box(change * frame.color[:, 3:] * other.known, 4)
    significance = change.square() * min(samples, spec.MAX_SAMPLES)
    return other.averaged[:, :3] * torch.exp(change * significance / (significance + spec.LIGHT_NOISE))


def log2(values: Tensor) -> Tensor:
    """Return exponent plus mantissa of positive floats: a piecewise linear logarithm to base 2."""
    return values.contiguous().view(torch.int32).float() * MANTISSA - 127.0


def squared(difference: Tensor) -> Tensor:
    """Return the squared length over the channels, (1, 1, h, w)."""
    return (difference * difference).sum(dim=1, keepdim=True)


def box(image: Tensor, reach: int) -> Tensor:
    """Return the mean over the square of pixels up to `reach` away; edges are repeated."""
    padded = F.pad(image, (reach,) * 4, mode="replicate")
    return F.avg_pool2d(padded, 2 * reach + 1, stride=1)


def nearest_motion(depth: Tensor, motion: Tensor) -> Tensor:
    """Return the motion of the closest of the 3x3 pixels around each, (1, 2, h, w).

    Edges then move with the foreground.

    Args:
        depth: (1, 1, h, w) reversed: larger is closer.
        motion: (1, 2, h, w) pixels.
    """
    best, found = depth, usable_motion(motion)
    for near, moved in zip(neighbours_3x3(depth), neighbours_3x3(found), strict=True):
        is_closer = near > best
        best, found = torch.where(is_closer, near, best), torch.where(is_closer, moved, found)
    return found
