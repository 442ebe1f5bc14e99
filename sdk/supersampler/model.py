"""`Model`: an exported method, ready to run. It keeps no state between calls."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import (
    AtRest,
    check_out,
    checked_at_rest,
    checked_choice,
    checked_flag,
    checked_names,
    checked_path,
    checked_size,
    checked_skip,
    checked_threads,
    ieee_arithmetic,
)
from supersampler.backends.base import Executor
from supersampler.backends.cpu.memory import aligned
from supersampler.backends.onnx.aovs import AovBlender, check_aovs
from supersampler.backends.onnx.executor import OnnxExecutor
from supersampler.backends.onnx.providers import CPU, resolve_providers
from supersampler.backends.onnx.session import pixels_of, session_options
from supersampler.backends.plan import Plan
from supersampler.conventions.jitter import check_ratio
from supersampler.errors import ArgumentError, FrameError
from supersampler.frame import (
    Float32,
    Frame,
    Size,
    arrays_of,
    checked_frame,
)
from supersampler.history import AOVS, History, StepResult, check_histories, checked_history
from supersampler.methods.at_rest import ADDED, converged_share
from supersampler.methods.executors import ExecutorName, Precision, choose_executor
from supersampler.methods.gbuffers import check_gbuffers, sampled
from supersampler.methods.model_file import read_model_info, read_upscaling_info
from supersampler.methods.model_info import ModelInfo, map_size
from supersampler.methods.sizes import resized
from supersampler.on_device.runs import DeviceRuns

if TYPE_CHECKING:
    import wgpu


__all__ = ["AtRest", "ExecutorName", "Model", "Precision"]


class Model(DeviceRuns):
    """An exported method, ready to run; threads and Upscalers may share it.

    Attributes:
        info: contents of its model.json.
        providers: execution providers of ONNX Runtime in use, in order of preference; the CPU's with the CPU
            and GPU backends.
        threads: number of CPU threads, as given; 0 uses every core.
        on_extrapolated: the model that steps on extrapolated frames with the same histories; most models do
            so themselves.
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
        device: "wgpu.GPUDevice | None" = None,
    ) -> "Model":
        """Load a shipped model by name, or a model folder by path.

        Args:
            name_or_path: one of `methods.model_file.model_names()`, or a folder with a model.json.
            providers: "auto" (CUDA, DirectML, else CPU), the name of a provider ("cpu", "cuda", "directml",
                ... or ONNX Runtime's own), or several in order of preference.
            threads: number of CPU threads; 0 uses every core.
            executor: "onnx" runs the model's graph in ONNX Runtime; "cpu" runs kernels compiled for this
                processor, which is several times as fast; "auto" uses "cpu" if the provider is the CPU and
                the model has kernels; "gpu" runs shaders on any GPU (`pip install "supersampler[gpu]"`);
                "cpu+onnx" runs the network of a classifier in ONNX Runtime on `providers`, such as that of an
                NPU, and kernels before and after it.
            precision: precision of the network: "int8", which the CPU backend always uses; "fp32" or "fp16"
                with the ONNX backend; "fp32" or "int8" with "cpu+onnx". With "fp16", colours within a frame
                are half floats, too; the history never is.
            capture: CUDA and TensorRT capture the step with tensors as a CUDA graph and replay it; a new size
                is captured again. The CPU uses the same fixed buffers without capture.
            device: with executor="gpu", the device of the caller's textures; None opens one.

        Raises:
            ModelError: the model does not exist, is damaged, has another contract, or does not upscale.
            ProviderError: a provider is not available, or cannot capture.
            DeviceError: there is no GPU, or it does not compile the shaders.
            ArgumentError: an argument is unknown, or the model does not support the combination.
        """
        threads, capture = checked_threads(threads), checked_flag("capture", capture)
        executor = checked_choice("executor", executor, get_args(ExecutorName))
        precision = checked_choice("precision", precision, get_args(Precision))
        info = read_upscaling_info(checked_path("model", name_or_path))
        names = resolve_providers(providers)
        aov_blender = AovBlender(info, session_options(threads))
        chosen = choose_executor(info, names, threads, executor, precision, capture=capture, device=device)
        used: list[str] = getattr(chosen, "providers", [CPU])
        if info.extrapolated is None or not isinstance(chosen, OnnxExecutor):
            return cls(info, chosen, aov_blender, used, threads)
        other = read_model_info(info.extrapolated)
        steps = OnnxExecutor(other, threads, used, chosen.precision, capture=False)  # steps with arrays only
        blender = AovBlender(other, session_options(threads))
        on_extrapolated = cls(other, steps, blender, steps.providers, threads)
        return cls(info, chosen, aov_blender, used, threads, on_extrapolated)

    @property
    def executor(self) -> str:
        """The backend in use: "onnx", "cpu", "cpu+onnx" or "gpu"."""
        return self._executor.name

    @property
    def precision(self) -> str:
        """Precision of the network: "fp32", "fp16" or "int8"."""
        return self._executor.precision

    def first_history(self, display_size: Size, render_size: Size) -> History:
        """Return an empty history, which is all zeros.

        Raises:
            ArgumentError: a size is not a valid image size.
        """
        display = checked_size("display_size", display_size)
        render = checked_size("render_size", render_size)
        return History(display, render, self._executor.zeros(display, render), kind=self._kind)

    @ieee_arithmetic
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
            frame: the frame. Its `reset` is ignored: pass `first_history` for a frame without a history.
            history: history after the previous frame; not changed.
            out: (H, W, 3) float32 to write the image to; None allocates it.
            history_out: an older history, whose buffers are reused; None allocates new ones.

        Returns:
            The image (H, W, 3) float32, linear RGB, >= 0, and the history for the next frame.

        Raises:
            FrameError: the frame lacks an input, or has a wrong size.
            ArgumentError: `out` has a wrong shape or type, or `history_out` is `history`.
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
        at_rest: AtRest = "converge",
        skip: bool = True,
    ) -> tuple[StepResult, History]:
        """Upscale like `run`, and return the fields of `StepResult` that `outputs` names, with the image.

        Other fields cost nothing. See `Upscaler` for `at_rest` and `skip`.

        Raises:
            FrameError: as `run`; or `outputs` has "aovs", and the frame has no AOVs, or not as many channels
                as the previous one.
            ArgumentError: as `run`; or the model has no such output.
        """
        at_rest, skip = checked_at_rest(at_rest), checked_skip(skip)
        outputs = checked_names("outputs", outputs)
        check_histories(history, history_out, self._kind, self._executor.fits)
        self.check(frame, history.display_size, outputs, history.aovs, out)
        return self.run_checked(
            frame, history, outputs, out=out, history_out=history_out, adds_samples=ADDED[at_rest], skip=skip
        )

    def run_checked(
        self,
        frame: Frame,
        history: History,
        outputs: Collection[str],
        *,
        out: Float32 | None,
        history_out: History | None,
        adds_samples: float,
        skip: bool,
    ) -> tuple[StepResult, History]:
        """Run `run_outputs` without its checks of frame, outputs and histories; see `check`.

        `adds_samples`: see `Executor.step`.
        """
        display_size = history.display_size
        image = aligned((*display_size[::-1], 3)) if out is None else out
        next_history = self._prepared(history_out, display_size, frame.size)
        needed = {self.info.maps[name].output for name in outputs if name in self.info.maps}
        needed |= {"weight"} if "aovs" in outputs else set()
        computed = image if image.flags.c_contiguous else aligned(image.shape)
        aux_outputs = self._executor.step(
            sampled(frame, self.info.gbuffers, display_size),
            display_size,
            history.buffers,
            next_history.buffers,
            computed,
            needed,
            adds_samples=adds_samples,
            skip=skip,
        )
        if computed is not image:
            np.copyto(image, computed)
        if "aovs" in outputs:
            next_history.aovs = self._aov_blender.blend(
                frame, aux_outputs.get("weight"), history.aovs, display_size
            )
        return self._result(image, outputs, aux_outputs, next_history), next_history

    def plan(self, render_size: Size, display_size: Size) -> Plan:
        """Return the memory and arithmetic that frames of this size need; nothing is allocated.

        Raises:
            FrameError: the method does not support this ratio.
            ArgumentError: a size is not a valid image size.
        """
        render_size = checked_size("render_size", render_size)
        display_size = checked_size("display_size", display_size)
        check_ratio(self.info.ratios, render_size, display_size)
        history, working = self._executor.required_bytes(display_size, render_size)
        multiply_adds = round(self.info.multiply_adds * display_size[0] * display_size[1])
        return Plan(self.executor, self.precision, 2 * history, working, multiply_adds)

    def note_stages(self) -> Mapping[str, float]:
        """Return a mapping in which each step adds its seconds by stage; empty for the ONNX backend."""
        return self._executor.note_stages()

    def save_history(self, history: History) -> dict[str, NDArray[Any]]:
        """Return copies of all history tensors; each executor of the model can load them."""
        buffers, names = history.buffers, [h.input.name for h in self.info.history]
        copies = {name: np.array(self._executor.tensor(buffers, name)) for name in names}
        return copies if history.aovs is None else {**copies, AOVS: history.aovs.copy()}

    def converged(self, history: History | None) -> float | None:
        """Return `Stats.converged` of the step that returned this history; 0 before the first frame."""
        if not self.info.converges:
            return None
        if history is None:
            return 0.0
        blocks = self._executor.tensor(history.buffers, "history.static_blocks")
        return converged_share(blocks, history.display_size, history.render_size)

    def load_history(
        self, display_size: Size, render_size: Size, arrays: Mapping[str, NDArray[Any]]
    ) -> History:
        """Return the history that `save_history` copied.

        Raises:
            ArgumentError: an array has a wrong name, type, shape or range, or does not fit into memory.
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
        """Check the arguments of `run_outputs`, and raise its errors, before anything is computed.

        `previous_aovs` are those of the history.
        """
        if checked_frame(frame).color is None:
            hint = "`extrapolate`, and `upscale --extrapolate`, take frames that were not shaded."
            want = f"(h, w, 3); {self.info.method!r} needs shaded frames"
            raise FrameError("color", got=None, want=want, hint=hint)
        check_ratio(self.info.ratios, frame.size, display_size)
        check_gbuffers(frame, self.info.gbuffers, display_size, self.info.method)
        for name in checked_names("outputs", outputs):
            checked_choice("outputs", name, ("aovs", *self.info.maps))
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
        history_names = {h.output: h.input.name for h in self.info.history}
        shapes = {h.output: h.input.shape for h in self.info.history}
        maps: dict[str, Float32] = {}
        for name in set(outputs) & set(self.info.maps):
            source = self.info.maps[name]
            planes = aux_outputs.get(source.output)
            if planes is None:
                planes = self._executor.tensor(next_history.buffers, history_names[source.output])
                planes = resized(planes, map_size(shapes[source.output], next_history.display_size))
            maps[name] = pixels_of(planes[:, source.first : source.first + source.channels])
        aovs = None if next_history.aovs is None else next_history.aovs[0].transpose(1, 2, 0).copy()
        return StepResult(image, aovs=aovs, **maps)
