"""model.json: what a model folder holds, which tensors its graph takes, and how far it is trusted."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from supersampler.array_spec import ArraySpec, values_of
from supersampler.errors import ModelError
from supersampler.frame import Size
from supersampler.gbuffers import GBUFFERS
from supersampler.ratios import only_ratio

CONTRACT = 1
"""Version of the graph contract (docs/contract.md). Raised when an engine's glue would have to change."""
DRAWN = "drawn"
"""Folder in a model's folder, of what steps on frames whose colour was drawn."""


@dataclass(frozen=True)
class TensorInfo:
    """One input, output or history tensor of a graph.

    Attributes:
        name: its name in the graph.
        type: numpy's name of its element type.
        shape: numbers, and names for what varies: render_width, display_height, previous_width, ...
    """

    name: str
    type: str
    shape: tuple[int | str, ...]

    def shape_for(self, *, render: Size, display: Size, previous: Size) -> tuple[int, ...]:
        """Its shape at the given (width, height) sizes."""
        named = extents(render=render, display=display, previous=previous)
        return tuple(named[n] if isinstance(n, str) else n for n in self.shape)

    def spec_for(self, *, render: Size, display: Size, previous: Size) -> ArraySpec:
        """What an array of it must be, of a history at the given sizes."""
        shape = self.shape_for(render=render, display=display, previous=previous)
        return ArraySpec(self.type, shape, values_of(self.name))

    def spec_of_frames(self) -> ArraySpec:
        """What an array of it must be, of a past that holds frames as they came: of any size and pixels."""
        return ArraySpec(self.type, self.shape, values_of(self.name) if "jitter" in self.name else None)


@dataclass(frozen=True)
class HistoryInfo:
    """One history tensor: goes in under `input.name`, comes out under `output`, all zeros for no past."""

    input: TensorInfo
    output: str


@dataclass(frozen=True)
class MapInfo:
    """Where a map for people to look at is: `channels` of the output tensor `output`, from `first` on."""

    output: str
    first: int
    channels: int


@dataclass(frozen=True)
class ModelInfo:
    """What model.json says; see `supersampler info MODEL`."""

    folder: Path
    contract: int
    method: str
    source: str
    ratios: tuple[float, float]
    inputs: tuple[TensorInfo, ...]
    history: tuple[HistoryInfo, ...]
    image: TensorInfo
    told: tuple[TensorInfo, ...]
    maps: Mapping[str, MapInfo]
    files: Mapping[str, str]
    multiply_adds: float  # of what is learned, per pixel of the display
    config: Mapping[str, Any]
    parity: Mapping[str, Any]
    licence: str
    attributions: tuple[str, ...]
    versions: Mapping[str, str]
    only_drawn: bool  # steps on frames whose colour was drawn alone, for the model whose folder this is in

    @property
    def drawn(self) -> Path | None:
        """Folder of the model that steps on frames whose colour was drawn; None where this one does."""
        return self.folder / DRAWN if f"{DRAWN}/model.json" in self.files else None

    @property
    def steps(self) -> Mapping[str, Path]:
        """Graphs of the whole recurrent step, by the precision of what is learned."""
        names = {"fp32": "step.onnx", "fp16": "step.fp16.onnx"}
        return {kind: self.folder / name for kind, name in names.items() if name in self.files}

    @property
    def gbuffers(self) -> tuple[str, ...]:
        """Names of the inputs that are G-buffers, as in `supersampler.gbuffers`."""
        return tuple(tensor.name for tensor in self.inputs if tensor.name in GBUFFERS)

    @property
    def extrapolates(self) -> bool:
        """Whether it upscales nothing, but draws frames that were not shaded: its image is of render size."""
        return _of_render_size(self.image.shape)

    @property
    def only_ratio(self) -> float | None:
        """The ratio of display to render size that it draws at; None where there is a range of them."""
        return only_ratio(self.ratios)

    @property
    def carry_path(self) -> Path:
        """The graph that blends what frames carry along."""
        return self.folder / "carry.onnx"


