"""A recording, read call by call."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from supersampler.conventions import Conventions
from supersampler.errors import RecordingError, ShotError, SupersamplerError
from supersampler.frame import Float32
from supersampler.io.atomic import check_inside
from supersampler.io.shot.format import files_of, frame_entry
from supersampler.io.shot.frame_files import read_frame, read_reference
from supersampler.io.shot.json_keys import JsonKeys
from supersampler.io.shot.safetensors import open_safetensors
from supersampler.recording.calls import Call, CloseCall, LoadStateCall, ResetCall, StepCall, state_of
from supersampler.recording.folder import CALLS, LAST_IMAGE, sampled_path, state_path
from supersampler.recording.outcome import Outcome, read_outcome
from supersampler.recording.setup import Setup, read_setup
from supersampler.state import State

MAX_LINE = 4 << 20
"""Bytes of a line of the log, at most."""

_STEPS = ("step", "extrapolate", "step_tensors")
_DAMAGED = "The recording is damaged; copy it again."


class Recording:
    """The calls of an Upscaler, in order. Each iteration reads the log anew, one frame at a time.

    Attributes:
        path: the folder.
        setup: how the Upscaler was made, and where.
    """

    def __init__(self, path: Path, setup: Setup) -> None:
        self.path, self.setup = path, setup

    def __iter__(self) -> Iterator[Call]:
        """Yield the calls up to the last complete line of the log.

        Raises:
            RecordingError: a line or a file is damaged, or none that an Upscaler writes; after the calls
                before it.
        """
        steps = states = 0
        step: StepCall | None = None  # waits for its outcome
        with _damage(self.path):
            for line in self._lines():
                if step is not None:
                    has_outcome = "returned" in line or "raised" in line
                    yield replace(step, outcome=self._outcome(line, steps)) if has_outcome else step
                    steps, step = steps + 1, None
                    if has_outcome:
                        continue
                kind = line.take("call", str)
                if kind in _STEPS:
                    step = self._step(kind, line, steps)
                elif kind == "reset":
                    yield ResetCall()
                elif kind == "load_state":
                    yield LoadStateCall(self._state(line, states))
                    states += 1
                elif kind == "close":
                    yield CloseCall(self._last_image() if line.take("image", bool) else None)
                else:
                    raise line.wrong("call", kind, "a call of an Upscaler")
            if step is not None:
                yield step

    def _lines(self) -> Iterator[JsonKeys]:
        """Yield the log's lines; one that the file's end cuts off is left out."""
        path, number = self._inside(self.path / CALLS), 1
        if not path.is_file():  # a pipe, say, which never ends
            raise ShotError(path, "is missing, or no regular file")
        with path.open("rb") as file:
            while (text := file.readline(MAX_LINE)).endswith(b"\n"):
                try:
                    content = json.loads(text)
                except (ValueError, RecursionError) as error:
                    raise ShotError(path, f"line {number} is not JSON ({error})") from error
                yield JsonKeys(path, f"line {number}", content)
                number += 1
        if len(text) == MAX_LINE:
            raise ShotError(path, f"line {number} is longer than {MAX_LINE >> 20} MiB")

    def _step(self, kind: str, line: JsonKeys, index: int) -> StepCall:
        entry = frame_entry(JsonKeys(line.path, f"the frame in {line.where}", line.take("frame", dict)))
        if entry.render_size is None:
            raise line.wrong("frame", None, "its render_size")
        for name in files_of(entry):
            self._inside(self.path / name)
        raw = read_frame(self.path, entry, entry.render_size, None)
        frame = Conventions().converter().to_frame(raw)
        tensors, extrapolated = kind == "step_tensors", kind == "extrapolate"
        return StepCall(index, frame, line.take_texts("outputs"), tensors, extrapolated, None)

    def _outcome(self, line: JsonKeys, index: int) -> Outcome:
        return read_outcome(line, self._inside(sampled_path(self.path, index)))

    def _state(self, line: JsonKeys, number: int) -> State:
        arrays, _ = open_safetensors(self._inside(state_path(self.path, number)))
        return state_of(line, {name: np.array(array) for name, array in arrays.items()})

    def _last_image(self) -> Float32:
        return read_reference(self._inside(self.path / LAST_IMAGE), None)

    def _inside(self, path: Path) -> Path:
        """Return a path once it is known that no link leads from it out of the folder."""
        check_inside(self.path, [path])
        return path


def open_recording(path: Path | str) -> Recording:
    """Open what `Upscaler(record=...)` wrote, or still writes.

    >>> for call in open_recording("kitchen.recording"):
    ...     if isinstance(call, StepCall):
    ...         print(call.index, call.frame.size, call.outcome)

    Raises:
        RecordingError: it is missing, of another kind or of another version.
    """
    return Recording(Path(path), read_setup(Path(path)))


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Raise RecordingError where a recording cannot be read."""
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
