"""Colour operations: tone curves, YCoCg, exposure, and sanitizing of invalid pixels."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.classifier.spec import ToneSpace

MAX_HALF = 65504.0
EXPOSURE_KEY = 0.18
EXPOSURE_ADAPTATION = 0.1
TONED: Mapping[torch.dtype, float] = {torch.float32: 1.0 - 1e-4, torch.float16: 1.0 - 2.0**-10}
"""Maximum of a toned colour, by type: 1 is infinite light, to which half floats round bright light."""
LEAST_EXPOSURE, MOST_EXPOSURE = 2.0**-24, 2.0**24
OUTLIER = 64.0
DARKEST = 1e-4
DARKNESS = 1e-12
GLARING = 1024.0
"""Exposed light ten stops over white; no display can distinguish brighter light."""
GLARE = 4.0
"""Added to a history value in [0, 1] for each consecutive frame with such light nearby."""
CONFIRMED = 3.0
"""Consecutive frames after which such light is accumulated: one shaded, one extrapolated, one more."""


def is_number(values: Tensor) -> Tensor:
    """Boolean mask of the values that are not NaN."""
    return (values >= 0.0) | (values < 0.0)


def valid(color: Tensor) -> Tensor:
    """(1, 1, h, w) 1 where no channel is NaN, else 0: a missing sample."""
    good = is_number(color)
    return (good[:, :1] & good[:, 1:2] & good[:, 2:3]).float()


def glaring(exposed: Tensor, usable: Tensor) -> Tensor:
    """(1, 1, h, w) 1 where a usable sample is over GLARING, else 0."""
    return (largest(exposed) * usable > GLARING).float()


def without_glare(values: Tensor) -> tuple[Tensor, Tensor]:
    """Split a history plane into values in [0, 1] and the number of glaring frames, (1, 1, H, W) each."""
    glared = (values / GLARE + 0.5).floor()
    return (values - GLARE * glared).clamp(min=0.0), glared


def sanitize(color: Tensor, fallback: Tensor | float) -> Tensor:
    """Clamp to [0, 65504], infinity included; replace NaN by `fallback`."""
    fallback = torch.as_tensor(fallback, dtype=color.dtype)
    return torch.where(is_number(color), color.clamp(0.0, MAX_HALF), fallback)


def finite(values: Tensor) -> Tensor:
    """Replace NaN, Inf and values beyond the range of half floats by 0."""
    return torch.where(values.abs() <= MAX_HALF, values, 0.0)


def bounded(color: Tensor) -> Tensor:
    """Clamp to [0, 65504]; NaN becomes black. The last operation on every image that a method returns.

    Values below DARKNESS become black too: fading averages would otherwise end as denormals, which are slow.
    """
    color = color.clamp(max=MAX_HALF)
    return torch.where(color >= DARKNESS, color, 0.0)


def least_divisor(values: Tensor, least: float) -> float:
    """`least`, or the least normal number of the tensor's type if that is larger: half floats end at 6e-5."""
    return max(least, torch.finfo(values.dtype).tiny)


def limited(toned: Tensor) -> Tensor:
    """Toned colours, in half floats at most TONED: there bright light is rounded to 1, infinite light."""
    return toned.clamp(max=TONED[toned.dtype]) if toned.dtype == torch.float16 else toned


def luminance(color: Tensor) -> Tensor:
    """(1, 1, h, w) BT.709 luminance of linear RGB."""
    return F.conv2d(color, color.new_tensor([0.2126, 0.7152, 0.0722]).reshape(1, 3, 1, 1))


def measured_exposure(color: Tensor, usable: Tensor) -> tuple[Tensor, Tensor]:
    """(1,) 0.18 over the log-average luminance of the usable pixels, and (1,) the number of those pixels.

    Args:
        color: (1, 3, h, w) linear RGB, >= 0.
        usable: (1, 1, h, w) 0 or 1.
    """
    logs = luminance(color).clamp(min=DARKEST).log() * usable
    count = usable.sum().reshape(1)  # sums: ReduceMean changed after opset 17
    return EXPOSURE_KEY * (-logs.sum().reshape(1) / count.clamp(min=1.0)).exp(), count


