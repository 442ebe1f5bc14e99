"""`Model`: an exported method, ready to run. It keeps no state between calls."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, cast, get_args

import numpy as np
from numpy.typing import NDArray

from supersampler import arguments
from supersampler.arguments import AtRest, ExecutorName, Precision
from supersampler.backends.base import AovRequest, Executor, StepReport, StepRequest
from supersampler.backends.cpu.executor import CpuExecutor
from supersampler.backends.cpu.ids import IdHistory, IdRequest, resample_ids
from supersampler.backends.cpu.library import aligned
from supersampler.backends.onnx import tensors as onnx_tensors
from supersampler.backends.onnx.executor import AovBlender, OnnxExecutor
from supersampler.backends.onnx.runtime import CPU, resolve_providers
from supersampler.backends.onnx.session import pixels_of, vector_inputs
from supersampler.backends.onnx.tensors import Tensor
from supersampler.conventions.jitter import check_ratio
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.frame import Float32, Frame, Size, checked_frame, checked_values
from supersampler.history import History, StepResult
from supersampler.io.display import MAX_HALF
from supersampler.methods.array_spec import ArraySpec, checked_arrays, values_of
from supersampler.methods.at_rest import ADDED, check_history, converged_fraction
from supersampler.methods.executors import choose_executor
from supersampler.methods.gbuffers import arrays_by_name, check_gbuffers, sampled
from supersampler.methods.model_file import read_model_info, read_upscaling_info
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import HALF, LARGE_HALF, half_size, resized

if TYPE_CHECKING:
    import wgpu

    from supersampler.backends.gpu.executor import GpuExecutor
    from supersampler.backends.gpu.frame import DeviceFrame
    from supersampler.backends.gpu.history import BlendedAovs


__all__ = ["Model", "Plan"]
AOVS, IDS, ID_DISTANCE = "history.aovs", "history.ids", "history.id_distance"


@dataclass(frozen=True)
class Plan:
    """Memory and arithmetic of an `Upscaler` for one render size and one display size.

    Attributes:
        executor: the backend; see `Model.executor`.
        precision: precision of the network: "fp32", "fp16" or "int8".
        history_bytes: bytes of two histories: a step reads one and writes the other.
        working_bytes: bytes of a step's buffers, which Upscalers of one Model share. None with the ONNX
            backend, because ONNX Runtime allocates them.
        multiply_adds: multiply-adds of the network per frame; 0 without a network.
    """

    executor: str
    precision: str
    history_bytes: int
    working_bytes: int | None
    multiply_adds: int


class ModelStep(NamedTuple):
    """Arguments of `Model.run_outputs` for one view; see `StepRequest` for `adds_samples`."""

    frame: Frame
    history: History
    outputs: Collection[str]
    out: Float32 | None
    history_out: History | None
    adds_samples: float
    skip: bool


class Model:
    """An exported method, ready to run; threads and Upscalers may share it.

    Attributes:
        info: content of its model.json.
        providers: execution providers of ONNX Runtime in use, in order of preference; only the CPU's with the
            CPU and GPU backends.
        threads: number of CPU threads, as given; 0 uses every core.
    """

    def __init__(
        self, info: ModelInfo, executor: Executor, threads: int, on_extrapolated: "Model | None" = None
    ) -> None:
        self.info, self.threads = info, threads
        self.providers: list[str] = getattr(executor, "providers", [CPU])
        self._executor = executor
        self._aov_blender = AovBlender(info, threads)
        # ONNX Runtime's are plain tensors; others refer to their model, or are on its device
        self._kind = self.device if executor.name == "onnx" else executor, info.history
        # or None: with a reference to itself, it would keep its memory until garbage is collected
        self._on_extrapolated = on_extrapolated

    @classmethod
    def load(
        cls,
        name_or_path: str | Path,
        *,
        providers: str | Sequence[str] = "auto",
        threads: int = 0,
        executor: ExecutorName = "auto",
        precision: Precision = "auto",
        device: "wgpu.GPUDevice | None" = None,
    ) -> "Model":
        """Load a shipped model by name, or a model folder by path.

        Args:
            name_or_path: one of `methods.model_file.model_names()`, or a folder with a model.json.
            providers: "auto" (CUDA, DirectML, else CPU), the name of a provider ("cpu", "cuda", "directml",
                ... or ONNX Runtime's own), or several in order of preference.
            threads: number of CPU threads; 0 uses every core.
            executor: "onnx" runs the model's graph in ONNX Runtime; "cpu" runs compiled kernels, which is
                several times as fast; "auto" uses "cpu" if the provider is the CPU and the model has kernels;
                "gpu" runs shaders on any GPU (`pip install "supersampler[gpu]"`).
            precision: precision of the network: "int8", which the CPU and the GPU backend always use; "fp32"
                or "fp16" with the ONNX backend. With "fp16", colours within a frame are half floats, too, but
                not the history.
            device: with executor="gpu", the device of the caller's textures; None opens one.

        Raises:
            ModelError: the model does not exist, is damaged, has another contract, or does not upscale.
            ProviderError: a provider is not available.
            DeviceError: there is no GPU, or it does not compile the shaders.
            ArgumentError: an argument is unknown, or the model does not support the combination.
        """
        threads = arguments.checked_threads(threads)
        executor = arguments.checked_choice("executor", executor, get_args(ExecutorName))
        precision = arguments.checked_choice("precision", precision, get_args(Precision))
        info = read_upscaling_info(arguments.checked_path("model", name_or_path))
        names = resolve_providers(providers)
        chosen = choose_executor(info, names, threads, executor, precision, device=device)
        if info.extrapolated is None or not isinstance(chosen, OnnxExecutor):
            return cls(info, chosen, threads)
        other = read_model_info(info.extrapolated)
        steps = OnnxExecutor(other, threads, chosen.providers, chosen.precision)
        return cls(info, chosen, threads, cls(other, steps, threads))

    def __reduce__(self) -> NoReturn:
        """Refuse copying and pickling: a model has threads, and memory of its backend."""
        hint = "Threads may share it; another process loads its own: Model.load(...)."
        raise ArgumentError("model", got="to be copied or pickled", want="loaded", hint=hint)

    @property
    def on_extrapolated(self) -> "Model":
        """The model that steps on extrapolated frames with the same histories; often this one."""
        return self._on_extrapolated or self

    @property
    def executor(self) -> str:
        """The backend in use: "onnx", "cpu" or "gpu"."""
        return self._executor.name

    @property
    def precision(self) -> str:
        """Precision of the network: "fp32", "fp16" or "int8"."""
        return self._executor.precision

    @property
    def device(self) -> str:
        """Device of histories and of tensors for `run_tensors`: "cpu", "cuda", "dml"."""
        return self._executor.device if isinstance(self._executor, OnnxExecutor) else "cpu"

    @property
    def gpu(self) -> "GpuExecutor":
        """The GPU backend.

        Raises:
            ArgumentError: the executor is not "gpu".
        """
        if self._executor.name != "gpu":
            want = "'gpu', which takes textures and buffers of wgpu"
            raise ArgumentError("executor", got=repr(self._executor.name), want=want)
        return cast("GpuExecutor", self._executor)

    def plan(self, render_size: Size, display_size: Size) -> Plan:
        """Return the memory and arithmetic that frames of this size need, without allocating it.

        Raises:
            FrameError: the method does not support this ratio.
            ArgumentError: a size is not a valid image size.
        """
        render_size = arguments.checked_size("render_size", render_size)
        display_size = arguments.checked_size("display_size", display_size)
        check_ratio(self.info.ratios, render_size, display_size)
        history, working = self._executor.required_bytes(display_size, render_size)
        multiply_adds = round(self.info.multiply_adds * display_size[0] * display_size[1])
        return Plan(self.executor, self.precision, 2 * history, working, multiply_adds)

    def first_history(self, display_size: Size, render_size: Size) -> History:
        """Return an empty history, which is all zeros.

        Raises:
            ArgumentError: a size is not a valid image size.
        """
        display = arguments.checked_size("display_size", display_size)
        render = arguments.checked_size("render_size", render_size)
        return History(display, render, self._executor.zeros(display, render), kind=self._kind)

    @arguments.ieee_arithmetic
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
            frame: the frame. Its `reset` is ignored: pass `first_history` to start without a history.
            history: history after the previous frame; not changed.
            out: (H, W, 3) float32 to write the image to; None allocates it.
            history_out: an older history whose buffers are reused; None allocates new ones.

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
        """Upscale like `run`, and return the image and the fields of `StepResult` that `outputs` names.

        Other fields are not computed. See `Upscaler` for `at_rest` and `skip`.

        Raises:
            FrameError: see `run`; or "aovs" are requested, and the frame has none, or another number of
                channels than the previous frame.
            ArgumentError: see `run`; or the model lacks an output.
        """
        at_rest = arguments.checked_choice("at_rest", at_rest, get_args(AtRest))
        skip = arguments.checked_flag("skip", skip)
        outputs = arguments.checked_names("outputs", outputs)
        self._check_histories(history, history_out)
        self.check(checked_frame(frame), history.display_size, outputs, history, out)
        step = ModelStep(frame, history, outputs, out, history_out, ADDED[at_rest], skip)
        [(result, next_history, _)] = self.run_checked([step])
        return result, next_history

    def check(
        self,
        frame: Frame,
        display_size: Size,
        outputs: Collection[str] = (),
        previous: History | None = None,
        out: Float32 | None = None,
    ) -> None:
        """Raise the errors of `run_outputs` for a valid frame, before anything is computed.

        `previous` is the history of the step; None: an empty one.
        """
        if frame.color is None:
            hint = "`extrapolate` and `upscale --extrapolate` take frames that were not shaded."
            want = f"(h, w, 3); {self.info.method!r} needs shaded frames"
            raise FrameError("color", got=None, want=want, hint=hint)
        check_ratio(self.info.ratios, frame.size, display_size)
        check_gbuffers(frame, self.info.gbuffers, display_size, self.info.method)
        for name in outputs:
            arguments.checked_choice("outputs", name, ("aovs", "ids", *self.info.maps))
        if "aovs" in outputs:
            channels = None if frame.aovs is None else frame.aovs.shape[2]
            _check_channels("aovs", channels, self._aov_channels(previous))
        if "ids" in outputs:
            before = None if previous is None or previous.ids is None else previous.ids.ids.shape[2]
            _check_channels("ids", None if frame.ids is None else frame.ids.shape[2], before)
        if out is not None:
            arguments.check_out(out, (*display_size[::-1], 3), arrays_by_name(frame).values())

    def run_checked(
        self, steps: Sequence[ModelStep]
    ) -> list[tuple[StepResult, History, Mapping[str, float]]]:
        """Run `run_outputs` on each of several views without its checks.

        Returns:
            Result, next history, and wall seconds of the stages, of each view.
        """
        requests, histories = [], []
        for step in steps:
            display = step.history.display_size
            next_history = self._next_history(step.history_out, display, step.frame.size)
            needed = {self.info.maps[name].output for name in step.outputs if name in self.info.maps}
            if "aovs" in step.outputs:
                needed.add("aovs" if self.executor == "gpu" else "weight")
            image = step.out
            if image is None or not image.flags.c_contiguous:
                image = aligned((*display[::-1], 3))
            frame = sampled(step.frame, self.info.gbuffers, display)
            buffers = step.history.buffers, next_history.buffers
            requests.append(
                StepRequest(frame, display, *buffers, image, needed, step.adds_samples, step.skip)
            )
            histories.append(next_history)
        reports = self._executor.step_many(requests)
        self._blend_aovs(steps, histories, reports)
        self._resample_ids(steps, histories)
        return [
            (self._result(step, request.image, report, next_history), next_history, report.stages)
            for step, request, report, next_history in zip(steps, requests, reports, histories, strict=True)
        ]

    def _blend_aovs(
        self, steps: Sequence[ModelStep], next_histories: Sequence[History], reports: Sequence[StepReport]
    ) -> None:
        """Blend the AOVs of the steps that ask for them, and write them to their next histories.

        The GPU backend has blended its own in the step.
        """
        asking = [k for k, step in enumerate(steps) if "aovs" in step.outputs and self.executor != "gpu"]
        if not asking:
            return
        requests = []
        for k in asking:
            frame, history = steps[k].frame, steps[k].history
            weight = None if history.aovs is None else reports[k].outputs.get("weight")
            requests.append(AovRequest(frame, history.display_size, weight, history.aovs))
        if isinstance(self._executor, CpuExecutor):
            blended = self._executor.blend_aovs(requests)
        else:
            blended = [self._aov_blender.blend(request) for request in requests]
        for k, aovs in zip(asking, blended, strict=True):
            next_histories[k].aovs = aovs

    def _resample_ids(self, steps: Sequence[ModelStep], next_histories: Sequence[History]) -> None:
        """Write the ids of the steps that ask for them to their next histories."""
        asking = [k for k, step in enumerate(steps) if "ids" in step.outputs]
        if not asking:
            return
        requests = [
            IdRequest(steps[k].frame, steps[k].history.display_size, steps[k].history.ids) for k in asking
        ]
        handle = self._executor.handle if isinstance(self._executor, CpuExecutor) else None
        for k, resampled in zip(asking, resample_ids(requests, handle), strict=True):
            next_histories[k].ids = resampled

    def _result(
        self, step: ModelStep, image: Float32, report: StepReport, next_history: History
    ) -> StepResult:
        """Return the outputs of a step, of which the executor has computed the image and `report`."""
        frame, history, outputs = step.frame, step.history, step.outputs
        display = history.display_size
        if step.out is not None and step.out is not image:
            np.copyto(step.out, image)
            image = step.out
        blended = report.outputs.get("aovs") if self.executor == "gpu" else next_history.aovs
        aovs = None if blended is None else blended[0].transpose(1, 2, 0).copy()
        ids = None
        if next_history.ids is not None and frame.ids is not None:
            ids = next_history.ids.ids.astype(frame.ids.dtype)
        tensors = {h.output: h for h in self.info.history}
        maps: dict[str, Float32] = {}
        for name in set(outputs) & set(self.info.maps):
            source = self.info.maps[name]
            planes = report.outputs.get(source.output)
            if planes is None:
                tensor = tensors[source.output]
                planes = self._executor.tensor(next_history.buffers, tensor.name)
                halved = tensor.shape[2:] in (HALF, LARGE_HALF)
                planes = resized(planes, half_size(display) if halved else display)  # of the larger display
            maps[name] = pixels_of(planes[:, source.first : source.first + source.channels])
        return StepResult(image, aovs=aovs, ids=ids, **maps)

    def run_tensors(
        self,
        tensors: Mapping[str, Tensor],
        history: History,
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        pre_exposure: float = 1.0,
        out: Tensor | None = None,
        history_out: History | None = None,
        adds_samples: float = 1.0,
    ) -> tuple[Tensor, History]:
        """Upscale a frame on the provider's device; see `Upscaler.step_tensors`.

        Raises:
            FrameError: an input is missing, or has a wrong type, shape, range or device.
            ArgumentError: the executor is not "onnx", `out` has a wrong type, shape or device, or
                `history_out` is `history`.
        """
        if not isinstance(self._executor, OnnxExecutor):
            want = "'onnx', which takes tensors"
            raise ArgumentError("executor", got=repr(self._executor.name), want=want)
        self._check_histories(history, history_out)
        jitter, exposure, pre_exposure = checked_values(jitter, exposure, pre_exposure)
        display = history.display_size
        vectors = vector_inputs(jitter, exposure, display, pre_exposure, adds_samples=adds_samples)
        given = onnx_tensors.graph_inputs(
            self.info.inputs, onnx_tensors.checked_tensors(tensors), vectors, self.device
        )
        render_size = onnx_tensors.render_size_of(given["color"])
        check_ratio(self.info.ratios, render_size, display)
        next_history = self._next_history(history_out, display, render_size)
        target = None if out is None else onnx_tensors.ort_value_of(out, "out", ArgumentError)
        if target is not None and any(onnx_tensors.shares_memory(target, value) for value in given.values()):
            raise ArgumentError("out", got="memory of the frame", want="memory that the step does not read")
        image = self._executor.step_tensors(given, display, history.buffers, next_history.buffers, target)
        return (image if out is None else out), next_history

    def encode(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        frame: "DeviceFrame",
        history: History,
        image: "wgpu.GPUTexture | wgpu.GPUBuffer",
        history_out: History | None = None,
        *,
        adds_samples: float = 1.0,
        skip: bool = True,
    ) -> History:
        """Encode a step on a frame in GPU memory; see `Upscaler.encode_into`.

        Returns:
            The history for the next frame; its buffers are written when the commands run.

        Raises:
            FrameError: its AOVs have another number of channels than those of the previous frame.
        """
        self._check_histories(history, history_out)
        if frame.aovs is not None:
            _check_channels("aovs", frame.aovs.channels, self._aov_channels(history))
        check_ratio(self.info.ratios, frame.size, history.display_size)
        next_history = self._next_history(history_out, history.display_size, frame.size)
        self.gpu.encode(
            encoder, frame, history.buffers, next_history.buffers, image, adds_samples=adds_samples, skip=skip
        )
        return next_history

    def converged(self, history: History | None) -> float | None:
        """Return `Stats.converged` for this history; 0 before the first frame."""
        if not self.info.converges:
            return None
        if history is None:
            return 0.0
        blocks = self._executor.tensor(history.buffers, "history.static_blocks")
        return converged_fraction(blocks, history.display_size, history.render_size)

    def save_history(self, history: History) -> dict[str, NDArray[Any]]:
        """Return copies of all history tensors, which every executor of the model can load."""
        names = [h.name for h in self.info.history]
        copies: dict[str, NDArray[Any]] = {
            name: np.array(self._executor.tensor(history.buffers, name)) for name in names
        }
        if self._aov_channels(history) is not None:
            on_device = self.executor == "gpu"
            copies[AOVS] = np.array(
                self._executor.tensor(history.buffers, AOVS) if on_device else history.aovs
            )
        if history.ids is not None:
            copies |= {IDS: history.ids.ids.copy(), ID_DISTANCE: history.ids.distance.copy()}
        return copies

    def load_history(
        self, display_size: Size, render_size: Size, arrays: Mapping[str, NDArray[Any]]
    ) -> History:
        """Return the history that `save_history` copied.

        Raises:
            ArgumentError: an array has a wrong name, type, shape or range, or does not fit into memory.
        """
        display = arguments.checked_size("state.display_size", display_size)
        render = arguments.checked_size("state.render_size", render_size)
        specs = {
            t.name: ArraySpec(t.type, t.shape_for(render=render, display=display), values_of(t.name))
            for t in self.info.history
        }
        if isinstance(arrays, Mapping) and AOVS in arrays:
            specs[AOVS] = ArraySpec("float32", (1, "k", *display[::-1]), (-MAX_HALF, MAX_HALF))
        if isinstance(arrays, Mapping) and IDS in arrays:
            specs[IDS] = ArraySpec("uint32", (*display[::-1], "ids"))
            specs[ID_DISTANCE] = ArraySpec("float32", display[::-1], values_of(ID_DISTANCE))

        def refusal(got: str, want: str) -> ArgumentError:
            return ArgumentError("state", got=got, want=want)

        checked = checked_arrays(arrays, specs, refusal)
        if self.info.converges:
            check_history(checked, refusal)
        try:
            history = self.first_history(display, render)
            self._executor.load(history.buffers, checked)
            if AOVS in checked and self.executor != "gpu":
                history.aovs = checked[AOVS].copy()
            if IDS in checked:
                history.ids = IdHistory(*(checked[name].copy("C") for name in (IDS, ID_DISTANCE)))
        except MemoryError:
            raise ArgumentError("state", got=f"at {display}", want="sizes that fit into memory") from None
        return history

    def _aov_channels(self, history: History | None) -> int | None:
        """Return the number of AOV channels in a history; None without AOVs."""
        if history is None:
            return None
        if self.executor == "gpu":
            blended: BlendedAovs | None = history.buffers.aovs
            return None if blended is None else blended.channels
        return None if history.aovs is None else history.aovs.shape[1]

    def _check_histories(self, history: History, next_history: History | None) -> None:
        """Raise ArgumentError unless a step may read `history` and write to `next_history`."""
        written = history if next_history is None else next_history
        for name, given in (("history", history), ("history_out", written)):
            if not isinstance(given, History) or given.kind != self._kind:
                hint = "`first_history`, `run` and `load_history` of the model make one."
                raise ArgumentError(name, got=shown(given), want="a History of this model", hint=hint)
        if not self._executor.fits(history.buffers, history.display_size, history.render_size):
            got = f"changed: its buffers do not match {history.display_size} and {history.render_size}"
            raise ArgumentError("history", got=got, want="unchanged")
        if next_history is not None and next_history.buffers is history.buffers:
            raise ArgumentError("history_out", got="history itself", want="other buffers")

    def _next_history(self, history: History | None, display: Size, render: Size) -> History:
        """Return the next history, in the buffers of `history` if they have the right sizes."""
        if history is not None and self._executor.fits(history.buffers, display, render):
            return History(display, render, history.buffers, kind=self._kind)
        return History(display, render, self._executor.zeros(display, render), kind=self._kind)


def _check_channels(name: str, channels: int | None, before: int | None) -> None:
    """Raise FrameError unless a frame has "aovs" or "ids", with as many channels as the history, if any."""
    if channels is None:
        raise FrameError(name, got=None, want=f"(h, w, k), because {name} are requested")
    if before not in (None, channels):
        want = f"{before} channels as before, or a reset"
        raise FrameError(name, got=f"{channels} channels", want=want)
