"""Colour boxes that clip the history, and the compositor of the learned methods.

Boxes and clipping follow Malan 2012, Karis 2014 and Salvi 2016. The compositor averages colours, weighted by
sample counts and learned factors. In every method with a history, the reactive mask raises the weight of this
frame.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler_model.ops.color import largest, min_divisor
from supersampler_model.ops.images import channels_of, sum_of
from supersampler_model.ops.sampling import Grid


class Box(NamedTuple):
    """Axis-aligned box of colours per pixel, each (1, 3, h, w)."""

    center: Tensor
    extent: Tensor  # from the centre to each side, >= 0


class Corners(NamedTuple):
    """Low and high corner of a box of colours per pixel, each (1, 3, h, w)."""

    low: Tensor
    high: Tensor

    def box(self) -> Box:
        """Return the box by its centre and extent."""
        return Box(0.5 * (self.low + self.high), 0.5 * (self.high - self.low))

    def clamp(self, color: Tensor) -> Tensor:
        """Clamp each channel."""
        return torch.minimum(torch.maximum(color, self.low), self.high)


def overshoot(color: Tensor, box: Box) -> Tensor:
    """Return the distance of `color` from the box's centre in extents, (1, 1, h, w): <= 1 inside the box."""
    offset = (color - box.center).abs()
    return largest(offset / box.extent.clamp(min=min_divisor(offset, 1e-5)))


def clip_to_center(color: Tensor, box: Box) -> Tensor:
    """Move `color` towards the box's centre until it is inside the box (Karis 2014)."""
    return box.center + (color - box.center) / overshoot(color, box).clamp(min=1.0)


def step_to_box(color: Tensor, box: Box) -> Tensor:
    """Return the step that `clip_to_center` adds: exactly 0 inside the box, also in half floats."""
    return (color - box.center) * (1.0 / overshoot(color, box).clamp(min=1.0) - 1.0)


def clip_to_sample(color: Tensor, sample: Tensor, corners: Corners) -> Tensor:
    """Clip the segment from the history `color` to the new `sample` where it enters the box (Salvi 2016).

    With variance clipping the new sample may lie outside the box, and the segment may miss the box. Such a
    colour is clipped towards the box's centre instead.
    """
    step = sample - color
    step = torch.where(step.abs() < 1e-6, 1e-6, step)
    near, far = (corners.low - color) / step, (corners.high - color) / step
    enter, leave = torch.minimum(near, far), torch.maximum(near, far)
    first, last = largest(enter), -largest(-leave)
    meets = (first <= last) & (first <= 1.0) & (last >= 0.0)
    return torch.where(meets, color + first.clamp(0.0, 1.0) * step, clip_to_center(color, corners.box()))


class Composite(NamedTuple):
    """Blended colours at display size."""

    color: Tensor  # (1, 3, H, W) weighted mean; black where all weights are 0
    weight: Tensor  # (1, 1, H, W) weight of the history in it, [0, 1]
    odds: Tensor  # (1, 1, H, W) effective number of samples in the history, >= 0


def composite(
    history: Sequence[tuple[Tensor, Tensor]],
    current: Sequence[tuple[Tensor, Tensor]],
    factors: Tensor,
    reactive: Tensor,
    frame: Tensor,
) -> Composite:
    """Blend colours of the history and of this frame.

    Args:
        history: colours (1, 3, H, W) and their initial weights (1, 1, H, W), >= 0, in numbers of samples.
        current: colours of this frame and their weights.
        factors: (1, n, H, W) logarithms of factors to the weights of all n colours, the history's first.
        reactive: (1, 1, H, W) `reactive_at`: the weight w of this frame becomes w + (1 - w) reactive.
        frame: (1, 3, H, W) the result where all weights are 0: no sample is near, and there is no history.

    Weights are float32. Colours of this frame may be half floats, and then so is their part of the sum: its
    rounding errors are proportional to it, so that small differences still reach the history.
    """
    colors = [*history, *current]
    factor = channels_of(factors.float().exp())
    weights = [weight * f for (_, weight), f in zip(colors, factor, strict=True)]
    of_history, of_current = sum_of(weights[: len(history)]), sum_of(weights[len(history) :])
    known = of_current.clamp(min=1e-12)
    kept = (1.0 - reactive) * (known / (known + reactive * of_history))
    of_history = of_history * kept
    weights[: len(history)] = [weight * kept for weight in weights[: len(history)]]
    sums = of_history + of_current
    total = sums.clamp(min=1e-12)
    parts = [(weight / total).to(c.dtype) * c for weight, (c, _) in zip(weights, colors, strict=True)]
    color = sum_of(parts[: len(history)]) + sum_of(parts[len(history) :])
    odds = of_history / known * sum_of([weight for _, weight in current])
    color = torch.where(sums > 0.0, color, frame.to(color.dtype))
    return Composite(color, of_history / total, odds)


def reactive_at(reactive: Tensor, usable: Tensor, grid: Grid) -> Tensor:
    """Return the reactive mask at the nearest samples, (1, 1, H, W) in [0, 1]; 0 where a sample is missing.

    Args:
        reactive: (1, 1, h, w) as given: any value, NaN counts as 0.
        usable: (1, 1, h, w) 1 where the colour is valid, else 0.
        grid: grid of the display.
    """
    return grid.pick(torch.where(reactive > 0.0, reactive.clamp(max=1.0), 0.0) * usable)
