"""Recordings of all calls of an Upscaler, for `supersampler replay`; docs/replay.md has the format.

A recording is a shot folder with a call log. `recorder` writes it, `replay` repeats its calls.
"""

import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias, get_args

import numpy as np

from supersampler.arguments import AtRest, checked_choice, checked_flag, checked_scale, checked_threads
from supersampler.conventions import Conventions
from supersampler.errors import RecordingError, ShotError, SupersamplerError
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.history import State
from supersampler.io.files import NOT_FOUND, check_inside, check_is_file, is_regular
from supersampler.io.images import read_exr
from supersampler.io.json_fields import Field, parse_json, read_json
from supersampler.io.machine import installed_versions
from supersampler.io.shot.format import (
    COLOR,
    files_of,
    frame_entry,
    read_frame,
    read_reference,
    take,
    take_aovs,
)
from supersampler.io.shot.safetensors import open_safetensors
from supersampler.methods.model_file import CONTRACT, sha256
from supersampler.methods.model_info import ModelInfo

__all__ = [
    "Call",
    "CloseCall",
    "LoadStateCall",
    "Recording",
    "ResetCall",
    "Setup",
    "StepCall",
    "StepOutcome",
    "open_recording",
]

FORMAT = 5
"""Version of a recording's files; other versions are refused."""
MAX_LINE = 4 << 20
"""Maximum bytes of a line of the log."""
SETUP, CALLS, LAST_IMAGE = "recording.json", "calls.jsonl", "last.exr"
FRAME, DISPLAY, SAMPLED = "{:04d}.exr", "display/{:04d}.exr", "sampled/{:04d}.exr"
STATE = "states/{:04d}.safetensors"
SHADED = "shaded."
"""Prefix of the arrays of `State.shaded` in a state's file."""
_STEPS = ("step", "extrapolate", "step_tensors")
_PACKAGES = ("supersampler", "numpy", "onnxruntime", "onnxruntime-gpu", "onnxruntime-directml")
_DAMAGED = "The recording is damaged; copy it again."


