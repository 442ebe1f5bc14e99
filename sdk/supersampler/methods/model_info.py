"""`ModelInfo`: the parsed content of a model.json."""

import math
import re
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from supersampler.conventions.jitter import only_ratio
from supersampler.errors import ModelError
from supersampler.frame import Size
from supersampler.io.json_files import Text
from supersampler.methods import spec as shapes
from supersampler.methods.at_rest import AT_REST_HISTORY, block_count, phase_count
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.spec import MAX_CHANNELS, MapOf, half_size, large_size, sized

EXTRAPOLATED = "extrapolated"
"""Subfolder of a model's folder with the model for extrapolated frames."""
EXTRAPOLATED_FILE = f"{EXTRAPOLATED}/model.json"
"""Entry of that model in `files`, the only one with a folder in its name."""

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
        shape: numbers, and names of dynamic extents: render_width, display_height, ...
    """

    name: _Name
    type: Literal["float32", "int64"]
    shape: Annotated[tuple[_Extent, ...], msgspec.Meta(max_length=4)]

    def __post_init__(self) -> None:
        if math.prod(extent for extent in self.shape if isinstance(extent, int)) > MAX_CHANNELS:
            raise ValueError(f"shape is {self.shape}; want numbers whose product is at most {MAX_CHANNELS}")

    def shape_for(self, *, render: Size, display: Size) -> tuple[int, ...]:
        """Return the shape at these sizes, (width, height), after a frame of the same size."""
        return sized(self.shape, extents(render=render, display=display, previous=render))


class HistoryInfo(TensorInfo, frozen=True):
    """One history tensor: its input takes the previous step's `output`; zeros mean no history."""

    output: _Name


class NetworkInfo(msgspec.Struct, frozen=True):
    """Cost of a network: its multiply-adds per display pixel."""

    multiply_adds: Annotated[float, msgspec.Meta(ge=0.0, le=1e12)] = 0.0


class ModelInfo(msgspec.Struct, frozen=True, kw_only=True):
    """The checked content of a model.json; `supersampler info MODEL` prints it.

    `only_extrapolated` says that the model steps on extrapolated frames only, for the model in the parent
    folder. `folder` is the folder of the file; it is not a key.
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
        """Folder of the model for extrapolated frames; None if this model steps on them."""
        return self.folder / EXTRAPOLATED if EXTRAPOLATED_FILE in self.files else None

    @property
    def steps(self) -> Mapping[str, Path]:
        """Graphs of the whole recurrent step, by the precision of the network."""
        names = {"fp32": "step.onnx", "fp16": "step.fp16.onnx"}
        return {kind: self.folder / name for kind, name in names.items() if name in self.files}

    @property
    def gbuffers(self) -> tuple[str, ...]:
        """Names of the inputs that are G-buffers, keys of GBUFFERS."""
        return tuple(tensor.name for tensor in self.inputs if tensor.name in GBUFFERS)

    @property
    def extrapolates(self) -> bool:
        """Whether it extrapolates unshaded frames instead of upscaling: its image has render size."""
        return self.image.shape[2:] == shapes.RENDER

    @property
    def converges(self) -> bool:
        """Whether static pixels converge to the mean of their samples (`methods.at_rest`)."""
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
        """The single ratio of display to render size; None for a range."""
        return only_ratio(self.ratios)

    def config_error(self, name: str, value: Any, want: str) -> ModelError:
        """Return the error for a constant that kernels do not support."""
        return ModelError(
            f"{self.folder / 'model.json'}: config.{name} is {value!r:.60}; want {want}. "
            "Export the model again, or run its graph in ONNX Runtime: Upscaler(..., executor='onnx')."
        )

    @property
    def aovs_path(self) -> Path:
        """The graph that blends AOVs."""
        return self.folder / "aovs.onnx"


def extents(*, render: Size, display: Size, previous: Size) -> dict[str, int]:
    """Return the dynamic extents by name, at the given (width, height) sizes."""
    sizes = {
        shapes.RENDER: render,
        shapes.DISPLAY: display,
        shapes.HALF: half_size(display),
        shapes.LARGE: large_size(display),
        shapes.LARGE_HALF: half_size(large_size(display)),
        shapes.PREVIOUS: previous,
        shapes.BLOCKS: block_count(previous),
        shapes.NEXT_BLOCKS: block_count(render),
    }
    found = {shapes.PHASES: phase_count(display, previous), shapes.NEXT_PHASES: phase_count(display, render)}
    for names, size in sizes.items():
        found |= zip(names, size[::-1], strict=True)
    return found
