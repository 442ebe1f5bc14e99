"""Recordings of all calls of an Upscaler, for `supersampler replay`; docs/replay.md describes the format.

A recording has a safetensors file for each call, and one for the outcome of each step. `recorder` writes
them, `replay` repeats the calls.
"""

import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import MAX_SIDE, MAX_THREADS, AtRest, checked_path, checked_size
from supersampler.errors import RecordingError, ShotError, SupersamplerError
from supersampler.frame import Frame, Size
from supersampler.history import State
from supersampler.io.files import IMAGE_BYTES, NOT_FOUND, check_inside, is_own_folder, is_regular, is_there
from supersampler.io.json_files import check_version, decoded, read_typed
from supersampler.io.safetensors import open_safetensors, write_safetensors
from supersampler.methods.gbuffers import frame_of, values_of
from supersampler.methods.model_file import CONTRACT
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

FORMAT = 6
"""Version of a recording's files; other versions are refused."""
SETUP = "recording.json"
CALL, OUTCOME = "calls/{:06d}.safetensors", "outcomes/{:06d}.safetensors"
"""Files of a call and of the outcome of a step, by the number of the call."""
SHADED = "shaded."
"""Prefix of the arrays of `State.shaded`."""
Arrays: TypeAlias = Mapping[str, NDArray[Any]]
_DAMAGED = "The recording is damaged; copy it again."
_CRC = "crc32"


class RecordedModel(msgspec.Struct, frozen=True, kw_only=True):
    """Identity of a recorded model.

    Attributes:
        folder: name of the model's folder, without its parents.
        method: name of its method.
        files: SHA-256 of the model's files, by name.
        config: the method's constants.
    """

    folder: str
    method: str
    files: dict[str, str]
    config: dict[str, Any]

    @staticmethod
    def of(model: ModelInfo) -> "RecordedModel":
        """Return the identity of a model."""
        files, config = dict(model.files), dict(model.config)
        return RecordedModel(folder=model.folder.name, method=model.method, files=files, config=config)

    def is_of(self, model: ModelInfo) -> bool:
        """Return whether this is the recorded model, in any folder."""
        return (self.method, self.files, self.config) == (model.method, model.files, model.config)


class Setup(RecordedModel, frozen=True, kw_only=True):
    """Model, settings and machine of a recorded Upscaler.

    Attributes:
        contract: version of the graph contract (docs/contract.md).
        extrapolation: the model that extrapolates unshaded frames, or None.
        executor, precision, providers: see `Model`.
        threads: requested CPU threads; 0 is every core.
        display_size: (width, height); None if `scale` and the first frame determine it.
        scale: display over render size; unused with a display size.
        at_rest, skip, validate: see `Upscaler`.
        versions, machine: see `supersampler.io.machine`.
    """

    contract: int = CONTRACT
    extrapolation: RecordedModel | None
    executor: Literal["onnx", "cpu", "gpu"]
    precision: Literal["fp32", "fp16", "int8"]
    providers: tuple[str, ...]
    threads: Annotated[int, msgspec.Meta(ge=0, le=MAX_THREADS)]
    display_size: Size | None
    scale: Annotated[float, msgspec.Meta(ge=1.0, le=MAX_SIDE)]
    at_rest: AtRest
    skip: bool
    validate: Literal["off", "warn", "strict"]
    versions: dict[str, str]
    machine: dict[str, Any]


class StepRecord(msgspec.Struct, tag="step", tag_field="call", forbid_unknown_fields=True, kw_only=True):
    """A step without the arrays of its frame; `name` is the name of the called method."""

    name: Literal["step", "extrapolate", "step_tensors"]
    outputs: tuple[str, ...]
    jitter: tuple[float, float]
    reset: bool
    exposure: float | None
    pre_exposure: float


class StateRecord(
    msgspec.Struct, tag="load_state", tag_field="call", forbid_unknown_fields=True, kw_only=True
):
    """A `load_state` without its arrays; `history` and `shaded` state whether the state has such arrays."""

    method: str
    display_size: Size | None
    render_size: Size | None
    version: int
    history: bool
    shaded: bool


class ResetCall(msgspec.Struct, tag="reset", tag_field="call", forbid_unknown_fields=True):
    """A call of `Upscaler.reset`."""


class CloseCall(msgspec.Struct, tag="close", tag_field="call", forbid_unknown_fields=True):
    """A call of `Upscaler.close`; missing if the process ended before it, or still runs."""


class OutcomeRecord(msgspec.Struct, forbid_unknown_fields=True):
    """An outcome without its samples: CRC-32 of each returned array, or class and text of the exception."""

    returned: dict[str, Annotated[int, msgspec.Meta(ge=0, le=0xFFFFFFFF)]] = {}
    raised: tuple[str, str] = ("", "")


class StepOutcome(NamedTuple):
    """Result or error of a recorded step.

    Attributes:
        digests: CRC-32 of the bytes of each returned array, by its name in `StepResult`.
        samples: some pixels of "image" and "aovs".
        error: class name and text of the exception; ("", "") if none was raised.
    """

    digests: Mapping[str, int]
    samples: Arrays
    error: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class StepCall:
    """A call of `Upscaler.step`, `extrapolate` or `step_tensors`.

    Attributes:
        index: number of steps before it, including refused ones.
        name: name of the called method.
        frame: the frame, without G-buffers that the model does not read.
        outputs: names of the requested auxiliary outputs.
        outcome: the result or the error; None if the process ended during the step or right after it.
    """

    index: int
    name: str
    frame: Frame
    outputs: tuple[str, ...]
    outcome: StepOutcome | None


class LoadStateCall(NamedTuple):
    """A call of `Upscaler.load_state`."""

    state: State


