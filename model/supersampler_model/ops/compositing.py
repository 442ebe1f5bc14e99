"""The compositor of the learned methods: a mean of colours, weighted by sample counts and learned factors.

And the reactive mask, which raises the weight of this frame in every method with a history.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler_model.ops.sampling import Grid, pick, sum_of
from supersampler_model.ops.windows import channels_of


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
        current: the same of this frame.
        factors: (1, n, H, W) logarithms of factors to the weights of all n colours, the history's first.
        reactive: (1, 1, H, W) `reactive_at`: the weight w of this frame becomes w + (1 - w) reactive.
        frame: (1, 3, H, W) shown where all weights are 0: no sample is near, and there is no history.

    Weights are float32. Colours of this frame may be half floats, and so is their part of the sum: its
    rounding errors are in proportion to it, and do not keep a small difference out of the history.
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
    """(1, 1, H, W) the reactive mask at the nearest samples, in [0, 1]; 0 where a sample is missing.

    Args:
        reactive: (1, 1, h, w) as given: any value, NaN counts as 0.
        usable: (1, 1, h, w) 1 where the colour is valid, else 0.
        grid: of the display.
    """
    return pick(torch.where(reactive > 0.0, reactive.clamp(max=1.0), 0.0) * usable, grid)
