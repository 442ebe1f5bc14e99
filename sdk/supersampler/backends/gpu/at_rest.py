"""Passes on the samples of a frame and on what stands still (ops/at_rest.py), for all methods with them."""

from collections.abc import Mapping

from supersampler.backends.gpu.extents import BLOCKS, DISPLAY, ONE, RENDER, Extent, PixelBuffer, PixelMemory
from supersampler.backends.gpu.extents import PixelTexture as Texture
from supersampler.backends.gpu.history import Plane, of_plane
from supersampler.backends.gpu.program import PassSpec
from supersampler.backends.gpu.shader import Constants
from supersampler.methods.at_rest import (
    BESIDE,
    BLOCK,
    COMMON,
    DARK,
    FLICKER,
    INNER,
    LEAST_WEIGHT,
    MAX_STATIC_MOTION,
    NOISE_FLICKER,
    NOISE_RATE,
    NOISE_SIGMAS,
    NOISE_WEIGHT,
    NOISY,
    OUTER,
    PHASES_PER_SAMPLE,
    SHOWN,
    SHOWN_FROM,
    SPARE_PHASES,
    SPARKLING,
    TILE,
    TOLERANCE,
    UNIFORM,
    UNRESOLVED,
    WINDOWS,
)
from supersampler.methods.missing import FILL_CONSTANTS

SIDE = 16
"""Samples of a workgroup of `preprocess` in either direction."""
REST_CONSTANTS: Constants = {
    "BLOCK": BLOCK, "TILE": TILE, "MAX_STATIC_MOTION": MAX_STATIC_MOTION,
    "PHASES_PER_SAMPLE": PHASES_PER_SAMPLE, "SPARE_PHASES": SPARE_PHASES, "TOLERANCE": TOLERANCE,
    "DARK": DARK, "INNER": INNER, "OUTER": OUTER, "SHOWN_FROM": SHOWN_FROM, "SHOWN": SHOWN,
    "LEAST_WEIGHT": LEAST_WEIGHT,
    "FLICKER": FLICKER, "UNIFORM": UNIFORM, "COMMON": COMMON, "UNRESOLVED": UNRESOLVED,
    "BESIDE": BESIDE, "SPARKLING": SPARKLING, "NOISY": NOISY, "NOISE_RATE": NOISE_RATE,
    "NOISE_FLICKER": NOISE_FLICKER, "NOISE_SIGMAS": NOISE_SIGMAS, "NOISE_WEIGHT": NOISE_WEIGHT,
    **dict(zip(("SMALL_WINDOW", "LARGE_WINDOW"), WINDOWS, strict=True)),
}  # fmt: skip
"""Constants of methods/at_rest.py for the shaders."""
BLOCK_PASSES = (
    PassSpec("follow_jitter", ONE, (1, 1), REST_CONSTANTS),
    PassSpec("compare_blocks", BLOCKS, (4, 4), REST_CONSTANTS),
    PassSpec("decide_blocks", BLOCKS, (8, 8), REST_CONSTANTS),
)
"""Passes that decide what stands still. They read the frame, the exposure and the history alone."""
TILES = Extent("display", TILE)
TILE_PASS = PassSpec("rest_tiles", TILES, (8, 8), REST_CONSTANTS)
REST_PLANES = {
    "mean": Plane("static_mean"),
    "blocks": Plane("static_blocks"),
    "signatures": Plane("signatures", 4, None),
    "phases": Plane("phases"),
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
    "block_states": Texture(BLOCKS, "rg32uint"),
}
"""Memory that BLOCK_PASSES write for later passes."""
TILE_MEMORY: Mapping[str, PixelMemory] = {"tiles": PixelBuffer(8, TILES)}
SAMPLE_MEMORY: Mapping[str, PixelMemory] = {
    "samples": Texture(RENDER, "rgba16float"),
    "dilated": Texture(RENDER),
    "light": PixelBuffer(8, Extent("render", SIDE)),
}
"""Memory that `preprocess` writes for later passes, beside the history."""


def preprocess(surface: str) -> PassSpec:
    """Return the pass on the samples of a frame; `surface`: what it stores of them, "depth" or "shade"."""
    return PassSpec(
        "preprocess", RENDER, (SIDE, SIDE), FILL_CONSTANTS, variants={"surface": f"surface_{surface}"}
    )


def showing(shader: str, constants: Constants | None = None, tile: tuple[int, int] = (16, 16)) -> PassSpec:
    """Return a pass that writes the image, at display size; `tile`: of `PassSpec`."""
    return PassSpec(shader, DISPLAY, tile, constants={**REST_CONSTANTS, **(constants or {})})
