"""The method interface: a pure function step(frame inputs, history) -> (image, history) as one torch module.

The signature of `forward` is the contract. Its parameters name the frame inputs; parameters that begin with
`history_` are the history tensors. Shapes are in `TENSORS` and in the method's `history`. An all-zero history
means no history. `forward` returns the image, the next history in the order of `history`, then the outputs
named in `aux_outputs`.
"""

import inspect
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from supersampler.methods.gbuffers import GBUFFERS

Shape = tuple[int | str, ...]

RENDER = ("render_height", "render_width")
PREVIOUS = (
    "previous_height",
    "previous_width",
)  # render size of the previous frame, which may differ from this one's
SHADED = ("shaded_height", "shaded_width")  # render size of the last frame that was shaded, likewise
EARLIER = ("earlier_height", "earlier_width")  # of the one that was shaded before that
BETWEEN = ("between_height", "between_width")  # of the frame right before the last shaded one, of either kind
DISPLAY = ("display_height", "display_width")
CHANNELS = "channels"  # of the AOVs
HALF = ("half_height", "half_width")  # half the display size, rounded up

TENSORS: Mapping[str, Shape] = {
    "color": (1, 3, *RENDER),
    "depth": (1, 1, *RENDER),
    "motion": (1, 2, *RENDER),
    "jitter": (1, 2),
    "exposure": (1,),  # 0: measured by the graph
    "display_size": (2,),  # int64 (width, height)
    "aovs": (1, CHANNELS, *RENDER),
    **{
        name: (1, place.channels, *(DISPLAY if place.of_display else RENDER))
        for name, place in GBUFFERS.items()
    },
    "weight": (1, 1, *DISPLAY),
    "image": (1, 3, *DISPLAY),
}


class Size(NamedTuple):
    """Width and height of an image; symbolic while a graph is exported."""

    width: int
    height: int


class MapOf(NamedTuple):
    """Source of a debug map: channels of one output of the graph."""

    output: str
    first: int
    channels: int


class Outputs(NamedTuple):
    """The results of one step."""

    image: Tensor
    history: list[Tensor]
    aux_outputs: list[Tensor]


class Fused(NamedTuple):
    """The network of a step, for backends that compute the rest themselves."""

    module: nn.Module
    inputs: Mapping[str, Shape]
    outputs: Mapping[str, Shape]
    ratio: int = 2  # of display to render size, where shapes are of both


class Method(nn.Module):
    """Base of all methods. Stages: `gather` resamples, `network` infers, `finish` blends and sanitizes.

    Attributes:
        name: as in `Upscaler(name)` and in the model folder.
        source: the paper or definition it follows.
        history: shape of each tensor handed from one frame to the next, without the `history_` prefix.
        aux_outputs: names, in `TENSORS`, of outputs that the next step does not need.
        maps: debug maps by name.
        image: shape of the image.
        ratios: least and largest ratio of display to render size, per axis. Where both are the same, display
            sizes are exactly that many times the render size, and a graph is traced so.
        only_extrapolated: whether it steps on extrapolated frames only; another method returns it from
            `on_extrapolated`.
        learned: training facts of the weights, plain data; empty without weights.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    history: ClassVar[Mapping[str, Shape]] = {}
    aux_outputs: ClassVar[tuple[str, ...]] = ()
    maps: ClassVar[Mapping[str, MapOf]] = {}
    image: ClassVar[Shape] = TENSORS["image"]
    ratios: ClassVar[tuple[float, float]] = (1.0, 4.0)
    only_extrapolated: ClassVar[bool] = False
    learned: Mapping[str, Any] = MappingProxyType({})

    @classmethod
    def inputs(cls) -> list[str]:
        """Names of the frame inputs of the step, in order."""
        return [name for name in cls._parameters_of_step() if not name.startswith("history_")]

    @classmethod
    def _parameters_of_step(cls) -> list[str]:
        return [name for name in inspect.signature(cls.forward).parameters if name != "self"]

    @classmethod
    def extrapolates(cls) -> bool:
        """Whether the method computes unshaded frames at render size, and upscales nothing."""
        return cls.image[2:] == RENDER

    @classmethod
    def after_shaded(
        cls, frame: Mapping[str, Tensor], history: Sequence[Tensor] | None = None
    ) -> list[Tensor]:
        """Return the history of an extrapolating method after a shaded frame (docs/contract.md).

        Such methods take no step on shaded frames: the history is a copy of the frame.

        Args:
            frame: the inputs of the step and `color`, by name.
            history: the history after the previous frame; None after a start or a cut.
        """
        previous = None if history is None else dict(zip(cls.history, history, strict=True))
        next_history: dict[str, Tensor] = {}
        for name in cls.history:
            own = name.removeprefix("earlier_")
            if own != name:
                next_history[name] = next_history[own] if previous is None else previous[own]
            elif name == "motion" or (name == "shaded_motion" and previous is None):
                next_history[name] = torch.zeros_like(frame["motion"])
            else:
                source = {"motion_jitter": "jitter", "shaded_motion": "motion"}.get(name, name)
                next_history[name] = frame[source] if source in frame else frame[f"gbuffer_{source}"]
        return list(next_history.values())

    def step(self, *arguments: Tensor) -> Outputs:
        """Run `forward` and split its results."""
        image, *rest = self(*arguments)
        count = len(self.history)
        return Outputs(image, rest[:count], rest[count:])

    def fused(self) -> Fused | None:
        """Return the network; None without one, or where it cannot run as one graph."""
        return None

    def on_extrapolated(self) -> "Method | None":
        """Return the method for extrapolated frames on the same history; None: this method."""
        return None

    def first_history(self, display: Size, render: Size, channels: int = 1) -> list[Tensor]:
        """Return zeros: no history."""
        half = Size((display.width + 1) // 2, (display.height + 1) // 2)
        names = (*DISPLAY, *HALF, *PREVIOUS, *SHADED, *EARLIER, *BETWEEN, CHANNELS)
        extents = (*display[::-1], *half[::-1], *4 * render[::-1], channels)
        sizes = dict(zip(names, extents, strict=True))
        return [
            torch.zeros([sizes[n] if isinstance(n, str) else n for n in s]) for s in self.history.values()
        ]


def render_size_of(image: Tensor) -> Size:
    """Size of an NCHW tensor."""
    return Size(image.shape[3], image.shape[2])


def display_size_of(display_size: Tensor) -> Size:
    """Read (width, height) from the int64 input as sizes that the exporter can trace."""
    width, height = int(display_size[0].item()), int(display_size[1].item())
    torch._check(width >= 1)  # type: ignore[no-untyped-call]
    torch._check(height >= 1)  # type: ignore[no-untyped-call]
    return Size(width, height)
