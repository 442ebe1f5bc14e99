"""Tone curve, YCoCg, exposure, and the quarantine that keeps bad pixels out of the history."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler.methods.classifier.spec import ToneSpace
from supersampler_model.ops.sampling import sum_of

MAX_HALF = 65504.0
EXPOSURE_KEY = 0.18
EXPOSURE_ADAPTATION = 0.1
LEAST_EXPOSURE, MOST_EXPOSURE = 2.0**-24, 2.0**24
OUTLIER = 64.0
DARKEST = 1e-4
DARKNESS = 1e-12
GLARING = 1024.0
"""Exposed light ten stops over white, from where on no screen tells one light from another."""
GLARE = 4.0
"""What a history's plane of values in [0, 1] holds more for each frame in a row that had such light near."""
CONFIRMED = 3.0
"""Such frames, from which on the light is accumulated: one that was shaded, one drawn from it, one more."""


def valid(color: Tensor) -> Tensor:
    """(1, 1, h, w) 1 where every channel is a number in [0, 65504], else 0; NaN and Inf are 0."""
    good = (color >= 0.0) & (color <= MAX_HALF)
    return (good[:, :1] & good[:, 1:2] & good[:, 2:3]).float()


def glaring(exposed: Tensor, usable: Tensor) -> Tensor:
    """(1, 1, h, w) 1 where a usable sample is over GLARING, else 0."""
    return (largest(exposed) * usable > GLARING).float()


def without_glare(values: Tensor) -> tuple[Tensor, Tensor]:
    """Values in [0, 1] and frames that have had glare near, (1, 1, H, W) each, of their sum in a history."""
    glared = (values / GLARE + 0.5).floor()
    return (values - GLARE * glared).clamp(min=0.0), glared


def sanitize(color: Tensor, fallback: Tensor | float) -> Tensor:
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


def measured_exposure(color: Tensor, usable: Tensor) -> tuple[Tensor, Tensor]:
    """(1,) 0.18 over the log-average luminance of the usable pixels, and how many they are.

    Args:
        color: (1, 3, h, w) linear RGB, >= 0.
        usable: (1, 1, h, w) 0 or 1.
    """
    logs = luminance(color).clamp(min=DARKEST).log() * usable
    count = usable.sum().reshape(1)  # sums: ReduceMean changed after opset 17
    return EXPOSURE_KEY * (-logs.sum().reshape(1) / count.clamp(min=1.0)).exp(), count


def exposure_for(color: Tensor, usable: Tensor, given: Tensor, before: Tensor) -> Tensor:
    """(1,) what the next frame wants back as `before`; its absolute value is the exposure to use.

    That is `given` where it is in [LEAST_EXPOSURE, MOST_EXPOSURE], else measured, and adapts by a tenth of
    the way, in stops, from the frame before; where no pixel is usable, the one before holds. An exposure that
    differs from the one before by more than a factor of OUTLIER is an outlier: the one before holds for that
    frame. What a second frame wants in a row is used at once.

    Args:
        color: (1, 3, h, w) linear RGB, >= 0.
        usable: (1, 1, h, w) 0 or 1.
        given: (1,) by the engine; 0 where it gives none.
        before: (1,) what this function returned for the frame before: negative where no second frame has
            confirmed it, 0 where there was none.
    """
    target, count = measured_exposure(color, usable)
    known = before.abs()
    has_past, is_given = known > 0.0, (given >= LEAST_EXPOSURE) & (given <= MOST_EXPOSURE)
    smooth = known.clamp(min=1e-8) ** (1.0 - EXPOSURE_ADAPTATION) * target**EXPOSURE_ADAPTATION
    measured = torch.where(has_past, torch.where(count > 0.0, smooth, known), target)
    followed = torch.where(is_given, given, measured)
    wanted = torch.where(is_given, given, torch.where(has_past & (count <= 0.0), known, target))
    is_outlier = has_past & ((wanted > known * OUTLIER) | (wanted * OUTLIER < known))
    confirmed = torch.where(is_outlier, torch.where(before < 0.0, wanted, -known), followed)
    return torch.where(has_past, confirmed, -followed)


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
