"""`GpuExecutor`: base class of the GPU backends of all methods."""

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import TILE
from supersampler.backends.gpu.device import default_device, raising, storage_limit
from supersampler.backends.gpu.device_frame import IMAGE_FORMAT, DeviceFrame, is_texture
from supersampler.backends.gpu.frame_inputs import FrameBuffers, step_params
from supersampler.backends.gpu.history import GpuHistory, HistoryLayout
from supersampler.backends.gpu.memory import Memory, Readback, buffer_of, image_of, uniform_of
from supersampler.backends.gpu.passes import Pass, Resource
from supersampler.backends.gpu.shader import Constants, load_shader
from supersampler.backends.locks import ForkSafeLock
from supersampler.errors import DeviceError
from supersampler.frame import Float32, Frame, Size

if TYPE_CHECKING:
    import wgpu

ARRAYS = {"frame": "frame_arrays", "image": "image_array"}
"""Files that shaders import for frames and images in buffers. In textures, they end in "_textures"."""
PARTS = 64
"""Workgroups of the pass `measure`."""
MOST_SIZES = 2
"""Sizes whose buffers are kept; dynamic resolution changes them often."""
AUX = ("weight", "converged")


class PassSpec(NamedTuple):
    """A pass of a method.

    Attributes:
        shader: name of its file.
        extent: size that its workgroups cover: "render", "display", "half", or another of `_extents`.
        tile: pixels that a workgroup computes.
        constants: of this pass, beside those of the method.
        names: of the resources of variables, where they differ.
    """

    shader: str
    extent: str = "display"
    tile: tuple[int, int] = (16, 16)
    constants: Constants = MappingProxyType({})
    names: Mapping[str, str] = MappingProxyType({})


@dataclass(eq=False)
class Space:
    """Buffers of a step for frames and images of one size.

    Attributes:
        frame: of the frame.
        memory: between passes, by the names that shaders use.
        image: (H, W, 3) float32, with the auxiliary outputs.
    """

    frame: FrameBuffers
    memory: dict[str, Memory]
    image: Readback
    aux: Readback


