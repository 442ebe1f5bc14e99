"""What the network of `classifier` sees of a pixel.

Few multiply-adds find differences and contrasts badly, and a gather that has the pixels at hand finds them
for nothing: the network sees them in place of colours. Colours count as square roots, so that dark ones
differ as much as bright ones.
"""

import math
from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from supersampler.methods.classifier.spec import CountCode
from supersampler_model.methods.classifier.buffers import Present, Remembered
from supersampler_model.methods.classifier.network import pack
from supersampler_model.ops.color import largest, luminance
from supersampler_model.ops.motion import Past, squared_length
from supersampler_model.ops.sampling import blurred, extreme, sum_of

MOST = 64.0  # samples that the logarithm reaches 1 at
COUNTS: Mapping[CountCode, Callable[[Tensor], Tensor]] = {
    "saturating": lambda count: count / (count + 4.0),
    "logarithm": lambda count: (1.0 + count).log() / math.log1p(MOST),
}
"""What the network sees of a count of samples."""


def inputs_of(
    present: Present, past: Remembered, there: Past, count: CountCode = "saturating"
) -> dict[str, Tensor]:
    """All of INPUTS, about 1 at most."""
    frame, sample, color, range_ = (_root(c) for c in (present.frame, present.sample, past.color, past.range))
    luma, luma_before = luminance(sample), luminance(color)
    low, high = extreme(luma_before, torch.minimum), extreme(luma_before, torch.maximum)
    speed = squared_length(there.motion).sqrt()
    across, down = there.x - there.x.floor(), there.y - there.y.floor()
    return {
        "frame": luminance(frame),
        "sample": luma,
        "past": luma_before,
        "past_to_sample": largest((color - sample).abs()),
        "past_to_frame": largest((color - frame).abs()),
        "contrast": _root(_root(largest(present.second - present.first * present.first))),
        "past_contrast": high - low,
        "beyond": torch.maximum(low - luma, luma - high).clamp(min=0.0),
        "least": range_[:, :1],
        "most": range_[:, 1:2],
        "detail": _root(largest(past.detail.abs())),
        "confidence": present.confidence,
        "count": COUNTS[count](past.samples),
        "difference": past.difference,
        "surface": past.surface,
        "speed": speed / (speed + 4.0),
        "blur": 2.0 * (across * (1.0 - across) + down * (1.0 - down)),
        "edge": present.edge,
    }


def around_of(seen: dict[str, Tensor]) -> dict[str, Tensor]:
    """All of AROUND. Aliasing differs from pixel to pixel and a change of light does not: means tell."""
    apart = seen["past"] - seen["frame"]
    return {"drift": _root(_mean(apart).abs()), "grain": _root(_mean(apart.abs()))}


def _mean(image: Tensor) -> Tensor:
    """(1, 1, H, W) to half size, a tent of 5x5 there."""
    four = pack(image)
    half = 0.25 * sum_of([four[:, i : i + 1] for i in range(4)])
    return blurred(blurred(half))


def _root(value: Tensor) -> Tensor:
    """Square root, whose slope is bounded."""
    return value.clamp(min=1e-6).sqrt()
