"""Shaders of `classifier` and related methods."""

import numpy as np

from supersampler.backends.gpu import history, program
from supersampler.backends.gpu import memory as gpu
from supersampler.backends.gpu.shader import Constants
from supersampler.frame import Float32
from supersampler.methods.classifier.gpu_network import CHUNK, read_gpu_network
from supersampler.methods.classifier.spec import CLASSES, CLASSIFIER, Variant
from supersampler.methods.constants import CONFIRMED, GLARE
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of

LOW_STEPS, HIGH_STEPS = 65535.0, 16383.0
"""Quantization steps of the minimum and of the maximum luma in a word."""
TILES = ((14, 14), (8, 8), (8, 8), (4, 4))
"""Pixels of a workgroup at each level: its features fit into 16 KiB."""
UNIFORM_BYTES = 64 << 10
"""Largest uniform buffer that every device supports."""
ALIGNED = 8
"""The first level, in 2x2 display pixels, is padded to a multiple of this by repeating its border."""
TEXELS_ACROSS = {1: 1, 2: 2, 4: 2, 16: 4}
"""Width of the rectangle of texels that holds a pixel's kept features, by the number of texels."""


def _unpack_ranges(words: history.Packed) -> Float32:
    packed = words[..., 0]
    high = (packed >> 16 & 0x3FFF) / HIGH_STEPS + GLARE * (packed >> 30)
    return np.stack([(packed & 0xFFFF) / LOW_STEPS, high], -1).astype(np.float32)


def _pack_ranges(pixels: Float32) -> history.Packed:
    low, high = pixels[..., 0], pixels[..., 1]
    glare = np.clip(np.floor(high / GLARE + 0.5), 0.0, CONFIRMED)
    maximum = np.clip(high - GLARE * glare, 0.0, 1.0)
    bits = [np.clip(low, 0.0, 1.0) * LOW_STEPS + 0.5, maximum * HIGH_STEPS + 0.5, glare]
    minimum, rounded, frames = (part.astype(np.uint32) for part in bits)
    packed: history.Packed = minimum | rounded << 16 | frames << 30
    return packed


LAYOUT = history.HistoryLayout(
    CLASSIFIER,
    {
        "pixels": history.PIXELS,
        "ranges": history.HistoryPlane("state", 1, "r32uint", history.Codec(_unpack_ranges, _pack_ranges)),
        "classes": history.HistoryPlane("classes", 2, None, history.BYTES),
        "surface": history.HistoryPlane("depth", 2, "rg32float"),
        **program.REST_PLANES,
    },
    {
        "color": history.of_plane("pixels", 0, 1, 2),
        "state": (("pixels", 3), ("ranges", 0), ("ranges", 1)),
        "classes": history.of_plane("classes", *range(CLASSES)),
        "depth": history.of_plane("surface", 0, 1),
        **program.REST_CHANNELS,
    },
)


def classifier_program(info: ModelInfo) -> program.GpuProgram:
    """Return the GPU program of a model of `classifier` or a related method.

    Raises:
        ModelError: see `read_gpu_network`.
    """
    variant = Variant.of(info.config)
    *network, last_layers = read_gpu_network(info, variant)
    constants = {name: info.config[name] for name in constants_of(CLASSIFIER)}
    constants |= {"low_steps": LOW_STEPS, "high_steps": HIGH_STEPS}
    constants |= variant._asdict()
    blend = {"colors": variant.colors, "sharpness_at": variant.colors, "kernel_at": variant.colors + 1}
    levels = [_level_pass(one.constants, tile) for one, tile in zip(network, TILES, strict=True)]
    compose = program.PassSpec(
        "compose",
        constants={**last_layers.constants, **blend},
        static=(*program.SHOWS_STATIC, "history_classes"),
        at_rest=program.SHOWS_FROZEN,
    )
    last, gather = _with_network(compose, "network_last"), program.PassSpec("gather", at_rest=("next_tiles",))
    passes = *program.frame_passes("depth"), gather, *levels, last
    memory: dict[str, gpu.PixelMemory] = {
        **program.FRAME_MEMORY,
        "inputs": gpu.PixelTexture(gpu.DISPLAY, "rgba32uint"),
        "differences": gpu.PixelBuffer(4, gpu.HALF),
    }
    for level in network:
        memory |= _level_memory(level.constants)
    weights = {f"network{i}": level.words for i, level in enumerate(network)}
    weights["network_last"] = last_layers.words
    packages = ("supersampler.methods.classifier",)
    return program.GpuProgram(LAYOUT, packages, constants, passes, memory, weights, "int8")


def _level_size(level: int, across: int = 1, down: int = 1) -> gpu.SizeRule:
    """Return the size of a level of the encoder, times (across, down)."""
    side = ALIGNED >> level
    return gpu.SizeRule("display", 2 * ALIGNED, (side * across, side * down))


def _level_pass(constants: Constants, tile: tuple[int, int]) -> program.PassSpec:
    level, kept = int(constants["level"]), int(constants["kept"])
    spec = program.PassSpec(
        "encode_pooled" if level else "encode_inputs",
        _level_size(level),
        tile,
        {**constants, "kept_across": TEXELS_ACROSS[kept], "tile_x": tile[0], "tile_y": tile[1]},
        {"kept": f"kept{level}", "pooled": f"pooled{level}", "pooled_above": f"pooled{level - 1}"},
        at_rest=("next_tiles",),
    )
    return _with_network(spec, f"network{level}")


def _with_network(spec: program.PassSpec, weights: str) -> program.PassSpec:
    """Return the pass with these weights, in a uniform buffer if they fit."""
    fits = CHUNK * spec.constants["network_size"] <= UNIFORM_BYTES
    variants = {**spec.variants, "network": "network_uniform" if fits else "network_storage"}
    return spec._replace(names={**spec.names, "network": weights}, variants=variants)


def _level_memory(constants: Constants) -> dict[str, gpu.PixelMemory]:
    """Return the memory that a level of the encoder writes."""
    level, kept, pooled = (int(constants[name]) for name in ("level", "kept", "pooled"))
    across = TEXELS_ACROSS[kept]
    below = _level_size(level + 1) if pooled else gpu.ONE  # the deepest level pools nothing
    return {
        f"kept{level}": gpu.PixelTexture(_level_size(level, across, kept // across), "rgba32uint"),
        f"pooled{level}": gpu.PixelBuffer(CHUNK * pooled, below),
    }