def extents(*, render: Size, display: Size, previous: Size) -> dict[str, int]:
    """Return what the names in shapes stand for at the given (width, height) sizes."""
    return {
        "render_width": render[0],
        "render_height": render[1],
        "display_width": display[0],
        "display_height": display[1],
        "half_width": (display[0] + 1) // 2,
        "half_height": (display[1] + 1) // 2,
        "previous_width": previous[0],
        "previous_height": previous[1],
    }


def model_names() -> list[str]:
    """Names of the models that ship with this package, for `Upscaler(name)`."""
    return _names(extrapolate=False)


def extrapolation_names() -> list[str]:
    """Names of those that draw frames that were not shaded, for `Upscaler(extrapolation=name)`."""
    return _names(extrapolate=True)


def _names(*, extrapolate: bool) -> list[str]:
    read = {name: json.loads(path.read_text("utf-8")) for name, path in _described().items()}
    return sorted(n for n, data in read.items() if _of_render_size(data["image"]["shape"]) is extrapolate)


def _described() -> dict[str, Path]:
    """Each shipped model's model.json, by the model's name."""
    return {path.parent.name: path for path in _shipped().glob("*/model.json")}


def _of_render_size(shape: Sequence[int | str]) -> bool:
    return tuple(shape[2:]) == ("render_height", "render_width")


def find_model(name_or_path: str | Path) -> Path:
    """Folder of a shipped model by name, or of any model by path.

    Raises:
        ModelError: neither exists.
    """
    path = Path(name_or_path)
    if (path / "model.json").is_file():
        return path
    if str(name_or_path) in _described():
        return shipped_model(str(name_or_path))
    known = ", ".join([*model_names(), *extrapolation_names()])
    raise ModelError(
        f"no model {str(name_or_path)!r}: it is neither one of {known} "
        "nor a folder with a model.json. `supersampler export METHOD -o FOLDER` writes one."
    )


def shipped_model(name: str) -> Path:
    """Folder of a model that ships, whatever lies in the working directory by that name."""
    return _shipped() / name


def read_model_info(folder: Path) -> ModelInfo:
    """Read and check `folder`/model.json and the hashes of the files it names.

    Raises:
        ModelError: it is damaged, or of a contract that this runtime does not drive.
    """
    path = folder / "model.json"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["contract"] != CONTRACT:
            raise ModelError(
                f"{path}: model contract is {data['contract']}; this runtime drives {CONTRACT}. "
                "Export the method again with this version of `supersampler export`."
            )
        info = _parse(folder, data)
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{path}: not a model description ({type(error).__name__}: {error})") from error
    for name, digest in info.files.items():
        if not (folder / name).is_file():
            raise ModelError(f"{folder}: {name} is missing. Export or copy the whole folder again.")
        if sha256(folder / name) != digest:
            raise ModelError(
                f"{folder / name}: its content is not what model.json describes (sha256 differs)"
            )
    return info


def sha256(path: Path) -> str:
    """Hex digest of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _parse(folder: Path, data: Mapping[str, Any]) -> ModelInfo:
    return ModelInfo(
        folder=folder,
        contract=data["contract"],
        method=data["method"],
        source=data["source"],
        ratios=(data["ratios"][0], data["ratios"][1]),
        inputs=tuple(_tensor(t) for t in data["inputs"]),
        history=tuple(HistoryInfo(_tensor(t), t["output"]) for t in data["history"]),
        image=_tensor(data["image"]),
        told=tuple(_tensor(t) for t in data["told"]),
        maps={name: MapInfo(**where) for name, where in data["maps"].items()},
        files=data["files"],
        multiply_adds=data.get("network", {}).get("multiply_adds", 0.0),
        config=data["config"],
        parity=data["parity"],
        licence=data["licence"],
        attributions=tuple(data["attributions"]),
        versions=data["versions"],
        only_drawn=data.get("only_drawn", False),
    )


def _tensor(data: Mapping[str, Any]) -> TensorInfo:
    return TensorInfo(data["name"], data["type"], tuple(data["shape"]))


def _shipped() -> Path:
    return Path(str(resources.files("supersampler"))) / "models"
