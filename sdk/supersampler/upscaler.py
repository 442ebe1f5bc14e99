"""`Upscaler`: a `Model` and the history of one camera."""

import time
from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, NoReturn, overload

from supersampler.arguments import (
    checked_at_rest,
    checked_names,
    checked_path,
    checked_scale,
    checked_size,
    checked_skip,
    ieee_arithmetic,
)
from supersampler.backends.onnx.tensors import tensors_of_frame
from supersampler.conventions.jitter import display_size_of
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.extrapolation import Extrapolator, ShadedHistory
from supersampler.frame import Float32, Frame, Size, checked_frame
from supersampler.history import Stats, StepResult
from supersampler.methods.at_rest import ADDED
from supersampler.methods.gbuffers import GBUFFERS, black
from supersampler.model import AtRest, ExecutorName, Model, Precision
from supersampler.on_device.steps import DeviceSteps
from supersampler.planning import plan
from supersampler.presets import PresetName, chosen, loaded_model
from supersampler.state import Memory, State
from supersampler.validation import FrameChecker, Validate

if TYPE_CHECKING:
    from supersampler.recording.recorder import Recorder


_Names = tuple[str, *tuple[str, ...]]
"""At least one name, so that the type of the result is known."""
_Out = Float32 | StepResult


class Upscaler(DeviceSteps):
    """Upscales the frames of one camera, in order, to anti-aliased images at display size.

    >>> upscaler = Upscaler(display_size=(1920, 1080))
    >>> for frame in shot:
    ...     image = upscaler.step(frame)  # (1080, 1920, 3) float32, linear RGB

    Two threads must not use it at once; several Upscalers may share one Model and step in parallel.

    Args:
        model: a `Model`, the name of a shipped one, or a model folder; None is "classifier".
        display_size: (width, height) of the images.
        scale: instead of `display_size`: display size over the first frame's render size, rounded to pixels.
        render_size: (width, height) of the frames. Only `warm_up` needs it; with `scale` it fixes the display
            size before the first frame. Frames may have other sizes.
        providers, threads, precision, capture: see `Model.load`; not with a `Model`.
        executor: see `Model.load`; "auto" with a `Model`. "onnx" runs extrapolation in ONNX Runtime, too.
        at_rest: "converge": where nothing moves or changes, the image becomes the mean of one jitter period
            of samples, and is then frozen. "accumulate" is for path tracers: where only noise changes, all
            samples are averaged without end. "off": images depend on recent frames only, as chunks of a shot
            need. Methods without a history of this kind do the last.
        skip: whether tiles whose image is frozen may be left out, as the CPU and the GPU backend do. The
            images are the same, bit for bit.
        preset: "fast", "balanced" or "high" in place of `model` and `precision`: Pareto-optimal settings of
            time and error (docs/pareto.md).
        extrapolation: model for `extrapolate`, which computes the colour of unshaded frames: "guided-warp",
            "guided-flow", or a model folder. It uses the providers and threads of `model`. None disables
            `extrapolate`.
        validate: "warn" checks the pixels of the first frames after a start or reset and warns of likely
            mistakes, "strict" checks every frame and raises, "off" checks only shapes and types.
        record: a new folder, to which all calls are recorded for `supersampler replay` until `close`.

    Attributes:
        model: the model in use.
        at_rest, skip: as given.
        gbuffers: names of the G-buffers that frames must have; see `ModelInfo.gbuffers`.

    Raises:
        ArgumentError: sizes are missing, or arguments contradict each other.
        ModelError, ProviderError: see `Model.load`.
        RecordingError: the folder exists already or cannot be written. Any call may raise it, before it
            changes anything; later calls are not recorded then.
    """

    def __init__(
        self,
        model: Model | str | Path | None = None,
        *,
        display_size: Size | None = None,
        scale: float | None = None,
        render_size: Size | None = None,
        providers: str | Sequence[str] = "auto",
        threads: int = 0,
        executor: ExecutorName = "auto",
        precision: Precision = "auto",
        capture: bool = False,
        at_rest: AtRest = "converge",
        skip: bool = True,
        preset: PresetName | None = None,
        extrapolation: str | Path | None = None,
        validate: Validate = "warn",
        record: str | Path | None = None,
    ) -> None:
        if (display_size is None) == (scale is None):
            got = "neither" if scale is None else "both"
            raise ArgumentError("display_size or scale", got=got, want="one of the two")
        display_size = None if display_size is None else checked_size("display_size", display_size)
        self._scale = 1.0 if scale is None else checked_scale(scale)
        self._render_size = None if render_size is None else checked_size("render_size", render_size)
        record = None if record is None else checked_path("record", record)
        self.at_rest, self.skip = checked_at_rest(at_rest), checked_skip(skip)
        model, precision = chosen(preset, model, precision)
        self.model = loaded_model(model, providers, threads, executor, precision, capture=capture)
        if self._render_size is not None and display_size is None:
            display_size = display_size_of(self._render_size, self._scale)
        self._memory = Memory(display_size)
        self._checker = FrameChecker(validate, converges=self.model.info.converges)
        self._extrapolator, self._on_extrapolated, infos = None, self.model, []
        if extrapolation is not None:
            device = self.model.providers, self.model.threads
            self._extrapolator = Extrapolator(extrapolation, *device, executor)
            self._on_extrapolated, infos = self.model.on_extrapolated, [self._extrapolator.info]
        read = (self.model.info, self._on_extrapolated.info, *infos)
        inputs = list(dict.fromkeys(tensor.name for info in read for tensor in info.inputs))
        self.gbuffers = tuple(name for name in inputs if name in GBUFFERS)
        self._closed = False
        self._recorder: Recorder | None = None
        if record is not None:  # imports image files, which a session without a recording does not need
            from supersampler.recording import recorder

            self._recorder = recorder.Recorder(
                record, self.model, infos, inputs, display_size=display_size, scale=self._scale,
                at_rest=self.at_rest, skip=self.skip, validate=validate,
            )  # fmt: skip

    plan = staticmethod(plan)

    @property
    def display_size(self) -> Size | None:
        """(width, height) of the images; with `scale` None until the first frame."""
        return self._memory.display_size

    @property
    def stats(self) -> Stats:
        """Counts and times of all steps so far."""
        stats = self._memory.stats
        return stats if self._closed else replace(stats, converged=self.model.converged(self._memory.history))

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., outputs: tuple[()] = ()) -> Float32: ...

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., outputs: _Names) -> StepResult: ...

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., outputs: Collection[str]) -> _Out: ...

    @ieee_arithmetic
    def step(self, frame: Frame, *, out: Float32 | None = None, outputs: Collection[str] = ()) -> _Out:
        """Upscale the next frame.

        Args:
            frame: see `Frame`. Its render size may differ from that of the previous frame; the history stays.
            out: (H, W, 3) float32 to write the image to.
            outputs: names of further outputs: "aovs", "class_map", "weight", "count", "converged";
                see `StepResult`. A method may lack some. Others than those named cost nothing. With "aovs"
                no tile is left out; after a frame without "aovs" it starts without AOV history.

        Returns:
            (H, W, 3) float32 linear RGB, finite and >= 0, in the units of `frame.color`; `out` if given.
            With `outputs`, a `StepResult` that holds it as `image`.

        Raises:
            FrameError: the frame breaks the contract. The history is unchanged; continue with the next frame.
            ArgumentError: `out` has a wrong shape or type, or the method has no such output.
        """
        outputs = self._checked_call(frame, outputs)
        with self._recorded("step", frame, outputs) as results:
            shaded = None
            if self._extrapolator is not None and frame.color is not None:
                shaded = self._extrapolator.after_shaded(frame, self._memory.shaded)
            results.append(self._upscaled(self.model, frame, frame, shaded, out, outputs))
        return results[0] if outputs else results[0].image

    @overload
    def extrapolate(
        self, frame: Frame, *, out: Float32 | None = ..., outputs: tuple[()] = ...
    ) -> Float32: ...

    @overload
    def extrapolate(self, frame: Frame, *, out: Float32 | None = ..., outputs: _Names) -> StepResult: ...

    @overload
    def extrapolate(self, frame: Frame, *, out: Float32 | None = ..., outputs: Collection[str]) -> _Out: ...

    @ieee_arithmetic
    def extrapolate(self, frame: Frame, *, out: Float32 | None = None, outputs: Collection[str] = ()) -> _Out:
        """Upscale the next frame, which was not shaded: its colour comes from the last shaded frame.

        Shaded and unshaded frames may alternate in any order. `step` upscales the shaded ones, which must
        have the G-buffers of the extrapolation, too. Motion points to the previous frame, shaded or not. The
        jitter counts shaded frames: `halton_jitter(index // 2, ratio)` where every second one is shaded.

        >>> upscaler = Upscaler(display_size=(1920, 1080), extrapolation="guided-warp")
        >>> image = upscaler.step(shaded) if is_shaded else upscaler.extrapolate(without_color)

        The frame has no colour, and the G-buffers of the extrapolation and of the method. Otherwise arguments
        and result are those of `step`.

        Raises:
            FrameError: as `step`; or the frame has colour, or is the first after a start or a reset.
            ArgumentError: as `step`; or the Upscaler has no `extrapolation`.
        """
        outputs = self._checked_call(frame, outputs)
        with self._recorded("extrapolate", frame, outputs) as results:
            if self._extrapolator is None:
                hint = "Upscaler(extrapolation='guided-warp') takes frames that were not shaded."
                raise ArgumentError("extrapolation", got=None, want="a model", hint=hint)
            started = time.perf_counter()
            color, shaded = self._extrapolator.extrapolate(frame, self._memory.shaded)
            took = time.perf_counter() - started
            model, shaded_frame = self._on_extrapolated, replace(frame, color=color)
            results.append(self._upscaled(model, frame, shaded_frame, shaded, out, outputs, took))
        return results[0] if outputs else results[0].image

    @ieee_arithmetic
    def step_computed(self, frame: Frame, color: Float32, *, outputs: Collection[str] = ()) -> _Out:
        """Upscale the next frame, which was not shaded, with a colour that was computed elsewhere.

        As after `extrapolate`, the mean of a static pixel's samples does not take it for a sample. It cannot
        be recorded.

        Args:
            frame: the frame, without colour.
            color: (h, w, 3) float32 linear RGB.
            outputs: see `step`.

        Raises:
            FrameError: as `step`; or the frame has colour.
            ArgumentError: as `step`; or the calls are recorded.
        """
        outputs = self._checked_call(frame, outputs)
        if self._recorder is not None:
            raise ArgumentError("record", got="given", want="None, as computed colours are not recorded")
        if frame.color is not None:
            hint = "`step` takes shaded frames."
            raise FrameError("color", got=frame.color.shape, want="None, as it is computed", hint=hint)
        shaded_frame = replace(frame, color=color)
        model = self.model.on_extrapolated
        result = self._upscaled(model, frame, shaded_frame, self._memory.shaded, None, outputs)
        return result if outputs else result.image

    def reset(self) -> None:
        """Drop the history, as `Frame.reset` does."""
        self._check_open()
        if self._recorder is not None:
            self._recorder.reset()
        self._memory = self._memory._replace(history=None, shaded=None)
        self._checker.reset()

    @ieee_arithmetic
    def warm_up(self, render_size: Size | None = None) -> None:
        """Run once on a black frame, so that the first `step` is fast; the history is unchanged.

        With `capture`, call it on the thread that will step: ONNX Runtime keeps CUDA graphs per thread.

        Raises:
            ArgumentError: `render_size` is missing here and in the constructor.
        """
        self._check_open()
        size = checked_size("render_size", self._render_size if render_size is None else render_size)
        display_size = self.display_size or display_size_of(size, self._scale)
        frame = black(self.gbuffers, size, display_size)
        if self._extrapolator is not None:
            self._extrapolator.extrapolate(replace(frame, color=None), self._extrapolator.after_shaded(frame))
        history = self.model.first_history(display_size, size)
        self.model.run(frame, history)
        if self._on_extrapolated is not self.model:
            self._on_extrapolated.run(frame, history)
        if self.model.capture:
            tensors = tensors_of_frame(frame, self.model.device)
            self.model.run_tensors(tensors, history, jitter=frame.jitter)

    def save_state(self) -> State:
        """Copy the history. An Upscaler that loads it computes the same next images, bit for bit."""
        self._check_open()
        history, shaded = self._memory.history, self._memory.shaded
        if history is None:
            return State(self.model.info.method, self.display_size, None, None)
        saved_shaded = None
        if self._extrapolator is not None and shaded is not None:
            saved_shaded = self._extrapolator.save(shaded)
        sizes = history.display_size, history.render_size
        return State(self.model.info.method, *sizes, self.model.save_history(history), saved_shaded)

    def load_state(self, state: State) -> None:
        """Continue from `state`. If it holds no shaded frame, a shaded one must precede `extrapolate`.

        Raises:
            ArgumentError: the state has another method, extrapolation or display size. The history is
                unchanged.
        """
        self._check_open()
        if not isinstance(state, State):
            raise ArgumentError("state", got=shown(state), want="a State, as `save_state` returns it")
        history = state.history_for(self.model, self.display_size)
        shaded = None
        if self._extrapolator is not None and state.shaded is not None:
            shaded = self._extrapolator.load(state.shaded)
        if self._recorder is not None:
            self._recorder.load_state(state)
        self._memory = Memory(state.display_size, history, None, shaded, self.stats)
        self._checker.reset()

    def close(self) -> None:
        """Free the history and end the recording; later calls other than `close` raise ArgumentError."""
        self._memory = Memory(self.display_size, stats=self.stats)
        self._closed = True
        if self._recorder is not None:
            self._recorder.close()

    def __reduce__(self) -> NoReturn:
        """Refuse copies and pickles: two Upscalers must not share one history."""
        hint = "Make a new Upscaler, and give it the history: `new.load_state(old.save_state())`."
        raise ArgumentError("upscaler", got="to be copied or pickled", want="one of its own", hint=hint)

    def __enter__(self) -> "Upscaler":
        self._check_open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _recorded(
        self, call: str, frame: Frame, outputs: tuple[str, ...]
    ) -> AbstractContextManager[list[StepResult]]:
        """Record the step of a `with` block, which appends its result to the list, if there is a recorder."""
        return nullcontext([]) if self._recorder is None else self._recorder.step(call, frame, outputs)

    def _upscaled(
        self,
        model: Model,
        given: Frame,
        frame: Frame,
        shaded: ShadedHistory | None,
        out: Float32 | None,
        outputs: Collection[str],
        extrapolation_seconds: float | None = None,
    ) -> StepResult:
        """Step on `frame`, which has colour: `given`, or its extrapolation."""
        started, memory = time.perf_counter(), self._memory
        kept = None if frame.reset else memory.history
        display = memory.display_size or display_size_of(frame.size, self._scale)
        # before anything is allocated or kept for a frame that is then refused
        model.check(frame, display, outputs, None if kept is None else kept.aovs, out)
        self._checker.check(given, display, self.gbuffers)
        history = model.first_history(display, frame.size) if kept is None else kept
        result, next_history = model.run_checked(
            frame, history, outputs, out=out, history_out=memory.spare, skip=self.skip,
            adds_samples=0.0 if given.color is None else ADDED[self.at_rest],
        )  # fmt: skip
        stats = memory.stats.after_step(
            fresh=kept is None,
            seconds=time.perf_counter() - started,
            extrapolation_seconds=extrapolation_seconds,
        )
        self._memory = Memory(display, next_history, history, shaded, stats)
        return result

    def _checked_call(self, frame: Frame, outputs: Collection[str]) -> tuple[str, ...]:
        """Check the arguments that a recording stores; return the names of the outputs."""
        self._check_open()
        checked_frame(frame)
        return checked_names("outputs", outputs)
