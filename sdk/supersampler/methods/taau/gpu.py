"""Shaders of `taau`."""

import numpy as np

from supersampler.backends.gpu import program
from supersampler.backends.gpu.history import PIXELS, Codec, HistoryLayout, HistoryPlane, Packed, of_plane
from supersampler.backends.gpu.memory import BLOCKS, ONE, PixelTexture
from supersampler.frame import Float32
from supersampler.io.display import MAX_HALF
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of
from supersampler.methods.taau.spec import TAAU


def _unpack_surface(words: Packed) -> Float32:
    shade = np.ascontiguousarray(words[..., 1:]).view(np.float16)
    return np.concatenate([words[..., :1].view(np.float32), shade], -1, dtype=np.float32)


def _pack_surface(pixels: Float32) -> Packed:
    shade = np.ascontiguousarray(pixels[..., 1:3]).clip(0.0, MAX_HALF).astype(np.float16).view(np.uint32)
    return np.concatenate([np.ascontiguousarray(pixels[..., :1]).view(np.uint32), shade], -1)


LAYOUT = HistoryLayout(
    TAAU,
    {
        "pixels": PIXELS,
        "power": HistoryPlane("samples", 1, None),
        "surface": HistoryPlane("surface", 2, "rg32uint", Codec(_unpack_surface, _pack_surface)),
        **program.REST_PLANES,
    },
    {
        "color": of_plane("pixels", 0, 1, 2),
        "samples": (("pixels", 3), ("power", 0)),
        "surface": of_plane("surface", 0, 1, 2),
        **program.REST_CHANNELS,
    },
)


def taau_program(info: ModelInfo) -> program.GpuProgram:
    """Return the GPU program of a `taau` model."""
    constants = {name: info.config[name] for name in constants_of(TAAU)}
    passes = (
        *program.frame_passes("shade"),
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
