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
    adds_samples: float = 1.0,
    writes_aux: bool = False,
    skip: bool = True,
) -> Float32:
    """Return the shader's `Params` of a step from `history`; auxiliary outputs are of the whole method."""
    values = [*render, *history.display, *history.render, *jitter, usable_exposure(exposure) or 0.0]
    flags = adds_samples, writes_aux, pre_exposure, has_reactive, skip and not writes_aux
    return np.array([*values, *flags, 0.0, 0.0], np.float32)


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
