"""A recording, read call by call."""

import reprlib
from collections.abc import Iterator
from pathlib import Path

from supersampler.errors import RecordingError, SupersamplerError
from supersampler.methods.model_file import CONTRACT
from supersampler.recording.calls import (
    FORMAT,
    Call,
    CloseCall,
    LoadStateCall,
    ResetCall,
    Setup,
    StepCall,
    frame_of,
    image_of,
    setup_of,
    state_of,
)
from supersampler.recording.format import Record, read_records
from supersampler.recording.outcome import outcome_of
from supersampler.recording.values import flag, texts

_WRONG = (SupersamplerError, AttributeError, KeyError, TypeError, ValueError, OverflowError)


class Recording:
    """The calls of an Upscaler, in order. Each iteration reads the file anew, one frame at a time.

    Attributes:
        path: the file.
        setup: how the Upscaler was made, and where.
    """

    def __init__(self, path: Path, setup: Setup) -> None:
        self.path, self.setup = path, setup

    def __iter__(self) -> Iterator[Call]:
        """Yield the calls up to the last whole one.

        Raises:
            RecordingError: a record is damaged, or is none that an Upscaler writes; after the calls before.
        """
        records = read_records(self.path)
        next(records, None)  # the setup
        steps, step = 0, None  # the latter waits for its outcome
        for record in records:
            if step is not None:
                outcome = record if record.kind == "outcome" else None
                yield self._call(step, steps, outcome)
                steps, step = steps + 1, None
                if outcome is not None:
                    continue
            if record.kind == "step":
                step = record
            else:
                yield self._call(record)
        if step is not None:
            yield self._call(step, steps)

    def _call(self, record: Record, index: int = 0, outcome: Record | None = None) -> Call:
        try:
            match record.kind:
                case "step":
                    told = None if outcome is None else outcome_of(outcome)
                    outputs, tensors = texts(record.values["outputs"], 16), flag(record.values["tensors"])
                    extrapolated = flag(record.values.get("extrapolated", False))
                    return StepCall(index, frame_of(record), outputs, tensors, extrapolated, told)
                case "load_state":
                    return LoadStateCall(state_of(record))
                case "reset":
                    return ResetCall()
                case "close":
                    return CloseCall(image_of(record))
        except _WRONG as error:
            raise _strange(self.path, record, error) from error
        raise _strange(self.path, record)


def open_recording(path: Path | str) -> Recording:
    """Open what `Upscaler(record=...)` wrote, or still writes.

    >>> for call in open_recording("kitchen.recording"):
    ...     if isinstance(call, StepCall):
    ...         print(call.index, call.frame.size, call.outcome)

    Raises:
        RecordingError: it is missing, of another kind or of another version.
    """
    first = next(read_records(path), None)
    if first is None:
        raise RecordingError(path, "ends in its first record", "The process ended, or the disk was full.")
    if first.kind != "setup" or first.values.get("format") != FORMAT:
        problem = f"is of format {reprlib.repr(first.values.get('format'))}; this package reads {FORMAT}"
        raise RecordingError(path, problem, "Replay it with the version of supersampler that wrote it.")
    try:
        setup = setup_of(first)
    except _WRONG as error:
        raise _strange(path, first, error) from error
    if setup.contract != CONTRACT:
        problem = f"holds frames of contract {setup.contract}; this package drives {CONTRACT}"
        raise RecordingError(path, problem, "Replay it with the version of supersampler that wrote it.")
    return Recording(Path(path), setup)


def _strange(path: Path | str, record: Record, error: Exception | None = None) -> RecordingError:
    why = "" if error is None else f" ({type(error).__name__}: {error})"
    return RecordingError(path, f"has a {reprlib.repr(record.kind)} record that no Upscaler writes{why}")