class GpuExecutor(ABC):
    """Base of the GPU executors; see `Executor`.

    Args:
        layout: layout of the method's history.
        package: of the method, with its shaders.
        constants: of the method, by name.
        passes: in order, after those of the exposure.
        device: to run on; None is that of the process.

    Raises:
        DeviceError: there is no device, or it does not compile a shader.
    """

    name = "gpu"
    precision = "fp32"

    def __init__(
        self,
        layout: HistoryLayout,
        package: str,
        constants: Constants,
        passes: Sequence[PassSpec],
        device: "wgpu.GPUDevice | None" = None,
    ) -> None:
        self.device = default_device() if device is None else device
        self._layout, self._package, self._constants = layout, package, constants
        first = PassSpec("measure", "parts", (1, 1)), PassSpec("follow_exposure", "one", (1, 1))
        self.pass_specs = (*first, *passes)
        self._compiled: dict[tuple[str, ...], list[Pass]] = {}
        self._spaces: OrderedDict[tuple[Size, Size], Space] = OrderedDict()
        self._lock = ForkSafeLock()  # of `_spaces` and of their buffers
        self._views: WeakKeyDictionary[Any, Resource] = WeakKeyDictionary()  # of textures of the caller
        self.passes(ARRAYS)

    @abstractmethod
    def _work_memory(self, render: Size, display: Size) -> dict[str, Memory]:
        """Allocate the buffers between the passes of a step, by the names that shaders use."""

    def _extents(self, render: Size, display: Size) -> dict[str, Size]:
        """Return the sizes that passes cover, by name."""
        half = (display[0] + 1) // 2, (display[1] + 1) // 2
        return {"one": (1, 1), "parts": (PARTS, 1), "render": render, "display": display, "half": half}

    def passes(self, variants: Mapping[str, str]) -> list[Pass]:
        """Return the compiled passes for frames and images in buffers, or in textures."""
        key = tuple(variants.values())
        if key not in self._compiled:
            with raising(self.device, "compiling shaders"):
                self._compiled[key] = [
                    Pass(self.device, self._shader(spec, variants), spec.tile, spec.names)
                    for spec in self.pass_specs
                ]
        return self._compiled[key]

    def _shader(self, spec: PassSpec, variants: Mapping[str, str]) -> Any:
        constants = {**self._constants, **spec.constants}
        return load_shader(spec.shader, [self._package], constants, variants)

    def zeros(self, display: Size, render: Size) -> GpuHistory:
        """See `Executor`."""
        with raising(self.device, f"allocating a history of {display}"):
            return GpuHistory(self.device, self._layout, display, render)

    def fits(self, buffers: GpuHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return buffers.fits(display, render)

    def step(
        self,
        frame: Frame,
        display: Size,
        history: GpuHistory,
        next_history: GpuHistory,
        image: Float32,
        aux_outputs: Collection[str],
        *,
        tolerance: float | None,  # noqa: ARG002  # every pixel is computed
        adds_samples: bool,
    ) -> Mapping[str, Float32]:
        """See `Executor`."""
        render, wanted = frame.size, [name for name in AUX if name in aux_outputs]
        with self._lock.lock, raising(self.device, f"in a step to {display}"):
            space = self._space(render, display)
            space.frame.write(frame)
            params = step_params(
                render,
                frame.jitter,
                frame.exposure,
                history,
                adds_samples=adds_samples,
                writes_aux=bool(wanted),
            )
            inputs = {name: memory.resource for name, memory in space.frame.memory.items()}
            encoder = self.device.create_command_encoder()
            resources = {**inputs, "image": space.image.buffer}
            self._encode(encoder, ARRAYS, params, history, next_history, resources, space)
            space.image.encode(encoder)
            if wanted:
                space.aux.encode(encoder)
            self.device.queue.submit([encoder.finish()])
            space.image.copy_to(image)
            if not wanted:
                return {}
            values = np.empty((*image.shape[:2], len(AUX)), np.float32)
            space.aux.copy_to(values)
            return {name: np.ascontiguousarray(values[None, None, ..., AUX.index(name)]) for name in wanted}

    def encode(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        frame: DeviceFrame,
        history: GpuHistory,
        next_history: GpuHistory,
        image: Any,
        *,
        adds_samples: bool,
    ) -> None:
        """Encode a step on a frame in textures or buffers of this device.

        Args:
            encoder: of this device.
            frame: the frame, checked.
            history: history after the previous frame; not changed.
            next_history: written to; not `history`.
            image: texture or buffer to write to, checked.
            adds_samples: see `Executor.step`.
        """
        variants = {
            "frame": "frame_textures" if frame.in_textures else "frame_arrays",
            "image": "image_texture" if is_texture(image) else "image_array",
        }
        display = history.display
        params = step_params(frame.size, frame.jitter, frame.exposure, history, adds_samples=adds_samples)
        with self._lock.lock, raising(self.device, f"encoding a step to {display}"):
            space = self._space(frame.size, display)
            unread = {name: memory.resource for name, memory in space.frame.memory.items()}
            inputs = {f"frame_{name}": self._resource(given) for name, given in frame.images.items()}
            inputs["image"] = self._resource(image)
            self._encode(encoder, variants, params, history, next_history, {**unread, **inputs}, space)

    def new_image(self, display: Size) -> "wgpu.GPUTexture":
        """Allocate a texture for an image."""
        with raising(self.device, f"allocating an image of {display}"):
            return image_of(self.device, display, IMAGE_FORMAT)

    def _resource(self, given: Any) -> Resource:
        """Return what a bind group takes for a texture or buffer of the caller."""
        if not is_texture(given):
            return given
        if given not in self._views:
            self._views[given] = given.create_view()
        return self._views[given]

    def _encode(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        variants: Mapping[str, str],
        params: Float32,
        history: GpuHistory,
        next_history: GpuHistory,
        inputs: Mapping[str, Resource],
        space: Space,
    ) -> None:
        """Encode all passes; `inputs`: the frame and the image, by the names that shaders use."""
        render = int(params[0]), int(params[1])
        next_history.jitter = float(params[6]), float(params[7])
        resources: dict[str, Resource] = {
            "params": uniform_of(self.device, params),
            "aux": space.aux.buffer,
            **{name: memory.resource for name, memory in space.memory.items()},
            **{f"history_{name}": memory.resource for name, memory in history.memory.items()},
            **{f"next_{name}": memory.resource for name, memory in next_history.memory.items()},
            **inputs,
        }
        extents = self._extents(render, history.display)
        compute = encoder.begin_compute_pass()
        for spec, one in zip(self.pass_specs, self.passes(variants), strict=True):
            one.encode(compute, resources, extents[spec.extent])
        compute.end()

    def _space(self, render: Size, display: Size) -> Space:
        key = render, display
        if key not in self._spaces:
            while len(self._spaces) >= MOST_SIZES:
                self._spaces.popitem(last=False)
            self._spaces[key] = self._new_space(render, display)
        self._spaces.move_to_end(key)
        return self._spaces[key]

    def _new_space(self, render: Size, display: Size) -> Space:
        pixels, shape = display[0] * display[1], (display[1], display[0])
        if 12 * pixels > storage_limit(self.device):
            most = storage_limit(self.device) // 12
            raise DeviceError(
                f"an image of {display} needs {12 * pixels} bytes in one binding; the device's limit is "
                f"{storage_limit(self.device)}: at most {most} pixels"
            )
        parts = {"measured": buffer_of(self.device, 8 * PARTS), "rising": buffer_of(self.device, 4)}
        return Space(
            FrameBuffers(self.device, self._layout.spec.inputs, render),
            {**parts, **self._work_memory(render, display)},
            Readback(self.device, (*shape, 3)),
            Readback(self.device, (*shape, len(AUX))),
        )

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        with self._lock.lock:
            history, space = self.zeros(display, render), self._new_space(render, display)
        working = (*space.frame.memory.values(), *space.memory.values())
        return _bytes_of(history.memory.values()), _bytes_of(working) + space.image.bytes + space.aux.bytes

    def note_stages(self) -> Mapping[str, float]:
        """See `Executor`."""
        return {}

    def tensor(self, buffers: GpuHistory, name: str) -> Float32:
        """See `Executor`."""
        with self._lock.lock, raising(self.device, f"reading {name}"):
            return buffers.tensor(name)

    def load(self, buffers: GpuHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        with self._lock.lock, raising(self.device, "loading a history"):
            buffers.load(tensors)

    def memory(self, buffers: GpuHistory) -> Mapping[str, NDArray[Any]]:  # noqa: ARG002  # has none
        """See `Executor`."""
        return {}

    def work(self, buffers: GpuHistory, display: Size) -> Float32:  # noqa: ARG002  # constant
        """See `Executor`."""
        return np.ones([-(-extent // TILE) for extent in display[::-1]], np.float32)

    def resting(self, buffers: GpuHistory) -> float | None:  # noqa: ARG002  # every pixel is computed
        """See `Executor`."""
        return None


def _bytes_of(memories: Iterable[Memory]) -> int:
    return sum(memory.bytes for memory in memories)
