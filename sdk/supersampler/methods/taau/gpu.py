"""Shaders of `taau`."""

from supersampler.backends.gpu.history import PIXELS, HistoryLayout, HistoryPlane, of_plane
from supersampler.backends.gpu.memory import BLOCKS, ONE, PixelTexture
from supersampler.backends.gpu.program import (
    BLOCK_PASSES,
    REST_CHANNELS,
    REST_MEMORY,
    REST_PLANES,
    SAMPLE_MEMORY,
    TILE_MEMORY,
    TILE_PASS,
    GpuProgram,
    PassSpec,
    display_pass,
    preprocess,
)
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of
from supersampler.methods.taau.spec import TAAU

LAYOUT = HistoryLayout(
    TAAU,
    {
        "pixels": PIXELS,
        "power": HistoryPlane("samples", 1, None),
        "surface": HistoryPlane("surface"),
        **REST_PLANES,
    },
    {
        "color": of_plane("pixels", 0, 1, 2),
        "samples": (("pixels", 3), ("power", 0)),
        "surface": of_plane("surface", 1, 2, 3),
        **REST_CHANNELS,
    },
)


def taau_program(info: ModelInfo) -> GpuProgram:
    """Return the GPU program of a `taau` model."""
    constants = {name: info.config[name] for name in constants_of(TAAU)}
    passes = (
        *BLOCK_PASSES,
        TILE_PASS,
        preprocess("shade"),
        PassSpec("light", ONE, (1, 1)),
        PassSpec("lag", BLOCKS, (8, 8)),
        display_pass("blend", tile=(32, 4)),
    )
    kept = {"kept_samples": PixelTexture(BLOCKS, "rg32float")}
    memory = {**REST_MEMORY, **TILE_MEMORY, **SAMPLE_MEMORY, **kept}
    return GpuProgram(LAYOUT, ("supersampler.methods.taau",), constants, passes, memory)
