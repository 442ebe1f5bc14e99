"""Frames that use every branch of a method: bad pixels, other light, exposures that come and go."""

from collections.abc import Iterator

import torch
from torch import Tensor

from supersampler.conventions.jitter import only_ratio, scaled
from supersampler_export.parity import noise
from supersampler_model.methods.base import Method
from supersampler_model.ops.images import Size

RENDER = Size(37, 22)
EXPOSURES = (0.0, 1.7, 0.0, 900.0, 900.0, 2.0, 0.0)
"""Measured, given, measured; an outlier, which is held back once; an outlier back again; measured."""
BAD = (float("nan"), float("inf"), -float("inf"), -1.0, 1e6)


def display_of(method: Method) -> Size:
    ratio = only_ratio(method.ratios)
    found = scaled(RENDER, ratio) if ratio else (81, 47)
    assert found is not None
    return Size(*found)


def frames(display: Size) -> Iterator[dict[str, Tensor]]:
    """Noise that moves by a few pixels, then off the screen, with bad pixels and in other light."""
    for index, frame in enumerate(noise(RENDER, display, len(EXPOSURES))):
        made = {**frame, "exposure": torch.tensor([EXPOSURES[index]])}
        if index == 1:
            made["motion"] = spoiled(6.0 * frame["motion"])
            made["depth"] = spoiled(frame["depth"])
        if index == 2:
            others = {name for name, value in made.items() if value.ndim == 4} - {"depth", "motion", "weight"}
            made |= {name: spoiled(made[name]) for name in others}
        if index == 3:
            made["color"] = 0.002 * frame["color"]
        if index == 5:  # a shadow on the left half; what was near is far
            made["color"][..., :18] *= 0.05
            made["depth"] = 0.05 - frame["depth"]
        if index == 6:
            made["color"] = torch.full_like(frame["color"], torch.nan)
        yield made


def spoiled(image: Tensor) -> Tensor:
    """The image with two rows of each invalid value, more than may differ, a bright and a dark row."""
    image = image.clone()
    for place, bad in enumerate(BAD):
        image[..., 1 + 2 * place : 3 + 2 * place, :] = bad
    image[..., 13, :] *= 300.0
    image[..., 14, :] *= 1e-7
    return image