@dataclass(frozen=True, kw_only=True)
class RecordedModel:
    """Identity of a recorded model.

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
        """Return the identity of a model."""
        files, config = dict(model.files), dict(model.config)
        return RecordedModel(folder=model.folder.name, method=model.method, files=files, config=config)

    def is_of(self, model: ModelInfo) -> bool:
        """Return whether this is the recorded model, in any folder."""
        other = RecordedModel.of(model)
        return (self.method, self.files, self.config) == (other.method, other.files, other.config)


@dataclass(frozen=True, kw_only=True)
class Setup(RecordedModel):
    """Model, settings and machine of a recorded Upscaler.

    Attributes:
        contract: version of the graph contract (docs/contract.md).
        extrapolation: the model that extrapolates unshaded frames, or None.
        executor: "onnx", "cpu" or "gpu".
        precision: precision of the network, "fp32", "fp16" or "int8".
        providers: ONNX Runtime providers.
        threads: requested CPU threads; 0 is every core.
        display_size: (width, height); None where `scale` and the first frame determine it.
        scale: display over render size; unused with a display size.
        at_rest, skip, validate: see `Upscaler`.
        versions: versions of this package, Python and the packages that images depend on.
        machine: see `supersampler.io.machine`.
    """

    contract: int = CONTRACT
    extrapolation: RecordedModel | None
    executor: str
    precision: str
    providers: tuple[str, ...]
    threads: int
    display_size: Size | None
    scale: float
    at_rest: AtRest
    skip: bool
    validate: Any
    versions: Mapping[str, str]
    machine: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class StepOutcome:
    """Result or error of a recorded step.

    Attributes:
        digests: CRC-32 of the bytes of each returned array, by its name in `StepResult`.
        samples: some pixels of "image" and "aovs".
        error: class name and text of the exception; ("", "") where none was raised.
    """

    digests: Mapping[str, int] = field(default_factory=dict)
    samples: Mapping[str, Array] = field(default_factory=dict)
    error: tuple[str, str] = ("", "")


@dataclass(frozen=True, eq=False)
class StepCall:
    """A call of `Upscaler.step`, `extrapolate` or `step_tensors`.

    Attributes:
        index: number of steps before it, including refused ones.
        name: name of the method.
        frame: the frame, without G-buffers that the model does not read.
        outputs: names of the requested auxiliary outputs.
        outcome: the result or the error; None where the process ended during the step or right after it.
    """

    index: int
    name: str
    frame: Frame
    outputs: tuple[str, ...]
    outcome: StepOutcome | None = None


@dataclass(frozen=True)
class ResetCall:
    """A call of `Upscaler.reset`."""


@dataclass(frozen=True, eq=False)
class LoadStateCall:
    """A call of `Upscaler.load_state`."""

    state: State


@dataclass(frozen=True, eq=False)
class CloseCall:
    """A call of `Upscaler.close`. It is missing where the process ended before it, or still runs.

    Attributes:
        image: (H, W, 3) the last image; None where there is none.
    """

    image: Float32 | None


Call: TypeAlias = StepCall | ResetCall | LoadStateCall | CloseCall


class Recording:
    """The recorded calls of an Upscaler, in order; each iteration reads the log from its start.

    Attributes:
        path: the folder.
        setup: model, settings and machine of the recorded Upscaler.
    """

    def __init__(self, path: Path, setup: Setup) -> None:
        self.path, self.setup = path, setup

    def __iter__(self) -> Iterator[Call]:
        """Yield the calls up to the last complete line of the log.

        Raises:
            RecordingError: a line or a file is damaged, or not of an Upscaler. The calls before it are
                yielded first.
        """
        steps = states = 0
        step: StepCall | None = None  # its outcome is in the next line
        with _errors_as_recording_error(self.path):
            for line in self._lines():
                if step is not None:
                    steps += 1
                    if {"returned", "raised"} & line.value.keys():
                        yield replace(step, outcome=self._outcome(line, SAMPLED.format(step.index)))
                        step = None
                        continue
                    yield step
                    step = None
                name = line["call"].one_of(*_STEPS, "reset", "load_state", "close")
                if name in _STEPS:
                    step = self._step(name, line, steps)
                elif name == "reset":
                    yield ResetCall()
                elif name == "load_state":
                    yield LoadStateCall(_state(line, self._checked(line, STATE.format(states))))
                    states += 1
                elif line.optional("sha256") is None:
                    yield CloseCall(None)
                else:
                    yield CloseCall(read_reference(self._checked(line, LAST_IMAGE), None))
            if step is not None:
                yield step

    def _lines(self) -> Iterator[Field]:
        """Yield the log's lines without an incomplete last one."""
        path, number = self.path / CALLS, 1
        check_inside(self.path, [path])
        check_is_file(path)
        with path.open("rb") as file:
            while (text := file.readline(MAX_LINE)).endswith(b"\n"):
                try:
                    line = Field(path, f"line {number}", parse_json(text))
                except (ValueError, RecursionError) as error:
                    raise ShotError(path, f"line {number} is not JSON ({error})") from error
                line.members()  # raises where it is no object
                yield line
                number += 1
        if len(text) == MAX_LINE:
            raise ShotError(path, f"line {number} is longer than {MAX_LINE >> 20} MiB")

    def _step(self, name: str, line: Field, index: int) -> StepCall:
        entry = frame_entry(line["frame"])
        if entry.render_size is None:
            line["frame"].refuse("an entry with a render_size")
        for file in files_of(entry):
            self._checked(line, file)
        raw = read_frame(self.path, entry, entry.render_size, None)
        return StepCall(index, name, Conventions().converter().to_frame(raw), line["outputs"].texts())

    def _outcome(self, line: Field, file: str) -> StepOutcome:
        """Read the outcome of a step; `file` has the kept pixels of its images."""
        if (error := line.optional("raised")) is not None:
            if len(error.texts()) != 2:
                error.refuse("[class, text]")
            name, text = error.texts()
            return StepOutcome(error=(name, text))
        digests = {name: crc.whole(0, 0xFFFFFFFF) for name, crc in line["returned"].members().items()}
        path = self._checked(line, file)
        channels = read_exr(path)
        aovs = take_aovs(path, channels)
        images = {"image": take(path, channels, COLOR)} | ({} if aovs is None else {"aovs": aovs})
        return StepOutcome(digests, images)

    def _checked(self, line: Field, name: str) -> Path:
        """Return the path of a call's file, after a check of its place and SHA-256."""
        path, digest = self.path / name, line["sha256"][name].of(str)
        check_inside(self.path, [path])
        check_is_file(path)
        if sha256(path) != digest:
            raise ShotError(path, "is not as it was recorded (sha256 differs)")
        return path


