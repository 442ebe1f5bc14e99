"""`Upscaler`: a Model and the history of one view. One per camera; frames go in one after the other."""

import time
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, overload

from supersampler.arguments import checked_names, checked_path, checked_scale, checked_size
from supersampler.backends.onnx.tensors import Tensor, checked_tensors, size_of_tensors, tensors_of_frame
from supersampler.conventions.ratios import display_size_of
from supersampler.errors import ArgumentError, shown
from supersampler.extrapolation import Extrapolation, ShadedHistory
from supersampler.frame import Float32, Frame, Size, checked_frame, checked_reset
from supersampler.history import Stats, StepResult
from supersampler.methods.gbuffers import GBUFFERS, black
from supersampler.model import ExecutorName, Model, Precision, Skip
from supersampler.planning import plan
from supersampler.presets import PresetName, chosen, loaded_model
from supersampler.state import Memory, State
from supersampler.validation import FrameChecker, Validate

if TYPE_CHECKING:
    from supersampler.recording.recorder import Recorder


class Upscaler:
    """Turns the frames of one camera, in order, into clean frames at display size.

    >>> upscaler = Upscaler(display_size=(1920, 1080))
    >>> for frame in shot:
    ...     image = upscaler.step(frame)  # (1080, 1920, 3) float32, linear RGB

    Not for use from two threads at once; several Upscalers may share one Model and step in parallel.

    Args:
        model: a `Model`, the name of a shipped one, or a model folder; "classifier" where None.
        display_size: (width, height) of the images.
        scale: instead of `display_size`: display size over the first frame's render size, rounded to pixels.
        render_size: (width, height) that frames will have; only `warm_up` needs it, and with `scale` it
            fixes the display size before the first frame. Frames of other sizes are taken too.
        providers: see `Model.load`; not with a `Model`.
        threads, precision, capture: see `Model.load`; not with a `Model`.
        executor: see `Model.load`; "auto" with a `Model`. "onnx" runs extrapolation in ONNX Runtime, too.
        skip: the tolerance of static-tile reuse. Where nothing moves and each frame is, bit for bit, what it
            was one period of the jitter before, a tile is not computed: its image fades to the mean of the
            samples of a period, and then is a copy. With a number, tiles settle before their period is whole
            once the estimated error of the mean is at most this: root mean square of display values, in
            [0, 1]. "auto" is half a step of an 8-bit image; "exact" computes every pixel by the method, as
            the ONNX backend always does.
        preset: "fast", "balanced" or "high" in place of `model`, `precision` and `skip`: settings that no
            other beats in both time and error (docs/pareto.md).
        extrapolation: a model that computes the colour of frames that were not shaded, for `extrapolate`:
            "guided-warp", "guided-flow", or a model folder. It runs as `model` does, and so does the model
            that `model` has for extrapolated frames, if any. None keeps nothing for it.
        validate: "warn" reads the pixels of the first frames after a start or reset and warns with a guess at
            the mistake, "strict" reads every frame and raises, "off" checks shapes alone.
        record: a new folder to record all calls to, for `supersampler replay`; `close` ends it.

    Attributes:
        model: in use.
        skip: the tolerance of static-tile reuse, as given.
        gbuffers: names of the G-buffers that are read of frames, as `ModelInfo.gbuffers` has them.

    Raises:
        ArgumentError: sizes are missing, or arguments contradict each other.
        ModelError, ProviderError: see `Model.load`.
        RecordingError: the folder to record to is there already, or cannot be written. Any call may raise it
            before anything is done; later calls are then not recorded.
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
        skip: Skip = "auto",
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
        self._checker = FrameChecker(validate)
        record = None if record is None else checked_path("record", record)
        model, precision, self.skip = chosen(preset, model, precision, skip)
        self.model = loaded_model(model, providers, threads, executor, precision, capture=capture)
        if self._render_size is not None and display_size is None:
            display_size = display_size_of(self._render_size, self._scale)
        self._memory = Memory(display_size)
        self._extrapolation = Extrapolation(extrapolation, self.model.providers, self.model.threads, executor)
        self._on_extrapolated = self.model.on_extrapolated if self._extrapolation.infos else self.model
        infos = (self.model.info, self._on_extrapolated.info, *self._extrapolation.infos)
        inputs = list(dict.fromkeys(tensor.name for info in infos for tensor in info.inputs))
        self.gbuffers = tuple(name for name in inputs if name in GBUFFERS)
        self._closed = False
        self._recorder: Recorder | None = None
        if record is not None:  # imports image files, which a session without a recording does not need
            from supersampler.recording import recorder
            from supersampler.recording.setup import setup_here

            made = {"display_size": display_size, "scale": self._scale, "skip": self.skip}
            setup = setup_here(self.model, self._extrapolation.infos, **made, validate=validate)
            self._recorder = recorder.Recorder(record, setup, inputs)

    plan = staticmethod(plan)

    @property
    def display_size(self) -> Size | None:
        """(width, height) of the images; with `scale` None until the first frame."""
        return self._memory.display_size

    @property
    def stats(self) -> Stats:
        """What has been done."""
        return self._memory.stats

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., outputs: tuple[()] = ...) -> Float32: ...

    @overload
    def step(
        self, frame: Frame, *, out: Float32 | None = ..., outputs: tuple[str, *tuple[str, ...]]
    ) -> StepResult: ...

    @overload
    def step(
        self, frame: Frame, *, out: Float32 | None = ..., outputs: Collection[str]
    ) -> Float32 | StepResult: ...

    def step(
        self, frame: Frame, *, out: Float32 | None = None, outputs: Collection[str] = ()
    ) -> Float32 | StepResult:
        """Upscale the next frame.

        Args:
            frame: see `Frame`. Its render size may differ from the frame before; the history is kept.
            out: (H, W, 3) float32 to write the image to.
            outputs: names of what else to return: "aovs", and maps that explain the image: "class_map",
                "weight", "count", "work", as far as the method has them. What is not named costs nothing.
                Blending of AOVs starts anew where the previous frame was stepped without "aovs"; with it, no
                tile is reused.

        Returns:
            (H, W, 3) float32 linear RGB, finite and >= 0, in the units of `frame.color`; `out` if given.
            Where `outputs` names something, a `StepResult` with it as `image`.

        Raises:
            FrameError: the frame breaks the contract. The history is as before; go on with the next frame.
            ArgumentError: `out` has the wrong shape or type, or the method has none of that name.
        """
        outputs = self._checked_call(frame, outputs)
        if self._recorder is None:
            return self._step(frame, out, outputs)
        return self._recorder.step(frame, outputs, partial(self._step, frame, out, outputs))

    @overload
    def extrapolate(
        self, frame: Frame, *, out: Float32 | None = ..., outputs: tuple[()] = ...
    ) -> Float32: ...

    @overload
    def extrapolate(
        self, frame: Frame, *, out: Float32 | None = ..., outputs: tuple[str, *tuple[str, ...]]
    ) -> StepResult: ...

    @overload
    def extrapolate(
        self, frame: Frame, *, out: Float32 | None = ..., outputs: Collection[str]
    ) -> Float32 | StepResult: ...

    def extrapolate(
        self, frame: Frame, *, out: Float32 | None = None, outputs: Collection[str] = ()
    ) -> Float32 | StepResult:
        """Upscale the next frame, which was not shaded: its colour is extrapolated from the last shaded one.

        Shaded and unshaded frames may alternate in any way. `step` takes the shaded ones, which need the
        G-buffers that the extrapolation reads, too. Motion leads to the previous frame, of either kind.

        >>> upscaler = Upscaler(display_size=(1920, 1080), extrapolation="guided-warp")
        >>> image = upscaler.step(shaded) if is_shaded else upscaler.extrapolate(without_color)

        Args:
            frame: without colour, with the G-buffers that the extrapolation and the method read.
            out: see `step`.
            outputs: see `step`.

        Returns:
            As `step`.

        Raises:
            FrameError: as `step`; or the frame has colour, or is the first after a start, a reset or a cut.
            ArgumentError: as `step`; or the Upscaler was made without `extrapolation`.
        """
        outputs = self._checked_call(frame, outputs)
        run = partial(self._extrapolate, frame, out, outputs)
        if self._recorder is None:
            return run()
        return self._recorder.step(frame, outputs, run, extrapolated=True)

    def step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        reset: bool = False,
        out: Tensor | None = None,
    ) -> Tensor:
        """Upscale the next frame on the provider's device; no image is copied to or from the CPU.

        >>> image = upscaler.step_tensors({"color": c, "depth": d, "motion": m}, jitter=(x, y))
        >>> image = torch.from_dlpack(image)

        For executor="onnx", and without `extrapolation`. Pixels are not read and checked as `step` does.

        Args:
            tensors: of the method's inputs, by name: float32, contiguous, in the shapes of docs/contract.md:
                "color" (1, 3, h, w), "depth" (1, 1, h, w), "motion" (1, 2, h, w), and the G-buffers that the
                method asks for. Anything that speaks DLPack (torch, CuPy, JAX).
            jitter: see `Frame`.
            exposure: see `Frame`.
            reset: see `Frame`.
            out: (1, 3, H, W) to write the image to; a new tensor where None.

        Returns:
            (1, 3, H, W) linear RGB on the device; `out` if given.

        Raises:
            FrameError: a tensor is missing, or its type, shape or device does not fit. The history is as
                before.
            ModelError: the provider cannot capture the step, with `capture`; likewise.
            ArgumentError: the executor takes no tensors, or the Upscaler was made with `extrapolation`.
        """
        self._check_open()
        tensors, reset = checked_tensors(tensors), checked_reset(reset)
        run = partial(self._step_tensors, tensors, jitter, exposure, reset, out)
        if self._recorder is None:
            return run()
        return self._recorder.step_tensors(tensors, jitter, exposure, reset, run)

    def reset(self) -> None:
        """Drop the history, as `Frame.reset` does."""
        self._check_open()
        if self._recorder is not None:
            self._recorder.reset()
        self._memory = self._memory._replace(history=None, shaded=None)
        self._checker.reset()

    def warm_up(self, render_size: Size | None = None) -> None:
        """Run once on a black frame, so that the first `step` pays for no start-up; the history is untouched.

        With `capture` this captures: call it on the thread that will step, as ONNX Runtime keeps CUDA graphs
        by thread.

        Raises:
            ArgumentError: `render_size` was given neither here nor to the constructor.
        """
        self._check_open()
        size = checked_size("render_size", self._render_size if render_size is None else render_size)
        display_size = self.display_size or display_size_of(size, self._scale)
        frame = black(self.gbuffers, size, display_size)
        self._extrapolation.warm_up(frame)
        history = self.model.first_history(display_size, size)
        self.model.run(frame, history)
        if self._on_extrapolated is not self.model:
            self._on_extrapolated.run(frame, history)
        if self.model.capture:
            tensors = tensors_of_frame(frame, self.model.device)
            self.model.run_tensors(tensors, history, jitter=frame.jitter)

    def save_state(self) -> State:
        """Copy the history; an Upscaler that loads it continues bit for bit as this one does."""
        self._check_open()
        history = self._memory.history
        if history is None:
            return State(self.model.info.method, self.display_size, None, None)
        saved = self.model.save_history(history), self._extrapolation.save(self._memory.shaded)
        return State(self.model.info.method, history.display_size, history.render_size, *saved)

    def load_state(self, state: State) -> None:
        """Continue from `state`; where it has nothing to extrapolate from, shade a frame first.

        Raises:
            ArgumentError: it is of another method, extrapolation or display size; the history stays as is.
        """
        self._check_open()
        if not isinstance(state, State):
            raise ArgumentError("state", got=shown(state), want="a State, as `save_state` returns it")
        history = state.history_for(self.model, self.display_size)
        shaded = self._extrapolation.load(state.shaded)
        if self._recorder is not None:
            self._recorder.load_state(state)
        self._memory = Memory(state.display_size, history, None, shaded, self.stats)
        self._checker.reset()

    def close(self) -> None:
        """Free the history, and end the recording; all but `close` raise ArgumentError afterwards."""
        self._memory = Memory(self.display_size, stats=self.stats)
        self._closed = True
        if self._recorder is not None:
            self._recorder.close()

    def __enter__(self) -> "Upscaler":
        self._check_open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _step(self, frame: Frame, out: Float32 | None, outputs: Collection[str]) -> Float32 | StepResult:
        before = self._memory.shaded
        shaded = None if frame.color is None else self._extrapolation.after_shaded(frame, before)
        return self._upscaled(self.model, frame, frame, shaded, out, outputs)

    def _extrapolate(
        self, frame: Frame, out: Float32 | None, outputs: Collection[str]
    ) -> Float32 | StepResult:
        started = time.perf_counter()
        shaded_frame, shaded = self._extrapolation.extrapolate(frame, self._memory.shaded)
        took = time.perf_counter() - started
        return self._upscaled(self._on_extrapolated, frame, shaded_frame, shaded, out, outputs, took)

    def _upscaled(
        self,
        model: Model,
        given: Frame,
        frame: Frame,
        shaded: ShadedHistory | None,
        out: Float32 | None,
        outputs: Collection[str],
        extrapolation_seconds: float | None = None,
    ) -> Float32 | StepResult:
        """Step on a frame that has colour, as it was `given` or extrapolated."""
        started, memory = time.perf_counter(), self._memory
        kept = None if frame.reset else memory.history
        display = memory.display_size or display_size_of(frame.size, self._scale)
        # first: no frame is remembered, and no memory taken for one, that is then refused
        model.check(frame, display, outputs, None if kept is None else kept.aovs, out)
        self._checker.check(given, display, self.gbuffers)
        history = model.first_history(display, frame.size) if kept is None else kept
        result, next_history = model.run_checked(
            frame, history, outputs, out=out, history_out=memory.spare, skip=self.skip
        )
        stats = memory.stats.after_step(
            fresh=kept is None,
            work=float(model.work(next_history).mean()),
            converged=model.converged(next_history),
            seconds=time.perf_counter() - started,
            extrapolation_seconds=extrapolation_seconds,
        )
        self._memory = Memory(display, next_history, history, shaded, stats)
        return result if outputs else result.image

    def _step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        jitter: tuple[float, float],
        exposure: float | None,
        reset: bool,
        out: Tensor | None,
    ) -> Tensor:
        started, memory = time.perf_counter(), self._memory
        if self._extrapolation.infos:
            hint = "Extrapolation takes arrays alone: use `step`."
            raise ArgumentError("step_tensors", got="called with extrapolation", want="neither", hint=hint)
        size, kept = size_of_tensors(tensors), None if reset else memory.history
        display = memory.display_size or display_size_of(size, self._scale)
        history = self.model.first_history(display, size) if kept is None else kept
        image, next_history = self.model.run_tensors(
            tensors, history, jitter=jitter, exposure=exposure, out=out, history_out=memory.spare
        )
        stats = memory.stats.after_step(
            fresh=kept is None, work=1.0, converged=0.0, seconds=time.perf_counter() - started
        )
        self._memory = Memory(display, next_history, history, None, stats)
        return image

    def _check_open(self) -> None:
        if self._closed:
            raise ArgumentError("upscaler", got="closed", want="open", hint="Make a new one.")

    def _checked_call(self, frame: Frame, outputs: Collection[str]) -> tuple[str, ...]:
        """Return `outputs`, once it is known that the call may be made, and recorded."""
        self._check_open()
        checked_frame(frame)
        return checked_names("outputs", outputs)
