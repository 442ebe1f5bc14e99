"""Shaders of `taau`."""

import numpy as np

from supersampler.backends.gpu import program
from supersampler.backends.gpu.history import PIXELS, Codec, HistoryLayout, HistoryPlane, Packed, of_plane
from supersampler.backends.gpu.memory import BLOCKS, ONE, PixelTexture
from supersampler.frame import Float32
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of
from supersampler.methods.taau.spec import TAAU


def _unpack_depth(words: Packed) -> Float32:
    return np.ascontiguousarray(words).view(np.float32)


def _pack_depth(pixels: Float32) -> Packed:
    return np.ascontiguousarray(pixels[..., :1]).view(np.uint32)


LAYOUT = HistoryLayout(
    TAAU,
    {
        "pixels": PIXELS,
        "power": HistoryPlane("samples", 1, None),
        "surface": HistoryPlane("surface", 1, "r32uint", Codec(_unpack_depth, _pack_depth)),
        **program.REST_PLANES,
    },
    {
        "color": of_plane("pixels", 0, 1, 2),
        "samples": (("pixels", 3), ("power", 0)),
        "surface": of_plane("surface", 0),
        **program.REST_CHANNELS,
    },
)


def taau_program(info: ModelInfo) -> program.GpuProgram:
    """Return the GPU program of a `taau` model."""
    constants = {name: info.config[name] for name in constants_of(TAAU)}
    passes = (
        *program.frame_passes("occluding"),
        program.PassSpec("light", ONE, (1, 1)),
        program.PassSpec(
            "lag",
            BLOCKS,
            (8, 8),
            static=("samples", "history_pixels"),
            at_rest=("block_states", "kept_samples"),
        ),
        program.PassSpec("blend", tile=(32, 4), static=program.SHOWS_STATIC, at_rest=program.SHOWS_FROZEN),
    )
    memory = {**program.FRAME_MEMORY, "kept_samples": PixelTexture(BLOCKS, "rg32float")}
    return program.GpuProgram(LAYOUT, ("supersampler.methods.taau",), constants, passes, memory)