Call: TypeAlias = StepCall | ResetCall | LoadStateCall | CloseCall
Record: TypeAlias = StepRecord | StateRecord | ResetCall | CloseCall


class Recording:
    """Recorded calls of an Upscaler; each iteration reads them from the first on.

    Attributes:
        path: the folder.
        setup: model, settings and machine of the recorded Upscaler.
    """

    def __init__(self, path: Path, setup: Setup) -> None:
        self.path, self.setup = path, setup

    def __iter__(self) -> Iterator[Call]:
        """Yield the calls in order.

        Raises:
            RecordingError: a file is damaged, missing, or was not written by an Upscaler.
        """
        steps = 0
        folder = self.path / "calls"
        with _errors_as_recording_error(self.path):
            check_inside(self.path, [folder])
            count = sum(1 for _ in folder.glob("[!.]*")) if is_own_folder(folder) else 0
            for number in range(count):
                record, arrays = self._read(CALL.format(number), Record)
                match record:
                    case StepRecord():
                        yield self._step(steps, record, arrays, OUTCOME.format(number))
                        steps += 1
                    case StateRecord():
                        yield LoadStateCall(_state(record, arrays))
                    case _:
                        yield record

    def _step(self, index: int, record: StepRecord, arrays: Arrays, outcome_file: str) -> StepCall:
        frame = frame_of(arrays, **values_of(record))
        outcome = None
        if (self.path / outcome_file).exists():
            found, samples = self._read(outcome_file, OutcomeRecord)
            if not any(found.raised) and "image" not in samples:
                raise ShotError(self.path / outcome_file, "has neither an error nor an image")
            outcome = StepOutcome(found.returned, samples, found.raised)
        return StepCall(index, record.name, frame, record.outputs, outcome)

    def _read(self, name: str, kind: Any) -> tuple[Any, Arrays]:
        """Read a file of `write_record`, and check its place and its CRC-32."""
        path = self.path / name
        check_inside(self.path, [path])
        tensors, texts = open_safetensors(path)
        if (size := sum(tensor.nbytes for tensor in tensors.values())) > IMAGE_BYTES:
            raise ShotError(path, f"has {size >> 30} GiB of arrays; want at most {IMAGE_BYTES >> 30}")
        text, arrays = str(texts.get("record")), {name: np.array(array) for name, array in tensors.items()}
        if str(texts.get(_CRC)) != str(_crc_of(text, arrays)):
            raise ShotError(path, f"has changed since it was recorded ({_CRC} differs)")
        return decoded(path, text, kind), arrays


def write_record(path: Path, record: Record | OutcomeRecord, arrays: Arrays) -> None:
    """Write a call or an outcome with its arrays; ShotError if the disk refuses."""
    text = msgspec.json.encode(record).decode()
    write_safetensors(path, arrays, {"record": text, _CRC: str(_crc_of(text, arrays))})


def open_recording(path: Path | str) -> Recording:
    """Open a recording of `Upscaler(record=...)`; it may still be growing.

    >>> for call in open_recording("kitchen.recording"):
    ...     if isinstance(call, StepCall):
    ...         print(call.index, call.frame.size, call.outcome)

    Raises:
        RecordingError: it is missing, damaged, or of another kind or version.
        ArgumentError: `path` is neither text nor a path.
    """
    folder = Path(checked_path("path", path))
    file = folder / SETUP
    if not is_there(folder):
        raise RecordingError(folder, "there is no such folder", NOT_FOUND)
    if not is_regular(file):
        raise RecordingError(folder, "is not a recording", "`supersampler upscale --record` writes them.")
    hint = "Replay it with the version of supersampler that wrote it."
    with _errors_as_recording_error(folder, hint):
        for name, known in (("format", FORMAT), ("contract", CONTRACT)):
            check_version(file, known, hint, name)
    with _errors_as_recording_error(folder, "No Upscaler writes this."):
        setup = read_typed(file, Setup)
        if setup.display_size is not None:
            checked_size("display_size", setup.display_size)
        return Recording(folder, setup)


def _state(record: StateRecord, arrays: Arrays) -> State:
    """Return a state; `Upscaler.load_state` checks its arrays."""
    shaded = {name.removeprefix(SHADED): array for name, array in arrays.items() if name.startswith(SHADED)}
    history = {name: array for name, array in arrays.items() if not name.startswith(SHADED)}
    return State(
        record.method,
        record.display_size,
        record.render_size,
        history if record.history else None,
        shaded if record.shaded else None,
        record.version,
    )


def _crc_of(text: str, arrays: Arrays) -> int:
    crc = zlib.crc32(text.encode(errors="replace"))
    for name in sorted(arrays):
        crc = crc32(arrays[name], zlib.crc32(name.encode(errors="replace"), crc))
    return crc


def crc32(array: NDArray[Any], start: int = 0) -> int:
    """Return the CRC-32 of an array's bytes, continued from another CRC-32."""
    return zlib.crc32(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data, start)


@contextmanager
def _errors_as_recording_error(path: Path, hint: str = _DAMAGED) -> Iterator[None]:
    """Replace other errors about a recording's content by RecordingError."""
    try:
        yield
    except RecordingError:
        raise
    except MemoryError as error:
        remedy = "Replay it on a machine with more memory."
        raise RecordingError(path, "needs more memory than there is", remedy) from error
    except ShotError as error:
        raise RecordingError(error.path, error.problem, hint) from error
    except OSError as error:
        raise RecordingError(path, f"cannot be read ({error})") from error
    except SupersamplerError as error:
        raise RecordingError(path, f"has content that no Upscaler writes ({error})", hint) from error
