"""Rectification of the history: colour boxes and clipping (Malan 2012, Karis 2014, Salvi 2016)."""

from typing import NamedTuple

import torch
from torch import Tensor

from supersampler_model.ops.color import largest, least_divisor
from supersampler_model.ops.windows import blurred, maximum_3x3, minimum_3x3


class Box(NamedTuple):
    """Axis-aligned box of colours per pixel, each (1, 3, h, w)."""

    center: Tensor
    extent: Tensor  # from the centre to each side, >= 0


class Rect(NamedTuple):
    """The same box: low and high corner, each (1, 3, h, w)."""

    low: Tensor
    high: Tensor

    def box(self) -> Box:
        """The box by its centre and extent."""
        return Box(0.5 * (self.low + self.high), 0.5 * (self.high - self.low))


def variance_box(first: Tensor, second: Tensor, gamma: float) -> Box:
    """Box mu +- gamma sigma of raw moments E[c] and E[c^2] (Salvi 2016, variance clipping)."""
    return Box(first, gamma * (second - first * first).clamp(min=0.0).sqrt())


def moments(color: Tensor) -> tuple[Tensor, Tensor]:
    """E[c] and E[c^2] over each 3x3 neighbourhood, unweighted."""
    return blurred(color), blurred(color * color)


def extent_box(color: Tensor) -> Rect:
    """Per-channel minimum and maximum over each 3x3 neighbourhood."""
    return Rect(minimum_3x3(color), maximum_3x3(color))


def intersect(a: Box, b: Rect) -> Rect:
    """The box inside both."""
    low, high = a.center - a.extent, a.center + a.extent
    return Rect(torch.maximum(low, b.low), torch.minimum(high, b.high))


def overshoot(color: Tensor, box: Box) -> Tensor:
    """(1, 1, h, w) distance of `color` from the box's centre in extents: <= 1 inside the box."""
    offset = (color - box.center).abs()
    return largest(offset / box.extent.clamp(min=least_divisor(offset, 1e-5)))


def clip_to_center(color: Tensor, box: Box) -> Tensor:
    """Move `color` towards the box's centre until it is inside (the common form)."""
    return box.center + (color - box.center) / overshoot(color, box).clamp(min=1.0)


def step_to_box(color: Tensor, box: Box) -> Tensor:
    """What `clip_to_center` adds to `color`: exactly 0 inside the box, in half floats, too."""
    return (color - box.center) * (1.0 / overshoot(color, box).clamp(min=1.0) - 1.0)


def clip_to_sample(color: Tensor, sample: Tensor, box: Rect) -> Tensor:
    """Clip the segment from the history `color` to the new `sample` where it enters the box (Salvi 2016).

    With variance clipping the new sample may lie outside the box, and the segment may miss the box. Such a
    colour is clipped towards the box's centre instead.
    """
    step = sample - color
    step = torch.where(step.abs() < 1e-6, 1e-6, step)
    near, far = (box.low - color) / step, (box.high - color) / step
    enter, leave = torch.minimum(near, far), torch.maximum(near, far)
    first, last = largest(enter), -largest(-leave)
    meets = (first <= last) & (first <= 1.0) & (last >= 0.0)
    return torch.where(meets, color + first.clamp(0.0, 1.0) * step, clip_to_center(color, box.box()))


def clamp_to(color: Tensor, box: Rect) -> Tensor:
    """Per-channel clamp."""
    return torch.minimum(torch.maximum(color, box.low), box.high)
