"""What a step reads: parameters, and the frame in buffers."""

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from supersampler.backends.gpu.extents import RENDER, PixelBuffer, PixelMemory
from supersampler.backends.gpu.history import GpuHistory
from supersampler.backends.gpu.memory import Memory, write_to
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import usable_exposure

if TYPE_CHECKING:
    import wgpu

PARAMS = 16
"""Values of the shader's `Params`."""
CHANNELS = {"color": 3, "depth": 1, "motion": 2, "reactive": 1}
"""Images of a frame that shaders read, and their channels; the last may be missing."""


def step_params(
    render: Size,
    jitter: tuple[float, float],
    exposure: float | None,
    pre_exposure: float,
    history: GpuHistory,
    *,
    has_reactive: bool,
    adds_samples: bool = True,
    writes_aux: bool = False,
) -> Float32:
    """Return the shader's `Params` of a step from `history`."""
    counts = adds_samples and np.any(np.array(jitter, np.float32) != np.array(history.jitter, np.float32))
    values = [*render, *history.display, *history.render, *jitter, *history.jitter]
    flags = bool(counts), writes_aux, pre_exposure, has_reactive, 0.0
    return np.array([*values, usable_exposure(exposure) or 0.0, *flags], np.float32)


def frame_buffers(names: Collection[str]) -> dict[str, PixelMemory]:
    """Return the buffers of the images that a method reads, by the names that shaders use."""
    return {
        f"frame_{name}": PixelBuffer(4 * channels, RENDER)
        for name, channels in CHANNELS.items()
        if name in names
    }


def write_frame(
    device: "wgpu.GPUDevice", memory: Mapping[str, Memory], frame: Frame, names: Collection[str]
) -> None:
    """Copy the images of a frame that the method reads to its buffers."""
    for name in CHANNELS:
        image: Any = getattr(frame, name)
        if name in names and image is not None:
            write_to(device, memory[f"frame_{name}"], np.asarray(image, np.float32))
