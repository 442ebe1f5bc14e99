"""Read and write recording.json: the recorded Upscaler's model, settings and machine."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from supersampler.arguments import AtRest, checked_at_rest, checked_scale, checked_skip, checked_threads
from supersampler.errors import RecordingError, ShotError, SupersamplerError
from supersampler.frame import Size
from supersampler.io.files import NOT_FOUND
from supersampler.io.json_fields import Field, read_json
from supersampler.io.machine import installed_versions, machine
from supersampler.methods.model_file import CONTRACT
from supersampler.methods.model_info import ModelInfo
from supersampler.recording.folder import SETUP, is_recording

if TYPE_CHECKING:
    from supersampler.model import Model

FORMAT = 5
"""Version of a recording's files; other versions are refused."""

_PACKAGES = ("numpy", "onnxruntime", "onnxruntime-gpu", "onnxruntime-directml", "numba", "llvmlite")


@dataclass(frozen=True, kw_only=True)
class RecordedModel:
    """Identity of the recorded model.

    Attributes:
        folder: name of the model's folder, without its parents.
        method: name of its method.
        files: SHA-256 of the model's files, by name.
        config: the method's constants.
    """

    folder: str
    method: str
    files: Mapping[str, str]
    config: Mapping[str, Any]

    @staticmethod
    def of(model: ModelInfo) -> "RecordedModel":
        """Return the record of a model."""
        return RecordedModel(
            folder=model.folder.name, method=model.method, files=dict(model.files), config=dict(model.config)
        )

    def is_of(self, model: ModelInfo) -> bool:
        """Return whether the recorded model is this one, in whatever folder."""
        other = RecordedModel.of(model)
        return (self.method, self.files, self.config) == (other.method, other.files, other.config)


@dataclass(frozen=True, kw_only=True)
class Setup(RecordedModel):
    """Model, settings and machine of a recorded Upscaler.

    Attributes:
        contract: version of the graph contract (docs/contract.md).
        extrapolation: the model that extrapolates unshaded frames, or None.
        executor: "onnx", "cpu", "cpu+onnx" or "gpu".
        precision: precision of the network, "fp32", "fp16" or "int8".
        providers: ONNX Runtime providers.
        threads: requested CPU threads; 0 is every core.
        display_size: (width, height); None where `scale` and the first frame determine it.
        scale: display over render size; unused with a display size.
        at_rest, skip, validate: see `Upscaler`.
        versions: versions of this package, Python and the packages that images depend on.
        machine: see `supersampler.io.machine`.
    """

    contract: int
    extrapolation: RecordedModel | None
    executor: str
    precision: str
    providers: tuple[str, ...]
    threads: int
    display_size: Size | None
    scale: float
    at_rest: AtRest
    skip: bool
    validate: Any  # of `Upscaler`
    versions: Mapping[str, str]
    machine: Mapping[str, Any]


def setup_here(model: "Model", extrapolation: Sequence[ModelInfo], **arguments: Any) -> Setup:
    """Return the setup of an Upscaler with this model, and at most one extrapolation, on this machine.

    `arguments` are display_size, scale, at_rest, skip and validate; see `Setup`.
    """
    return Setup(
        contract=CONTRACT,
        **vars(RecordedModel.of(model.info)),
        extrapolation=next(map(RecordedModel.of, extrapolation), None),
        executor=model.executor,
        precision=model.precision,
        providers=tuple(model.providers),
        threads=model.threads,
        versions=versions(),
        machine=machine(),
        **arguments,
    )


def versions() -> dict[str, str]:
    """Return the versions of this package, Python and the packages that images depend on."""
    return installed_versions("supersampler", *_PACKAGES) | {"Python": platform.python_version()}


def read_setup(folder: Path) -> Setup:
    """Read recording.json; RecordingError where it is missing, damaged or of another version."""
    path = folder / SETUP
    if not folder.exists():
        raise RecordingError(folder, "there is no such folder", NOT_FOUND)
    if not is_recording(folder):
        raise RecordingError(folder, "is not a recording", "`supersampler upscale --record` writes them.")
    try:
        data = Field(path, "the file", read_json(path))
        for name, known in (("format", FORMAT), ("contract", CONTRACT)):
            found = data[name].of(int)
            if found != known:
                hint = "Replay it with the version of supersampler that wrote it."
                raise RecordingError(path, f"is of {name} {found}; this package reads {known}", hint)
        return _setup(data)
    except ShotError as error:
        raise RecordingError(error.path, error.problem, "No Upscaler writes this.") from error
    except SupersamplerError as error:
        raise error if isinstance(error, RecordingError) else RecordingError(path, str(error)) from error


def _setup(data: Field) -> Setup:
    return Setup(
        **_model(data),
        contract=CONTRACT,
        extrapolation=data.read("extrapolation", lambda model: RecordedModel(**_model(model)), None),
        executor=data["executor"].one_of("onnx", "cpu", "cpu+onnx", "gpu"),
        precision=data["precision"].one_of("fp32", "fp16", "int8"),
        providers=data["providers"].texts(),
        threads=checked_threads(data["threads"].of(int)),
        display_size=data.read("display_size", Field.size, None),
        scale=checked_scale(data["scale"].number()),
        at_rest=checked_at_rest(data["at_rest"].value),
        skip=checked_skip(data["skip"].value),
        validate=data["validate"].one_of("off", "warn", "strict"),
        versions=_texts_by_name(data["versions"]),
        machine=data["machine"].of(dict),
    )


def _model(data: Field) -> dict[str, Any]:
    return {
        "folder": data["folder"].of(str),
        "method": data["method"].of(str),
        "files": _texts_by_name(data["files"]),
        "config": data["config"].of(dict),
    }


def _texts_by_name(data: Field) -> dict[str, str]:
    return {name: text.of(str) for name, text in data.members().items()}
