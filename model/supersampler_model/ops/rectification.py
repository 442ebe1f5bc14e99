"""Rectification of the history: colour boxes and clipping (Malan 2012, Karis 2014, Salvi 2016)."""

from typing import NamedTuple

import torch
from torch import Tensor

from supersampler_model.ops.sampling import extreme, neighbours_3x3, sum_of


class Rect(NamedTuple):
    """Axis-aligned box of colours per pixel: low and high corner, each (1, 3, h, w)."""

    low: Tensor
    high: Tensor


def variance_box(first: Tensor, second: Tensor, gamma: float | Tensor, floor: float | Tensor = 0.0) -> Rect:
    """Box mu +- (gamma sigma + floor) of raw moments E[c] and E[c^2] (Salvi 2016, variance clipping)."""
    reach = gamma * (second - first * first).clamp(min=0.0).sqrt() + floor
    return Rect(first - reach, first + reach)


def moments(color: Tensor) -> tuple[Tensor, Tensor]:
    """E[c] and E[c^2] over each 3x3 neighbourhood, unweighted."""
    window = neighbours_3x3(color)
    return sum_of(window) / 9.0, sum_of([c * c for c in window]) / 9.0


def extent_box(color: Tensor) -> Rect:
    """Per-channel minimum and maximum over each 3x3 neighbourhood."""
    return Rect(extreme(color, torch.minimum), extreme(color, torch.maximum))


def intersect(a: Rect, b: Rect) -> Rect:
    """The box inside both."""
    return Rect(torch.maximum(a.low, b.low), torch.minimum(a.high, b.high))


def overshoot(color: Tensor, box: Rect) -> Tensor:
    """(1, 1, h, w) distance of `color` from the box's centre in half extents: <= 1 inside the box."""
    extent = (0.5 * (box.high - box.low)).clamp(min=1e-5)
    ratio = (color - 0.5 * (box.low + box.high)).abs() / extent
    return torch.maximum(torch.maximum(ratio[:, :1], ratio[:, 1:2]), ratio[:, 2:3])


def clip_to_center(color: Tensor, box: Rect) -> Tensor:
    """Move `color` towards the box's centre until it is inside (the common form)."""
    center = 0.5 * (box.low + box.high)
    return center + (color - center) / overshoot(color, box).clamp(min=1.0)


def clip_to_sample(color: Tensor, sample: Tensor, box: Rect) -> Tensor:
    """Clip the segment from the history `color` to the new `sample` where it enters the box (Salvi 2016).

    With variance clipping the new sample may lie outside the box, and the segment may miss the box. Such a
    colour is clipped towards the box's centre instead.
    """
    step = sample - color
    step = torch.where(step.abs() < 1e-6, torch.full_like(step, 1e-6), step)
    near, far = (box.low - color) / step, (box.high - color) / step
    enter, leave = torch.minimum(near, far), torch.maximum(near, far)
    first = torch.maximum(torch.maximum(enter[:, :1], enter[:, 1:2]), enter[:, 2:3])
    last = torch.minimum(torch.minimum(leave[:, :1], leave[:, 1:2]), leave[:, 2:3])
    meets = (first <= last) & (first <= 1.0) & (last >= 0.0)
    return torch.where(meets, color + first.clamp(0.0, 1.0) * step, clip_to_center(color, box))


def clamp_to(color: Tensor, box: Rect) -> Tensor:
    """Per-channel clamp."""
    return torch.minimum(torch.maximum(color, box.low), box.high)