def open_recording(path: Path | str) -> Recording:
    """Open a recording of `Upscaler(record=...)`, which may still be written.

    >>> for call in open_recording("kitchen.recording"):
    ...     if isinstance(call, StepCall):
    ...         print(call.index, call.frame.size, call.outcome)

    Raises:
        RecordingError: it is missing, damaged, or of another kind or version.
    """
    folder = Path(path)
    file = folder / SETUP
    if not folder.exists():
        raise RecordingError(folder, "there is no such folder", NOT_FOUND)
    if not is_regular(file):
        raise RecordingError(folder, "is not a recording", "`supersampler upscale --record` writes them.")
    try:
        data = Field(file, "the file", read_json(file))
        for name, known in (("format", FORMAT), ("contract", CONTRACT)):
            if (found := data[name].of(int)) != known:
                hint = "Replay it with the version of supersampler that wrote it."
                raise RecordingError(file, f"is of {name} {found}; this package reads {known}", hint)
        return Recording(folder, _setup(data))
    except ShotError as error:
        raise RecordingError(error.path, error.problem, "No Upscaler writes this.") from error
    except SupersamplerError as error:
        raise error if isinstance(error, RecordingError) else RecordingError(file, str(error)) from error


def versions() -> dict[str, str]:
    """Return the versions of this package, Python and the packages that images depend on."""
    return installed_versions(*_PACKAGES, "numba", "llvmlite") | {"Python": platform.python_version()}


def _setup(data: Field) -> Setup:
    return Setup(
        **_model(data),
        extrapolation=data.read("extrapolation", lambda model: RecordedModel(**_model(model)), None),
        executor=data["executor"].one_of("onnx", "cpu", "gpu"),
        precision=data["precision"].one_of("fp32", "fp16", "int8"),
        providers=data["providers"].texts(),
        threads=checked_threads(data["threads"].of(int)),
        display_size=data.read("display_size", Field.size, None),
        scale=checked_scale(data["scale"].number()),
        at_rest=checked_choice("at_rest", data["at_rest"].value, get_args(AtRest)),
        skip=checked_flag("skip", data["skip"].value),
        validate=data["validate"].one_of("off", "warn", "strict"),
        versions=_texts_by_name(data["versions"]),
        machine=data["machine"].of(dict),
    )


def _model(data: Field) -> dict[str, Any]:
    names = {name: data[name].of(str) for name in ("folder", "method")}
    return {**names, "files": _texts_by_name(data["files"]), "config": data["config"].of(dict)}


def _texts_by_name(data: Field) -> dict[str, str]:
    return {name: text.of(str) for name, text in data.members().items()}


def _state(data: Field, path: Path) -> State:
    """Read a state, whose arrays `Upscaler.load_state` checks."""
    arrays = {name: np.array(array) for name, array in open_safetensors(path)[0].items()}
    shaded = {n.removeprefix(SHADED): array for n, array in arrays.items() if n.startswith(SHADED)}
    history = {n: array for n, array in arrays.items() if not n.startswith(SHADED)}
    return State(
        data["method"].of(str),
        data.read("display_size", Field.size, None),
        data.read("render_size", Field.size, None),
        history if data["history"].flag() else None,
        shaded if data["shaded"].flag() else None,
        data["version"].of(int),
    )


@contextmanager
def _errors_as_recording_error(path: Path) -> Iterator[None]:
    """Raise RecordingError in place of other errors about a recording's content."""
    try:
        yield
    except MemoryError as error:
        hint = "Replay it on a machine with more memory."
        raise RecordingError(path, "needs more memory than there is", hint) from error
    except ShotError as error:
        raise RecordingError(error.path, error.problem, _DAMAGED) from error
    except OSError as error:
        raise RecordingError(path, f"cannot be read ({error})") from error
    except SupersamplerError as error:
        raise RecordingError(path, f"has a call that no Upscaler makes ({error})", _DAMAGED) from error