def exposure_for(color: Tensor, usable: Tensor, given: Tensor, before: Tensor) -> Tensor:
    """(1,) signed exposure for the history; its absolute value is the exposure to use in this frame.

    The exposure is `given` where that is in [LEAST_EXPOSURE, MOST_EXPOSURE]. Otherwise it is measured and
    adapts from the previous frame by a tenth of the difference in stops; without usable pixels the previous
    exposure is kept. An exposure that differs from the previous one by more than a factor of OUTLIER is
    ignored for one frame, and used at once if the next frame is an outlier too.

    Args:
        color: (1, 3, h, w) linear RGB, >= 0.
        usable: (1, 1, h, w) 0 or 1.
        given: (1,) from the engine; 0: measure.
        before: (1,) what this function returned for the previous frame: negative until a second frame
            confirms it, 0 without a previous frame.
    """
    target, count = measured_exposure(color, usable)
    known = before.abs()
    has_history, is_given = known > 0.0, (given >= LEAST_EXPOSURE) & (given <= MOST_EXPOSURE)
    smooth = known.clamp(min=1e-8) ** (1.0 - EXPOSURE_ADAPTATION) * target**EXPOSURE_ADAPTATION
    measured = torch.where(has_history, torch.where(count > 0.0, smooth, known), target)
    followed = torch.where(is_given, given, measured)
    wanted = torch.where(is_given, given, torch.where(has_history & (count <= 0.0), known, target))
    is_outlier = has_history & ((wanted > known * OUTLIER) | (wanted * OUTLIER < known))
    confirmed = torch.where(is_outlier, torch.where(before < 0.0, wanted, -known), followed)
    return torch.where(has_history, confirmed, -followed)


def is_flash(followed: Tensor, given: Tensor, before: Tensor) -> Tensor:
    """(1,) whether a measured exposure is an outlier: the light of the whole frame is unconfirmed.

    Args:
        followed: (1,) result of `exposure_for`.
        given: (1,) from the engine; 0: measure.
        before: (1,) result of `exposure_for` for the previous frame; 0 without one.
    """
    known, used = before.abs(), followed.abs()
    is_outlier = (followed < 0.0) | (used > known * OUTLIER) | (used * OUTLIER < known)
    is_given = (given >= LEAST_EXPOSURE) & (given <= MOST_EXPOSURE)
    return is_outlier & (torch.where(is_given, 0.0, known) > 0.0)


def largest(color: Tensor) -> Tensor:
    """(1, 1, h, w) largest of three channels."""
    return color.amax(dim=1, keepdim=True)


def tone(color: Tensor, unit: Tensor | float = 1.0) -> Tensor:
    """Linear RGB [0, inf) to [0, 1): c / (unit + max(r, g, b)). Keeps hue; weighs down fireflies.

    Args:
        color: (1, 3, h, w) >= 0.
        unit: the value that exposure maps to 1: 1 for exposed colours, else 1 / exposure.
    """
    return color / (unit + largest(color))


def inverse_tone(color: Tensor) -> Tensor:
    """Inverse of `tone`, limited to the range of half floats."""
    return color / (1.0 - largest(color)).clamp(min=1.0 / MAX_HALF)


class ToneCurve(NamedTuple):
    """Linear RGB [0, inf) to [0, 1], with the `unit` of `tone`, and back to exposed linear RGB."""

    tone: Callable[[Tensor, Tensor | float], Tensor]
    inverse: Callable[[Tensor], Tensor]


_LOG = math.log1p(MAX_HALF)
TONES: Mapping[ToneSpace, ToneCurve] = {
    "largest": ToneCurve(tone, inverse_tone),
    "channels": ToneCurve(
        lambda color, unit: color / (unit + color),
        lambda color: color / (1.0 - color).clamp(min=1.0 / MAX_HALF),
    ),
    "logarithm": ToneCurve(
        lambda color, unit: ((1.0 + color / unit).log() / _LOG).clamp(max=1.0),
        lambda color: (color * _LOG).exp() - 1.0,
    ),
}
"""Tone curves for blending: by the largest channel, per channel, or logarithmic per channel."""


def ycocg(color: Tensor) -> Tensor:
    """RGB to luma and two chroma axes; axis-aligned boxes fit colours tightly in this space."""
    return _transformed(color, ((0.25, 0.5, 0.25), (0.5, 0.0, -0.5), (-0.25, 0.5, -0.25)))


def from_ycocg(color: Tensor) -> Tensor:
    """Inverse of `ycocg`."""
    return _transformed(color, ((1.0, 1.0, -1.0), (1.0, 0.0, 1.0), (1.0, -1.0, -1.0)))


def _transformed(color: Tensor, matrix: Sequence[Sequence[float]]) -> Tensor:
    """Matrix product of each colour, which is finite."""
    return F.conv2d(color, color.new_tensor(matrix)[:, :, None, None])
