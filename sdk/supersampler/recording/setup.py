"""recording.json: how the recorded Upscaler was made, of which model, and on which machine."""

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast

from supersampler import __version__
from supersampler.arguments import Skip, checked_scale, checked_size, checked_skip, checked_threads
from supersampler.errors import RecordingError, ShotError, SupersamplerError
from supersampler.frame import Size
from supersampler.io.atomic import replacing
from supersampler.io.machine import installed_versions, machine
from supersampler.io.shot.json_keys import JsonKeys, read_json
from supersampler.methods.model_file import CONTRACT, ModelInfo
from supersampler.recording.folder import SETUP, is_recording

if TYPE_CHECKING:
    from supersampler.model import Model

FORMAT = 2
"""Version of a recording's files. A reader refuses others."""

_PACKAGES = ("numpy", "onnxruntime", "onnxruntime-gpu", "onnxruntime-directml", "numba", "llvmlite")
_OTHER_VERSION = "Replay it with the version of supersampler that wrote it."
_Validate: TypeAlias = Literal["off", "warn", "strict"]


@dataclass(frozen=True, kw_only=True)
class RecordedModel:
    """Which model it was.

    Attributes:
        folder: name of the model's folder, without its parents.
        method: of the model.
        files: sha256 of the model's files, by name.
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
            folder=model.folder.name, method=model.method, files=model.files, config=model.config
        )

    def is_of(self, model: ModelInfo) -> bool:
        """Tell whether it was this model."""
        recorded = (self.method, dict(self.files), dict(self.config))
        return recorded == (model.method, dict(model.files), dict(model.config))


@dataclass(frozen=True, kw_only=True)
class Setup(RecordedModel):
    """How an Upscaler was made, of which model, and where.

    Attributes:
        contract: version of the meaning of a frame's inputs (docs/contract.md).
        extrapolation: the model that extrapolates unshaded frames; None where there was none.
        executor: "onnx" or "cpu".
        precision: of the network, "fp32", "fp16" or "int8".
        providers: of ONNX Runtime.
        threads: as asked for; 0 takes every core.
        display_size: (width, height); None where `scale` and the first frame determine it.
        scale: display over render size; unused beside a display size.
        skip, validate: see `Upscaler`.
        versions: of this package, Python and the packages that images depend on.
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
    skip: Skip
    validate: _Validate
    versions: Mapping[str, str]
    machine: Mapping[str, Any]


def setup_here(
    model: "Model",
    extrapolation: Sequence[ModelInfo],
    *,
    display_size: Size | None,
    scale: float,
    skip: Skip,
    validate: _Validate,
) -> Setup:
    """Return how an Upscaler of this model, and at most one extrapolation, is made here; see `Setup`."""
    return Setup(
        contract=CONTRACT,
        **vars(RecordedModel.of(model.info)),
        extrapolation=next(map(RecordedModel.of, extrapolation), None),
        executor=model.executor,
        precision=model.precision,
        providers=tuple(model.providers),
        threads=model.threads,
        display_size=display_size,
        scale=scale,
        skip=skip,
        validate=validate,
        versions=versions(),
        machine=machine(),
    )


def versions() -> dict[str, str]:
    """Return the versions of this package, Python and the packages that images depend on."""
    own = {"supersampler": __version__, "Python": platform.python_version()}
    return own | installed_versions(*_PACKAGES)


def write_setup(folder: Path, setup: Setup) -> None:
    """Write recording.json.

    Raises:
        ShotError: the disk refused.
    """
    with replacing(folder / SETUP) as partial:
        content = {"format": FORMAT, **asdict(setup)}
        partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8", newline="\n")


def read_setup(folder: Path) -> Setup:
    """Read and check recording.json.

    Raises:
        RecordingError: it is missing, of another version, or a value is of a wrong type or range.
    """
    path = folder / SETUP
    if not folder.exists():
        raise RecordingError(folder, "there is no such folder", "Is the path right, is the drive connected?")
    if not is_recording(folder):
        raise RecordingError(folder, "is not a recording", "`supersampler upscale --record` writes them.")
    try:
        content = read_json(path)
        keys = JsonKeys(path, "the file", content)
        for name, known in (("format", FORMAT), ("contract", CONTRACT)):
            found = keys.take(name, int)
            if found != known:
                problem = f"is of {name} {found}; this package reads {known}"
                raise RecordingError(path, problem, _OTHER_VERSION)
        return _setup(keys, content)
    except ShotError as error:
        raise RecordingError(error.path, error.problem, "No Upscaler writes this.") from error
    except SupersamplerError as error:
        raise error if isinstance(error, RecordingError) else RecordingError(path, str(error)) from error


def _setup(keys: JsonKeys, content: Mapping[str, Any]) -> Setup:
    extrapolation = keys.take_or("extrapolation", dict, {})
    size = keys.take_or("display_size", list, [])
    skip: Any = content.get("skip")
    return Setup(
        **_model(keys),
        contract=CONTRACT,
        extrapolation=RecordedModel(**_model(JsonKeys(keys.path, '"extrapolation"', extrapolation)))
        if extrapolation
        else None,
        executor=_choice(keys, "executor", "onnx", "cpu"),
        precision=_choice(keys, "precision", "fp32", "fp16", "int8"),
        providers=keys.take_texts("providers"),
        threads=checked_threads(keys.take("threads", int)),
        display_size=checked_size("display_size", size) if size else None,
        scale=checked_scale(keys.take("scale", float)),
        skip=checked_skip(skip),
        validate=cast("_Validate", _choice(keys, "validate", "off", "warn", "strict")),
        versions=_texts_by_name(keys, "versions"),
        machine=keys.take("machine", dict),
    )


def _model(keys: JsonKeys) -> dict[str, Any]:
    return {
        "folder": keys.take("folder", str),
        "method": keys.take("method", str),
        "files": _texts_by_name(keys, "files"),
        "config": keys.take("config", dict),
    }


def _choice(keys: JsonKeys, key: str, *known: str) -> str:
    value = keys.take(key, str)
    if value not in known:
        raise keys.wrong(key, value, f"one of {', '.join(known)}")
    return value


def _texts_by_name(keys: JsonKeys, key: str) -> dict[str, str]:
    value = keys.take(key, dict)
    if not all(isinstance(text, str) for text in value.values()):
        raise keys.wrong(key, value, "an object of texts")
    return value
