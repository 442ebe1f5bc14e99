"""`gbuffer-small`: `gbuffer` with narrow separable blocks, trained in hours on two cores."""

from dataclasses import dataclass
from typing import ClassVar

from supersampler_model.methods.gbuffer import GBuffer, GBufferConfig


@dataclass(frozen=True)
class FourConfig(GBufferConfig):
    """Constants at a ratio of 4.

    Attributes:
        ratio: display over render size.
    """

    ratio: int = 4


class SmallGBuffer(GBuffer):
    """At a ratio of 2."""

    name = "gbuffer-small"


class SmallGBuffer4(GBuffer):
    """At a ratio of 4."""

    name = "gbuffer-small-4x"
    ratios: ClassVar = (4.0, 4.0)
    settings: ClassVar[type[GBufferConfig]] = FourConfig
