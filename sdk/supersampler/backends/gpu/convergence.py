"""Passes on the samples of a frame, and the convergence of static pixels, for all methods that have it."""

from typing import TYPE_CHECKING

from supersampler.backends.gpu.executor import PassSpec
from supersampler.backends.gpu.history import Plane, of_plane
from supersampler.backends.gpu.memory import Memory, buffer_of, texture_of
from supersampler.frame import Size
from supersampler.methods.spec import DISPLAY, PREVIOUS

if TYPE_CHECKING:
    import wgpu

PREPROCESS = PassSpec("preprocess", "render")
CONVERGENCE_PASSES = (PassSpec("residuals", "render"), PassSpec("flags", "render"))
CONVERGENCE_PLANES = {"still": Plane(DISPLAY), "opening": Plane(PREVIOUS)}
CONVERGENCE_CHANNELS = {
    "still": of_plane("still", 0, 1, 2, 3),
    "opening": of_plane("opening", 0, 1, 2),
}


def sample_memory(device: "wgpu.GPUDevice", render: Size) -> dict[str, Memory]:
    """Allocate what PREPROCESS and CONVERGENCE_PASSES write for later passes."""
    across, down = (-(-extent // side) for extent, side in zip(render, PREPROCESS.tile, strict=True))
    return {
        "tones": texture_of(device, render),
        "samples": texture_of(device, render),
        "dilated": texture_of(device, render),
        "flags": texture_of(device, render, "rgba32uint"),
        "own_motion": buffer_of(device, 8 * render[0] * render[1]),
        "light": buffer_of(device, 8 * across * down),
    }
