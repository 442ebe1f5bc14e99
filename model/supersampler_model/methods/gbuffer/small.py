"""`gbuffer-small`: `gbuffer` with narrow separable convolutions."""

from typing import ClassVar

from supersampler.methods.gbuffer.spec import GBUFFER_SMALL, GBUFFER_SMALL_4X
from supersampler_model.methods.gbuffer.model import GBuffer


class SmallGBuffer(GBuffer):
    """`gbuffer-small` at a ratio of 2."""

    spec: ClassVar = GBUFFER_SMALL


class SmallGBuffer4(GBuffer):
    """`gbuffer-small` at a ratio of 4."""

    spec: ClassVar = GBUFFER_SMALL_4X
