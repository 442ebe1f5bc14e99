"""`MethodSpec`: a method's name, tensor shapes, ratios, outputs and constants, for all backends and training.

The `spec.py` in a method's folder registers the `MethodSpec` (see `registry`) with a frozen dataclass of
constants. Annotations give the ranges of constants that kernels use: `gamma: Number = 1.0`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_type_hints

import msgspec
import numpy as np

from supersampler.frame import Float32, Size
from supersampler.methods.gbuffers import GBUFFERS

Shape = tuple[int | str, ...]
MAX_CHANNELS = 1024
"""Largest number of values per pixel in a tensor."""

RENDER = ("render_height", "render_width")
PREVIOUS = ("previous_height", "previous_width")
"""Render size of the previous frame, which may differ."""
SHADED = ("shaded_height", "shaded_width")
"""Render size of the last shaded frame."""
EARLIER = ("earlier_height", "earlier_width")
"""Render size of the shaded frame before the last one."""
BETWEEN = ("between_height", "between_width")
"""Render size of the frame before the last shaded one, shaded or not."""
DISPLAY = ("display_height", "display_width")
HALF = ("half_height", "half_width")
"""Half the display size, rounded up."""
LARGE = ("large_height", "large_width")
"""1.4 times the display size, rounded up: the history of `classifier-large`."""
LARGE_HALF = ("large_half_height", "large_half_width")
"""Half of LARGE, rounded up."""
BLOCKS = ("previous_blocks_down", "previous_blocks_across")
"""Blocks of 4x4 samples of the previous frame, including partial ones at the edges."""
NEXT_BLOCKS = ("blocks_down", "blocks_across")
"""Blocks of this frame."""
PHASES = "previous_phases"
"""Number of jitter phases with a history: int(9 ratio^2) + 2 at the previous frame's ratio."""
NEXT_PHASES = "phases"
"""Number of jitter phases at this frame's ratio."""
CHANNELS = "channels"
"""Number of a frame's AOV channels."""

INPUTS: Mapping[str, Shape] = {
    "color": (1, 3, *RENDER),
    "depth": (1, 1, *RENDER),
    "motion": (1, 2, *RENDER),
    "reactive": (1, 1, *RENDER),
    "jitter": (1, 2),
    "exposure": (1,),  # 0: the graph measures it
    "pre_exposure": (1,),
    "adds_samples": (1,),  # 0: the frame adds none to the mean of static pixels
    "display_size": (2,),  # (width, height)
    **{
        name: (1, place.channels, *(DISPLAY if place.of_display else RENDER))
        for name, place in GBUFFERS.items()
    },
}
"""Shapes of all inputs of steps, by tensor name."""
FRAME_INPUTS = (
    "color", "depth", "motion", "reactive", "jitter", "exposure", "pre_exposure", "display_size",
)  # fmt: skip
"""Inputs of every method with a history."""
WEIGHT: Shape = (1, 1, *DISPLAY)
"""Shape of the auxiliary outputs "weight" and "converged"."""
TENSORS: Mapping[str, Shape] = {
    **INPUTS,
    "aovs": (1, CHANNELS, *RENDER),
    "weight": WEIGHT,
    "converged": WEIGHT,
}
"""Shapes of the inputs of all graphs, and of auxiliary outputs."""


def half_size(size: Size) -> Size:
    """Return half of a (width, height), rounded up."""
    return (size[0] + 1) // 2, (size[1] + 1) // 2


def large_size(display: Size) -> Size:
    """Return 1.4 times a display's (width, height), rounded up."""
    return (7 * display[0] + 4) // 5, (7 * display[1] + 4) // 5


def resized(planes: Float32, size: Size) -> Float32:
    """Return planes (1, c, h, w) resampled to another (width, height) by nearest pixels."""
    if planes.shape[:1:-1] == tuple(size):
        return planes
    rows, columns = (
        (np.arange(extent) * 2 + 1) * own // (2 * extent)
        for extent, own in zip(size[::-1], planes.shape[2:], strict=True)
    )
    return np.ascontiguousarray(planes[:, :, rows[:, None], columns])


def dtype_of(tensor: str) -> Literal["float32", "int64"]:
    """Return numpy's name of a tensor's element type."""
    return "int64" if tensor == "display_size" else "float32"


