"""Passes on the samples of a frame, and the convergence of static pixels, for all methods that have it."""

from collections.abc import Mapping

from supersampler.backends.gpu.extents import RENDER, Extent, PixelBuffer, PixelMemory, PixelTexture
from supersampler.backends.gpu.history import HALVES, Plane, of_plane
from supersampler.backends.gpu.program import PassSpec

SIDE = 16
"""Samples of a workgroup of `preprocess` in either direction."""
CONVERGENCE_PASSES = (PassSpec("residuals", RENDER), PassSpec("flags", RENDER))
CONVERGENCE_PLANES = {
    "still": Plane("static_mean"),
    "opening": Plane("residual_range", 2, "rgba16float", HALVES),
}
CONVERGENCE_CHANNELS = {
    "static_mean": of_plane("still", 0, 1, 2, 3),
    "residual_range": of_plane("opening", 0, 1, 2),
}


SAMPLE_MEMORY: Mapping[str, PixelMemory] = {
    "samples": PixelTexture(RENDER, "rgba16float"),
    "dilated": PixelTexture(RENDER),
    "flags": PixelTexture(RENDER, "rg32uint"),
    "own_motion": PixelBuffer(8, RENDER),
    "light": PixelBuffer(8, Extent("render", SIDE)),
}
"""What `preprocess` and CONVERGENCE_PASSES write for later passes."""


def preprocess(surface: str) -> PassSpec:
    """Return the pass on the samples of a frame; `surface`: what it stores of them, "depth" or "shade"."""
    return PassSpec("preprocess", RENDER, (SIDE, SIDE), variants={"surface": f"surface_{surface}"})
