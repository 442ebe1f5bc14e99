"""`gbuffer-small`: `gbuffer` with narrow separable convolutions, trained in hours on two cores."""

from dataclasses import dataclass, field
from typing import ClassVar

from supersampler_model.methods.gbuffer import GBuffer, GBufferConfig
from supersampler_model.networks.gbuffer import GBufferNetworkConfig

NETWORK = GBufferNetworkConfig(
    surfaces=(32, 32), detailed=(32, 32), frame=24, levels=(48, 64, 96, 128), separable=True
)


@dataclass(frozen=True)
class SmallGBufferConfig(GBufferConfig):
    """Constants.

    Attributes:
        network: its widths.
    """

    network: GBufferNetworkConfig = field(default_factory=lambda: NETWORK)


@dataclass(frozen=True)
class SmallGBuffer4Config(SmallGBufferConfig):
    """Constants at a ratio of 4.

    Attributes:
        ratio: display over render size.
    """

    ratio: int = 4


class SmallGBuffer(GBuffer):
    """At a ratio of 2."""

    name = "gbuffer-small"
    settings: ClassVar[type[GBufferConfig]] = SmallGBufferConfig


class SmallGBuffer4(GBuffer):
    """At a ratio of 4."""

    name = "gbuffer-small-4x"
    ratios: ClassVar = (4.0, 4.0)
    settings: ClassVar[type[GBufferConfig]] = SmallGBuffer4Config
