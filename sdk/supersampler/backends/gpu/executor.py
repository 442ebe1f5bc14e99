"""`GpuExecutor`: base class of the GPU backends of all methods."""

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import TILE
from supersampler.backends.gpu.device import default_device, raising, storage_limit
from supersampler.backends.gpu.device_frame import IMAGE_FORMAT, DeviceFrame, is_texture
from supersampler.backends.gpu.frame_inputs import CHANNELS, PARAMS, frame_specs, step_params, write_frame
from supersampler.backends.gpu.history import GpuHistory, HistoryLayout
from supersampler.backends.gpu.memory import (
    BufferSpec,
    Memory,
    MemorySpec,
    Readback,
    allocate,
    encode_write,
    image_of,
    uniform_of,
)
from supersampler.backends.gpu.passes import Pass, Resource
from supersampler.backends.gpu.shader import Constants, load_shader
from supersampler.backends.locks import ForkSafeLock
from supersampler.errors import DeviceError
from supersampler.frame import Float32, Frame, Size

if TYPE_CHECKING:
    import wgpu

ARRAYS = {"frame": "frame_arrays", "image": "image_array"}
TEXTURES = {"frame": "frame_textures", "image": "image_texture"}
"""Files that shaders import for frames and images in buffers, and in textures of the caller."""
PARTS = 64
"""Workgroups of the pass `measure`."""
MOST_SIZES = 2
"""Sizes whose buffers are kept; dynamic resolution changes them often."""
AUX = ("weight", "converged")


class PassSpec(NamedTuple):
    """A pass of a method.

    Attributes:
        shader: name of its file.
        extent: size that its workgroups cover: "render", "display", "half", or another of `extents`.
        tile: pixels that a workgroup computes.
        constants: of this pass, beside those of the method.
        names: of the resources of variables, where they differ.
        variants: files to import in place of a name.
    """

    shader: str
    extent: str = "display"
    tile: tuple[int, int] = (16, 16)
    constants: Constants = MappingProxyType({})
    names: Mapping[str, str] = MappingProxyType({})
    variants: Mapping[str, str] = MappingProxyType({})


@dataclass(eq=False)
class Space:
    """Buffers of a step for frames and images of one size.

    Attributes:
        params: see `step_params`.
        memory: of the frame and between passes, by the names that shaders use.
        image: (H, W, 3) float32.
        aux: (H, W, 2) float32, the auxiliary outputs AUX.
    """

    params: "wgpu.GPUBuffer"
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

    Attributes:
        device: as given, or that of the process.
        pass_specs: all passes, in order.
        weights: of a network, by the names that shaders use.

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
        self.weights: dict[str, Memory] = {}
        self._compiled: dict[tuple[str, ...], list[Pass]] = {}
        self._spaces: OrderedDict[tuple[Size, Size], Space] = OrderedDict()
        self._lock = ForkSafeLock()  # of `_spaces` and of their buffers
        self._views: WeakKeyDictionary[Any, Resource] = WeakKeyDictionary()  # of textures of the caller
        self.passes(ARRAYS)

    @abstractmethod
    def work_specs(self, render: Size, display: Size) -> dict[str, MemorySpec]:
        """Return the memory between the passes of a step, by the names that shaders use."""

    def specs(self, render: Size, display: Size) -> dict[str, MemorySpec]:
        """Return all memory of a step, by the names that shaders use; without weights."""
        width, height = display
        history = self._layout.specs(display, render)
        return {
            **{f"history_{name}": spec for name, spec in history.items()},
            **{f"next_{name}": spec for name, spec in history.items()},
            **self._space_specs(render, display),
            "image": BufferSpec(12 * width * height),
            "aux": BufferSpec(4 * len(AUX) * width * height),
        }

    def _space_specs(self, render: Size, display: Size) -> dict[str, MemorySpec]:
        return {
            **frame_specs(self._layout.spec.inputs, render),
            "measured": BufferSpec(8 * PARTS),
            "rising": BufferSpec(4),
            **self.work_specs(render, display),
        }

    def extents(self, render: Size, display: Size) -> dict[str, Size]:
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
        return load_shader(spec.shader, [self._package], constants, {**variants, **spec.variants})

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
            write_frame(self.device, space.memory, frame, self._layout.spec.inputs)
            params = step_params(
                render,
                frame.jitter,
                frame.exposure,
                history,
                adds_samples=adds_samples,
                writes_aux=bool(wanted),
            )
            encoder = self.device.create_command_encoder()
            self._encode(encoder, ARRAYS, params, history, next_history, {"image": space.image.buffer}, space)
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
        kinds = {"frame": frame.in_textures, "image": is_texture(image)}
        variants = {name: (TEXTURES if kind else ARRAYS)[name] for name, kind in kinds.items()}
        display = history.display
        params = step_params(frame.size, frame.jitter, frame.exposure, history, adds_samples=adds_samples)
        with self._lock.lock, raising(self.device, f"encoding a step to {display}"):
            space = self._space(frame.size, display)
            given = {
                name: frame.images.get(name, frame.images["color"]) for name in CHANNELS
            }  # some are not read
            inputs = {f"frame_{name}": self._resource(image) for name, image in given.items()}
            inputs["image"] = self._resource(image)
            self._encode(encoder, variants, params, history, next_history, inputs, space)

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
        """Encode all passes; `inputs`: the image, and the frame unless it is in the buffers of `space`."""
        render = int(params[0]), int(params[1])
        next_history.jitter = float(params[6]), float(params[7])
        resources: dict[str, Resource] = {
            "params": space.params,
            "aux": space.aux.buffer,
            **{name: memory.resource for name, memory in (*self.weights.items(), *space.memory.items())},
            **{f"history_{name}": memory.resource for name, memory in history.memory.items()},
            **{f"next_{name}": memory.resource for name, memory in next_history.memory.items()},
            **inputs,
        }
        extents = self.extents(render, history.display)
        encode_write(self.device, encoder, space.params, params)
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
        specs = self._space_specs(render, display)
        return Space(
            uniform_of(self.device, 4 * PARAMS),
            {name: allocate(self.device, spec) for name, spec in specs.items()},
            Readback(self.device, (*shape, 3)),
            Readback(self.device, (*shape, len(AUX))),
        )

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        history = self._layout.specs(display, render)
        specs = self.specs(render, display)
        working = [spec.bytes for name, spec in specs.items() if not name.startswith(("history_", "next_"))]
        mapped = specs["image"].bytes + specs["aux"].bytes  # what the CPU reads
        return sum(spec.bytes for spec in history.values()), sum(working) + mapped

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
