"""`ModelInfo`: the parsed content of a model.json."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from supersampler.conventions.jitter import only_ratio
from supersampler.errors import ModelError
from supersampler.frame import Size
from supersampler.methods.array_spec import ArraySpec, values_of
from supersampler.methods.at_rest import AT_REST_HISTORY, block_count, phase_count
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.spec import (
    BLOCKS,
    DISPLAY,
    HALF,
    LARGE,
    LARGE_HALF,
    NEXT_BLOCKS,
    NEXT_PHASES,
    PHASES,
    PREVIOUS,
    RENDER,
    MapOf,
    Shape,
    half_size,
    large_size,
    sized,
)

EXTRAPOLATED = "extrapolated"
"""Subfolder of a model's folder with the model for extrapolated frames."""
EXTRAPOLATED_FILE = f"{EXTRAPOLATED}/model.json"
"""Entry of its model.json in `files`, the only one with a folder in its name."""


@dataclass(frozen=True)
class TensorInfo:
    """One input, output or history tensor of a graph.

    Attributes:
        name: name in the graph.
        type: numpy's name of its element type.
        shape: numbers, and names of dynamic extents: render_width, display_height, previous_width, ...
    """

    name: str
    type: str
    shape: Shape

    def shape_for(self, *, render: Size, display: Size, previous: Size) -> tuple[int, ...]:
        """Return the shape at the given (width, height) sizes."""
        return sized(self.shape, extents(render=render, display=display, previous=previous))

    def spec_for(self, *, render: Size, display: Size, previous: Size) -> ArraySpec:
        """Return the type, shape and range of this history tensor, at the given (width, height) sizes."""
        shape = self.shape_for(render=render, display=display, previous=previous)
        return ArraySpec(self.type, shape, values_of(self.name))

    def spec_of_frames(self) -> ArraySpec:
        """Return the type and shape where the history is earlier frames: of any size, with any pixels."""
        return ArraySpec(self.type, self.shape, values_of(self.name) if "jitter" in self.name else None)


@dataclass(frozen=True)
class HistoryInfo:
    """One history tensor: `input` takes the previous step's `output`; zeros mean no history."""

    input: TensorInfo
    output: str


@dataclass(frozen=True)
class ModelInfo:
    """The checked content of a model.json; `supersampler info MODEL` prints it.

    `multiply_adds` counts those of the network, per display pixel. `only_extrapolated`: the model handles
    extrapolated frames only, for the model in the parent folder.
    """

    folder: Path
    contract: int
    method: str
    source: str
    ratios: tuple[float, float]
    inputs: tuple[TensorInfo, ...]
    history: tuple[HistoryInfo, ...]
    image: TensorInfo
    aux_outputs: tuple[TensorInfo, ...]
    maps: Mapping[str, MapOf]
    files: Mapping[str, str]
    multiply_adds: float
    config: Mapping[str, Any]
    parity: Mapping[str, Any]
    licence: str
    attributions: tuple[str, ...]
    versions: Mapping[str, str]
    only_extrapolated: bool

    @property
    def extrapolated(self) -> Path | None:
        """Folder of the model for extrapolated frames; None where this model handles them."""
        return self.folder / EXTRAPOLATED if EXTRAPOLATED_FILE in self.files else None

    @property
    def steps(self) -> Mapping[str, Path]:
        """Graphs of the whole recurrent step, by the precision of the network."""
        names = {"fp32": "step.onnx", "fp16": "step.fp16.onnx"}
        return {kind: self.folder / name for kind, name in names.items() if name in self.files}

    @property
    def networks(self) -> Mapping[str, Path]:
        """Graphs of the network alone, by its precision; empty for methods without a network."""
        names = {"fp32": "network.onnx", "int8": "network.int8.onnx"}
        return {kind: self.folder / name for kind, name in names.items() if name in self.files}

    @property
    def gbuffers(self) -> tuple[str, ...]:
        """Names of the inputs that are G-buffers, keys of GBUFFERS."""
        return tuple(tensor.name for tensor in self.inputs if tensor.name in GBUFFERS)

    @property
    def extrapolates(self) -> bool:
        """Whether it extrapolates unshaded frames instead of upscaling: its image has render size."""
        return has_render_size(self.image.shape)

    @property
    def converges(self) -> bool:
        """Whether the image becomes the mean of its samples where nothing moves (`methods.at_rest`)."""
        channels = {h.input.name: h.input.shape[:2] for h in self.history}
        wanted = {f"history.{name}": shape[:2] for name, shape in AT_REST_HISTORY.items()}
        return wanted.items() <= channels.items()

    @property
    def graph_inputs(self) -> list[TensorInfo]:
        """All inputs of the graph."""
        return [*self.inputs, *(h.input for h in self.history)]

    @property
    def graph_outputs(self) -> list[TensorInfo]:
        """All outputs of the graph."""
        next_history = [TensorInfo(h.output, h.input.type, h.input.shape) for h in self.history]
        return [self.image, *next_history, *self.aux_outputs]

    @property
    def only_ratio(self) -> float | None:
        """The only ratio of display to render size; None where there is a range."""
        return only_ratio(self.ratios)

    def config_error(self, name: str, value: Any, want: str) -> ModelError:
        """Return the error for a constant that kernels do not support."""
        return ModelError(f"{self.folder / 'model.json'}: config.{name} is {value!r:.60}; want {want}.")

    @property
    def aovs_path(self) -> Path:
        """The graph that blends AOVs."""
        return self.folder / "aovs.onnx"


def extents(*, render: Size, display: Size, previous: Size) -> dict[str, int]:
    """Return the dynamic extents by name, at the given (width, height) sizes."""
    large = large_size(display)
    sizes = {
        RENDER: render,
        DISPLAY: display,
        HALF: half_size(display),
        LARGE: large,
        LARGE_HALF: half_size(large),
        PREVIOUS: previous,
    }
    sizes |= {BLOCKS: block_count(previous), NEXT_BLOCKS: block_count(render)}
    extents = {
        name: extent for pair, size in sizes.items() for name, extent in zip(pair, size[::-1], strict=True)
    }
    return extents | {PHASES: phase_count(display, previous), NEXT_PHASES: phase_count(display, render)}


def map_size(shape: Shape, display: Size) -> Size:
    """Return the (width, height) of a map of a history tensor: those of the larger display are resampled."""
    return half_size(display) if shape[2:] in (HALF, LARGE_HALF) else display


def has_render_size(shape: Sequence[int | str]) -> bool:
    """Whether a tensor (1, channels, height, width) has the size of the frame."""
    return tuple(shape[2:]) == RENDER
