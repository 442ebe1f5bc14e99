"""`DeviceSteps`: the calls of an `Upscaler` that take and return images in memory of a device."""

import time
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

from supersampler.arguments import checked_size, ieee_arithmetic
from supersampler.backends.gpu.device_frame import DeviceFrame, check_encoder, checked_images, checked_target
from supersampler.backends.onnx.tensors import Tensor, checked_tensors, size_of_tensors
from supersampler.conventions.jitter import display_size_of
from supersampler.errors import ArgumentError
from supersampler.extrapolation import Extrapolator
from supersampler.frame import (
    Size,
    checked_exposure,
    checked_jitter,
    checked_pre_exposure,
    checked_reset,
)
from supersampler.methods.at_rest import ADDED
from supersampler.model import AtRest, Model
from supersampler.state import Memory

if TYPE_CHECKING:
    import wgpu

    from supersampler.recording.recorder import Recorder


class DeviceSteps:
    """Base of `Upscaler`; its attributes are those of it."""

    model: Model
    at_rest: AtRest
    skip: bool
    _memory: Memory
    _scale: float
    _closed: bool
    _extrapolator: Extrapolator | None
    _recorder: "Recorder | None"

    @ieee_arithmetic
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
        """Upscale the next frame on the provider's device, without copies of images to or from the CPU.

        >>> image = upscaler.step_tensors({"color": c, "depth": d, "motion": m}, jitter=(x, y))
        >>> image = torch.from_dlpack(image)

        Requires executor="onnx", and no `extrapolation`. Pixels are not validated.

        Args:
            tensors: inputs by name, as float32 contiguous tensors with DLPack (torch, CuPy, JAX): "color"
                (1, 3, h, w), "depth" (1, 1, h, w), "motion" (1, 2, h, w), and the method's G-buffers; see
                docs/contract.md. "reactive" (1, 1, h, w) may be missing.
            jitter: see `Frame`.
            exposure: see `Frame`.
            pre_exposure: see `Frame`.
            reset: see `Frame`.
            out: (1, 3, H, W) to write the image to; None allocates it.

        Returns:
            (1, 3, H, W) linear RGB on the device; `out` if given.

        Raises:
            FrameError: a tensor is missing, or has a wrong type, shape or device. The history is unchanged.
            ModelError: the provider cannot capture the step. The history is unchanged.
            ArgumentError: the executor does not accept tensors, or the Upscaler has an `extrapolation`.
        """
        self._check_open()
        tensors, reset = checked_tensors(tensors), checked_reset(reset)
        pre_exposure = checked_pre_exposure(pre_exposure)
        recorded: AbstractContextManager[list[Tensor]] = nullcontext([])
        if self._recorder is not None:
            recorded = self._recorder.step_tensors(tensors, jitter, exposure, pre_exposure, reset)
        with recorded as results:
            started, memory = time.perf_counter(), self._memory
            self._check_device_step("step_tensors")
            size, kept = size_of_tensors(tensors), None if reset else memory.history
            display = memory.display_size or display_size_of(size, self._scale)
            history = self.model.first_history(display, size) if kept is None else kept
            image, next_history = self.model.run_tensors(
                tensors, history, jitter=jitter, exposure=exposure, pre_exposure=pre_exposure, out=out,
                history_out=memory.spare, adds_samples=ADDED[self.at_rest],
            )  # fmt: skip
            stats = memory.stats.after_step(fresh=kept is None, seconds=time.perf_counter() - started)
            self._memory = Memory(display, next_history, history, None, stats)
            results.append(image)
        return image

    @ieee_arithmetic
    def step_textures(
        self,
        images: Mapping[str, "wgpu.GPUTexture | wgpu.GPUBuffer"],
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        pre_exposure: float = 1.0,
        reset: bool = False,
        render_size: Size | None = None,
        out: "wgpu.GPUTexture | wgpu.GPUBuffer | None" = None,
    ) -> "wgpu.GPUTexture | wgpu.GPUBuffer":
        """Upscale the next frame on the GPU, without copies of images to or from the CPU.

        >>> model = Model.load("classifier", executor="gpu", device=device)
        >>> upscaler = Upscaler(model, display_size=(1920, 1080))
        >>> image = upscaler.step_textures({"color": c, "depth": d, "motion": m}, jitter=(x, y))

        The commands are submitted to the device's queue; nothing waits for them. Requires executor="gpu", and
        no `extrapolation`. Pixels are not validated.

        Args:
            images: by name, of the model's device, in the units of `Frame`. Textures of a float format, with
                TEXTURE_BINDING: "color" (RGB), "depth" (R), "motion" (RG), "reactive" (R), which may be
                missing. Or buffers of float32, with STORAGE: the arrays of a `Frame`, row by row.
            jitter: see `Frame`.
            exposure: see `Frame`.
            pre_exposure: see `Frame`.
            reset: see `Frame`.
            render_size: (width, height) of buffers; textures have theirs.
            out: to write the image to: a texture rgba16float with STORAGE_BINDING, or a buffer of float32
                (H, W, 3) with STORAGE; None allocates a texture.

        Returns:
            The image, linear RGB; `out` if given.

        Raises:
            FrameError: an image is missing, or has a wrong format, size, usage or device. The history is
                unchanged.
            DeviceError: the device failed. The history is unchanged unless the message says that it is lost.
            ArgumentError: the executor has no textures, or `out` is not as described.
        """
        encoder = self.model.gpu.device.create_command_encoder()
        image = self.encode_into(
            encoder, images, jitter=jitter, exposure=exposure, pre_exposure=pre_exposure, reset=reset,
            render_size=render_size, out=out,
        )  # fmt: skip
        self.model.gpu.device.queue.submit([encoder.finish()])
        return image

    def encode_into(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        images: Mapping[str, "wgpu.GPUTexture | wgpu.GPUBuffer"],
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        pre_exposure: float = 1.0,
        reset: bool = False,
        render_size: Size | None = None,
        out: "wgpu.GPUTexture | wgpu.GPUBuffer | None" = None,
    ) -> "wgpu.GPUTexture | wgpu.GPUBuffer":
        """Encode `step_textures` into a command encoder, for engines that submit by themselves.

        The next call continues from this frame: submit frames in order, each once. Call `reset` after an
        encoder that is not submitted. Arguments, result and errors are those of `step_textures`.
        """
        self._check_open()
        started, memory, gpu = time.perf_counter(), self._memory, self.model.gpu
        self._check_device_step("step_textures", recorded=False)
        check_encoder(encoder, gpu.device)
        names = [tensor.name for tensor in self.model.info.inputs]
        size = None if render_size is None else checked_size("render_size", render_size)
        given, size = checked_images(images, names, size, gpu.device)
        kept = None if checked_reset(reset) else memory.history
        display = memory.display_size or display_size_of(size, self._scale)
        values = checked_jitter(jitter), checked_exposure(exposure), checked_pre_exposure(pre_exposure)
        frame = DeviceFrame(given, size, *values)
        image = gpu.new_image(display) if out is None else checked_target(out, display, gpu.device)
        history = self.model.first_history(display, size) if kept is None else kept
        adds_samples = ADDED[self.at_rest]
        next_history = self.model.encode(
            encoder, frame, history, image, memory.spare, adds_samples=adds_samples, skip=self.skip
        )
        stats = memory.stats.after_step(fresh=kept is None, seconds=time.perf_counter() - started)
        self._memory = Memory(display, next_history, history, None, stats)
        return image

    def _check_device_step(self, name: str, *, recorded: bool = True) -> None:
        """Raise ArgumentError where this Upscaler takes arrays alone."""
        if self._extrapolator is not None:
            hint = "Extrapolation takes arrays alone: use `step`."
            raise ArgumentError(name, got="called with extrapolation", want="neither", hint=hint)
        if self._recorder is not None and not recorded:
            hint = "Recordings hold arrays: use `step`."
            raise ArgumentError(name, got="called while recording", want="neither", hint=hint)

    def _check_open(self) -> None:
        if self._closed:
            raise ArgumentError("upscaler", got="closed", want="open", hint="Make a new one.")
