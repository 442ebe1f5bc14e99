"""`gbuffer-small`: `gbuffer` with narrow separable convolutions, trained in hours on two cores."""

from typing import ClassVar

from supersampler.methods.gbuffer.spec import GBUFFER_SMALL, GBUFFER_SMALL_4X
from supersampler_model.methods.gbuffer.model import GBuffer


class SmallGBuffer(GBuffer):
    """At a ratio of 2."""

    spec: ClassVar = GBUFFER_SMALL


class SmallGBuffer4(GBuffer):
    """At a ratio of 4."""

    spec: ClassVar = GBUFFER_SMALL_4X
