"""`Recorder`: writes each call of an Upscaler and its outcome to a folder."""

import json
import math
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from supersampler import recording
from supersampler.backends.onnx.tensors import Tensor, frame_of_tensors, image_of_tensor
from supersampler.errors import ArgumentError, RecordingError, ShotError
from supersampler.frame import Float32, Frame
from supersampler.history import State, StepResult
from supersampler.io.files import NO_ROOM, remove_files, write_text
from supersampler.io.machine import machine, versions
from supersampler.methods.gbuffers import arrays_by_name, only_gbuffers, values_of
from supersampler.methods.model_info import ModelInfo
from supersampler.recording import Arrays, Record, Setup, StepOutcome

if TYPE_CHECKING:
    from supersampler.model import Model

SAMPLES = 4096
"""Approximate number of pixels of each image that are kept."""


class Recorder:
    """Writes each call of an Upscaler before it is made, and its outcome after it.

    If the disk refuses a call, the recording ends with the previous call: this call raises before it is made,
    and later calls are not recorded.

    Args:
        path: the folder, which must not exist.
        model: the Upscaler's model.
        extrapolation: the model that extrapolates unshaded frames, if there is one.
        inputs: the G-buffers to record.
        settings: display_size, scale, at_rest, skip and validate of the Upscaler.

    Raises:
        RecordingError: the folder exists, or cannot be written.
    """

    def __init__(
        self,
        path: Path | str,
        model: "Model",
        extrapolation: Sequence[ModelInfo],
        inputs: Collection[str],
        **settings: Any,
    ) -> None:
        self.path, self._inputs = Path(path).absolute(), inputs  # the working directory may change
        self._failure: RecordingError | None = None
        self._count, self._steps, self._on = 0, 0, True
        self._process = os.getpid()  # calls of a fork would be mixed with those of its parent
        setup = Setup(
            **msgspec.structs.asdict(recording.RecordedModel.of(model.info)),
            extrapolation=next(map(recording.RecordedModel.of, extrapolation), None),
            executor=model.executor,  # type: ignore[arg-type]  # an executor's name
            precision=model.precision,  # type: ignore[arg-type]  # an executor's precision
            providers=tuple(model.providers),
            threads=model.threads,
            versions=versions(),
            machine=machine(),
            **settings,
        )
        with self._writing():
            try:
                self.path.mkdir(parents=True)
            except FileExistsError:
                hint = "Choose another name, or move it away."
                raise RecordingError(path, "already exists", hint) from None
            content = {"format": recording.FORMAT, **msgspec.to_builtins(setup)}
            write_text(self.path / recording.SETUP, json.dumps(content, indent=1) + "\n")

    @contextmanager
    def step(self, name: str, frame: Frame, outputs: Sequence[str]) -> Iterator[list[Any]]:
        """Record the step in a `with` block, which appends its result, a StepResult or tensor, to the list.

        The frame is written before the block, so that the recording has it if the step ends the process. A
        step that raises ArgumentError or KeyboardInterrupt before its result is appended is removed from the
        recording.

        Raises:
            RecordingError: the call, or the previous outcome, cannot be written; the block was not run.
        """
        results: list[Any] = []
        if not self._is_on():
            yield results
            return
        frame = replace(only_gbuffers(frame, self._inputs))  # checks G-buffers again
        record = recording.StepRecord(
            name=name,  # type: ignore[arg-type]  # one of the three
            outputs=tuple(outputs),
            **values_of(frame),
        )
        number, index = self._count, self._steps
        self._append(record, arrays_by_name(frame))
        self._steps += 1
        try:
            yield results
        except BaseException as error:
            if results:  # the step is made; `step_many` failed in another view, or while it was recorded
                self._write_result(number, index, results)
            elif isinstance(error, ArgumentError) or not isinstance(error, Exception):
                self._remove(number)
            else:
                self._write_outcome(number, raised(error))
            raise
        self._write_result(number, index, results)

    @contextmanager
    def step_tensors(self, tensors: Mapping[str, Tensor], **values: Any) -> Iterator[list[Any]]:
        """Record a step with tensors and `values_of` the frame, which is copied from the device; see `step`.

        Raises:
            FrameError: the tensors are not a valid frame; the block was not run.
        """
        if not self._is_on():
            yield []
            return
        with self.step("step_tensors", frame_of_tensors(tensors, self._inputs, **values), ()) as results:
            yield results

    def reset(self) -> None:
        """Record a reset, before it is made."""
        if self._is_on():
            self._append(recording.ResetCall(), {})

    def load_state(self, state: State) -> None:
        """Record a state, before it is loaded."""
        if self._is_on():
            record = recording.StateRecord(
                method=state.method,
                display_size=state.display_size,
                render_size=state.render_size,
                version=state.version,
                history=state.history is not None,
                shaded=state.shaded is not None,
            )
            shaded = {f"{recording.SHADED}{name}": array for name, array in (state.shaded or {}).items()}
            self._append(record, {**(state.history or {}), **shaded})

    def close(self) -> None:
        """End the recording."""
        if self._is_on():
            self._append(recording.CloseCall(), {})
            self._on = False

    def _append(self, record: Record, arrays: Arrays) -> None:
        with self._writing():
            recording.write_record(self.path / recording.CALL.format(self._count), record, arrays)
            self._count += 1

    def _write_result(self, number: int, index: int, results: Sequence[Any]) -> None:
        """Write the outcome of the last call, a step that returned the only one of `results`."""
        [made] = results
        result = made if isinstance(made, StepResult) else StepResult(image_of_tensor(made))
        self._write_outcome(number, returned(index, result))

    def _write_outcome(self, number: int, outcome: StepOutcome) -> None:
        """Write the outcome of the last call; if the disk refuses, remove the call, and raise in the next."""
        record = recording.OutcomeRecord(dict(outcome.digests), outcome.error)
        with self._writing(lambda: self._remove(number), raises=False):
            recording.write_record(self.path / recording.OUTCOME.format(number), record, outcome.samples)

    def _remove(self, number: int) -> None:
        """Remove the last call, a step, if the disk allows it."""
        with suppress(OSError):
            remove_files([self.path / recording.CALL.format(number)])
            self._count, self._steps = number, self._steps - 1

    @contextmanager
    def _writing(self, undo: Callable[[], None] = lambda: None, *, raises: bool = True) -> Iterator[None]:
        """Call `undo` and end the recording if the disk refuses in the block.

        Raises:
            RecordingError: the disk refused. If `raises` is False, the next call raises it.
        """
        try:
            yield
        except OSError as error:
            undo()
            self._on = False
            if isinstance(error, RecordingError):
                raise
            problem = error.problem if isinstance(error, ShotError) else f"cannot be written ({error})"
            self._failure = RecordingError(self.path, problem, NO_ROOM)
            self._failure.__cause__ = error
            if raises:
                self._is_on()

    def _is_on(self) -> bool:
        """Return whether calls are recorded; raise if the previous outcome could not be written."""
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        return self._on and os.getpid() == self._process


def returned(index: int, result: StepResult) -> StepOutcome:
    """Return the outcome of a step that returned `result`."""
    arrays = {name: array for name, array in vars(result).items() if array is not None}
    samples = {name: _sampled(index, arrays[name]) for name in arrays if name in ("image", "aovs")}
    return StepOutcome({name: recording.crc32(array) for name, array in arrays.items()}, samples)


def raised(error: Exception) -> StepOutcome:
    """Return the outcome of a step that raised `error`."""
    return StepOutcome({}, {}, (type(error).__name__, str(error)))


def _sampled(index: int, image: Float32) -> Float32:
    """Return every s-th pixel of (H, W, k) in x and y, s = ceil(sqrt(H W / SAMPLES)), offset by the index."""
    height, width = image.shape[:2]
    stride = math.ceil(math.sqrt(height * width / SAMPLES))
    top, left = index % min(stride, height), index // stride % min(stride, width)
    return np.ascontiguousarray(image[top::stride, left::stride])
