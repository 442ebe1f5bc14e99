"""`ModelInfo`: the parsed content of a model.json."""

import math
import re
import reprlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from supersampler.conventions.jitter import only_ratio
from supersampler.errors import ModelError
from supersampler.frame import Size
from supersampler.io.json_files import Text
from supersampler.methods.array_spec import ArraySpec, values_of
from supersampler.methods.at_rest import AT_REST_HISTORY, block_count, phase_count
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.spec import (
    BLOCKS,
    DISPLAY,
    HALF,
    LARGE,
    LARGE_HALF,
    MAX_CHANNELS,
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


_MANY = msgspec.Meta(max_length=100)
_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=80)]
_Ratio = Annotated[float, msgspec.Meta(ge=1.0, le=64.0)]
_Extent = Annotated[str, msgspec.Meta(max_length=40)] | Annotated[int, msgspec.Meta(ge=1, le=MAX_CHANNELS)]
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")


class TensorInfo(msgspec.Struct, frozen=True):
    """One input, output or history tensor of a graph.

    Attributes:
        name: name in the graph.
        type: numpy's name of its element type.
        shape: numbers, and names of dynamic extents: render_width, display_height, previous_width, ...
    """

    name: _Name
    type: Literal["float32", "int64"]
    shape: Annotated[tuple[_Extent, ...], msgspec.Meta(max_length=4)]

    def __post_init__(self) -> None:
        if math.prod(extent for extent in self.shape if isinstance(extent, int)) > MAX_CHANNELS:
            raise ValueError(f"shape is {self.shape}; want numbers whose product is at most {MAX_CHANNELS}")

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


class HistoryInfo(TensorInfo, frozen=True):
    """One history tensor: its input takes the previous step's `output`; zeros mean no history."""

    output: _Name


class NetworkInfo(msgspec.Struct, frozen=True):
    """Cost of a network: its multiply-adds per display pixel."""

    multiply_adds: Annotated[float, msgspec.Meta(ge=0.0, le=1e12)] = 0.0


class ModelInfo(msgspec.Struct, frozen=True, kw_only=True):
    """The checked content of a model.json; `supersampler info MODEL` prints it.

    `only_extrapolated`: the model handles extrapolated frames only, for the model in the parent folder.
    `folder` is that of the file, and no key of it.
    """

    contract: int
    method: _Name
    source: Text
    ratios: tuple[_Ratio, _Ratio]
    inputs: Annotated[tuple[TensorInfo, ...], _MANY]
    history: Annotated[tuple[HistoryInfo, ...], _MANY]
    image: TensorInfo
    aux_outputs: Annotated[tuple[TensorInfo, ...], _MANY]
    maps: Annotated[dict[str, MapOf], _MANY]
    files: Annotated[dict[str, Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]], _MANY]
    config: Annotated[dict[str, Any], _MANY]
    parity: Annotated[dict[str, Any], _MANY]
    licence: Text
    attributions: Annotated[tuple[Text, ...], msgspec.Meta(max_length=1000)]
    versions: Annotated[dict[str, Annotated[str, msgspec.Meta(max_length=200)]], _MANY]
    network: NetworkInfo = NetworkInfo()
    only_extrapolated: bool = False
    folder: Path = Path()

    def __post_init__(self) -> None:
        if self.ratios[0] > self.ratios[1]:
            raise ValueError(f"ratios is {self.ratios}; want [smallest, largest]")
        for name in self.files:
            if name != EXTRAPOLATED_FILE and not _FILE_NAME.fullmatch(name):
                want = f"plain names of files in the folder, or {EXTRAPOLATED_FILE!r}"
                raise ValueError(f"files has {reprlib.repr(name)}; want {want}")

    @property
    def multiply_adds(self) -> float:
        """Multiply-adds of the network, per display pixel."""
        return self.network.multiply_adds

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
        channels = {h.name: h.shape[:2] for h in self.history}
        wanted = {f"history.{name}": shape[:2] for name, shape in AT_REST_HISTORY.items()}
        return wanted.items() <= channels.items()

    @property
    def graph_inputs(self) -> list[TensorInfo]:
        """All inputs of the graph."""
        return [*self.inputs, *self.history]

    @property
    def graph_outputs(self) -> list[TensorInfo]:
        """All outputs of the graph."""
        next_history = [TensorInfo(h.output, h.type, h.shape) for h in self.history]
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
