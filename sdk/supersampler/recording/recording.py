"""`Recording`: reads the calls of a recording, one at a time."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from supersampler.conventions import Conventions
from supersampler.errors import RecordingError, ShotError, SupersamplerError
from supersampler.io.files import check_inside, check_is_file
from supersampler.io.json_fields import Field, parse_json
from supersampler.io.shot.format import files_of, frame_entry
from supersampler.io.shot.frame_files import read_frame, read_reference
from supersampler.io.shot.safetensors import open_safetensors
from supersampler.methods.model_file import sha256
from supersampler.recording.calls import Call, CloseCall, LoadStateCall, ResetCall, StepCall, state_of
from supersampler.recording.folder import CALLS, LAST_IMAGE, SAMPLED, STATE
from supersampler.recording.outcome import read_outcome
from supersampler.recording.setup import Setup, read_setup

MAX_LINE = 4 << 20
"""Maximum bytes of a line of the log."""

_STEPS = ("step", "extrapolate", "step_tensors")
_DAMAGED = "The recording is damaged; copy it again."


class Recording:
    """The recorded calls of an Upscaler, in order; each iteration reads the log from its start.

    Attributes:
        path: the folder.
        setup: how and where the Upscaler was made.
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
        with _damage(self.path):
            for line in self._lines():
                if step is not None:
                    has_outcome = "returned" in line.value or "raised" in line.value
                    if has_outcome:
                        samples = partial(self._checked, line, SAMPLED.format(steps))
                        step = replace(step, outcome=read_outcome(line, samples))
                    yield step
                    steps, step = steps + 1, None
                    if has_outcome:
                        continue
                kind = line["call"].one_of(*_STEPS, "reset", "load_state", "close")
                if kind in _STEPS:
                    step = self._step(kind, line, steps)
                elif kind == "reset":
                    yield ResetCall()
                elif kind == "load_state":
                    arrays, _ = open_safetensors(self._checked(line, STATE.format(states)))
                    yield LoadStateCall(state_of(line, {name: np.array(a) for name, a in arrays.items()}))
                    states += 1
                else:
                    has_image = line.optional("sha256") is not None
                    yield CloseCall(
                        read_reference(self._checked(line, LAST_IMAGE), None) if has_image else None
                    )
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

    def _step(self, kind: str, line: Field, index: int) -> StepCall:
        entry = frame_entry(line["frame"])
        if entry.render_size is None:
            line["frame"].refuse("an entry with a render_size")
        for name in files_of(entry):
            self._checked(line, name)
        raw = read_frame(self.path, entry, entry.render_size, None)
        frame = Conventions().converter().to_frame(raw)
        tensors, extrapolated = kind == "step_tensors", kind == "extrapolate"
        return StepCall(index, frame, line["outputs"].texts(), tensors, extrapolated, None)

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
        RecordingError: it is missing, of another kind or of another version.
    """
    return Recording(Path(path), read_setup(Path(path)))


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Turn errors about a recording's content into RecordingError."""
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
