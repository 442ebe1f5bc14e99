"""What a step reads: parameters, and the frame in buffers of the device."""

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np

from supersampler.backends.gpu.history import GpuHistory
from supersampler.backends.gpu.memory import Memory, buffer_of, write_to
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import usable_exposure

if TYPE_CHECKING:
    import wgpu

CHANNELS = {"color": 3, "depth": 1, "motion": 2}
"""Images of a frame that shaders read, and their channels."""


def step_params(
    render: Size,
    jitter: tuple[float, float],
    exposure: float | None,
    history: GpuHistory,
    *,
    adds_samples: bool = True,
    writes_aux: bool = False,
) -> Float32:
    """Return the shader's `Params` of a step from `history`."""
    counts = adds_samples and np.any(np.array(jitter, np.float32) != np.array(history.jitter, np.float32))
    values = [*render, *history.display, *history.render, *jitter, *history.jitter]
    return np.array([*values, usable_exposure(exposure) or 0.0, counts, writes_aux, 0.0], np.float32)


class FrameBuffers:
    """Storage buffers for the images of a frame.

    Args:
        device: of the buffers.
        names: the images that the method reads; the others are not copied.
        size: of the frame, (width, height).

    Attributes:
        memory: by the names that shaders use.
    """

    def __init__(self, device: "wgpu.GPUDevice", names: Collection[str], size: Size) -> None:
        self._device, self._names = device, [name for name in CHANNELS if name in names]
        pixels = size[0] * size[1]
        self.memory: dict[str, Memory] = {
            f"frame_{name}": buffer_of(device, 4 * channels * pixels if name in self._names else 4)
            for name, channels in CHANNELS.items()
        }

    def write(self, frame: Frame) -> None:
        """Copy the images of a frame to the device."""
        for name in self._names:
            image: Any = getattr(frame, name)
            write_to(self._device, self.memory[f"frame_{name}"], np.asarray(image, np.float32))
