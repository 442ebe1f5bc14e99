"""`Recorder`: writes down what an Upscaler is asked and what it answers, while it is asked."""

import platform
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np

from supersampler import __version__
from supersampler.backends.onnx.tensors import Tensor
from supersampler.errors import ArgumentError, RecordingError
from supersampler.frame import Float32, Frame, Size
from supersampler.history import StepResult
from supersampler.io.machine import installed_versions, machine
from supersampler.methods.gbuffers import only_gbuffers
from supersampler.methods.model_file import CONTRACT, ModelInfo
from supersampler.recording.calls import RecordedModel, Setup, setup_record, state_record, step_record
from supersampler.recording.format import Record, RecordWriter
from supersampler.recording.outcome import Outcome, outcome_record, raised, returned
from supersampler.recording.tensors import frame_of_tensors, image_of_tensor
from supersampler.state import State

if TYPE_CHECKING:
    from supersampler.model import Model, Skip

_PACKAGES = ("numpy", "onnxruntime", "onnxruntime-gpu", "onnxruntime-directml", "numba", "llvmlite")
_Made = TypeVar("_Made")


class Recorder:
    """Appends each call to a file before it is carried out, and what came of it after.

    Where the file cannot be written, the call raises before anything is done, and the recording ends with
    the call before; later calls are carried out without being recorded.

    Args:
        path: the file, which must not be there yet.
        setup: how the Upscaler was made.
        inputs: names of the tensors that its models read; no other G-buffers are recorded.

    Raises:
        RecordingError: the file is there already, or cannot be written.
    """

    def __init__(self, path: Path | str, setup: Setup, inputs: Collection[str]) -> None:
        self._inputs = inputs
        self._writer: RecordWriter | None = RecordWriter(path)
        self._failure: RecordingError | None = None
        self._steps = 0
        self._last: Float32 | None = None
        self._write(setup_record(setup))

    def step(
        self,
        frame: Frame,
        outputs: Collection[str],
        run: Callable[[], Float32 | StepResult],
        *,
        extrapolated: bool = False,
    ) -> Float32 | StepResult:
        """Carry out a step by `run`, of a frame whose colour is to be drawn if `extrapolated`, and record it.

        The frame is written first, so that one in which the process ends is there. What is refused for an
        argument of the call, and what Ctrl-C stops, changes nothing and is no part of the recording.

        Raises:
            RecordingError: it, or the outcome of the step before, cannot be written; nothing was done.
        """
        kept = only_gbuffers(frame, self._inputs)
        return self._around(run, lambda: step_record(kept, outputs, extrapolated=extrapolated), _as_result)

    def step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        jitter: tuple[float, float],
        exposure: float | None,
        reset: bool,
        run: Callable[[], Tensor],
    ) -> Tensor:
        """Carry out a step with tensors by `run`, and record it: as a frame, which is copied to the host.

        Raises:
            FrameError: they make no frame; nothing was done.
            RecordingError: see `step`.
        """

        def record() -> Record:
            frame = frame_of_tensors(tensors, jitter, exposure, reset=reset, inputs=self._inputs)
            return step_record(frame, (), tensors=True)

        return self._around(run, record, lambda image: StepResult(image_of_tensor(image)))

    def reset(self) -> None:
        """Record a reset that is about to be made."""
        self._raise_failure()
        self._write(Record("reset"))

    def load_state(self, state: State) -> None:
        """Record a state that is about to be loaded."""
        self._raise_failure()
        self._write(state_record(state))

    def close(self) -> None:
        """Write the last image as a whole, and end the file."""
        self._raise_failure()
        self._write(Record("close", arrays={} if self._last is None else {"image": self._last}))
        self._stop()

    def _around(
        self, run: Callable[[], _Made], record: Callable[[], Record], result_of: Callable[[_Made], StepResult]
    ) -> _Made:
        self._raise_failure()
        if self._writer is None:
            return run()
        begin = self._writer.end
        self._write(record())
        try:
            made = run()
        except BaseException as error:
            if isinstance(error, ArgumentError) or not isinstance(error, Exception):
                self._writer.cut(begin)
            else:
                self._close_step(begin, raised(error))
            raise
        result = result_of(made)
        self._close_step(begin, returned(self._steps, result))
        if self._last is None or self._last.shape != result.image.shape:
            self._last = np.empty_like(result.image)
        np.copyto(self._last, result.image)
        return made

    def _close_step(self, begin: int, outcome: Outcome) -> None:
        """Record what came of a step. It has been made: where that fails, the next call raises."""
        self._steps += 1
        try:
            self._write(outcome_record(outcome), keep=begin)
        except RecordingError as error:
            self._failure = error

    def _write(self, record: Record, keep: int | None = None) -> None:
        """Append a record, or end the recording: as it was before, or after `keep` bytes."""
        if self._writer is None:
            return
        try:
            self._writer.write(record)
        except RecordingError:
            if keep is not None:
                self._writer.cut(keep)
            self._stop()
            raise

    def _raise_failure(self) -> None:
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    def _stop(self) -> None:
        if self._writer is not None:
            self._writer.close()
        self._writer = self._last = None


def _as_result(made: Float32 | StepResult) -> StepResult:
    return made if isinstance(made, StepResult) else StepResult(made)


def setup_here(
    model: "Model",
    extrapolation: Sequence[ModelInfo],
    *,
    display_size: Size | None,
    scale: float,
    skip: "Skip",
    validate: Literal["off", "warn", "strict"],
) -> Setup:
    """Return how an Upscaler is made, with all that its pictures depend on.

    Args:
        model: of the Upscaler.
        extrapolation: of the one model that draws frames that were not shaded, if any.
        display_size: see `Setup`, as what follows.
        scale: see there.
        skip: see there.
        validate: see there.
    """
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
    """Return the versions of this package, Python and the packages that pictures depend on."""
    own = {"supersampler": __version__, "Python": platform.python_version()}
    return own | installed_versions(*_PACKAGES)
