"""`GpuProgram`: passes, memory and weights of a method's step on a GPU, and the passes that methods share."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

from numpy.typing import NDArray

from supersampler.backends.gpu import memory as gpu
from supersampler.backends.gpu.frame import frame_memory
from supersampler.backends.gpu.history import PHASE_TABLE, HistoryLayout, HistoryPlane, of_plane
from supersampler.backends.gpu.shader import Constants, Shader, load_shader
from supersampler.methods.at_rest import TILE

ARRAYS = {"frame": "frame_arrays", "image": "image_array"}
TEXTURES = {"frame": "frame_textures", "image": "image_texture"}
"""Files that shaders import for frames and images in buffers, and in textures of the caller."""
PARTS = 256
"""Workgroups of the pass `measure`, and sums that `follow_frame` adds up."""
AUX = ("weight", "converged")


class PassSpec(NamedTuple):
    """A pass of a method.

    Attributes:
        shader: name of its file.
        extent: size that its workgroups cover.
        tile: pixels that a workgroup computes.
        constants: constants of this pass, in addition to the method's.
        names: resource of each variable that has another name than its resource.
        variants: file to import in place of each name.
        static: variables of resources that it accesses only where blocks are static.
        at_rest: variables of resources that it accesses where the whole frame is frozen, and the previous one
            was, too; None: all.
    """

    shader: str
    extent: gpu.SizeRule = gpu.DISPLAY
    tile: tuple[int, int] = (16, 16)
    constants: Constants = MappingProxyType({})
    names: Mapping[str, str] = MappingProxyType({})
    variants: Mapping[str, str] = MappingProxyType({})
    static: Collection[str] = ()
    at_rest: Collection[str] | None = None

    @property
    def title(self) -> str:
        """Name of its shader, with the level if it has one."""
        return f"{self.shader} {self.constants['level']}" if "level" in self.constants else self.shader


MEASURE = PassSpec("measure", gpu.SizeRule("one", multiply=(PARTS, 1)), (1, 1), {"parts": PARTS})
FOLLOW = PassSpec("follow_frame", gpu.ONE, (1, 1), {"parts": PARTS})
"""The first two passes of every method."""


@dataclass(frozen=True)
class GpuProgram:
    """Passes, memory and weights of a method's step on a GPU, independent of a device.

    Attributes:
        layout: layout of the method's history.
        packages: packages whose folders `shaders` are searched, in this order.
        constants: constants of the method, by name.
        method_passes: the method's passes in order, which follow MEASURE and FOLLOW.
        method_memory: memory between these passes, by the names that shaders use.
        weights: weights of a network, by the names that shaders use; rows of four words.
        precision: precision of the network, or of all passes without a network.
    """

    layout: HistoryLayout
    packages: Sequence[str]
    constants: Constants
    method_passes: Sequence[PassSpec]
    method_memory: Mapping[str, gpu.PixelMemory]
    weights: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    precision: str = "fp32"

    @property
    def passes(self) -> tuple[PassSpec, ...]:
        """All passes, in order."""
        phases = "phases" if PHASE_TABLE in self.layout.planes else "no_phases"
        return MEASURE, FOLLOW._replace(variants={"phases": phases}), *self.method_passes

    @property
    def work(self) -> dict[str, gpu.PixelMemory]:
        """Memory between passes, by the names that shaders use."""
        return {"measured": gpu.PixelBuffer(8 * PARTS), **self.method_memory}

    @property
    def outputs(self) -> dict[str, gpu.PixelMemory]:
        """Image and auxiliary outputs in buffers."""
        return {"image": gpu.PixelBuffer(12, gpu.DISPLAY), "aux": gpu.PixelBuffer(4 * len(AUX), gpu.DISPLAY)}

    def memory(self) -> dict[str, gpu.PixelMemory]:
        """Return all memory of a step with frame and image in buffers, without weights."""
        return {
            **{f"history_{name}": memory for name, memory in self.layout.memory("previous").items()},
            **{f"next_{name}": memory for name, memory in self.layout.memory("render").items()},
            **frame_memory(self.layout.spec.inputs),
            **self.work,
            **self.outputs,
        }

    def shader(self, spec: PassSpec, variants: Mapping[str, str]) -> Shader:
        """Return the shader of a pass for frames and images in buffers, or in textures."""
        constants = {**self.constants, **spec.constants}
        return load_shader(spec.shader, self.packages, constants, {**variants, **spec.variants})


SHOWS_STATIC = "history_mean", "next_mean", "next_phases", "frame_color"
"""`PassSpec.static` of a pass that shows the mean of static pixels."""
SHOWS_FROZEN = "next_tiles", "history_mean", "image"
"""`PassSpec.at_rest` of a pass that shows frozen pixels."""
SIDE = 16
"""Side of a workgroup of `preprocess`, samples."""
TILES = gpu.SizeRule("display", TILE)
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
FRAME_MEMORY: Mapping[str, gpu.PixelMemory] = {
    "awake": gpu.PixelBuffer(4),
    "block_marks": gpu.PixelBuffer(4, gpu.BLOCKS),
    "block_sums": gpu.PixelBuffer(48, gpu.BLOCKS),
    "block_states": gpu.PixelTexture(gpu.BLOCKS, "rg32uint"),
    "samples": gpu.PixelTexture(gpu.RENDER, "rgba16float"),
    "dilated": gpu.PixelTexture(gpu.RENDER, "rg32uint"),
    "light": gpu.PixelBuffer(8, gpu.SizeRule("render", SIDE)),
}
"""Memory that `frame_passes` write for later passes, in addition to the history."""


def frame_passes(surface: str) -> tuple[PassSpec, ...]:
    """Return the passes that find static blocks and frozen tiles, and preprocess the samples.

    `surface`, "depth" or "occluding", selects the property of samples that the last pass stores.
    """
    blocks = "next_state", "block_marks", "history_blocks", "history_signatures", "next_signatures"
    return (
        PassSpec(
            "compare_blocks",
            gpu.BLOCKS,
            (4, 4),
            static=("history_mean", "frame_color", "block_sums"),
            at_rest=(*blocks, "frame_color", "frame_motion"),
        ),
        PassSpec(
            "decide_blocks",
            gpu.BLOCKS,
            (8, 8),
            static=("history_mean", "history_signatures", "next_signatures", "block_sums"),
            at_rest=(*blocks, "next_blocks", "block_states", "awake"),
        ),
        PassSpec("rest_tiles", TILES, (8, 8)),
        PassSpec(
            "preprocess",
            gpu.RENDER,
            (SIDE, SIDE),
            variants={"surface": f"surface_{surface}"},
            static=("history_surface",),
            at_rest=("next_state",),
        ),
    )
