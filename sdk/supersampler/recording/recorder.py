"""`Recorder`: writes each call of an Upscaler and its outcome to a folder."""

import json
import weakref
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from io import FileIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from supersampler.backends.onnx.tensors import Tensor, frame_of_tensors, image_of_tensor
from supersampler.conventions import Conventions
from supersampler.errors import ArgumentError, RecordingError, ShotError
from supersampler.frame import Float32, Frame
from supersampler.history import StepResult
from supersampler.io.files import NO_ROOM, new_file, remove_files, write_text
from supersampler.io.images import write_exr
from supersampler.io.shot.format import FILE_NAME, FrameEntry, ShotInfo, entry_json, files_of, shot_json
from supersampler.io.shot.frame_files import write_frame
from supersampler.io.shot.safetensors import write_safetensors
from supersampler.methods.gbuffers import only_gbuffers
from supersampler.methods.model_file import sha256
from supersampler.recording.calls import state_arrays, state_json
from supersampler.recording.folder import CALLS, DISPLAY, FRAME, LAST_IMAGE, SAMPLED, SETUP, STATE
from supersampler.recording.outcome import outcome_json, raised, returned, write_samples
from supersampler.recording.setup import FORMAT, Setup
from supersampler.state import State

_Made = TypeVar("_Made")


