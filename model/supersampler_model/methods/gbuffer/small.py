"""`gbuffer-small`: `gbuffer` with narrow separable convolutions."""

from functools import partial
from typing import ClassVar

from supersampler_model.methods.gbuffer.model import GBuffer, GBufferConfig
from supersampler_model.methods.gbuffer.network import GBufferNetworkConfig

NETWORK = GBufferNetworkConfig(
    surfaces=(32, 32), detailed=(32, 32), frame=24, levels=(48, 64, 96, 128), separable=True
)


class SmallGBuffer(GBuffer):
    """`gbuffer-small` at a ratio of 2."""

    name = "gbuffer-small"
    settings: ClassVar = staticmethod(partial(GBufferConfig, network=NETWORK))


class SmallGBuffer4(GBuffer):
    """`gbuffer-small` at a ratio of 4."""

    name = "gbuffer-small-4x"
    ratios: ClassVar = (4.0, 4.0)
    settings: ClassVar = staticmethod(partial(GBufferConfig, network=NETWORK, ratio=4))
