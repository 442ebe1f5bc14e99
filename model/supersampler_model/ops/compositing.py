"""The compositor of the learned methods: a mean of colours, weighted by sample counts and learned factors."""

from collections.abc import Sequence
from typing import NamedTuple

from torch import Tensor

from supersampler_model.ops.sampling import sum_of
from supersampler_model.ops.windows import channels_of


class Composite(NamedTuple):
    """Blended colours at display size."""

    color: Tensor  # (1, 3, H, W) weighted mean; black where all weights are 0
    weight: Tensor  # (1, 1, H, W) weight of the history in it, [0, 1]
    odds: Tensor  # (1, 1, H, W) effective number of samples in the history, >= 0


def composite(
    history: Sequence[tuple[Tensor, Tensor]], current: Sequence[tuple[Tensor, Tensor]], factors: Tensor
) -> Composite:
    """Blend colours of the history and of this frame.

    Args:
        history: colours (1, 3, H, W) and their initial weights (1, 1, H, W), >= 0, in numbers of samples.
        current: the same of this frame.
        factors: (1, n, H, W) logarithms of factors to the weights of all n colours, the history's first.

    Weights are float32. Colours of this frame may be half floats, and so is their part of the sum: its
    rounding errors are in proportion to it, and do not keep a small difference out of the history.
    """
    colors = [*history, *current]
    factor = channels_of(factors.float().exp())
    weights = [weight * f for (_, weight), f in zip(colors, factor, strict=True)]
    of_history, of_current = sum_of(weights[: len(history)]), sum_of(weights[len(history) :])
    total = (of_history + of_current).clamp(min=1e-12)
    parts = [(weight / total).to(c.dtype) * c for weight, (c, _) in zip(weights, colors, strict=True)]
    color = sum_of(parts[: len(history)]) + sum_of(parts[len(history) :])
    odds = of_history / of_current.clamp(min=1e-12) * sum_of([weight for _, weight in current])
    return Composite(color, of_history / total, odds)
