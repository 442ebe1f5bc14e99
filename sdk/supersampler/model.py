"""`Model`: one exported method, ready to run. Pure: it remembers nothing between calls."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import (
    TOLERANCE,
    Skip,
    check_out,
    checked_choice,
    checked_flag,
    checked_names,
    checked_path,
    checked_size,
    checked_skip,
    checked_threads,
    tolerance_of,
)
from supersampler.backends.base import Executor
from supersampler.backends.cpu.memory import aligned
from supersampler.backends.onnx.aovs import AovBlender, check_aovs
from supersampler.backends.onnx.executor import OnnxExecutor
from supersampler.backends.onnx.providers import CPU, resolve_providers
from supersampler.backends.onnx.session import pixels_of, session_options, vector_inputs
from supersampler.backends.onnx.tensors import Tensor, checked_tensors, graph_inputs, render_size_of, taken
from supersampler.backends.plan import Plan
from supersampler.conventions.ratios import check_ratio
from supersampler.errors import ArgumentError, FrameError
from supersampler.frame import (
    Float32,
    Frame,
    Size,
    arrays_of,
    checked_exposure,
    checked_frame,
    checked_jitter,
)
from supersampler.history import AOVS, WORK, History, StepResult, check_histories, checked_history
from supersampler.methods.cpu_backends import cpu_executor
from supersampler.methods.gbuffers import check_gbuffers
from supersampler.methods.model_file import read_model_info, read_upscaling_info
from supersampler.methods.model_info import ModelInfo

__all__ = ["TOLERANCE", "ExecutorName", "Model", "Precision", "Skip"]

ExecutorName = Literal["auto", "onnx", "cpu"]
Precision = Literal["auto", "fp32", "fp16", "int8"]


class Model:
    """An exported method, ready to run; shareable between threads and Upscalers.

    Attributes:
        info: what its model.json says.
        providers: execution providers of ONNX Runtime in use, in order; the CPU backend needs none for a
            step, and counts as the CPU's.
        threads: on the CPU, as given; 0 takes every core.
        on_extrapolated: the model that steps on extrapolated frames, on the same histories; mostly this one.
    """

    def __init__(
        self,
        info: ModelInfo,
        executor: Executor,
        aov_blender: AovBlender,
        providers: list[str],
        threads: int,
        on_extrapolated: "Model | None" = None,
    ) -> None:
        self.info = info
        self.providers = providers
        self.threads = threads
        self._aov_blender = aov_blender
        self._executor = executor
        self._kind = type(executor), self.device, info.history
        self.on_extrapolated = on_extrapolated or self

    @classmethod
    def load(
        cls,
        name_or_path: str | Path,
        *,
        providers: str | Sequence[str] = "auto",
        threads: int = 0,
        executor: ExecutorName = "auto",
        precision: Precision = "auto",
        capture: bool = False,
    ) -> "Model":
        """Load a shipped model by name, or a model folder by path.

        Args:
            name_or_path: one of `methods.model_file.model_names()`, or a folder with a model.json.
            providers: "auto" (CUDA, DirectML, else CPU), a provider's name ("cpu", "cuda", "directml", ... or
                ONNX Runtime's own), or several in order of preference.
            threads: threads on the CPU; 0 takes every core.
            executor: "onnx" runs the model's graph in ONNX Runtime; "cpu" runs kernels compiled for this
                processor, which is several times as fast; "auto" takes "cpu" where the provider is the CPU
                and the model has kernels.
            precision: of the learned part: "int8", which the CPU backend always runs; "fp32" or "fp16" of the
                ONNX backend. All else is fp32 everywhere.
            capture: have CUDA or TensorRT capture the step with tensors as a CUDA graph, launched as one from
                then on; anew where a size changes. The CPU runs the same on fixed buffers, without capture.

        Raises:
            ModelError: no such model, a damaged folder, another contract, or a model that upscales nothing.
            ProviderError: a provider was asked for and cannot be had, or cannot capture.
            ArgumentError: the model cannot run so.
        """
        threads, capture = checked_threads(threads), checked_flag("capture", capture)
        executor = checked_choice("executor", executor, get_args(ExecutorName))
        precision = checked_choice("precision", precision, get_args(Precision))
        info = read_upscaling_info(checked_path("model", name_or_path))
        names = resolve_providers(providers)
        aov_blender = AovBlender(info, session_options(threads))
        if executor != "onnx" and not capture and list(names) == [CPU]:
            required = executor == "cpu" or precision == "int8"
            kernels = cpu_executor(info, threads, required=required)
            if kernels is not None and precision in ("auto", kernels.precision):
                return cls(info, kernels, aov_blender, [CPU], threads)
        kind = "fp32" if precision == "auto" else precision
        if executor == "cpu" or kind not in info.steps:
            got = f"{executor=}, {precision=}, {capture=}, providers {', '.join(names)}"
            want = f"what {info.method!r} has: a graph in {' or '.join(info.steps)}, or kernels, on the CPU"
            raise ArgumentError("executor", got=got, want=want, hint="Only graphs are captured." * capture)
        graph = OnnxExecutor(info, threads, names, kind, capture=capture)
        if info.extrapolated is None:
            return cls(info, graph, aov_blender, graph.providers, threads)
        other = read_model_info(info.extrapolated)
        steps = OnnxExecutor(other, threads, graph.providers, kind, capture=False)  # without run_tensors
        blender = AovBlender(other, session_options(threads))
        on_extrapolated = cls(other, steps, blender, steps.providers, threads)
        return cls(info, graph, aov_blender, graph.providers, threads, on_extrapolated)

    @property
    def executor(self) -> str:
        """How it runs: "onnx" or "cpu"."""
        return self._executor.name

    @property
    def device(self) -> str:
        """Where histories, and tensors for `run_tensors`, lie: "cpu", "cuda", "dml"."""
        return self._executor.device if isinstance(self._executor, OnnxExecutor) else "cpu"

    @property
    def capture(self) -> bool:
        """Whether steps with tensors are captured; see `load`."""
        return isinstance(self._executor, OnnxExecutor) and self._executor.capture

    @property
    def precision(self) -> str:
        """Of what is learned: "fp32", "fp16" or "int8"."""
        return self._executor.precision

    def first_history(self, display_size: Size, render_size: Size) -> History:
        """Return an empty history: all zeros.

        Raises:
            ArgumentError: a size is not that of an image.
        """
        display = checked_size("display_size", display_size)
        render = checked_size("render_size", render_size)
        return History(display, render, self._executor.zeros(display, render), kind=self._kind)

    def run(
        self,
        frame: Frame,
        history: History,
        *,
        out: Float32 | None = None,
        history_out: History | None = None,
    ) -> tuple[Float32, History]:
        """Upscale one frame to the display size of `history`.

        Args:
            frame: its `reset` is not read; hand in `first_history` for a frame without a history.
            history: of the previous frame; not changed.
            out: (H, W, 3) float32 to write the image to; a new array where None.
            history_out: buffers of an older history to write to; new ones where None.

        Returns:
            The image (H, W, 3) float32, linear RGB, >= 0, and the history for the next frame.

        Raises:
            FrameError: the frame lacks an input, or its size does not fit.
            ArgumentError: `out` has the wrong shape or type, or `history_out` is `history`.
        """
        result, next_history = self.run_outputs(frame, history, (), out=out, history_out=history_out)
        return result.image, next_history

    def run_outputs(
        self,
        frame: Frame,
        history: History,
        outputs: Collection[str],
        *,
        out: Float32 | None = None,
        history_out: History | None = None,
        skip: Skip = "exact",
    ) -> tuple[StepResult, History]:
        """Upscale as `run` does, and return what `outputs` names of `StepResult` with the image.

        What is not named costs nothing.

        Args:
            frame: see `run`.
            history: see `run`.
            outputs: names of `StepResult`'s.
            out: see `run`.
            history_out: see `run`.
            skip: see `Upscaler`.

        Raises:
            FrameError: as `run`; or "aovs" is among the outputs, and the frame has none, or other channels
                than the previous one.
            ArgumentError: as `run`; or the model has no output of that name.
        """
        outputs = checked_names("outputs", outputs)
        check_histories(history, history_out, self._kind, self._executor.fits)
        self.check(frame, history.display_size, outputs, history.aovs, out)
        return self.run_checked(frame, history, outputs, out=out, history_out=history_out, skip=skip)

    def run_checked(
        self,
        frame: Frame,
        history: History,
        outputs: Collection[str],
        *,
        out: Float32 | None,
        history_out: History | None,
        skip: Skip,
    ) -> tuple[StepResult, History]:
        """Do as `run_outputs`, for arguments that `check` has passed and histories of this model."""
        tolerance, display_size = tolerance_of(checked_skip(skip), outputs), history.display_size
        image = aligned((*display_size[::-1], 3)) if out is None else out
        next_history = self._prepared(history_out, display_size, frame.size)
        needed = {self.info.maps[name].output for name in outputs if name in self.info.maps}
        needed |= {"weight"} if "aovs" in outputs else set()
        computed = image if image.flags.c_contiguous else aligned(image.shape)
        aux_outputs = self._executor.step(
            frame, display_size, history.buffers, next_history.buffers, computed, needed, tolerance=tolerance
        )
        if computed is not image:
            np.copyto(image, computed)
        if "aovs" in outputs:
            next_history.aovs = self._aov_blender.blend(
                frame, aux_outputs.get("weight"), history.aovs, display_size
            )
        return self._result(image, outputs, aux_outputs, next_history), next_history

    def run_tensors(
        self,
        tensors: Mapping[str, Tensor],
        history: History,
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        out: Tensor | None = None,
        history_out: History | None = None,
    ) -> tuple[Tensor, History]:
        """Upscale a frame that lies on the provider's device; see `Upscaler.step_tensors`.

        Raises:
            FrameError: an input is missing, or its type, shape, range or device does not fit.
            ModelError: the provider cannot capture the step.
            ArgumentError: the executor is not "onnx", or `history_out` is `history`.
        """
        if not isinstance(self._executor, OnnxExecutor):
            want = "'onnx', which takes tensors"
            raise ArgumentError("executor", got=repr(self.executor), want=want)
        check_histories(history, history_out, self._kind, self._executor.fits)
        jitter, exposure = checked_jitter(jitter), checked_exposure(exposure)
        vectors = vector_inputs(jitter, exposure, history.display_size)
        given = graph_inputs(self.info.inputs, checked_tensors(tensors), vectors)
        render_size = render_size_of(given["color"])
        check_ratio(self.info.ratios, render_size, history.display_size)
        next_history = self._prepared(history_out, history.display_size, render_size)
        target = None if out is None else taken(out, "image")
        if target is not None and target.data_ptr() in {value.data_ptr() for value in given.values()}:
            raise ArgumentError("out", got="memory of the frame", want="memory that the step does not read")
        display = history.display_size
        image = self._executor.step_tensors(given, display, history.buffers, next_history.buffers, target)
        return (image if out is None else out), next_history

    def plan(self, render_size: Size, display_size: Size) -> Plan:
        """Return what frames of this size need; nothing of it is made.

        Args:
            render_size: (width, height) of the frames.
            display_size: (width, height) of the images.

        Raises:
            FrameError: the method does not upscale by that much.
        """
        render_size = checked_size("render_size", render_size)
        display_size = checked_size("display_size", display_size)
        check_ratio(self.info.ratios, render_size, display_size)
        history, working = self._executor.needs(display_size, render_size)
        products = round(self.info.multiply_adds * display_size[0] * display_size[1])
        return Plan(self.executor, self.precision, 2 * history, working, products)

    def note_stages(self) -> Mapping[str, float]:
        """Return wall seconds by stage, which fill with each step from now on; none for the ONNX backend."""
        return self._executor.note_stages()

    def save_history(self, history: History) -> dict[str, NDArray[Any]]:
        """Copies of all history tensors of the contract, and of the executor's own.

        Any executor of the model can load them.
        """
        buffers, names = history.buffers, [h.input.name for h in self.info.history]
        copies = {name: np.array(self._executor.tensor(buffers, name)) for name in names}
        copies |= self._executor.memory(buffers)
        return copies if history.aovs is None else {**copies, AOVS: history.aovs.copy()}

    def work(self, history: History) -> Float32:
        """Return `StepResult.work` of the step that returned this history."""
        return self._executor.work(history.buffers, history.display_size)

    def converged(self, history: History) -> float:
        """Return `Stats.converged` of the step that returned this history."""
        return self._executor.converged(history.buffers)

    def load_history(
        self, display_size: Size, render_size: Size, arrays: Mapping[str, NDArray[Any]]
    ) -> History:
        """Make a history of copies by `save_history`.

        Raises:
            ArgumentError: they are of another method or of other sizes, or one has another type, values that
                are not finite or out of range, or is too large for the memory that there is.
        """
        display_size = checked_size("state.display_size", display_size)
        render_size = checked_size("state.render_size", render_size)
        checked = checked_history(self.info, arrays, display_size, render_size)
        try:
            history = self.first_history(display_size, render_size)
            self._executor.load(history.buffers, checked)
            history.aovs = checked[AOVS].copy() if AOVS in checked else None
        except MemoryError:
            raise ArgumentError("state", got=f"at {display_size}", want="what fits into memory") from None
        return history

    def check(
        self,
        frame: Frame,
        display_size: Size,
        outputs: Collection[str] = (),
        previous_aovs: Float32 | None = None,
        out: Float32 | None = None,
    ) -> None:
        """Raise what `run_outputs` would for this frame, before anything is done with it.

        Args:
            frame: the frame.
            display_size: (width, height) of the image.
            outputs: names of what else is to be returned.
            previous_aovs: `History.aovs` of the previous frame.
            out: where the image is to be written.

        Raises:
            FrameError, ArgumentError: see `run_outputs`.
        """
        if checked_frame(frame).color is None:
            hint = "`extrapolate`, and `upscale --extrapolate`, take frames that were not shaded."
            want = f"(h, w, 3); {self.info.method!r} needs shaded frames"
            raise FrameError("color", got=None, want=want, hint=hint)
        check_ratio(self.info.ratios, frame.size, display_size)
        check_gbuffers(frame, self.info.gbuffers, display_size, self.info.method)
        for name in checked_names("outputs", outputs):
            checked_choice("outputs", name, ("aovs", WORK, *self.info.maps))
        if "aovs" in outputs:
            check_aovs(frame, previous_aovs)
        if out is not None:
            check_out(out, (*display_size[::-1], 3), arrays_of(frame))

    def _result(
        self,
        image: Float32,
        outputs: Collection[str],
        aux_outputs: Mapping[str, Float32],
        next_history: History,
    ) -> StepResult:
        inputs = {h.output: h.input.name for h in self.info.history}
        maps: dict[str, Float32] = {}
        for name in set(outputs) & set(self.info.maps):
            where = self.info.maps[name]
            planes = aux_outputs.get(where.output)
            if planes is None:
                planes = self._executor.tensor(next_history.buffers, inputs[where.output])
            maps[name] = pixels_of(planes[:, where.first : where.first + where.channels])
        aovs = None if next_history.aovs is None else next_history.aovs[0].transpose(1, 2, 0).copy()
        if WORK in outputs:
            maps[WORK] = self.work(next_history).copy()
        return StepResult(image, aovs=aovs, **maps)

    def _prepared(self, history: History | None, display: Size, render: Size) -> History:
        """Return buffers for the next history: those of `history` where they fit."""
        if history is not None and self._executor.fits(history.buffers, display, render):
            return History(display, render, history.buffers, kind=self._kind)
        return self.first_history(display, render)
