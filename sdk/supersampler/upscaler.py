"""`Upscaler`: a `Model` and the history of one camera."""

import time
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeAlias, get_args, overload

import numpy as np
from numpy.lib.array_utils import byte_bounds

from supersampler import arguments
from supersampler.arguments import AtRest, ExecutorName, Precision, PresetName, Validate
from supersampler.backends.onnx.tensors import Tensor, checked_tensors, size_of_tensors
from supersampler.conventions.jitter import display_size_of
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.extrapolation import Extrapolator, ShadedHistory, extrapolator_beside
from supersampler.frame import Float32, Frame, Size, checked_frame, checked_reset, checked_values
from supersampler.history import STATE_VERSION, History, State, Stats, StepResult
from supersampler.methods.at_rest import ADDED
from supersampler.methods.gbuffers import GBUFFERS, arrays_by_name, black
from supersampler.model import Model, ModelStep, Plan
from supersampler.validation import FrameChecker

if TYPE_CHECKING:
    import wgpu

    from supersampler.recording.recorder import Recorder

    _DeviceImage: TypeAlias = wgpu.GPUTexture | wgpu.GPUBuffer

_Names = tuple[str, *tuple[str, ...]]
"""At least one name: then the result is a StepResult."""
_Out = Float32 | StepResult


class Preset(NamedTuple):
    """Arguments of `Upscaler` that a preset sets."""

    model: str
    precision: Precision


PRESETS: Mapping[PresetName, Preset] = {
    "fast": Preset("taau", "auto"),
    "balanced": Preset("classifier-small", "auto"),
    "high": Preset("classifier", "auto"),
}
"""Settings on the Pareto frontier of run time and error (docs/pareto.md), selected by `bench pareto`."""


class CameraState(NamedTuple):
    """State between frames. It is replaced as a whole, so an interrupted step changes all of it or nothing.

    Attributes:
        display_size: (width, height) of the images; with `scale`, None before the first frame.
        checker: checks of the frames so far; never changed.
        history: history for the next frame; None at the start or after a reset.
        spare: the previous history; the next step writes to its buffers.
        shaded: history from which unshaded frames are extrapolated.
        stats: see `Upscaler.stats`.
    """

    display_size: Size | None
    checker: FrameChecker
    history: History | None = None
    spare: History | None = None
    shaded: ShadedHistory | None = None
    stats: Stats = Stats()


