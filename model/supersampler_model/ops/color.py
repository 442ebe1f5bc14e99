"""Colour operations: tone curves, YCoCg, exposure, and invalid or missing samples."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.io.display import (
    BT709_WEIGHTS,
    DARKEST,
    EXPOSURE_ADAPTATION,
    EXPOSURE_KEY,
    EXPOSURE_OUTLIER,
    MAX_EXPOSURE,
    MAX_HALF,
    MIN_EXPOSURE,
)
from supersampler.methods import constants
from supersampler.methods.classifier.spec import ToneSpace
from supersampler_model.ops.images import maximum_3x3, window_means

TONED: Mapping[torch.dtype, float] = {torch.float32: constants.MAX_TONED, torch.float16: 1.0 - 2.0**-10}
"""Maximum of a toned colour, by type: half floats round brighter light to 1, which is infinite light."""


def is_number(values: Tensor) -> Tensor:
    """Return a boolean mask of the values that are not NaN."""
    return (values >= 0.0) | (values < 0.0)


def valid(color: Tensor) -> Tensor:
    """Return (1, 1, h, w): 1 where no channel is NaN; 0 at a missing sample."""
    good = is_number(color)
    return (good[:, :1] & good[:, 1:2] & good[:, 2:3]).float()


def sanitize(color: Tensor, fallback: Tensor | float) -> Tensor:
    """Clamp to [0, 65504], infinity included; replace NaN by `fallback`."""
    fallback = torch.as_tensor(fallback, dtype=color.dtype)
    return torch.where(is_number(color), color.clamp(0.0, MAX_HALF), fallback)


def finite(values: Tensor) -> Tensor:
    """Replace NaN, Inf and values beyond the range of half floats by 0."""
    return torch.where(values.abs() <= MAX_HALF, values, 0.0)


def bounded(color: Tensor) -> Tensor:
    """Clamp to [0, 65504]; NaN becomes black. The last operation on every image that a method returns.

    Values below DARKNESS become black, too: fading averages would otherwise end as denormals, which are slow.
    """
    color = color.clamp(max=MAX_HALF)
    return torch.where(color >= constants.DARKNESS, color, 0.0)


def limited(toned: Tensor) -> Tensor:
    """Clamp toned half floats to TONED: they round bright light to 1, which is infinite light."""
    return toned.clamp(max=TONED[toned.dtype]) if toned.dtype == torch.float16 else toned


def min_divisor(values: Tensor, minimum: float) -> float:
    """Return `minimum`, or the smallest normal number of the tensor's type: half floats end at 6e-5."""
    return max(minimum, torch.finfo(values.dtype).tiny)


def filled(color: Tensor, usable: Tensor, exposure: Tensor) -> Tensor:
    """Fill missing samples with the mean of their window of FILL_WINDOW x FILL_WINDOW samples.

    The mean is the square of the mean of square roots, so that highlights do not dominate. A window without
    any usable sample becomes grey.

    Args:
        color: (1, 3, h, w) linear RGB, finite.
        usable: (1, 1, h, w) 0 where a sample is missing, else 1.
        exposure: (1,) of the frame; it maps grey to EXPOSURE_KEY.

    Returns:
        (1, 3, h, w) linear RGB.
    """
    values = torch.cat([color.sqrt(), torch.ones_like(usable)], dim=1) * usable
    roots, share = window_means(values, constants.FILL_WINDOW).split_with_sizes([3, 1], dim=1)
    mean = (roots + constants.GREY_SHARE * (EXPOSURE_KEY / exposure).sqrt()) / (share + constants.GREY_SHARE)
    return torch.where(usable > 0.0, color, mean * mean)


def glaring(exposed: Tensor, usable: Tensor) -> Tensor:
    """Return (1, 1, h, w): 1 where a usable sample is over GLARE_EXPOSED, else 0."""
    return (largest(exposed) * usable > constants.GLARE_EXPOSED).float()


def without_glare(values: Tensor) -> tuple[Tensor, Tensor]:
    """Split a history plane into values in [0, 1] and the number of glaring frames, (1, 1, H, W) each."""
    glared = (values / constants.GLARE + 0.5).floor()
    return (values - constants.GLARE * glared).clamp(min=0.0), glared


def luminance(color: Tensor) -> Tensor:
    """Return the BT.709 luminance of linear RGB, (1, 1, h, w)."""
    return F.conv2d(color, color.new_tensor(BT709_WEIGHTS).reshape(1, 3, 1, 1))


def largest(color: Tensor) -> Tensor:
    """Return the largest of three channels, (1, 1, h, w)."""
    return color.amax(dim=1, keepdim=True)


def measured_exposure(color: Tensor, usable: Tensor) -> tuple[Tensor, Tensor]:
    """Return 0.18 over the log-average luminance of the lit pixels, and their number, (1,) each.

    Lit are usable pixels over DARKEST. `color` is (1, 3, h, w) linear RGB >= 0, `usable` (1, 1, h, w) 0 or 1.
    """
    light = luminance(color)
    lit = usable * (light > DARKEST).float()
    logs = light.clamp(min=DARKEST).log() * lit
    count = lit.sum().reshape(1)  # sums: ReduceMean changed after opset 17
    return EXPOSURE_KEY * (-logs.sum().reshape(1) / count.clamp(min=1.0)).exp(), count


