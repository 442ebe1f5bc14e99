"""`Upscaler`: a Model and the history of one view. One per camera; frames go in one after the other."""

import time
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Literal, overload

from supersampler.checks import FrameChecker
from supersampler.errors import ArgumentError, FrameError
from supersampler.frame import Float32, Frame, Size
from supersampler.gbuffers import black
from supersampler.history import History, Result
from supersampler.model import ExecutorName, Model, Precision, Skip
from supersampler.plan import Plan
from supersampler.presets import PresetName, chosen
from supersampler.recording.calls import Setup
from supersampler.recording.recorder import Recorder, setup_here
from supersampler.recording.tensors import tensors_of_frame
from supersampler.state import State
from supersampler.stats import Stats
from supersampler.tensors import Tensor, render_size_of, taken


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
        threads, executor, precision, capture: see `Model.load`; not with a `Model`.
        skip: a number leaves those tiles of the image as they are in which the scene stands still (nothing
            moves, and each frame is, bit for bit, what it was one period of the jitter before) and their
            pixels have changed by no more than this in that period, root mean square of what a screen shows,
            in [0, 1]. A frame without other tiles is a copy. "auto" is half a step of an 8-bit picture;
            "exact" draws every pixel, as graphs always do.
        preset: "fast", "balanced" or "high" in place of `model`, `precision` and `skip`: settings that no
            other beats in both time and error (docs/pareto.md).
        validate: "warn" reads the pixels of the first frames after a start or reset and warns with a guess at
            the mistake, "strict" reads every frame and raises, "off" checks shapes alone.
        record: a new file to record all calls to, for `supersampler replay`; `close` ends it.

    Attributes:
        model: in use.
        skip: how far tiles are left as they are.
        stats: what has been done.

    Raises:
        ArgumentError: sizes are missing, or arguments contradict each other.
        ModelError, ProviderError: see `Model.load`.
        RecordingError: the file to record to is there already, or cannot be written. Any call may raise it
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
        validate: Literal["off", "warn", "strict"] = "warn",
        record: str | Path | None = None,
    ) -> None:
        if (display_size is None) == (scale is None):
            got = "neither" if scale is None else "both"
            raise ArgumentError("display_size or scale", got=got, want="one of the two")
        self._display_size = None if display_size is None else _checked_size("display_size", display_size)
        self._scale = 1.0 if scale is None else _checked_scale(scale)
        self._render_size = None if render_size is None else _checked_size("render_size", render_size)
        self._checker = FrameChecker(validate)
        model, precision, skip = chosen(preset, model, precision, skip)
        self.skip = _checked_skip(skip)
        if isinstance(model, Model):
            if threads or capture or (providers, executor, precision) != ("auto",) * 3:
                name = "providers, threads, executor, precision or capture"
                raise ArgumentError(name, got="set beside a Model", want="set in Model.load")
            self.model = model
        else:
            self.model = Model.load(
                model,
                providers=providers,
                threads=threads,
                executor=executor,
                precision=precision,
                capture=capture,
            )
        if self._render_size is not None and self._display_size is None:
            self._display_size = self._scaled(self._render_size)
        self._history: History | None = None
        self._spare: History | None = None
        self._closed = False
        self.stats = Stats()
        inputs = [tensor.name for tensor in self.model.info.inputs]
        self._recorder = None if record is None else Recorder(record, self._setup(), inputs)

    @staticmethod
    def plan(
        render_size: Size,
        display_size: Size,
        model: str | Path = "classifier",
        *,
        providers: str | Sequence[str] = "auto",
        threads: int = 0,
        executor: ExecutorName = "auto",
        precision: Precision = "auto",
    ) -> Plan:
        """Return what an Upscaler will need: bytes of history, of working memory, and multiply-adds.

        >>> plan = Upscaler.plan((960, 540), (1920, 1080))  # render size, display size
        >>> megabytes = plan.history_bytes / 1e6

        Args:
            render_size: (width, height) of the frames.
            display_size: (width, height) of the images.
            model: see the constructor; a `Model` has a `plan` of its own.
            providers: see `Model.load`.
            threads: see `Model.load`.
            executor: see `Model.load`.
            precision: see `Model.load`.

        Raises:
            FrameError: the method does not upscale by that much.
            ModelError, ProviderError, ArgumentError: see `Model.load`.
        """
        loaded = Model.load(
            model, providers=providers, threads=threads, executor=executor, precision=precision
        )
        return loaded.plan(
            _checked_size("render_size", render_size), _checked_size("display_size", display_size)
        )

    @property
    def display_size(self) -> Size | None:
        """(width, height) of the images; with `scale` None until the first frame."""
        return self._display_size

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., want: tuple[()] = ...) -> Float32: ...

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., want: Collection[str]) -> Float32 | Result: ...

    def step(
        self, frame: Frame, *, out: Float32 | None = None, want: Collection[str] = ()
    ) -> Float32 | Result:
        """Upscale the next frame.

        Args:
            frame: see `Frame`. Its render size may differ from the frame before; the history is kept.
            out: (H, W, 3) float32 to write the image to.
            want: what else to return: "carry", and what tells why the image is as it is, "class_map",
                "weight", "count", "work", as far as the method knows it. What is not named costs nothing.
                What frames carry along must be asked for from one frame to the next, or begins anew, and
                while it is, nothing is skipped.

        Returns:
            (H, W, 3) float32 linear RGB, finite and >= 0, in the units of `frame.color`; `out` if given.
            Where `want` names something, a `Result` with it as `image`.

        Raises:
            FrameError: the frame breaks the contract. The history is as before; go on with the next frame.
            ArgumentError: `out` has the wrong shape or type, or the method does not know what `want` names.
        """
        if self._recorder is None:
            return self._step(frame, out, want)
        return self._recorder.step(frame, want, partial(self._step, frame, out, want))

    def step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        reset: bool = False,
        out: Tensor | None = None,
    ) -> Tensor:
        """Upscale the next frame where it lies, on the provider's device: no image goes to or from the host.

        >>> image = upscaler.step_tensors({"color": c, "depth": d, "motion": m}, jitter=(x, y))
        >>> image = torch.from_dlpack(image)

        For executor="graph". Pixels are not read and checked as `step` does.

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
            ArgumentError: the executor takes no tensors.
        """
        run = partial(self._step_tensors, tensors, jitter, exposure, reset, out)
        if self._recorder is None:
            return run()
        return self._recorder.step_tensors(tensors, jitter, exposure, reset, run)

    def reset(self) -> None:
        """Forget the past, as `Frame.reset` does."""
        if self._recorder is not None:
            self._recorder.reset()
        self._history = None
        self._checker.reset()

    def warm_up(self, render_size: Size | None = None) -> None:
        """Run once on a black frame, so that the first `step` pays for no start-up; the history is untouched.

        With `capture` this captures: call it on the thread that will step, as ONNX Runtime keeps CUDA graphs
        by thread.

        Raises:
            ArgumentError: `render_size` was given neither here nor to the constructor.
        """
        size = render_size or self._render_size
        if size is None:
            raise ArgumentError("render_size", got=None, want="(width, height)")
        size = _checked_size("render_size", size)
        display_size = self._display_size or self._scaled(size)
        frame = black(self.model.info.gbuffers, size, display_size)
        history = self.model.first_history(display_size, size)
        self.model.run(frame, history)
        if self.model.capture:
            tensors = tensors_of_frame(frame, self.model.device)
            self.model.run_tensors(tensors, history, jitter=frame.jitter)

    def save_state(self) -> State:
        """Copy the history; an Upscaler that loads it continues bit for bit as this one does."""
        if self._history is None:
            return State(self.model.info.method, self._display_size, None, None)
        history = self._history
        return State(
            self.model.info.method,
            history.display_size,
            history.render_size,
            self.model.save_history(history),
        )

    def load_state(self, state: State) -> None:
        """Continue from `state`.

        Raises:
            ArgumentError: it is of another method or display size; the history stays as it was.
        """
        if state.method != self.model.info.method:
            raise ArgumentError("state", got=f"of {state.method!r}", want=f"of {self.model.info.method!r}")
        if self._display_size not in (None, state.display_size):
            raise ArgumentError("state", got=f"at {state.display_size}", want=f"at {self._display_size}")
        history = None
        if state.history is not None and state.display_size and state.render_size:
            history = self.model.load_history(state.display_size, state.render_size, state.history)
        if self._recorder is not None:
            self._recorder.load_state(state)
        self._history, self._spare = history, None
        self._display_size = state.display_size
        self._checker.reset()

    def close(self) -> None:
        """Free the history, and end the recording; `step` raises afterwards."""
        self._history = self._spare = None
        self._closed = True
        if self._recorder is not None:
            self._recorder.close()

    def __enter__(self) -> "Upscaler":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _step(self, frame: Frame, out: Float32 | None, want: Collection[str]) -> Float32 | Result:
        started = time.perf_counter()
        self._check_open()
        display_size = self._display_size or self._scaled(frame.size)
        history = None if frame.reset else self._history
        carried = None if history is None else history.carry
        self.model.check(frame, display_size, want, carried)  # first: no frame is remembered and then refused
        self._checker.check(frame, display_size, self.model.info.gbuffers)
        fresh = history is None
        history = history or self.model.first_history(display_size, frame.size)
        result, left = self.model.run_wanted(
            frame, history, want, out=out, history_out=self._spare, skip=self.skip
        )
        self._display_size = display_size
        self._history, self._spare = left, history
        self._count(fresh, float(self.model.work(left).mean()), time.perf_counter() - started)
        return result if want else result.image

    def _step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        jitter: tuple[float, float],
        exposure: float | None,
        reset: bool,
        out: Tensor | None,
    ) -> Tensor:
        started = time.perf_counter()
        self._check_open()
        if "color" not in tensors:
            raise FrameError("color", got=None, want="a tensor (1, 3, h, w)")
        size = render_size_of(taken(tensors["color"], "color"))
        display_size = self._display_size or self._scaled(size)
        history = None if reset else self._history
        fresh = history is None
        history = history or self.model.first_history(display_size, size)
        image, left = self.model.run_tensors(
            tensors, history, jitter=jitter, exposure=exposure, out=out, history_out=self._spare
        )
        self._display_size = display_size
        self._history, self._spare = left, history
        self._count(fresh, 1.0, time.perf_counter() - started)
        return image

    def _check_open(self) -> None:
        if self._closed:
            raise ArgumentError("upscaler", got="closed", want="open", hint="Make a new one.")

    def _count(self, fresh: bool, work: float, seconds: float) -> None:
        s, full = self.stats, work == 1.0
        self.stats = Stats(
            frames=s.frames + 1,
            resets=s.resets + fresh,
            seconds=s.seconds + seconds,
            work=s.work + work,
            full_frames=s.full_frames + full,
            full_seconds=s.full_seconds + (seconds if full else 0.0),
        )

    def _setup(self) -> Setup:
        return setup_here(
            self.model,
            display_size=self._display_size,
            scale=self._scale,
            skip=self.skip,
            validate=self._checker.validate,
        )

    def _scaled(self, render_size: Size) -> Size:
        return round(render_size[0] * self._scale), round(render_size[1] * self._scale)


def _checked_skip(skip: Skip) -> Skip:
    if skip in ("auto", "exact") or (isinstance(skip, (int, float)) and 0.0 <= skip <= 1.0):
        return skip
    raise ArgumentError("skip", got=repr(skip), want="'auto', 'exact' or a number in [0, 1]")


def _checked_scale(scale: float) -> float:
    if not 1.0 <= scale < float("inf"):
        raise ArgumentError("scale", got=scale, want="a number >= 1: display size over render size")
    return float(scale)


def _checked_size(name: str, size: Size) -> Size:
    try:
        width, height = (int(n) for n in size)
    except (TypeError, ValueError):
        raise ArgumentError(name, got=repr(size), want="(width, height) in pixels") from None
    if width < 1 or height < 1:
        raise ArgumentError(name, got=(width, height), want="(width, height), each at least 1")
    return width, height