class Upscaler:
    """Upscales the frames of one camera, in order, to anti-aliased images at display size.

    >>> upscaler = Upscaler(display_size=(1920, 1080))
    >>> for frame in shot:
    ...     image = upscaler.step(frame)  # (1080, 1920, 3) float32, linear RGB

    Two threads must not use it at once; several Upscalers may share one Model and step in parallel.

    Args:
        model: a `Model`, the name of a shipped one, or a model folder; None is "classifier".
        display_size: (width, height) of the images.
        scale: display size over the first frame's render size, rounded to pixels; instead of `display_size`.
        render_size: (width, height) of the frames, which may have other sizes later. `warm_up` needs it; with
            `scale` it fixes the display size before the first frame.
        providers, threads, precision: see `Model.load`; not with a `Model`.
        executor: see `Model.load`; "auto" with a `Model`. "onnx" runs extrapolation in ONNX Runtime, too; on
            the GPU, "guided-warp" runs on the device of the model.
        at_rest: "converge": where nothing moves or changes, the image converges to the mean of one jitter
            period of samples, and is then frozen. "accumulate", for path tracers: where only noise changes,
            all samples are averaged without limit. "off": images depend on recent frames only, which chunks
            of a shot need; methods that do not converge always behave like this.
        skip: whether the CPU and GPU backends may skip frozen tiles. The images are the same, bit for bit.
        preset: "fast", "balanced" or "high" instead of `model` and `precision`: Pareto-optimal settings of
            time and error (docs/pareto.md).
        extrapolation: model for `extrapolate`, which computes the colour of unshaded frames: "guided-warp",
            "guided-flow", or a model folder. It uses the providers and threads of `model`. None disables
            `extrapolate`.
        validate: "warn" checks the pixels of the first frames after a start or reset and warns of likely
            mistakes, "strict" checks every frame and raises, "off" checks only shapes and types.
        record: a new folder to which all calls are recorded until `close`, for `supersampler replay`.

    Attributes:
        model: the model in use.
        at_rest, skip: as given.
        gbuffers: names of the G-buffers that frames must have; see `ModelInfo.gbuffers`.

    Raises:
        ArgumentError: sizes are missing, or arguments contradict each other.
        ModelError, ProviderError: see `Model.load`.
        RecordingError: the folder already exists or cannot be written. Any call may raise it before it
            changes anything; later calls are then not recorded.
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
        display_size = None if display_size is None else arguments.checked_size("display_size", display_size)
        self._scale = 1.0 if scale is None else arguments.checked_scale(scale)
        self._render_size = (
            None if render_size is None else arguments.checked_size("render_size", render_size)
        )
        if display_size is None and self._render_size is not None:
            display_size = display_size_of(self._render_size, self._scale)
        record = None if record is None else arguments.checked_path("record", record)
        self.at_rest = arguments.checked_choice("at_rest", at_rest, get_args(AtRest))
        self.skip = arguments.checked_flag("skip", skip)
        model, precision = preset_model(preset, model, precision)
        if isinstance(model, Model):
            words = {"providers": providers, "executor": executor, "precision": precision}
            given = [name for name, word in words.items() if not (isinstance(word, str) and word == "auto")]
            given += ["threads"] * (arguments.as_index(threads) != 0)
            if given:
                raise ArgumentError(" and ".join(given), got="set with a Model", want="set in Model.load")
            self.model = model
        else:
            self.model = Model.load(
                model, providers=providers, threads=threads, executor=executor, precision=precision
            )
        validate = arguments.checked_choice("validate", validate, get_args(Validate))
        self._new_checker = partial(FrameChecker, validate, converges=self.model.info.converges)
        self._camera = CameraState(display_size, self._new_checker())
        self._extrapolator: Extrapolator | None = None
        self._on_extrapolated, infos = self.model, [self.model.info]
        if extrapolation is not None:
            self._on_extrapolated = self.model.on_extrapolated
            self._extrapolator = extrapolator_beside(self.model, extrapolation, executor)
            infos += [self._on_extrapolated.info, self._extrapolator.info]
        inputs = list(dict.fromkeys(tensor.name for info in infos for tensor in info.inputs))
        self.gbuffers = tuple(name for name in inputs if name in GBUFFERS)
        self._closed = False
        self._recorder: Recorder | None = None
        if record is not None:  # imports image files, which a session without a recording does not need
            from supersampler.recording import recorder

            self._recorder = recorder.Recorder(
                record, self.model, infos[2:], inputs, display_size=display_size, scale=self._scale,
                at_rest=self.at_rest, skip=self.skip, validate=validate,
            )  # fmt: skip

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
        """Return the memory and the multiply-adds that an Upscaler needs, without allocating it.

        >>> plan = Upscaler.plan((960, 540), (1920, 1080))  # render size, display size
        >>> megabytes = plan.history_bytes / 1e6

        Sizes are (width, height). See `Model.load` for the other arguments; a `Model` has its own `plan`.

        Raises:
            FrameError: the method does not support this ratio.
            ModelError, ProviderError, ArgumentError: see `Model.load`.
        """
        sizes = (
            arguments.checked_size("render_size", render_size),
            arguments.checked_size("display_size", display_size),
        )
        loaded = Model.load(
            model, providers=providers, threads=threads, executor=executor, precision=precision
        )
        return loaded.plan(*sizes)

    @property
    def display_size(self) -> Size | None:
        """(width, height) of the images; with `scale`, None before the first frame."""
        return self._camera.display_size

    def display_size_for(self, render_size: Size) -> Size:
        """Return `display_size`; before the first frame, that of a first frame of this size."""
        return self._camera.display_size or display_size_of(render_size, self._scale)

    @property
    def stats(self) -> Stats:
        """Counts and times of all steps so far."""
        stats = self._camera.stats
        return stats if self._closed else replace(stats, converged=self.model.converged(self._camera.history))

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., outputs: tuple[()] = ()) -> Float32: ...

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., outputs: _Names) -> StepResult: ...

    @overload
    def step(self, frame: Frame, *, out: Float32 | None = ..., outputs: Collection[str]) -> _Out: ...

    @arguments.ieee_arithmetic
    def step(self, frame: Frame, *, out: Float32 | None = None, outputs: Collection[str] = ()) -> _Out:
        """Upscale the next frame.

        Args:
            frame: see `Frame`. Its render size may differ from the previous frame's; the history is kept.
            out: (H, W, 3) float32 to write the image to.
            outputs: names of further outputs to compute: "aovs", "ids", "class_map", "weight", "count",
                "converged"; see `StepResult`. A method may lack some. With "aovs" no tile is skipped; after a
                frame without "aovs" there is no AOV history, and after one without "ids" no id history.
                "ids" needs the CPU library, with any executor.

        Returns:
            (H, W, 3) float32 linear RGB, finite and >= 0, in the units of `frame.color`; `out` if given.
            With `outputs`, a `StepResult` with this image.

        Raises:
            FrameError: the frame breaks the contract. The history is unchanged; continue with the next frame,
                which needs `reset` if this one had it.
            ArgumentError: `out` has a wrong shape or type, or the method has no such output.
        """
        outputs = self._checked_call(frame, outputs)
        with self._recorded("step", frame, outputs) as results:
            shaded = self._after_shaded(frame)
            self._upscale(self.model, frame, frame, shaded, out, outputs, results)
        return results[0] if outputs else results[0].image

    @overload
    @staticmethod
    def step_many(
        upscalers: "Sequence[Upscaler]",
        frames: Sequence[Frame],
        *,
        out: Sequence[Float32 | None] | Float32 | None = ...,
        outputs: tuple[()] = (),
    ) -> list[Float32]: ...

    @overload
    @staticmethod
    def step_many(
        upscalers: "Sequence[Upscaler]",
        frames: Sequence[Frame],
        *,
        out: Sequence[Float32 | None] | Float32 | None = ...,
        outputs: _Names,
    ) -> list[StepResult]: ...

    @staticmethod
    @arguments.ieee_arithmetic
    def step_many(
        upscalers: "Sequence[Upscaler]",
        frames: Sequence[Frame],
        *,
        out: Sequence[Float32 | None] | Float32 | None = None,
        outputs: Collection[str] = (),
    ) -> list[Float32] | list[StepResult]:
        """Upscale the next frame of each of several cameras, as for robot simulators, stereo and thumbnails.

        >>> model = Model.load("taau")
        >>> cameras = [Upscaler(model, display_size=(256, 256)) for _ in range(16)]
        >>> images = Upscaler.step_many(cameras, frames)  # frames[k] is the next frame of cameras[k]

        Each Upscaler keeps its own history, size, resets and stats, and may also `step` alone. The images are
        the same as by `step`, bit for bit. The CPU backend computes one view per thread, which is faster for
        small images; other backends compute the views in sequence.

        Args:
            upscalers: different Upscalers of one Model, one for each view.
            frames: the next frame of each view.
            out: (H, W, 3) float32 arrays to write the images to, one for each view (None: a new one), or one
                array (N, H, W, 3).
            outputs: see `step`; the same for all views.

        Returns:
            The result of `step` for each view. `Stats.seconds` of a view grows by the wall time of the call
            divided by the number of views.

        Raises:
            FrameError: the frame of a view breaks the contract; `FrameError.view` says which. All histories
                are unchanged.
            ArgumentError: see `step`; or the sequences differ in length, the Upscalers have different Models,
                one of them is given twice, or an array of `out` shares memory with another view.
        """
        started = time.perf_counter()
        upscalers, frames = _checked_views(upscalers, frames, out)
        steps, following, names = [], [], arguments.checked_names("outputs", outputs)
        for view, (upscaler, frame) in enumerate(zip(upscalers, frames, strict=True)):
            try:
                upscaler._checked_call(frame, names)
                target = None if out is None else out[view]
                step, checker = upscaler._checked_step(upscaler.model, frame, frame, target, names)
                steps.append(step)
                following.append((checker, upscaler._after_shaded(frame)))
            except (FrameError, ArgumentError) as error:
                error.name_view(view)
                raise
        _check_apart(out, frames)
        with ExitStack() as recordings:
            recorded = [
                recordings.enter_context(upscaler._recorded("step", frame, names))
                for upscaler, frame in zip(upscalers, frames, strict=True)
            ]
            made = upscalers[0].model.run_checked(steps)
            seconds = (time.perf_counter() - started) / len(steps)
            cameras = [
                upscaler._advanced(step.history, next_history, seconds, *after, stages)
                for upscaler, step, after, (_, next_history, stages) in zip(
                    upscalers, steps, following, made, strict=True
                )
            ]
            _store(upscalers, cameras, recorded, [result for result, *_ in made])
        return [result if names else result.image for [result] in recorded]  # type: ignore[return-value]

    @overload
    def extrapolate(
        self, frame: Frame, *, out: Float32 | None = ..., outputs: tuple[()] = ...
    ) -> Float32: ...

    @overload
    def extrapolate(self, frame: Frame, *, out: Float32 | None = ..., outputs: _Names) -> StepResult: ...

    @overload
    def extrapolate(self, frame: Frame, *, out: Float32 | None = ..., outputs: Collection[str]) -> _Out: ...

    @arguments.ieee_arithmetic
    def extrapolate(self, frame: Frame, *, out: Float32 | None = None, outputs: Collection[str] = ()) -> _Out:
        """Upscale the next frame, which was not shaded: the last shaded frame provides the colour.

        Shaded and unshaded frames may alternate in any order. Shaded frames go to `step`, and must also have
        the G-buffers of the extrapolation. Motion points to the previous frame, shaded or not. The jitter
        index counts shaded frames: `halton_jitter(index // 2, ratio)` if every second frame is shaded.

        >>> upscaler = Upscaler(display_size=(1920, 1080), extrapolation="guided-warp")
        >>> image = upscaler.step(shaded) if is_shaded else upscaler.extrapolate(without_color)

        The frame has no colour, and has the G-buffers of the extrapolation and of the method. See `step` for
        the other arguments and the result.

        Raises:
            FrameError: see `step`; or the frame has colour, or is the first after a start or a reset.
            ArgumentError: see `step`; or the Upscaler has no `extrapolation`.
        """
        outputs = self._checked_call(frame, outputs)
        with self._recorded("extrapolate", frame, outputs) as results:
            if self._extrapolator is None:
                hint = "Upscaler(extrapolation='guided-warp') takes frames that were not shaded."
                raise ArgumentError("extrapolation", got=None, want="a model", hint=hint)
            started = time.perf_counter()
            color, shaded = self._extrapolator.extrapolate(frame, self._camera.shaded)
            took = time.perf_counter() - started
            model, shaded_frame = self._on_extrapolated, replace(frame, color=color)
            self._upscale(model, frame, shaded_frame, shaded, out, outputs, results, took)
        return results[0] if outputs else results[0].image

    @arguments.ieee_arithmetic
    def step_computed(self, frame: Frame, color: Float32, *, outputs: Collection[str] = ()) -> _Out:
        """Upscale the next frame, which was not shaded, with a colour that the caller has computed.

        As with `extrapolate`, the colour is not added to the means of static pixels. The call cannot be
        recorded. Requires no `extrapolation`.

        Args:
            frame: the frame, without colour.
            color: (h, w, 3) float32 linear RGB.
            outputs: see `step`.

        Raises:
            FrameError: see `step`; or the frame has colour.
            ArgumentError: see `step`; or calls are recorded, or the Upscaler has an `extrapolation`.
        """
        outputs = self._checked_call(frame, outputs)
        if self._recorder is not None:
            raise ArgumentError("record", got="given", want="None, as computed colours are not recorded")
        if frame.color is not None:
            hint = "`step` takes shaded frames."
            raise FrameError("color", got=frame.color.shape, want="None, as it is computed", hint=hint)
        # the motion since the last shaded frame would lack that of this frame
        self._check_no_extrapolation("step_computed", "`extrapolate` takes frames without colour.")
        shaded_frame, model = replace(frame, color=color), self.model.on_extrapolated
        results: list[StepResult] = []
        self._upscale(model, frame, shaded_frame, None, None, outputs, results)
        return results[0] if outputs else results[0].image

    @arguments.ieee_arithmetic
    def step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        pre_exposure: float = 1.0,
        reset: bool = False,
        out: Tensor | None = None,
    ) -> Tensor:
        """Upscale the next frame on the provider's device, without copying images to or from the CPU.

        >>> image = upscaler.step_tensors({"color": c, "depth": d, "motion": m}, jitter=(x, y))
        >>> image = torch.from_dlpack(image)

        Requires executor="onnx", and no `extrapolation`. Pixels are not validated.

        Args:
            tensors: inputs by name, as contiguous float32 tensors with DLPack (torch, CuPy, JAX): "color"
                (1, 3, h, w), "depth" (1, 1, h, w), "motion" (1, 2, h, w), optionally "reactive" (1, 1, h, w),
                and the method's G-buffers (docs/contract.md).
            jitter: see `Frame`.
            exposure: see `Frame`.
            pre_exposure: see `Frame`.
            reset: see `Frame`.
            out: (1, 3, H, W) to write the image to; None allocates it.

        Returns:
            (1, 3, H, W) linear RGB on the device; `out` if given.

        Raises:
            FrameError: a tensor is missing, or has an unknown name or a wrong type, shape or device. The
                history is unchanged.
            ArgumentError: the executor does not accept tensors, the Upscaler has an `extrapolation`, or `out`
                has a wrong type, shape or device.
        """
        self._check_open()
        tensors, reset = checked_tensors(tensors), checked_reset(reset)
        jitter, exposure, pre_exposure = checked_values(jitter, exposure, pre_exposure)
        recorded: AbstractContextManager[list[Tensor]] = nullcontext([])
        if self._recorder is not None:
            recorded = self._recorder.step_tensors(
                tensors, jitter=jitter, exposure=exposure, pre_exposure=pre_exposure, reset=reset
            )
        with recorded as results:
            started = time.perf_counter()
            self._check_no_extrapolation("step_tensors")
            history = self._history(size_of_tensors(tensors), reset=reset)
            image, next_history = self.model.run_tensors(
                tensors, history, jitter=jitter, exposure=exposure, pre_exposure=pre_exposure, out=out,
                history_out=self._camera.spare, adds_samples=ADDED[self.at_rest],
            )  # fmt: skip
            camera = self._advanced(history, next_history, time.perf_counter() - started, self._new_checker())
            _store([self], [camera], [results], [image])
        return image

    @arguments.ieee_arithmetic
    def step_textures(
        self,
        images: Mapping[str, "_DeviceImage"],
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        pre_exposure: float = 1.0,
        reset: bool = False,
        render_size: Size | None = None,
        out: "_DeviceImage | None" = None,
        aovs: "Sequence[_DeviceImage]" = (),
        aovs_out: "Sequence[_DeviceImage]" = (),
    ) -> "_DeviceImage":
        """Upscale the next frame on the GPU, without copying images to or from the CPU.

        >>> model = Model.load("classifier", executor="gpu", device=device)
        >>> upscaler = Upscaler(model, display_size=(1920, 1080))
        >>> image = upscaler.step_textures({"color": c, "depth": d, "motion": m}, jitter=(x, y))

        The commands are submitted to the device's queue; nothing waits for them. Requires executor="gpu", and
        no `extrapolation`. Pixels are not validated.

        Args:
            images: images by name, on the model's device, in the units of `Frame`: "color" (RGB), "depth"
                (R), "motion" (RG), optionally "reactive" (R). Either textures of a float format, with one
                sample and TEXTURE_BINDING, or buffers of float32, with STORAGE: the arrays of a `Frame`, row
                by row. G-buffers that the method reads are textures in either case, by the names of the
                contract: "gbuffer_normal", "gbuffer_display_depth".
            jitter: see `Frame`.
            exposure: see `Frame`.
            pre_exposure: see `Frame`.
            reset: see `Frame`.
            render_size: (width, height) of the frame: of buffers, or of the part of larger textures that was
                rendered, from the upper left. None is the size of the textures.
            out: where to write the image: a texture rgba16float with STORAGE_BINDING, or a buffer of float32
                (H, W, 3) with STORAGE; None allocates a texture.
            aovs: AOVs to blend: textures, whose four channels are blended each, or one buffer of float32
                (h, w, k); of the kind of `images`, which then hold "depth" for any method. The number of
                channels may change after a reset. After a frame without AOVs there is no AOV history.
            aovs_out: where to write them: a texture rgba16float with STORAGE_BINDING for each texture, or one
                buffer of float32 (H, W, k) with COPY_DST.

        Returns:
            The image, linear RGB; `out` if given.

        Raises:
            FrameError: an image is missing, or has an unknown name or a wrong format, size, usage or device.
                The history is unchanged.
            DeviceError: the device failed. The history is unchanged unless the message says that it is lost.
            ArgumentError: the executor is not "gpu", or `out` or `aovs_out` has a wrong format, size, usage
                or device.
        """
        camera, gpu = self._camera, self.model.gpu
        encoder = gpu.device.create_command_encoder()
        image = self.encode_into(
            encoder, images, jitter=jitter, exposure=exposure, pre_exposure=pre_exposure, reset=reset,
            render_size=render_size, out=out, aovs=aovs, aovs_out=aovs_out,
        )  # fmt: skip
        try:
            gpu.submit(encoder)
        except BaseException:
            self._camera = camera
            raise
        return image

    def encode_into(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        images: Mapping[str, "_DeviceImage"],
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        pre_exposure: float = 1.0,
        reset: bool = False,
        render_size: Size | None = None,
        out: "_DeviceImage | None" = None,
        aovs: "Sequence[_DeviceImage]" = (),
        aovs_out: "Sequence[_DeviceImage]" = (),
    ) -> "_DeviceImage":
        """Encode `step_textures` into a command encoder, for engines that submit their own commands.

        The next call continues from this frame: submit frames in order, each once. Call `reset` if an encoder
        is not submitted. See `step_textures` for arguments, result and errors.
        """
        from supersampler.backends.gpu import frame as gpu_frame  # other backends do not need it

        self._check_open()
        started, gpu = time.perf_counter(), self.model.gpu
        self._check_no_extrapolation("step_textures")
        if self._recorder is not None:
            hint = "Recordings hold arrays: use `step`."
            raise ArgumentError(
                "step_textures", got="called while recording", want="one of the two", hint=hint
            )
        gpu_frame.check_encoder(encoder, gpu.device)
        names = [tensor.name for tensor in self.model.info.inputs]
        size = None if render_size is None else arguments.checked_size("render_size", render_size)
        read = [*names, "depth"] if aovs else names  # motion is dilated by depth
        may_be_larger = size is not None
        given, size = gpu_frame.checked_images(images, read, size, self.display_size_for, gpu.device)
        reset = checked_reset(reset)
        values = checked_values(jitter, exposure, pre_exposure)
        display = self.display_size_for(size)
        blended = gpu_frame.checked_aovs(
            aovs, aovs_out, size, display, gpu.device,
            in_textures=gpu_frame.is_texture(given["color"]), may_be_larger=may_be_larger,
        )  # fmt: skip
        image = gpu.new_image(display) if out is None else gpu_frame.checked_target(out, display, gpu.device)
        gpu_frame.check_apart([image, *aovs_out], [*given.values(), *aovs])
        history = self._history(size, reset=reset)
        next_history = self.model.encode(
            encoder, gpu_frame.DeviceFrame(given, size, *values, blended), history, image, self._camera.spare,
            adds_samples=ADDED[self.at_rest], skip=self.skip,
        )  # fmt: skip
        self._camera = self._advanced(
            history, next_history, time.perf_counter() - started, self._new_checker()
        )
        return image

    def reset(self) -> None:
        """Drop the history, as `Frame.reset` does."""
        self._check_open()
        if self._recorder is not None:
            self._recorder.reset()
        self._camera = self._camera._replace(history=None, shaded=None, checker=self._new_checker())

    @arguments.ieee_arithmetic
    def warm_up(self, render_size: Size | None = None) -> None:
        """Step on a black frame, so that the first `step` is fast; the history is unchanged.

        Raises:
            ArgumentError: `render_size` is missing here and in the constructor.
        """
        self._check_open()
        size = arguments.checked_size(
            "render_size", self._render_size if render_size is None else render_size
        )
        display_size = self.display_size_for(size)
        frame = black(self.gbuffers, size, display_size)
        if self._extrapolator is not None:
            self._extrapolator.extrapolate(replace(frame, color=None), self._extrapolator.after_shaded(frame))
        history = self.model.first_history(display_size, size)
        _, spare = self.model.run(frame, history)
        if self._on_extrapolated is not self.model:
            self._on_extrapolated.run(frame, history)
        if self._camera.spare is None:  # the first step then writes to memory that is already mapped
            self._camera = self._camera._replace(spare=spare)

    def save_state(self) -> State:
        """Copy the history. An Upscaler that loads it computes the same images from then on, bit for bit."""
        self._check_open()
        history, shaded = self._camera.history, self._camera.shaded
        if history is None:
            return State(self.model.info.method, self.display_size, None, None)
        saved_shaded = None
        if self._extrapolator is not None and shaded is not None:
            saved_shaded = self._extrapolator.save(shaded)
        sizes = history.display_size, history.render_size
        return State(self.model.info.method, *sizes, self.model.save_history(history), saved_shaded)

    def load_state(self, state: State) -> None:
        """Continue from `state`. If it has no shaded frame, `step` one before `extrapolate`.

        A state from before the first frame drops the history, as `reset` does.

        Raises:
            ArgumentError: the state has another method, extrapolation or display size. The history is
                unchanged.
        """
        self._check_open()
        if not isinstance(state, State):
            raise ArgumentError("state", got=shown(state), want="a State, as `save_state` returns it")
        state = self._checked_state(state)
        history = None
        if state.history is not None and state.display_size and state.render_size:
            history = self.model.load_history(state.display_size, state.render_size, state.history)
        shaded = None
        if self._extrapolator is not None and state.shaded is not None:
            shaded = self._extrapolator.load(state.shaded)
        if self._recorder is not None:
            self._recorder.load_state(state)
        display, checker = state.display_size or self.display_size, self._new_checker()
        self._camera = CameraState(display, checker, history, None, shaded, self.stats)

    def close(self) -> None:
        """Free the history and end the recording; all later calls except `close` raise ArgumentError."""
        self._camera = CameraState(self.display_size, self._new_checker(), stats=self.stats)
        self._closed = True
        if self._recorder is not None:
            self._recorder.close()

    def __reduce__(self) -> NoReturn:
        """Refuse copying and pickling, because two Upscalers must not share one history."""
        hint = "Make a new Upscaler and load the history: `new.load_state(old.save_state())`."
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
        """Record the step of a `with` block, which appends the result to the list, if there is a recorder."""
        return nullcontext([]) if self._recorder is None else self._recorder.step(call, frame, outputs)

    def _upscale(
        self,
        model: Model,
        given: Frame,
        frame: Frame,
        shaded: ShadedHistory | None,
        out: Float32 | None,
        outputs: Collection[str],
        results: list[StepResult],
        extrapolation_seconds: float | None = None,
    ) -> None:
        """Step on `frame`, which is `given`, or `given` with an extrapolated colour; append to `results`."""
        started = time.perf_counter()
        step, checker = self._checked_step(model, given, frame, out, outputs)
        [(result, next_history, stages)] = model.run_checked([step])
        seconds = time.perf_counter() - started
        camera = self._advanced(
            step.history, next_history, seconds, checker, shaded, stages, extrapolation_seconds
        )
        _store([self], [camera], [results], [result])

    def _checked_step(
        self, model: Model, given: Frame, frame: Frame, out: Float32 | None, outputs: Collection[str]
    ) -> tuple[ModelStep, FrameChecker]:
        """Check the arguments of `_upscale`; return those of `Model.run_checked`, and the next checker."""
        display = self.display_size_for(frame.size)
        history = None if frame.reset else self._camera.history
        # before anything is allocated for a frame that may be refused
        model.check(frame, display, outputs, history, out)
        checker = copy(self._camera.checker)  # the step may fail, or that of another view
        checker.check(given, display, self.gbuffers)
        history = self._history(frame.size, reset=frame.reset)
        adds_samples = 0.0 if given.color is None else ADDED[self.at_rest]
        step = ModelStep(frame, history, outputs, out, self._camera.spare, adds_samples, self.skip)
        return step, checker

    def _after_shaded(self, frame: Frame) -> ShadedHistory | None:
        """Return the history from which unshaded frames after this one are extrapolated."""
        if self._extrapolator is None or frame.color is None:
            return None
        return self._extrapolator.after_shaded(frame, self._camera.shaded)

    def _history(self, render_size: Size, *, reset: bool) -> History:
        """Return the history that a step on a frame of this size reads."""
        if self._camera.history is None or reset:
            return self.model.first_history(self.display_size_for(render_size), render_size)
        return self._camera.history

    def _advanced(
        self,
        history: History,
        next_history: History,
        seconds: float,
        checker: FrameChecker,
        shaded: ShadedHistory | None = None,
        stages: Mapping[str, float] | None = None,
        extrapolation_seconds: float | None = None,
    ) -> CameraState:
        """Return the state after a step that read `history` and took `seconds`, and its checker."""
        stats, sums = self._camera.stats, dict(self._camera.stats.stages)
        for name, spent in (stages or {}).items():
            sums[name] = sums.get(name, 0.0) + spent
        stats = replace(
            stats,
            frames=stats.frames + 1,
            extrapolated=stats.extrapolated + (extrapolation_seconds is not None),
            resets=stats.resets + (history is not self._camera.history),
            seconds=stats.seconds + seconds,
            extrapolation_seconds=stats.extrapolation_seconds + (extrapolation_seconds or 0.0),
            stages=sums,
        )
        return CameraState(next_history.display_size, checker, next_history, history, shaded, stats)

    def _checked_call(self, frame: Frame, outputs: Collection[str]) -> tuple[str, ...]:
        """Check the arguments that a recording stores; return the names of the outputs."""
        self._check_open()
        checked_frame(frame)
        return arguments.checked_names("outputs", outputs)

    def _check_open(self) -> None:
        if self._closed:
            raise ArgumentError("upscaler", got="closed", want="open", hint="Make a new one.")

    def _check_no_extrapolation(
        self, call: str, hint: str = "Extrapolation takes arrays only: use `step`."
    ) -> None:
        if self._extrapolator is not None:
            raise ArgumentError(call, got="called with extrapolation", want="one of the two", hint=hint)

    def _checked_state(self, state: State) -> State:
        """Return a state with Python's text and numbers, where files may hold numpy's.

        Its arrays are not checked.

        Raises:
            ArgumentError: it does not fit this Upscaler.
        """
        version = getattr(state, "version", None)
        if arguments.as_index(version) != STATE_VERSION:
            hint = "Load it with the version of supersampler that saved it, or start without a state."
            raise ArgumentError("state", got=f"of version {version!r}", want=f"{STATE_VERSION}", hint=hint)
        method = self.model.info.method
        if state.method != method:
            raise ArgumentError("state", got=f"of {state.method!r}", want=f"of {method!r}")
        display, render = (
            None if size is None else arguments.checked_size(f"state.{name}", size)
            for name, size in (("display_size", state.display_size), ("render_size", state.render_size))
        )
        if None not in (self.display_size, display) and self.display_size != display:
            raise ArgumentError("state", got=f"at {display}", want=f"at {self.display_size}")
        if state.history is not None and None in (display, render):
            want = "both with a history"
            raise ArgumentError("state", got="without display_size or render_size", want=want)
        return replace(state, method=method, display_size=display, render_size=render, version=STATE_VERSION)


def _store(
    upscalers: Sequence[Upscaler],
    cameras: Sequence[CameraState],
    recorded: Sequence[list[Any]],
    results: Sequence[Any],
) -> None:
    """Store the states after steps, and append the results to the lists that are recorded: all or nothing.

    No signal handler runs inside a call that executes no bytecode.
    """
    states = map(setattr, upscalers, repeat("_camera"), cameras)
    deque(chain(states, map(list.append, recorded, results)), maxlen=0)


def _checked_views(
    upscalers: Sequence[Upscaler], frames: Sequence[Frame], out: Sequence[Float32 | None] | Float32 | None
) -> tuple[list[Upscaler], list[Frame]]:
    """Return Upscalers and frames of `step_many`; raise ArgumentError unless they belong together."""
    for name, given in (("upscalers", upscalers), ("frames", frames), ("out", () if out is None else out)):
        if not hasattr(given, "__len__"):
            raise ArgumentError(name, got=shown(given), want="a sequence, one for each view")
    upscalers, frames = list(upscalers), list(frames)
    if not upscalers:
        raise ArgumentError("upscalers", got="empty", want="an Upscaler for each view")
    for name, count in (("frames", len(frames)), ("out", len(upscalers) if out is None else len(out))):
        if count != len(upscalers):
            raise ArgumentError(name, got=f"of length {count}", want=f"{len(upscalers)}, one for each view")
    for view, upscaler in enumerate(upscalers):
        name = f"upscalers[{view}]"
        if not isinstance(upscaler, Upscaler):
            raise ArgumentError(name, got=shown(upscaler), want="an Upscaler")
        if upscaler.model is not upscalers[0].model:
            hint = "Load it once: model = Model.load(...), then Upscaler(model, ...) for each view."
            raise ArgumentError(name, got="of another Model", want="that of upscalers[0]", hint=hint)
        if upscaler in upscalers[:view]:
            want = "an Upscaler of its own for each view"
            raise ArgumentError(name, got=f"upscalers[{upscalers.index(upscaler)}]", want=want)
    return upscalers, frames


def _check_apart(out: Sequence[Float32 | None] | Float32 | None, frames: Sequence[Frame]) -> None:
    """Raise ArgumentError where the image of a view is in memory that another view reads or writes."""
    if out is None:
        return
    arrays = [(view, "image", image) for view, image in enumerate(out) if image is not None]
    images = slice(len(arrays))
    for view, frame in enumerate(frames):
        arrays += [(view, "frame", array) for array in arrays_by_name(frame).values()]
    low, high = np.array([byte_bounds(array) for _, _, array in arrays]).T
    for place, index in np.argwhere((low[images, None] < high) & (low < high[images, None])).tolist():
        (view, _, image), (other, kind, array) = arrays[place], arrays[index]
        if other != view and np.shares_memory(image, array):
            want = "memory that no other view reads or writes"
            error = ArgumentError("out", got=f"memory of the {kind} of view {other}", want=want)
            error.name_view(view)
            raise error


def preset_model(
    preset: PresetName | None, model: Model | str | Path | None, precision: Precision
) -> tuple[Model | str | Path, Precision]:
    """Return the given model and precision, or those of the preset.

    Raises:
        ArgumentError: a value is unknown, or a preset is given together with a value that it sets.
    """
    precision = arguments.checked_choice("precision", precision, get_args(Precision))
    if preset is None:
        return "classifier" if model is None else model, precision
    arguments.checked_choice("preset", preset, get_args(PresetName))
    if model is not None or precision != "auto":
        got = f"{preset!r} with a model or a precision"
        raise ArgumentError("preset", got=got, want="either a preset, or a model and a precision")
    return PRESETS[preset]
