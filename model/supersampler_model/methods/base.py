"""Base class of methods: a pure function step(frame inputs, history) -> (image, history), as a torch module.

The method's `spec`, in the SDK, gives names, shapes, ratios and constants. `forward` takes the spec's inputs,
then its history tensors; it returns the image, the next history and the auxiliary outputs, all in the order
of the spec. A history of zeros means no history. A method is written as `compute`, of colours without
pre-exposure.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from supersampler.methods.model_info import extents
from supersampler.methods.spec import BETWEEN, CHANNELS, EARLIER, RENDER, SHADED, MethodSpec, Shape, sized
from supersampler_model.ops.size import Size


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

    A subclass names its `spec` and repeats no fact of it.

    Attributes:
        spec: the facts of the method.
        name, history, ratios: those of the spec.
        config: its constants, an instance of `spec.config`.
        compute: the step without pre-exposure: takes the inputs but for `pre_exposure`, returns what
            `forward` returns.
        learned: provenance of the weights, plain data; empty for methods without a network.
    """

    spec: ClassVar[MethodSpec]
    name: ClassVar[str]
    history: ClassVar[Mapping[str, Shape]]
    ratios: ClassVar[tuple[float, float]]
    config: Any
    compute: Callable[..., tuple[Tensor, ...]]
    learned: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, config: Any = None) -> None:
        super().__init__()
        self.config = config or self.spec.config()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "spec" in cls.__dict__:
            cls.name, cls.history, cls.ratios = cls.spec.name, cls.spec.history, cls.spec.ratios

    def forward(self, *arguments: Tensor) -> tuple[Tensor, ...]:
        """Run `compute` on the colour over `pre_exposure`, and multiply the image by it again."""
        names = self.inputs()
        if "pre_exposure" not in names:
            return self.compute(*arguments)
        given = dict(zip(names, arguments, strict=False))
        pre_exposure = given.pop("pre_exposure")
        if "color" in given:
            given["color"] = given["color"] / pre_exposure
        image, *others = self.compute(*given.values(), *arguments[len(names) :])
        return image * pre_exposure, *others

    @classmethod
    def inputs(cls) -> list[str]:
        """Names of the frame inputs that the step asks for, in order."""
        return list(cls.spec.inputs)

    @classmethod
    def extrapolates(cls) -> bool:
        """Whether it extrapolates unshaded frames at render size, in place of upscaling."""
        return cls.spec.image[2:] == RENDER

    @classmethod
    def after_shaded(
        cls, frame: Mapping[str, Tensor], history: Sequence[Tensor] | None = None
    ) -> list[Tensor]:
        """Return the history of an extrapolating method after a shaded frame (docs/contract.md).

        Such methods take no step on shaded frames: the history is a copy of the frame, without pre-exposure.

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
            elif name == "color":
                next_history[name] = frame["color"] / frame["pre_exposure"]
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
        sizes = extents(render=render, display=display, previous=render) | {CHANNELS: channels}
        for pair in (SHADED, EARLIER, BETWEEN):
            sizes |= dict(zip(pair, render[::-1], strict=True))
        return [torch.zeros(sized(shape, sizes)) for shape in self.history.values()]
