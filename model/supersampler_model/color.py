"""Tone curve, YCoCg, exposure, and the quarantine that keeps bad pixels out of the history."""

import math
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from supersampler_model.sampling import sum_of

MAX_HALF = 65504.0
EXPOSURE_KEY = 0.18
EXPOSURE_ADAPTATION = 0.1
DARKEST = 1e-4
DARKNESS = 1e-12


def valid(color: Tensor) -> Tensor:
    """(1, 1, h, w) 1 where every channel is a number in [0, 65504], else 0; NaN and Inf are 0."""
    good = (color >= 0.0) & (color <= MAX_HALF)
    return (good[:, :1] & good[:, 1:2] & good[:, 2:3]).float()


def quarantine(color: Tensor, fallback: Tensor | float) -> Tensor:
    """Replace what is not a number in [0, 65504]."""
    fallback = torch.as_tensor(fallback, dtype=color.dtype)
    return torch.where((color >= 0.0) & (color <= MAX_HALF), color, fallback)


def finite(values: Tensor) -> Tensor:
    """NaN, Inf and what no half float holds become 0."""
    return torch.where(values.abs() <= MAX_HALF, values, torch.zeros_like(values))


def bounded(color: Tensor) -> Tensor:
    """Clamp to [0, 65504]; what is not a number becomes black. Last step before an image leaves a method.

    So does what is darker than any light: averages that fade would end as denormals, which processors are
    slow with.
    """
    color = color.clamp(max=MAX_HALF)
    return torch.where(color >= DARKNESS, color, torch.zeros_like(color))


def luminance(color: Tensor) -> Tensor:
    """(1, 1, h, w) BT.709 luminance of linear RGB."""
    return 0.2126 * color[:, :1] + 0.7152 * color[:, 1:2] + 0.0722 * color[:, 2:3]


def exposure_for(color: Tensor, usable: Tensor, given: Tensor, before: Tensor) -> Tensor:
    """(1,) exposure to use: `given` where > 0, else measured, adapting from `before` where that is > 0.

    Measured is 0.18 over the log-average luminance of the `usable` pixels (1, 1, h, w) of `color`; where
    there are none, the one before holds.
    """
    logs = luminance(color).clamp(min=DARKEST).log() * usable
    count = usable.sum().reshape(1)  # sums: ReduceMean changed after opset 17
    target = EXPOSURE_KEY * (-logs.sum().reshape(1) / count.clamp(min=1.0)).exp()
    smooth = before.clamp(min=1e-8) ** (1.0 - EXPOSURE_ADAPTATION) * target**EXPOSURE_ADAPTATION
    measured = torch.where(before > 0.0, torch.where(count > 0.0, smooth, before), target)
    return torch.where(given > 0.0, given, measured)


def largest(color: Tensor) -> Tensor:
    """(1, 1, h, w) largest of three channels."""
    return torch.maximum(torch.maximum(color[:, :1], color[:, 1:2]), color[:, 2:3])


def tone(color: Tensor) -> Tensor:
    """Exposed linear RGB [0, inf) to [0, 1): c / (1 + max(r, g, b)). Keeps hue; weighs down fireflies."""
    return color / (1.0 + largest(color))


def inverse_tone(color: Tensor) -> Tensor:
    """Inverse of `tone`, bounded by the range of half floats."""
    return color / (1.0 - largest(color)).clamp(min=1.0 / MAX_HALF)


class ToneCurve(NamedTuple):
    """Exposed linear RGB [0, inf) to [0, 1] and back."""

    tone: Callable[[Tensor], Tensor]
    inverse: Callable[[Tensor], Tensor]


ToneSpace = Literal["largest", "channels", "logarithm"]
_LOG = math.log1p(MAX_HALF)
TONES: Mapping[ToneSpace, ToneCurve] = {
    "largest": ToneCurve(tone, inverse_tone),
    "channels": ToneCurve(
        lambda color: color / (1.0 + color), lambda color: color / (1.0 - color).clamp(min=1.0 / MAX_HALF)
    ),
    "logarithm": ToneCurve(
        lambda color: ((1.0 + color).log() / _LOG).clamp(max=1.0), lambda color: (color * _LOG).exp() - 1.0
    ),
}
"""Spaces to blend in: by the largest channel, each channel alone, each by its logarithm."""


def ycocg(color: Tensor) -> Tensor:
    """RGB to luma and two chroma axes, the space in which boxes fit colours tightly."""
    r, g, b = color[:, :1], color[:, 1:2], color[:, 2:3]
    return torch.cat([0.25 * (r + b) + 0.5 * g, 0.5 * (r - b), 0.5 * g - 0.25 * (r + b)], dim=1)


def from_ycocg(color: Tensor) -> Tensor:
    """Inverse of `ycocg`."""
    y, co, cg = color[:, :1], color[:, 1:2], color[:, 2:3]
    return torch.cat([sum_of([y, co, -cg]), y + cg, sum_of([y, -co, -cg])], dim=1)
