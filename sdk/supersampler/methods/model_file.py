"""Finding model folders by name, and reading and checking model.json (docs/contract.md)."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import NoReturn

import msgspec
from msgspec.structs import replace

from supersampler.errors import INCOMPLETE_PACKAGE, ModelError, ShotError, did_you_mean, shown
from supersampler.io.files import is_file
from supersampler.io.json_files import read_typed
from supersampler.methods import spec as shapes
from supersampler.methods.model_info import ModelInfo, TensorInfo
from supersampler.methods.registry import find_method
from supersampler.methods.spec import INPUTS, WEIGHT, dtype_of

CONTRACT = 4
"""Version of the graph contract (docs/contract.md), raised when engines must change their integration."""
MAX_FILE, MAX_DESCRIPTION = 256 << 20, 1 << 20
"""Maximum bytes of a model's file and of model.json."""
_HINT = "Export the model again; docs/contract.md lists the keys."
_OF_FRAMES = {"color", "depth", "jitter", "motion", "motion_jitter", "shaded_motion"}
_IMAGES = (1, 3, *shapes.DISPLAY), (1, 3, *shapes.RENDER)
_EXTENTS = {
    *shapes.RENDER, *shapes.DISPLAY, *shapes.HALF, *shapes.LARGE, *shapes.LARGE_HALF, *shapes.PREVIOUS,
    *shapes.BLOCKS, shapes.PHASES,
}  # fmt: skip
_MAPS = {"class_map", "weight", "count", "converged"}  # fields of StepResult


def model_names() -> list[str]:
    """Return the names of the models that ship with this package, for `Upscaler(name)`."""
    return _names(extrapolate=False)


def extrapolation_names() -> list[str]:
    """Return the names of the shipped models that extrapolate, for `Upscaler(extrapolation=name)`."""
    return _names(extrapolate=True)


def _names(*, extrapolate: bool) -> list[str]:
    read = {name: json.loads(path.read_text("utf-8")) for name, path in _described().items()}
    has_render_size = {name: data["image"]["shape"][2:] == [*shapes.RENDER] for name, data in read.items()}
    return sorted(name for name, extrapolates in has_render_size.items() if extrapolates is extrapolate)


def _described() -> dict[str, Path]:
    """Return the path of each shipped model.json by the model's name."""
    return {path.parent.name: path for path in _shipped().glob("*/model.json")}


def find_model(name_or_path: str | Path) -> Path:
    """Return the folder of a shipped model by name, or of any model by path.

    Raises:
        ModelError: neither exists; or the package's own models are missing.
    """
    path = Path(name_or_path).absolute()  # the working directory may change before a graph is loaded
    if is_file(path / "model.json"):
        return path
    name = str(name_or_path)
    if name in (described := _described()):
        return shipped_model(name)
    if not described:
        raise ModelError(
            f"the package's data files are missing: {_shipped()} has no model. {INCOMPLETE_PACKAGE}"
        )
    known = [*model_names(), *extrapolation_names()]
    hint = f"No weights of it ship: `supersampler info {name}`." if find_method(name) else ""
    raise ModelError(
        f"no model {shown(name)}: it is neither one of {', '.join(known)} "
        "nor a folder with a model.json. `supersampler export METHOD -o FOLDER` writes one. "
        f"{hint or did_you_mean(name, known)}".rstrip()
    )


def shipped_model(name: str) -> Path:
    """Return the folder of a shipped model, even if the working directory has a folder of that name."""
    return _shipped() / name


def is_shipped(path: Path) -> bool:
    """Return whether a file is part of this package and therefore trusted."""
    return path.resolve().is_relative_to(_shipped().resolve())


def read_model_info(folder: Path) -> ModelInfo:
    """Read and check `folder`/model.json, and check the files that it lists.

    Raises:
        ModelError: a file is missing or damaged, or the contract has another version.
    """
    try:
        info = _described_in(folder)
        for name, digest in info.files.items():
            _check_file(folder, name, digest)
        if info.extrapolated is not None:
            _check_extrapolated(info, _described_in(info.extrapolated))
    except (OSError, ValueError) as error:  # ValueError: an impossible path
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{folder}: cannot be read ({error}). Copy the whole folder again.") from error
    return info


