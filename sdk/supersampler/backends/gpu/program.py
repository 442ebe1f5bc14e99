"""`GpuProgram`: what a step of a method is on a GPU: passes, memory, weights. It needs no device."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

from numpy.typing import NDArray

from supersampler.backends.gpu.extents import DISPLAY, ONE, Extent, PixelBuffer, PixelMemory
from supersampler.backends.gpu.frame_inputs import frame_buffers
from supersampler.backends.gpu.history import HistoryLayout
from supersampler.backends.gpu.memory import MemorySpec
from supersampler.backends.gpu.shader import Constants, Shader, load_shader
from supersampler.frame import Size

ARRAYS = {"frame": "frame_arrays", "image": "image_array"}
TEXTURES = {"frame": "frame_textures", "image": "image_texture"}
"""Files that shaders import for frames and images in buffers, and in textures of the caller."""
PARTS = 256
"""Workgroups of the pass `measure`, and sums that `follow_exposure` adds up."""
AUX = ("weight", "converged")


class PassSpec(NamedTuple):
    """A pass of a method.

    Attributes:
        shader: name of its file.
        extent: size that its workgroups cover.
        tile: pixels that a workgroup computes.
        constants: of this pass, beside those of the method.
        names: of the resources of variables, where they differ.
        variants: files to import in place of a name.
    """

    shader: str
    extent: Extent = DISPLAY
    tile: tuple[int, int] = (16, 16)
    constants: Constants = MappingProxyType({})
    names: Mapping[str, str] = MappingProxyType({})
    variants: Mapping[str, str] = MappingProxyType({})


EXPOSURE_PASSES = (
    PassSpec("measure", Extent("one", multiply=(PARTS, 1)), (1, 1), {"parts": PARTS}),
    PassSpec("follow_exposure", ONE, (1, 1), {"parts": PARTS}),
)
"""The first passes of every method."""
EXPOSURE_MEMORY: Mapping[str, PixelMemory] = {"measured": PixelBuffer(8 * PARTS)}


@dataclass(frozen=True)
class GpuProgram:
    """What a step of a method is on a GPU.

    Attributes:
        layout: layout of the method's history.
        packages: with the method's shaders in their folders `shaders`, in the order of the search.
        constants: of the method, by name.
        method_passes: in order, after those of the exposure.
        method_memory: between these passes, by the names that shaders use.
        weights: of a network, by the names that shaders use; rows of four words.
        precision: of the network, or of all where there is none.
    """

    layout: HistoryLayout
    packages: Sequence[str]
    constants: Constants
    method_passes: Sequence[PassSpec]
    method_memory: Mapping[str, PixelMemory]
    weights: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    precision: str = "fp32"

    @property
    def passes(self) -> tuple[PassSpec, ...]:
        """All passes, in order."""
        return (*EXPOSURE_PASSES, *self.method_passes)

    @property
    def work(self) -> dict[str, PixelMemory]:
        """The memory between passes, by the names that shaders use."""
        return {**EXPOSURE_MEMORY, **self.method_memory}

    @property
    def outputs(self) -> dict[str, PixelMemory]:
        """Image and auxiliary outputs in buffers."""
        return {"image": PixelBuffer(12, DISPLAY), "aux": PixelBuffer(4 * len(AUX), DISPLAY)}

    def memory(self) -> dict[str, PixelMemory]:
        """Return all memory of a step with frame and image in buffers, without weights."""
        histories = {"history": self.layout.memory("previous"), "next": self.layout.memory("render")}
        return {
            **{f"{of}_{name}": memory for of, known in histories.items() for name, memory in known.items()},
            **frame_buffers(self.layout.spec.inputs),
            **self.work,
            **self.outputs,
        }

    def specs(self, render: Size, display: Size) -> dict[str, MemorySpec]:
        """Return `memory` at these sizes, after a frame of the same size."""
        return {name: memory.spec(render, display) for name, memory in self.memory().items()}

    def shader(self, spec: PassSpec, variants: Mapping[str, str]) -> Shader:
        """Return the shader of a pass for frames and images in buffers, or in textures."""
        constants = {**self.constants, **spec.constants}
        return load_shader(spec.shader, self.packages, constants, {**variants, **spec.variants})