class Range(NamedTuple):
    """Smallest and largest value of a constant."""

    low: float
    high: float


Sigma = Annotated[float, Range(1e-3, 1e3)]
"""Standard deviation of a Gaussian."""
Number = Annotated[float, Range(0.0, 1e6)]
"""A non-negative constant."""
UnitFloat = Annotated[float, Range(0.0, 1.0)]
"""A fraction or weight."""
Flag = Annotated[bool, "compiled"]
"""An option that kernels are compiled for, on and off."""


class MapOf(msgspec.Struct, frozen=True):
    """A debug view: `channels` channels of the graph's output `output`, from index `first` on."""

    output: Annotated[str, msgspec.Meta(min_length=1, max_length=80)]
    first: Annotated[int, msgspec.Meta(ge=0, le=MAX_CHANNELS)]
    channels: Annotated[int, msgspec.Meta(ge=1, le=MAX_CHANNELS)]


@dataclass(frozen=True)
class NoConstants:
    """Config of methods without constants."""


@dataclass(frozen=True, kw_only=True)
class MethodSpec:
    """Description of one method. Implementations are given as "package.module:name", and imported on use.

    Attributes:
        name: name of the method, for `Upscaler(name)`, and of its model folder.
        source: the paper or definition that it follows.
        inputs: names in INPUTS that the step takes, in the order of the graph.
        history: shape of each history tensor, in the order of the graph. The input `history.NAME` takes the
            previous step's `next.NAME`; zeros mean no history.
        aux_outputs: names in TENSORS of outputs that the next step does not read.
        maps: debug views, by name.
        image: shape of the image.
        ratios: smallest and largest ratio of display to render size, per axis. If they are equal, the ratio
            is exact: no size is rounded.
        only_extrapolated: whether it steps on extrapolated frames only, next to a method of shaded frames.
        config: frozen dataclass of its constants, with defaults.
        torch: the torch module that defines the step.
        task: the training task; "" without learned parts.
        weights: file of the released weights in supersampler_model/weights; "" if none ship.
        cpu: name of the method in the CPU library; "" if the library lacks it.
        gpu: the function that returns the program of the GPU backend; "" without shaders.
        kernel_files: files of the model folder that kernels and shaders read.
        kernels_support: returns whether kernels and shaders compute the step with a config.
    """

    name: str
    source: str
    inputs: tuple[str, ...]
    history: Mapping[str, Shape] = field(default_factory=dict)
    aux_outputs: tuple[str, ...] = ()
    maps: Mapping[str, MapOf] = field(default_factory=dict)
    image: Shape = (1, 3, *DISPLAY)
    ratios: tuple[float, float] = (1.0, 4.0)
    only_extrapolated: bool = False
    config: type[Any] = NoConstants
    torch: str = ""
    task: str = ""
    weights: str = ""
    cpu: str = ""
    gpu: str = ""
    kernel_files: tuple[str, ...] = ()
    kernels_support: Callable[[Mapping[str, Any]], bool] = lambda _: True

    @property
    def ships(self) -> bool:
        """Whether the package ships a model: it needs no weights, or they are released."""
        return not self.task or bool(self.weights)

    @property
    def extrapolates(self) -> bool:
        """Whether it extrapolates unshaded frames at render size instead of upscaling."""
        return self.image[2:] == RENDER

    @property
    def graph_history(self) -> dict[str, Shape]:
        """Shape of each history tensor by its name as an input of the graph."""
        return {f"history.{name}": shape for name, shape in self.history.items()}


def sized(shape: Shape, extents: Mapping[str, int]) -> tuple[int, ...]:
    """Return a shape with numbers in place of the names of dynamic extents."""
    return tuple(extents[extent] if isinstance(extent, str) else extent for extent in shape)


def constants_of(spec: MethodSpec) -> dict[str, Range]:
    """Return the range of each constant that kernels use, in the order of the config."""
    hints = get_type_hints(spec.config, include_extras=True)
    return {
        name: part for name, hint in hints.items() for part in get_args(hint)[1:] if isinstance(part, Range)
    }


def flags_of(spec: MethodSpec) -> list[str]:
    """Return the names of the options for which kernels are compiled."""
    hints = get_type_hints(spec.config, include_extras=True)
    return [name for name, hint in hints.items() if hint == Flag]
