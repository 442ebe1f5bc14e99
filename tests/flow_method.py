"""`guided-flow` with a narrow network of random weights that move light, and a scene with a moving shadow."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import torch

from lit_scene import LitScene
from supersampler import Frame
from supersampler.frame import Size
from supersampler.methods.extrapolation.spec import FlowNetworkConfig, GuidedFlowConfig, GuidedWarpConfig
from supersampler_model.data.scenes.analytic import Values, Vector, grey
from supersampler_model.methods.guided_flow import GuidedFlow

SMALL = GuidedFlowConfig(network=FlowNetworkConfig((8, 8, 8)), warp=GuidedWarpConfig(strides=(1,)))


def random_flow() -> GuidedFlow:
    """The method with weights that move light by pixels."""
    torch.manual_seed(3)
    method = GuidedFlow(SMALL)
    for name, parameter in method.net.named_parameters():
        if name.endswith("flow.weight"):
            torch.nn.init.normal_(parameter, std=0.5)
    return method.eval()


@dataclass(frozen=True)
class Shadow:
    """A plane whose left is in the shade; the shade's edge moves right over it, `speed` units a frame."""

    speed: float
    edge: float = 24.0
    velocity: Vector = (0.0, 0.0)

    def frame(self, index: int, size: Size = (64, 36), jitter: Vector = (0.0, 0.0), **over: Any) -> Frame:
        """See `LitScene.frame`; all surfaces are rough."""
        scene = LitScene(light=self._light(index), velocity=self.velocity)
        frame = scene.frame(index, size, jitter, **over)
        gbuffer = {**(frame.gbuffer or {}), "roughness": 0.0 * frame.depth + 0.7}
        return frame if "gbuffer" in over else replace(frame, gbuffer=gbuffer)

    def _light(self, index: int) -> Callable[[Values, Values], Values]:
        at = self.edge + index * (self.speed - self.velocity[0])
        return lambda x, y: grey(0.4 + 1.6 / (1.0 + 2.0 ** (-2.0 * (x - at))) + 0.0 * y)
