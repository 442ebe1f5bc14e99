"""`Recorder`: writes each call of an Upscaler, and its outcome, to a folder while it is made."""

import json
import weakref
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from io import FileIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from supersampler.backends.onnx.tensors import Tensor
from supersampler.conventions import Conventions
from supersampler.errors import ArgumentError, RecordingError, ShotError
from supersampler.frame import Float32, Frame, Size
from supersampler.history import StepResult
from supersampler.io.atomic import NO_ROOM, remove_files, replacing
from supersampler.io.images import write_exr
from supersampler.io.shot.format import FILE_NAME, FrameEntry, ShotInfo, entry_json, files_of, shot_json
from supersampler.io.shot.frame_files import write_frame
from supersampler.io.shot.safetensors import write_safetensors
from supersampler.methods.gbuffers import only_gbuffers
from supersampler.recording.calls import state_arrays, state_json
from supersampler.recording.folder import CALLS, LAST_IMAGE, sampled_path, state_path
from supersampler.recording.outcome import Outcome, outcome_json, raised, returned, write_samples
from supersampler.recording.setup import Setup, write_setup
from supersampler.recording.tensors import frame_of_tensors, image_of_tensor
from supersampler.state import State

_FRAME_RATE = 30.0  # which shot.json must have, and no call tells
_Made = TypeVar("_Made")