class Recorder:
    """Appends each call to a log before it is made, and its outcome after it.

    Where the disk refuses, the call raises before it is made, and the recording ends with the previous call.
    Later calls are not recorded.

    Args:
        path: the folder, which must not exist.
        setup: how the Upscaler was made.
        inputs: names of the tensors that its models read; other G-buffers are not recorded.

    Raises:
        RecordingError: the folder exists, or cannot be written.
    """

    def __init__(self, path: Path | str, setup: Setup, inputs: Collection[str]) -> None:
        self.path, self._inputs = Path(path), inputs
        self._failure: OSError | None = None
        self._entries: list[FrameEntry] = []  # entries in shot.json
        self._steps = self._states = 0
        self._last: Float32 | None = None
        self._log: FileIO | None = None
        with self._or_end():
            try:
                self.path.mkdir(parents=True)
            except FileExistsError:
                hint = "Choose another name, or move it away."
                raise RecordingError(path, "is there already", hint) from None
            write_text(self.path / SETUP, json.dumps({"format": FORMAT, **asdict(setup)}, indent=1) + "\n")
            self._log = new_file(self.path / CALLS)  # unbuffered: each line is in the file at once
            self._close_log = weakref.finalize(self, self._log.close)  # no ResourceWarning without `close`

    def step(
        self,
        frame: Frame,
        outputs: Collection[str],
        run: Callable[[], Float32 | StepResult],
        *,
        extrapolated: bool = False,
    ) -> Float32 | StepResult:
        """Call `run`, which makes a step or an extrapolation, and record it.

        The frame is written before, so that the recording has it if the process ends in the step. A call that
        raises ArgumentError or KeyboardInterrupt is removed from the recording.

        Raises:
            RecordingError: the call, or the previous outcome, cannot be written; `run` was not called.
        """
        call = {"call": "extrapolate" if extrapolated else "step", "outputs": list(map(str, outputs))}
        return self._around(
            call,
            lambda: replace(only_gbuffers(frame, self._inputs)),  # checks G-buffers again
            run,
            lambda made: made if isinstance(made, StepResult) else StepResult(made),
        )

    def step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        jitter: tuple[float, float],
        exposure: float | None,
        pre_exposure: float,
        reset: bool,
        run: Callable[[], Tensor],
    ) -> Tensor:
        """Call `run`, which makes a step with tensors, and record it as a frame copied from the device.

        Raises:
            FrameError: the tensors are not a valid frame; `run` was not called.
            RecordingError: see `step`.
        """
        return self._around(
            {"call": "step_tensors", "outputs": []},
            lambda: frame_of_tensors(
                tensors, jitter, exposure, pre_exposure=pre_exposure, reset=reset, inputs=self._inputs
            ),
            run,
            lambda image: StepResult(image_of_tensor(image)),
        )

    def reset(self) -> None:
        """Record a reset, before it is made."""
        if self._is_on():
            with self._or_end():
                self._append({"call": "reset"})

    def load_state(self, state: State) -> None:
        """Record a state, before it is loaded."""
        if self._is_on():
            name = STATE.format(self._states)
            with self._or_end():
                write_safetensors(self.path / name, state_arrays(state))
                self._append({"call": "load_state", **state_json(state)}, [name])
            self._states += 1

    def close(self) -> None:
        """Write the last image and end the recording."""
        if self._is_on():
            with self._or_end():
                if self._last is not None:
                    write_exr(self.path / LAST_IMAGE, self._last, compression="none")
                self._append({"call": "close"}, [] if self._last is None else [LAST_IMAGE])
            self._stop()

    def _around(
        self,
        call: Mapping[str, Any],
        frame_of: Callable[[], Frame],
        run: Callable[[], _Made],
        result_of: Callable[[_Made], StepResult],
    ) -> _Made:
        if not self._is_on():
            return run()
        frame, begin, index = frame_of(), self._end(), self._steps
        entry = FrameEntry(
            file=FRAME.format(index),
            jitter=frame.jitter,
            reset=frame.reset,
            exposure=frame.exposure,
            pre_exposure=frame.pre_exposure,
            display_file=DISPLAY.format(index) if frame.gbuffer_display else None,
            render_size=frame.size,
            shaded=frame.color is not None,
        )
        files = files_of(entry)

        def undo() -> None:
            self._cut(begin)
            with suppress(OSError):
                remove_files(self.path / name for name in (*files, SAMPLED.format(index)))

        with self._or_end(undo):
            write_frame(self.path, entry, Conventions().converter().from_frame(frame), "none")
            self._append({**call, "frame": entry_json(entry)}, files)
        self._steps += 1  # after any interruption the next step has its own files
        try:
            made = run()
        except BaseException as error:
            if isinstance(error, ArgumentError) or not isinstance(error, Exception):
                undo()
                self._steps -= 1
            else:
                with self._or_end(undo, later=True):
                    self._append(outcome_json(raised(error)))
            raise
        result, sampled = result_of(made), SAMPLED.format(index)
        with self._or_end(undo, later=True):
            outcome = returned(index, result)
            write_samples(self.path / sampled, outcome.samples)
            self._append(outcome_json(outcome), [sampled])
            self._list_in_shot(entry, result.image)
        if self._last is None or self._last.shape != result.image.shape:
            self._last = np.empty_like(result.image)
        np.copyto(self._last, result.image)
        return made

    def _list_in_shot(self, entry: FrameEntry, image: Float32) -> None:
        """List a frame in shot.json, after its step has accepted it."""
        entries = [*self._entries, entry]
        info = ShotInfo(
            name=self.path.name,
            render_size=entries[0].render_size or (0, 0),
            display_size=(image.shape[1], image.shape[0]),
            frame_rate=None,  # unknown to an Upscaler
            conventions=Conventions(),
        )
        write_text(self.path / FILE_NAME, shot_json(info, entries))
        self._entries = entries

    def _append(self, line: Mapping[str, Any], files: Collection[str] = ()) -> None:
        """Append a line to the log, with the hashes of its files."""
        if files:
            line = {**line, "sha256": {name: sha256(self.path / name) for name in files}}
        data = memoryview(json.dumps(line, allow_nan=False).encode() + b"\n")
        while data and self._log is not None:  # on a nearly full disk only a part is written
            data = data[self._log.write(data) :]

    def _end(self) -> int:
        return 0 if self._log is None else self._log.tell()

    def _cut(self, end: int) -> None:
        """Truncate the log to its first `end` bytes, if the disk allows."""
        if self._log is not None:
            with suppress(OSError):
                self._log.seek(end)
                self._log.truncate()

    @contextmanager
    def _or_end(self, undo: Callable[[], None] = lambda: None, *, later: bool = False) -> Iterator[None]:
        """After an error, remove the block's lines from the log; after a disk error also `undo` and end it.

        Raises:
            RecordingError: the disk refused; with `later`, the next call raises it instead.
        """
        end = self._end()
        try:
            yield
        except BaseException as error:
            self._cut(end)
            if not isinstance(error, OSError):
                raise
            undo()
            self._stop()
            problem = error.problem if isinstance(error, ShotError) else f"cannot be written ({error})"
            own = isinstance(error, RecordingError)
            failure = error if own else RecordingError(self.path, problem, NO_ROOM)
            if not later:
                raise failure from (None if own else error)
            self._failure = failure

    def _is_on(self) -> bool:
        """Return whether calls are recorded; raise where the previous outcome could not be written."""
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        return self._log is not None

    def _stop(self) -> None:
        if self._log is not None:
            self._close_log()
        self._log = self._last = None
