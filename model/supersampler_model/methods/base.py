"""What a method is: a pure function step(frame inputs, history) -> (image, history), as one torch module.

The signature of `forward` is the contract: its parameters name the inputs that the method asks for, those
that begin with `history_` the tensors it wants back from the frame before. Each has the shape in `TENSORS`
or in the method's own `history`. An all-zero history means no past. What it returns is the image, the
history in the order of `history`, then what else it tells, in the order of `aux_outputs`.
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
PREVIOUS = ("previous_height", "previous_width")  # render size of the frame before, which may differ
SHADED = ("shaded_height", "shaded_width")  # render size of the last frame that was shaded, likewise
EARLIER = ("earlier_height", "earlier_width")  # of the one that was shaded before that
BETWEEN = ("between_height", "between_width")  # of the frame right before the last shaded one, of either kind
DISPLAY = ("display_height", "display_width")
CHANNELS = "channels"  # of what a frame carries along
HALF = ("half_height", "half_width")  # half the display size, rounded up

TENSORS: Mapping[str, Shape] = {
    "color": (1, 3, *RENDER),
    "depth": (1, 1, *RENDER),
    "motion": (1, 2, *RENDER),
    "jitter": (1, 2),
    "exposure": (1,),  # 0 asks the graph to measure it
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
    """Where a map for people to look at is: channels of one output of the graph."""

    output: str
    first: int
    channels: int


class Outputs(NamedTuple):
    """What one step returns, told apart."""

    image: Tensor
    history: list[Tensor]
    aux_outputs: list[Tensor]


class Fused(NamedTuple):
    """The learned part of a step, for executors that do the rest by themselves."""

    module: nn.Module
    inputs: Mapping[str, Shape]
    outputs: Mapping[str, Shape]
    ratio: int = 2  # of display to render size, where shapes are of both


class Method(nn.Module):
    """Base of all methods: `gather` reads, `network` decides, `finish` blends and guards.

    Attributes:
        name: as in `Upscaler(name)` and in the model folder.
        source: the paper or definition it follows.
        history: shape of each tensor handed from one frame to the next, without the `history_` prefix.
        told: names, of `TENSORS`, of outputs that no step needs.
        maps: by name, what says why a picture is as it is.
        image: shape of the image.
        ratios: least and largest ratio of display to render size, per axis. Where both are the same, display
            sizes are exactly that many times the render size, and a graph is traced so.
        only_drawn: whether it steps on frames whose colour was drawn alone, beside a method that has it
            `on_extrapolated`.
        learned: what weights were learned from, plain data; empty where nothing was.
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
        """Names of the frame inputs that the step asks for, in order."""
        return [name for name in cls._parameters_of_step() if not name.startswith("history_")]

    @classmethod
    def _parameters_of_step(cls) -> list[str]:
        return [name for name in inspect.signature(cls.forward).parameters if name != "self"]

    @classmethod
    def extrapolates(cls) -> bool:
        """Whether it upscales nothing: it draws frames that were not shaded, at render size."""
        return cls.image[2:] == RENDER

    @classmethod
    def after_shaded(cls, frame: Mapping[str, Tensor], past: Sequence[Tensor] | None = None) -> list[Tensor]:
        """Return the history that a shaded frame leaves to a method that extrapolates (docs/contract.md).

        It is that frame, by copying: such methods take no step on it.

        Args:
            frame: the inputs of the step and `color`, by name.
            past: the history that the frame before left; None after a start or a cut.
        """
        before = None if past is None else dict(zip(cls.history, past, strict=True))
        left: dict[str, Tensor] = {}
        for name in cls.history:
            own = name.removeprefix("earlier_")
            if own != name:
                left[name] = left[own] if before is None else before[own]
            elif name == "motion" or (name == "shaded_motion" and before is None):
                left[name] = torch.zeros_like(frame["motion"])
            else:
                source = {"motion_jitter": "jitter", "shaded_motion": "motion"}.get(name, name)
                left[name] = frame[source] if source in frame else frame[f"gbuffer_{source}"]
        return list(left.values())

    def step(self, *arguments: Tensor) -> Outputs:
        """Return what `forward` does, told apart."""
        image, *rest = self(*arguments)
        count = len(self.history)
        return Outputs(image, rest[:count], rest[count:])

    def fused(self) -> Fused | None:
        """Return the learned part; None where nothing is learned, or not all of it is in one place."""
        return None

    def on_extrapolated(self) -> "Method | None":
        """Return what steps on frames whose colour was drawn, on the same history; None: this does."""
        return None

    def first_history(self, display: Size, render: Size, channels: int = 1) -> list[Tensor]:
        """All zeros: no past."""
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
    """Read (width, height) from the graph's int64 input, as sizes that an exporter can trace."""
    width, height = int(display_size[0].item()), int(display_size[1].item())
    torch._check(width >= 1)  # type: ignore[no-untyped-call]
    torch._check(height >= 1)  # type: ignore[no-untyped-call]
    return Size(width, height)
