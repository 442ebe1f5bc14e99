"""`GpuProgram`: passes, memory and weights of a method's step on a GPU, and the passes that methods share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

from numpy.typing import NDArray

from supersampler.backends.gpu.frame import frame_buffers
from supersampler.backends.gpu.history import PHASE_TABLE, HistoryLayout, HistoryPlane, of_plane
from supersampler.backends.gpu.memory import (
    BLOCKS,
    DISPLAY,
    ONE,
    RENDER,
    MemorySpec,
    PixelBuffer,
    PixelMemory,
    PixelTexture,
    SizeRule,
)
from supersampler.backends.gpu.shader import Constants, Shader, load_shader
from supersampler.frame import Size
from supersampler.methods import at_rest

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
        constants: constants of this pass, beside those of the method.
        names: names of the resources of variables, where they differ.
        variants: files to import in place of a name.
    """

    shader: str
    extent: SizeRule = DISPLAY
    tile: tuple[int, int] = (16, 16)
    constants: Constants = MappingProxyType({})
    names: Mapping[str, str] = MappingProxyType({})
    variants: Mapping[str, str] = MappingProxyType({})

    @property
    def title(self) -> str:
        """Name of its shader; with its level, where a method has it several times."""
        return f"{self.shader} {self.constants['level']}" if "level" in self.constants else self.shader


MEASURE = PassSpec("measure", SizeRule("one", multiply=(PARTS, 1)), (1, 1), {"parts": PARTS})
FOLLOW = PassSpec("follow_frame", ONE, (1, 1), {"parts": PARTS})
"""The first passes of every method."""
EXPOSURE_MEMORY: Mapping[str, PixelMemory] = {"measured": PixelBuffer(8 * PARTS)}


@dataclass(frozen=True)
class GpuProgram:
    """Passes, memory and weights of a method's step on a GPU; it needs no device.

    Attributes:
        layout: layout of the method's history.
        packages: packages with the method's shaders in their folders `shaders`, in the order of the search.
        constants: constants of the method, by name.
        method_passes: method passes in order, after those of the whole frame.
        method_memory: between these passes, by the names that shaders use.
        weights: weights of a network, by the names that shaders use; rows of four words.
        precision: precision of the network, or of all where there is none.
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
        phases = "phases" if PHASE_TABLE in self.layout.planes else "no_phases"
        return MEASURE, FOLLOW._replace(variants={"phases": phases}), *self.method_passes

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


SIDE = 16
"""Samples of a workgroup of `preprocess` in either direction."""
BLOCK_PASSES = (
    PassSpec("compare_blocks", BLOCKS, (4, 4)),
    PassSpec("decide_blocks", BLOCKS, (8, 8)),
)
"""Passes that find static blocks. They read the frame, the exposure and the history, nothing else."""
TILES = SizeRule("display", at_rest.TILE)
TILE_PASS = PassSpec("rest_tiles", TILES, (8, 8))
REST_PLANES = {
    "mean": HistoryPlane("static_mean"),
    "blocks": HistoryPlane("static_blocks"),
    "signatures": HistoryPlane("signatures", 4, None),
    "phases": HistoryPlane("phases"),
}
REST_CHANNELS = {
    "static_mean": of_plane("mean", 0, 1, 2, 3),
    "static_blocks": of_plane("blocks", 0, 1, 2, 3),
    "signatures": of_plane("signatures", 0, 1, 2, 3),
    "phases": of_plane("phases", 0, 1, 2, 3),
}
REST_MEMORY: Mapping[str, PixelMemory] = {
    "awake": PixelBuffer(4),
    "block_sums": PixelBuffer(64, BLOCKS),
    "block_states": PixelTexture(BLOCKS, "rg32uint"),
}
"""Memory that BLOCK_PASSES write for later passes."""
TILE_MEMORY: Mapping[str, PixelMemory] = {"tiles": PixelBuffer(8, TILES)}
SAMPLE_MEMORY: Mapping[str, PixelMemory] = {
    "samples": PixelTexture(RENDER, "rgba16float"),
    "dilated": PixelTexture(RENDER, "rg32uint"),
    "light": PixelBuffer(8, SizeRule("render", SIDE)),
}
"""Memory that `preprocess` writes for later passes, beside the history."""


def preprocess(surface: str) -> PassSpec:
    """Return the pass on the samples of a frame; `surface`: what it stores of them, "depth" or "shade"."""
    return PassSpec("preprocess", RENDER, (SIDE, SIDE), variants={"surface": f"surface_{surface}"})
