"""`guided-flow` with a narrow network that says something, small enough to be exported in a test."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch

from lit_scene import LitScene
from supersampler import Frame
from supersampler.frame import Size
from supersampler.methods.extrapolation.spec import FlowNetworkConfig, GuidedFlowConfig, GuidedWarpConfig
from supersampler_model.data.scenes.analytic import Values, Vector, grey
from supersampler_model.methods.extrapolation.guided_flow import GuidedFlow
from supersampler_model.methods.weights_file import Trained, save_trained

SMALL = GuidedFlowConfig(network=FlowNetworkConfig((8, 8, 8)), warp=GuidedWarpConfig(strides=(1,)))
TINY = GuidedFlowConfig(network=FlowNetworkConfig((8, 8)), warp=GuidedWarpConfig(strides=(), taps=1))
"""Of as few operators as there can be: tracing takes its time for each."""


def random_flow(config: GuidedFlowConfig = SMALL) -> GuidedFlow:
    """The method with weights that move light by pixels."""
    torch.manual_seed(3)
    method = GuidedFlow(config)
    for name, parameter in method.net.named_parameters():
        if name.endswith("flow.weight"):
            torch.nn.init.normal_(parameter, std=0.5)
    return method.eval()


def flow_weights(path: Path) -> Path:
    """Write weights as a run does, of the method that is fast to trace."""
    method = random_flow(TINY)
    facts: dict[str, Any] = {"steps": 1, "data": "0" * 64, "assets": [], "commit": "abc", "validation": {}}
    save_trained(path, Trained(method.name, asdict(method.config), facts, method.state_dict()))
    return path


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