def exposure_for(color: Tensor, usable: Tensor, given: Tensor, before: Tensor) -> Tensor:
    """Return the signed exposure for the history, (1,); its absolute value is the exposure of this frame.

    The exposure is `given` where that is in [MIN_EXPOSURE, MAX_EXPOSURE]. Otherwise it is measured and adapts
    from the previous frame by a tenth of the difference in stops; without lit pixels the previous exposure is
    kept. An exposure that differs from the previous one by more than a factor of EXPOSURE_OUTLIER is
    ignored for one frame, and used at once if the next frame is an outlier too.

    Args:
        color: (1, 3, h, w) linear RGB, >= 0.
        usable: (1, 1, h, w) 0 or 1.
        given: (1,) from the engine; 0: measure.
        before: (1,) the result for the previous frame: negative until a second frame confirms it, 0 without a
            previous frame.
    """
    target, count = measured_exposure(color, usable)
    known = before.abs()
    has_history, is_given = known > 0.0, (given >= MIN_EXPOSURE) & (given <= MAX_EXPOSURE)
    smooth = known.clamp(min=1e-8) ** (1.0 - EXPOSURE_ADAPTATION) * target**EXPOSURE_ADAPTATION
    measured = torch.where(has_history, torch.where(count > 0.0, smooth, known), target)
    followed = torch.where(is_given, given, measured)
    proposed = torch.where(is_given, given, torch.where(has_history & (count <= 0.0), known, target))
    is_outlier = has_history & ((proposed > known * EXPOSURE_OUTLIER) | (proposed * EXPOSURE_OUTLIER < known))
    confirmed = torch.where(is_outlier, torch.where(before < 0.0, proposed, -known), followed)
    return torch.where(has_history, confirmed, -followed)


def is_flash(followed: Tensor, given: Tensor, before: Tensor) -> Tensor:
    """Return whether a measured exposure is an outlier, (1,): the light of the whole frame is unconfirmed.

    Args:
        followed: (1,) result of `exposure_for`.
        given: (1,) from the engine; 0: measure.
        before: (1,) result of `exposure_for` for the previous frame; 0 without one.
    """
    known, used = before.abs(), followed.abs()
    is_outlier = (followed < 0.0) | (used > known * EXPOSURE_OUTLIER) | (used * EXPOSURE_OUTLIER < known)
    is_given = (given >= MIN_EXPOSURE) & (given <= MAX_EXPOSURE)
    return is_outlier & (torch.where(is_given, 0.0, known) > 0.0)


def tone(color: Tensor, unit: Tensor | float = 1.0) -> Tensor:
    """Map linear RGB [0, inf) to [0, 1): c / (unit + max(r, g, b)). This keeps hue, and limits fireflies.

    Args:
        color: (1, 3, h, w) >= 0.
        unit: the value that exposure maps to 1: 1 for exposed colours, 1 / exposure for others.
    """
    return color / (unit + largest(color))


def inverse_tone(color: Tensor) -> Tensor:
    """Invert `tone`, limited to the range of half floats."""
    return color / (1.0 - largest(color)).clamp(min=1.0 / MAX_HALF)


def peak(toned: Tensor) -> Tensor:
    """Return the largest channel of the 3x3 samples, at least HIGHLIGHT_TONED, (1, 1, h, w)."""
    return maximum_3x3(largest(toned)).clamp(min=constants.HIGHLIGHT_TONED)


def dimming(toned: Tensor, limit: Tensor) -> Tensor:
    """Return the factor, (1, 1, H, W), with which no channel of `toned` exceeds `limit`; 1 where none does.

    Filters with negative weights, and luma and chroma filtered apart, exceed the samples that they filter.
    In highlights, the inverse of the tone curve turns little of that into a multiple of the light.
    """
    return limit / torch.maximum(limit, largest(toned))


class ToneCurve(NamedTuple):
    """Map from linear RGB [0, inf) to [0, 1], with the `unit` of `tone`, and back to exposed linear RGB."""

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
    """Convert RGB to luma and two chroma axes. Axis-aligned boxes fit colours tightly in this space."""
    return _transformed(color, ((0.25, 0.5, 0.25), (0.5, 0.0, -0.5), (-0.25, 0.5, -0.25)))


def from_ycocg(color: Tensor) -> Tensor:
    """Invert `ycocg`."""
    return _transformed(color, ((1.0, 1.0, -1.0), (1.0, 0.0, 1.0), (1.0, -1.0, -1.0)))


def _transformed(color: Tensor, matrix: Sequence[Sequence[float]]) -> Tensor:
    return F.conv2d(color, color.new_tensor(matrix)[:, :, None, None])
