"""`GpuExecutor`: runs the passes of a method on a device."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import ForkSafeLock, StepReport, StepRequest
from supersampler.backends.gpu import frame as gpu_frame
from supersampler.backends.gpu import memory as gpu
from supersampler.backends.gpu.aovs import AovPasses
from supersampler.backends.gpu.device import default_device, raising
from supersampler.backends.gpu.history import SIGNATURES, GpuHistory
from supersampler.backends.gpu.passes import Pass, Resource
from supersampler.backends.gpu.program import ARRAYS, AUX, TEXTURES, GpuProgram, PassSpec
from supersampler.errors import DeviceError
from supersampler.frame import Float32, Size

if TYPE_CHECKING:
    import wgpu

MAX_SIZES = 2
"""Pairs of render and display size whose buffers are kept; dynamic resolution changes them often."""


@dataclass(eq=False)
class StepBuffers:
    """Buffers of a step for one render size and one display size.

    Attributes:
        params: see `step_params`.
        memory: frame and intermediate memory, by the names that shaders use.
        image: (H, W, 3) float32.
        aux: (H, W, 2) float32, the auxiliary outputs AUX.
    """

    params: "wgpu.GPUBuffer"
    memory: dict[str, gpu.Memory]
    image: gpu.Readback
    aux: gpu.Readback

    @property
    def resources(self) -> dict[str, Resource]:
        """Resources for bind groups, by the names that shaders use."""
        memory = {name: memory.resource for name, memory in self.memory.items()}
        return {"params": self.params, "image": self.image.buffer, "aux": self.aux.buffer, **memory}


class GpuExecutor:
    """Runs a method as compute shaders; see `Executor`.

    Raises:
        DeviceError: there is no device, or it does not compile a shader.
    """

    name = "gpu"

    def __init__(self, program: GpuProgram, device: "wgpu.GPUDevice | None" = None) -> None:
        self.device = default_device() if device is None else device
        self.program, self.precision = program, program.precision
        self._compiled: dict[tuple[str, ...], list[Pass]] = {}
        self._aovs = AovPasses(self.device)
        self._buffers: OrderedDict[tuple[Size, Size], StepBuffers] = OrderedDict()
        self._lock = ForkSafeLock()  # of `_buffers` and of their buffers
        self.passes(ARRAYS)
        self.weights: dict[str, gpu.Memory] = {}
        for name, words in program.weights.items():
            self.weights[name] = gpu.allocate(self.device, gpu.PixelBuffer(words.nbytes))
            gpu.write_to(self.device, self.weights[name], words)

    def passes(self, variants: Mapping[str, str]) -> list[Pass]:
        """Return the compiled passes for frames and images in buffers, or in textures."""
        key = tuple(variants.values())
        if key not in self._compiled:
            with raising(self.device, "compiling shaders"), ThreadPoolExecutor() as threads:

                def compiled(spec: PassSpec) -> Pass:
                    return Pass(self.device, self.program.shader(spec, variants), spec.tile, spec.names)

                longest_first = reversed(self.program.passes)
                self._compiled[key] = [*threads.map(compiled, longest_first)][::-1]
        return self._compiled[key]

    def zeros(self, display: Size, render: Size) -> GpuHistory:
        """See `Executor`."""
        with raising(self.device, f"allocating a history of {display}"):
            return GpuHistory(self.device, self.program.layout, display, render)

    def fits(self, buffers: GpuHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return (buffers.display, buffers.render) == (display, render)

    def step_many(self, steps: Sequence[StepRequest]) -> list[StepReport]:
        """See `Executor`."""
        return [self._step(request) for request in steps]

    def _step(self, request: StepRequest) -> StepReport:
        frame, display, history, next_history, image, aux_outputs, adds_samples, skip = request
        render, names = frame.size, [name for name in AUX if name in aux_outputs]
        blends_aovs = "aovs" in aux_outputs
        with self._lock.lock, raising(self.device, f"in a step to {display}"):
            buffers = self._buffers_for(render, display)
            gpu_frame.upload_frame(self.device, buffers.memory, frame, self.program.layout.spec.inputs)
            aovs, inputs = None, {}
            if blends_aovs:
                aovs, inputs["frame_depth"] = self._aovs.upload(frame)
            params = gpu_frame.step_params(
                frame, history.display, history.render, has_reactive=frame.reactive is not None,
                adds_samples=adds_samples, writes_aux=bool(names) or blends_aovs, skip=skip,
            )  # fmt: skip
            encoder = self.device.create_command_encoder()
            self._encode(encoder, ARRAYS, params, history, next_history, inputs, buffers, aovs)
            buffers.image.encode(encoder)
            if names:
                buffers.aux.encode(encoder)
            self.device.queue.submit([encoder.finish()])
            buffers.image.copy_to(image)
            outputs = {"aovs": next_history.tensor("aovs")} if blends_aovs else {}
            if names:
                values = np.empty((*image.shape[:2], len(AUX)), np.float32)
                buffers.aux.copy_to(values)
                outputs |= {
                    name: np.ascontiguousarray(values[None, None, ..., AUX.index(name)]) for name in names
                }
            return StepReport(outputs)

    def encode(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        frame: gpu_frame.DeviceFrame,
        history: GpuHistory,
        next_history: GpuHistory,
        image: Any,
        *,
        adds_samples: float,
        skip: bool = True,
    ) -> None:
        """Encode a step on a frame in textures or buffers of this device.

        Encoder, frame and image are checked; see `StepRequest` for `adds_samples` and `skip`.
        """
        kinds = {"frame": frame.in_textures, "image": gpu_frame.is_texture(image)}
        variants = {name: (TEXTURES if kind else ARRAYS)[name] for name, kind in kinds.items()}
        params = gpu_frame.step_params(
            frame, history.display, history.render, has_reactive="reactive" in frame.images,
            adds_samples=adds_samples, writes_aux=frame.aovs is not None, skip=skip,
        )  # fmt: skip
        with self._lock.lock, raising(self.device, f"encoding a step to {history.display}"):
            buffers = self._buffers_for(frame.size, history.display)
            inputs = {f"frame_{name}": image for name, image in frame.images.items()}
            if frame.in_textures and "reactive" not in frame.images:
                inputs["frame_reactive"] = self._no_mask
            inputs["image"] = image
            self._encode(encoder, variants, params, history, next_history, inputs, buffers, frame.aovs)

    def submit(self, encoder: "wgpu.GPUCommandEncoder") -> None:
        """Submit encoded steps to the device's queue."""
        with raising(self.device, "submitting a step"):
            self.device.queue.submit([encoder.finish()])

    @cached_property
    def _no_mask(self) -> Resource:
        """A texture to bind in place of a missing reactive mask; no shader reads it."""
        return gpu.new_texture(self.device, (1, 1), gpu_frame.IMAGE_FORMAT)

    def new_image(self, display: Size) -> "wgpu.GPUTexture":
        """Allocate a texture for an image."""
        with raising(self.device, f"allocating an image of {display}"):
            return gpu.new_texture(self.device, display, gpu_frame.IMAGE_FORMAT)

    def _encode(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        variants: Mapping[str, str],
        params: Float32,
        history: GpuHistory,
        next_history: GpuHistory,
        inputs: Mapping[str, Resource],
        buffers: StepBuffers,
        aovs: gpu_frame.DeviceAovs | None,
    ) -> None:
        """Encode all passes; `inputs` are the caller's images, which replace those of `buffers`."""
        blended = None if aovs is None else self._aovs.room(aovs.channels, next_history)
        is_second = next_history.follow(history)
        params[gpu_frame.SKIPS] *= 1.0 + is_second
        render = int(params[0]), int(params[1])
        resources: dict[str, Resource] = {
            **buffers.resources,
            **{name: memory.resource for name, memory in self.weights.items()},
            **{f"history_{name}": memory.resource for name, memory in history.memory.items()},
            **{f"next_{name}": memory.resource for name, memory in next_history.memory.items()},
            **inputs,
        }
        next_history.aovs = blended
        if not is_second and SIGNATURES in history.memory and history.render == next_history.render:
            # a step writes those of its own phase and of the previous step's
            source, target = (one.memory[SIGNATURES].resource for one in (history, next_history))
            encoder.copy_buffer_to_buffer(source, 0, target, 0, target.size)
        gpu.encode_write(self.device, encoder, buffers.params, params)
        groups = next_history.groups.setdefault(history, {})
        compute = encoder.begin_compute_pass()
        for spec, one in zip(self.program.passes, self.passes(variants), strict=True):
            one.encode(compute, resources, spec.extent.size(render, history.display), groups)
        compute.end()
        if aovs is not None:
            self._aovs.encode(encoder, aovs, history, next_history, render, variants, resources)

    def _buffers_for(self, render: Size, display: Size) -> StepBuffers:
        key = render, display
        if key not in self._buffers:
            while len(self._buffers) >= MAX_SIZES:
                self._buffers.popitem(last=False)
            self._buffers[key] = self._new_buffers(render, display)
        self._buffers.move_to_end(key)
        return self._buffers[key]

    def _new_buffers(self, render: Size, display: Size) -> StepBuffers:
        size, limit = 12 * display[0] * display[1], self.device.limits["max-storage-buffer-binding-size"]
        if size > limit:
            raise DeviceError(
                f"an image of {display} needs {size} bytes in one binding; the device's limit is {limit}: "
                f"at most {limit // 12} pixels"
            )
        memory = {**gpu_frame.frame_memory(self.program.layout.spec.inputs), **self.program.work}
        return StepBuffers(
            gpu.allocate(self.device, gpu.PixelBuffer(4 * gpu_frame.PARAMS)).resource,
            {name: gpu.allocate(self.device, each, render, display) for name, each in memory.items()},
            gpu.Readback(self.device, (*display[::-1], 3)),
            gpu.Readback(self.device, (*display[::-1], len(AUX))),
        )

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        sizes = {name: m.total_bytes(render, display) for name, m in self.program.memory().items()}
        history = sum(size for name, size in sizes.items() if name.startswith("next_"))
        working = sum(size for name, size in sizes.items() if not name.startswith(("history_", "next_")))
        return history, working + sizes["image"] + sizes["aux"]  # the CPU maps copies of these two

    def tensor(self, buffers: GpuHistory, name: str) -> Float32:
        """See `Executor`."""
        with self._lock.lock, raising(self.device, f"reading {name}"):
            return buffers.tensor(name)

    def load(self, buffers: GpuHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        with self._lock.lock, raising(self.device, "loading a history"):
            buffers.load(tensors)
