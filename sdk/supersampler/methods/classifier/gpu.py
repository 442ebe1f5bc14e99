"""GPU backend of `classifier` and its relatives."""

from typing import TYPE_CHECKING

import numpy as np

from supersampler.backends.gpu.convergence import (
    CONVERGENCE_CHANNELS,
    CONVERGENCE_PASSES,
    CONVERGENCE_PLANES,
    preprocess,
    sample_specs,
)
from supersampler.backends.gpu.executor import GpuExecutor, PassSpec
from supersampler.backends.gpu.history import Codec, HistoryLayout, Packed, Plane, of_plane
from supersampler.backends.gpu.memory import BufferSpec, MemorySpec, TextureSpec, allocate, write_to
from supersampler.frame import Float32, Size
from supersampler.methods.classifier.gpu_network import CHUNK, read_gpu_network
from supersampler.methods.classifier.spec import CLASSES, CLASSIFIER, CONTRAST, FLASH_FRACTION, RISE, WHITE
from supersampler.methods.classifier.variant import Variant
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of

if TYPE_CHECKING:
    import wgpu

GLARE = 4.0
"""Added to a maximum in [0, 1] for each consecutive frame with glare: see ranges.wgsl."""
LEAST, MOST = 65535.0, 16383.0
TILES = ((16, 8), (8, 8), (8, 8), (4, 4))
"""Pixels of a workgroup at each level: its features fit into 16 KiB."""
ALIGNED = 8
"""The first level repeats its border up to a multiple of it."""


def _unpack_ranges(words: Packed) -> Float32:
    packed = words[..., 0]
    high = (packed >> 16 & 0x3FFF) / MOST + GLARE * (packed >> 30)
    return np.stack([(packed & 0xFFFF) / LEAST, high], -1).astype(np.float32)


def _pack_ranges(pixels: Float32) -> Packed:
    low, high = pixels[..., 0], pixels[..., 1]
    glare = np.clip(np.floor(high / GLARE + 0.5), 0.0, 3.0)
    most = np.clip(high - GLARE * glare, 0.0, 1.0)
    bits = [np.clip(low, 0.0, 1.0) * LEAST + 0.5, most * MOST + 0.5, glare]
    least, largest, frames = (part.astype(np.uint32) for part in bits)
    packed: Packed = least | largest << 16 | frames << 30
    return packed


def _unpack_classes(words: Packed) -> Float32:
    shares: Float32 = np.ascontiguousarray(words).view(np.uint8).astype(np.float32) / np.float32(255.0)
    return shares


def _pack_classes(pixels: Float32) -> Packed:
    rounded: Packed = (np.clip(pixels, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return rounded


LAYOUT = HistoryLayout(
    CLASSIFIER,
    {
        "pixels": Plane("color"),
        "ranges": Plane("state", 1, None, Codec(_unpack_ranges, _pack_ranges)),
        "classes": Plane("classes", 2, None, Codec(_unpack_classes, _pack_classes)),
        "surface": Plane("depth", 2, "rg32float"),
        **CONVERGENCE_PLANES,
    },
    {
        "color": of_plane("pixels", 0, 1, 2),
        "state": (("pixels", 3), ("ranges", 0), ("ranges", 1)),
        "classes": of_plane("classes", *range(CLASSES)),
        "depth": of_plane("surface", 0, 1),
        **CONVERGENCE_CHANNELS,
    },
)


class ClassifierGpu(GpuExecutor):
    """Runs `classifier` and its relatives; see `Executor`.

    Args:
        info: the model.
        device: to run on; None is that of the process.
    """

    precision = "int8"

    def __init__(self, info: ModelInfo, device: "wgpu.GPUDevice | None" = None) -> None:
        variant = Variant.of(info.config)
        network = read_gpu_network(info, variant)
        constants = {name: info.config[name] for name in constants_of(CLASSIFIER)}
        constants |= {"white": WHITE, "rise": RISE, "contrast": CONTRAST, "flash_fraction": FLASH_FRACTION}
        constants |= variant._asdict()
        blend = {
            "colors": variant.history_colors + 3,
            "sharpness_at": variant.sharpness,
            "kernel_at": variant.kernel_weights,
        }
        self._levels = [self._level(one, tile) for one, tile in zip(network.levels, TILES, strict=True)]
        passes = (
            preprocess("depth"), *CONVERGENCE_PASSES, PassSpec("gather"), *self._levels,
            PassSpec("compose", constants={**network.last, **blend}),
        )  # fmt: skip
        super().__init__(LAYOUT, "supersampler.methods.classifier", constants, passes, device)
        self.weights["network"] = allocate(self.device, BufferSpec(network.words.nbytes))
        write_to(self.device, self.weights["network"], network.words)

    @staticmethod
    def _level(constants: dict[str, int], tile: tuple[int, int]) -> PassSpec:
        level = constants["level"]
        across = {1: 1, 2: 2, 4: 2, 16: 4}[constants["kept"]]
        return PassSpec(
            "encode_pooled" if level else "encode_inputs",
            f"level{level}",
            tile,
            {**constants, "kept_across": across, "tile_x": tile[0], "tile_y": tile[1]},
            {"kept": f"kept{level}", "pooled": f"pooled{level}", "pooled_above": f"pooled{level - 1}"},
        )

    def extents(self, render: Size, display: Size) -> dict[str, Size]:
        """See `GpuExecutor`."""
        half = ((extent + 1) // 2 for extent in display)
        width, height = (-(-extent // ALIGNED) * ALIGNED for extent in half)
        levels = {f"level{level}": (width >> level, height >> level) for level in range(len(TILES))}
        return {**super().extents(render, display), **levels}

    def work_specs(self, render: Size, display: Size) -> dict[str, MemorySpec]:
        """See `GpuExecutor`."""
        extents = self.extents(render, display)
        half = extents["half"][0] * extents["half"][1]
        specs: dict[str, MemorySpec] = {
            **sample_specs(render),
            "inputs": TextureSpec(display, "rgba32uint"),
            "differences": BufferSpec(4 * half),
        }
        for spec in self._levels:
            level, kept, across = (int(spec.constants[name]) for name in ("level", "kept", "kept_across"))
            width, height = extents[spec.extent]
            size = across * width, kept // across * height
            specs[f"kept{level}"] = TextureSpec(size, "rgba32uint")
            pooled = int(spec.constants["pooled"]) * (width // 2) * (height // 2)
            specs[f"pooled{level}"] = BufferSpec(CHUNK * pooled)
        return specs