def read_upscaling_info(name_or_path: str | Path) -> ModelInfo:
    """Read the model.json of a model that upscales; see `find_model` and `read_model_info`.

    Raises:
        ModelError: see there; or the model only extrapolates, or only steps on extrapolated frames.
    """
    info = read_model_info(find_model(name_or_path))
    if info.extrapolates:
        raise ModelError(
            f"{info.method!r} does not upscale: it extrapolates unshaded frames. "
            f"Upscaler(extrapolation={info.folder.name!r}) takes it, in addition to a model that upscales."
        )
    if info.only_extrapolated:
        raise ModelError(
            f"{info.method!r} only steps on extrapolated frames, for the model in the parent folder. "
            f"Upscaler({str(info.folder.parent)!r}, extrapolation='guided-warp') takes both."
        )
    return info


def _check_file(folder: Path, name: str, digest: str) -> None:
    path = folder / name
    if not path.is_file():
        raise ModelError(f"{folder}: {name} is missing. Export or copy the whole folder again.")
    if not path.resolve().is_relative_to(folder.resolve()):
        raise ModelError(f"{path}: is a link out of the folder. Copy the file itself there.")
    if path.stat().st_size > MAX_FILE:
        raise ModelError(f"{path}: is {path.stat().st_size} bytes; want at most {MAX_FILE}.")
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != digest:
        raise ModelError(f"{path}: its content is not what model.json describes (sha256 differs)")


def _described_in(folder: Path) -> ModelInfo:
    """Read and check model.json, but not the files that it lists."""
    path = folder / "model.json"
    try:
        contract = read_typed(path, _Contract, _HINT, MAX_DESCRIPTION).contract
        if contract != CONTRACT:
            raise ModelError(
                f"{path}: model contract is {contract}; this runtime drives {CONTRACT}. "
                "Export the method again with this version of `supersampler export`."
            )
        info = replace(read_typed(path, ModelInfo, _HINT, MAX_DESCRIPTION), folder=folder)
    except ShotError as error:
        raise ModelError(str(error)) from error
    _check_contract(info)
    return info


class _Contract(msgspec.Struct):
    contract: int


def _shipped() -> Path:
    return Path(str(resources.files("supersampler"))) / "models"


def _check_contract(info: ModelInfo) -> None:
    """Raise ModelError if a tensor or map does not match the contract."""
    for tensor in info.inputs:
        if tensor.name not in INPUTS:
            _refuse(info, "inputs", repr(tensor.name), f"any of {', '.join(INPUTS)}")
        wanted = dtype_of(tensor.name), INPUTS[tensor.name]
        if (tensor.type, tensor.shape) != wanted:
            _refuse(info, f"input {tensor.name!r}", _text(tensor), f"{wanted[1]} {wanted[0]}")
    if (info.image.type, info.image.shape) not in [("float32", shape) for shape in _IMAGES]:
        _refuse(info, "image", _text(info.image), f"{_IMAGES[0]} or {_IMAGES[1]} float32")
    _check_unique(info, "inputs and history", info.graph_inputs)
    _check_unique(info, "image, history's outputs and aux_outputs", info.graph_outputs)
    if info.extrapolates:
        _check_extrapolation(info)
    else:
        _check_upscaling(info)
    _check_aux_outputs(info)


def _check_extrapolated(outer: ModelInfo, inner: ModelInfo) -> None:
    """Raise ModelError unless `inner`, the model for extrapolated frames, has the tensors of `outer`."""
    tensors = [(m.history, m.image.shape, {t.name for t in m.aux_outputs}) for m in (outer, inner)]
    if not inner.only_extrapolated or tensors[0] != tensors[1]:
        want = f"true, with history, image and aux_outputs as in {outer.folder / 'model.json'}"
        _refuse(inner, "only_extrapolated", repr(inner.only_extrapolated), want)