class Recorder:
    """Appends each call to a log before it is made, and its outcome after it.

    Where the disk refuses, the call raises before anything is done, and the recording ends with the call
    before; later calls are made without being recorded.

    Args:
        path: the folder, which must not exist.
        setup: how the Upscaler was made.
        inputs: names of the tensors that its models read; no other G-buffers are recorded.

    Raises:
        RecordingError: the folder exists, or cannot be written.
    """

    def __init__(self, path: Path | str, setup: Setup, inputs: Collection[str]) -> None:
        self.path, self._inputs = Path(path), inputs
        self._failure: RecordingError | None = None
        self._entries: list[FrameEntry] = []  # of the frames in shot.json
        self._display_size: Size | None = None
        self._steps = self._states = 0
        self._last: Float32 | None = None
        self._log: FileIO | None = None
        with self._or_end():
            try:
                self.path.mkdir(parents=True)
            except FileExistsError:
                hint = "Choose another name, or move it away."
                raise RecordingError(path, "is there already", hint) from None
            write_setup(self.path, setup)
            self._log = FileIO(self.path / CALLS, "x")  # unbuffered: each line stays at once
            self._close_log = weakref.finalize(self, self._log.close)  # without a warning if it is dropped

    def step(
        self,
        frame: Frame,
        outputs: Collection[str],
        run: Callable[[], Float32 | StepResult],
        *,
        extrapolated: bool = False,
    ) -> Float32 | StepResult:
        """Make a step, or an extrapolation, by `run`, and record it.

        The frame is written first, so that it is there if the process ends in the step. A call that is
        refused for an argument, or stopped by Ctrl-C, changes nothing and is removed from the recording.

        Raises:
            RecordingError: the call, or the outcome of the one before, cannot be written; nothing was done.
        """
        call = {"call": "extrapolate" if extrapolated else "step", "outputs": list(map(str, outputs))}
        return self._around(
            call,
            lambda: replace(only_gbuffers(frame, self._inputs)),  # checks the shapes of G-buffers again
            run,
            lambda made: made if isinstance(made, StepResult) else StepResult(made),
        )

    def step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        jitter: tuple[float, float],
        exposure: float | None,
        reset: bool,
        run: Callable[[], Tensor],
    ) -> Tensor:
        """Make a step with tensors by `run`, and record it as a frame, which is copied from the device.

        Raises:
            FrameError: the tensors make no frame; nothing was done.
            RecordingError: see `step`.
        """
        return self._around(
            {"call": "step_tensors"},
            lambda: frame_of_tensors(tensors, jitter, exposure, reset=reset, inputs=self._inputs),
            run,
            lambda image: StepResult(image_of_tensor(image)),
        )

    def reset(self) -> None:
        """Record a reset that is about to be made."""
        self._raise_failure()
        with self._or_end():
            self._append({"call": "reset"})

    def load_state(self, state: State) -> None:
        """Record a state that is about to be loaded."""
        self._raise_failure()
        if self._log is not None:
            with self._or_end():
                write_safetensors(state_path(self.path, self._states), state_arrays(state))
                self._append({"call": "load_state", **state_json(state)})
            self._states += 1

    def close(self) -> None:
        """Write the last image and end the recording."""
        self._raise_failure()
        if self._log is not None:
            with self._or_end():
                if self._last is not None:
                    write_exr(self.path / LAST_IMAGE, self._last, compression="none")
                self._append({"call": "close", "image": self._last is not None})
            self._stop()

    def _around(
        self,
        call: Mapping[str, Any],
        frame_of: Callable[[], Frame],
        run: Callable[[], _Made],
        result_of: Callable[[_Made], StepResult],
    ) -> _Made:
        self._raise_failure()
        if self._log is None:
            return run()
        frame, begin = frame_of(), self._log.tell()
        entry = self._entry(frame)
        with self._or_end(lambda: self._remove(begin, entry)):
            write_frame(self.path, entry, Conventions().converter().from_frame(frame), "none")
            self._append({**call, "frame": entry_json(entry)})
        self._steps += 1  # whatever interrupts what follows, the next step has files of its own
        try:
            made = run()
        except BaseException as error:
            if isinstance(error, ArgumentError) or not isinstance(error, Exception):
                self._remove(begin, entry)
                self._steps -= 1
            else:
                self._finish(begin, entry, raised(error))
            raise
        result = result_of(made)
        self._display_size = result.image.shape[1], result.image.shape[0]
        self._finish(begin, entry, returned(_number(entry), result))
        if self._last is None or self._last.shape != result.image.shape:
            self._last = np.empty_like(result.image)
        np.copyto(self._last, result.image)
        return made

    def _entry(self, frame: Frame) -> FrameEntry:
        name = f"{self._steps:04d}.exr"
        return FrameEntry(
            file=name,
            jitter=frame.jitter,
            reset=frame.reset,
            exposure=frame.exposure,
            display_file=f"display/{name}" if frame.gbuffer_display else None,
            render_size=frame.size,
            shaded=frame.color is not None,
        )

    def _finish(self, begin: int, entry: FrameEntry, outcome: Outcome) -> None:
        """Record the outcome of a step. The step has been made: if this fails, the next call raises."""
        try:
            with self._or_end(lambda: self._remove(begin, entry)):
                if outcome.samples:
                    write_samples(sampled_path(self.path, _number(entry)), outcome.samples)
                self._append(outcome_json(outcome))
                if outcome.samples:
                    self._list_in_shot(entry)
        except RecordingError as error:
            self._failure = error

    def _list_in_shot(self, entry: FrameEntry) -> None:
        """List a frame in shot.json: it has been stepped, and no check refused it."""
        entries = [*self._entries, entry]
        info = ShotInfo(
            name=self.path.name,
            render_size=entries[0].render_size or (0, 0),
            display_size=self._display_size,
            frame_rate=_FRAME_RATE,
            conventions=Conventions(),
        )
        with replacing(self.path / FILE_NAME) as partial:
            partial.write_text(shot_json(info, entries), encoding="utf-8", newline="\n")
        self._entries = entries

    def _append(self, line: Mapping[str, Any]) -> None:
        """Append a line to the log, whole or not at all."""
        if self._log is None:
            return
        data, begin = memoryview(json.dumps(line, allow_nan=False).encode() + b"\n"), self._log.tell()
        try:
            while data:  # an unbuffered file takes a part where the disk is nearly full
                data = data[self._log.write(data) :]
        except BaseException:
            self._cut(begin)
            raise

    def _cut(self, end: int) -> None:
        """Let the log end there again, as far as the disk allows."""
        if self._log is not None:
            with suppress(OSError):
                self._log.seek(end)
                self._log.truncate()

    def _remove(self, begin: int, entry: FrameEntry) -> None:
        """Remove a step from the recording: its lines, from `begin` on, and its files."""
        self._cut(begin)
        files = [*(self.path / name for name in files_of(entry)), sampled_path(self.path, _number(entry))]
        with suppress(OSError):
            remove_files(files)

    @contextmanager
    def _or_end(self, undo: Callable[[], None] = lambda: None) -> Iterator[None]:
        """Where the disk refuses what is done inside, undo it and end the recording.

        Raises:
            RecordingError: the disk refused.
        """
        try:
            yield
        except OSError as error:
            undo()
            self._stop()
            if isinstance(error, RecordingError):
                raise
            reason = error.problem if isinstance(error, ShotError) else f"cannot be written ({error})"
            raise RecordingError(self.path, reason, NO_ROOM) from error

    def _raise_failure(self) -> None:
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    def _stop(self) -> None:
        if self._log is not None:
            self._close_log()
        self._log = self._last = None


def _number(entry: FrameEntry) -> int:
    """Return the number of the step that a frame's file is named after."""
    return int(Path(entry.file).stem)
