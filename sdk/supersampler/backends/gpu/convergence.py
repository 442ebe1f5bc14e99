"""Passes on the samples of a frame, and the convergence of static pixels, for all methods that have it."""

from supersampler.backends.gpu.executor import PassSpec
from supersampler.backends.gpu.history import HALVES, Plane, of_plane
from supersampler.backends.gpu.memory import BufferSpec, MemorySpec, TextureSpec
from supersampler.frame import Size

TILE = (16, 16)
"""Samples of a workgroup of `preprocess`."""
CONVERGENCE_PASSES = (PassSpec("residuals", "render"), PassSpec("flags", "render"))
CONVERGENCE_PLANES = {"still": Plane("still"), "opening": Plane("opening", 2, "rgba16float", HALVES)}
CONVERGENCE_CHANNELS = {
    "still": of_plane("still", 0, 1, 2, 3),
    "opening": of_plane("opening", 0, 1, 2),
}


def preprocess(surface: str) -> PassSpec:
    """Return the pass on the samples of a frame; `surface`: what it stores of them, "depth" or "shade"."""
    return PassSpec("preprocess", "render", TILE, variants={"surface": f"surface_{surface}"})


def sample_specs(render: Size) -> dict[str, MemorySpec]:
    """Return the memory that `preprocess` and CONVERGENCE_PASSES write for later passes."""
    across, down = (-(-extent // side) for extent, side in zip(render, TILE, strict=True))
    return {
        "samples": TextureSpec(render, "rgba16float"),
        "dilated": TextureSpec(render),
        "flags": TextureSpec(render, "rg32uint"),
        "own_motion": BufferSpec(8 * render[0] * render[1]),
        "light": BufferSpec(8 * across * down),
    }