def _check_upscaling(info: ModelInfo) -> None:
    spec = find_method(info.method)
    if spec is not None and not spec.ratios[0] <= info.ratios[0] <= info.ratios[1] <= spec.ratios[1]:
        _refuse(info, "ratios", f"{info.ratios}", f"within {spec.ratios}, the range of {info.method!r}")
    if "color" not in (tensor.name for tensor in info.inputs):
        _refuse(info, "inputs", "without 'color'", "with it: the model upscales")
    for tensor in info.history:
        named = {extent for extent in tensor.shape if isinstance(extent, str)}
        if tensor.type != "float32" or not named <= _EXTENTS or tensor.name == "history.aovs":
            want = f"float32 of {', '.join(sorted(_EXTENTS))}"
            _refuse(info, f"history {tensor.name!r}", _text(tensor), want)


def _check_extrapolation(info: ModelInfo) -> None:
    """Check that each history tensor is named after a frame's input, and `earlier_X` follows `X`."""
    inputs = {tensor.name for tensor in info.inputs}
    if "color" in inputs or "step.onnx" not in info.files:
        got, want = "with 'color' or without 'step.onnx'", "neither: it computes the colour"
        _refuse(info, "inputs and files", got, want)
    before: set[str] = set()
    for tensor in info.history:
        own = tensor.name.removeprefix("history.")
        later = own.removeprefix("earlier_")
        known = f"gbuffer_{own}" in inputs or own in _OF_FRAMES or (later != own and later in before)
        if tensor.name == own or not known or tensor.type != "float32" or tensor.shape[:1] != (1,):
            names = ", ".join(sorted(_OF_FRAMES))
            want = f"float32, 'history.' and one of {names}, a G-buffer, 'earlier_' ..."
            _refuse(info, f"history {tensor.name!r}", _text(tensor), want)
        before.add(own)


def _check_aux_outputs(info: ModelInfo) -> None:
    for tensor in info.aux_outputs:
        named = tensor.shape[2:]
        if tensor.type != "float32" or tensor.shape[:1] != (1,) or named not in (shapes.DISPLAY, shapes.HALF):
            want = f"(1, k, ...) float32 of {shapes.DISPLAY} or {shapes.HALF}"
            _refuse(info, f"aux_outputs {tensor.name!r}", _text(tensor), want)
        if tensor.name in ("weight", "converged") and tensor.shape != WEIGHT:
            _refuse(info, f"aux_outputs {tensor.name!r}", _text(tensor), f"{WEIGHT} float32")
    names = [tensor.name for tensor in info.aux_outputs]
    if info.converges and "converged" not in names:
        got, want = ", ".join(names) or "none", "'converged' too, as there is a history of the mean"
        _refuse(info, "aux_outputs", got, want)
    known = {h.output: h.shape for h in info.history} | {t.name: t.shape for t in info.aux_outputs}
    for name, where in info.maps.items():
        shape = known.get(where.output, ())
        channels = shape[1] if len(shape) == 4 else 0
        if name not in _MAPS or not isinstance(channels, int) or where.first + where.channels > channels:
            got = f"channels {where.first} to {where.first + where.channels} of {where.output!r}"
            want = f"{', '.join(sorted(_MAPS))}, of channels that an auxiliary or history tensor has"
            _refuse(info, f"map {name!r}", got, want)


def _check_unique(info: ModelInfo, what: str, tensors: Iterable[TensorInfo]) -> None:
    for name, count in Counter(tensor.name for tensor in tensors).items():
        if count > 1:
            _refuse(info, what, f"{name!r} twice", "each name once")


def _text(tensor: TensorInfo) -> str:
    return f"{tensor.shape} {tensor.type}"


def _refuse(info: ModelInfo, what: str, got: str, want: str) -> NoReturn:
    path = info.folder / "model.json"
    raise ModelError(f"{path}: {what}: {got}; want {want}. Export the model again.")
