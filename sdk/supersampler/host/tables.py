"""Where rows and columns of a display look in a frame, and with what weights: one axis at a time.

Twins of `supersampler_model.sampling.positions`, `nearest` and `taps`, in the same single precision.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32

Int32 = NDArray[np.int32]
Kernel = Callable[[Float32], Float32]
LANES = 16  # tables end in copies of their last entry, up to a multiple of this


class Axis(NamedTuple):
    """How the display pixels of one axis look at the samples of a frame.

    Attributes:
        position: where, in samples; 0 is the centre of the first.
        near: index of the nearest sample.
        first: index of the one at or before `position`.
    """

    position: Float32
    near: Int32
    first: Int32


def axis(display: int, render: int, jitter: float) -> Axis:
    """Return the table of one axis, `display` entries."""
    half = np.float32(0.5)
    pixel = np.arange(display, dtype=np.float32)
    position = (pixel + half) * np.float32(render) / np.float32(display) - half - np.float32(jitter)
    near = _inside(np.floor(position + half), render)
    return Axis(position, near, _inside(np.floor(position), render))


def taps(table: Axis, render: int, kernels: list[tuple[Kernel, float, int]]) -> tuple[Int32, Float32]:
    """Return the four samples around each pixel, (n, 4), and their weights, (n, 4, LANES).

    Args:
        table: the axis.
        render: samples on it.
        kernels: of the channels in order: kernel, what distances are multiplied by, how many channels.
    """
    first = np.floor(table.position) - np.float32(1.0)
    samples = first[:, None] + np.arange(4, dtype=np.float32)
    distance = samples - table.position[:, None]
    weights = np.zeros((len(first), 4, LANES), np.float32)
    lane = 0
    for kernel, scale, channels in kernels:
        weights[:, :, lane : lane + channels] = kernel(distance * np.float32(scale))[:, :, None]
        lane += channels
    return _inside(samples, render), weights


def padded(values: Int32) -> Int32:
    """Repeat the last entry up to a multiple of LANES."""
    return np.pad(values, (0, -len(values) % LANES), mode="edge")


def gaussian(sigma: float) -> Kernel:
    """Gaussian of height one."""
    scale = np.float32(-0.5 / (sigma * sigma))
    return lambda distance: np.exp(distance * distance * scale)


def catmull_rom(distance: Float32) -> Float32:
    """Catmull-Rom cubic of support 2."""
    d = np.abs(distance)
    near = (np.float32(1.5) * d - np.float32(2.5)) * d * d + np.float32(1.0)
    far = ((np.float32(-0.5) * d + np.float32(2.5)) * d - np.float32(4.0)) * d + np.float32(2.0)
    found: Float32 = np.where(d < 1.0, near, np.where(d < 2.0, far, np.float32(0.0)))
    return found


def _inside(index: Float32, size: int) -> Int32:
    return np.clip(index, 0, size - 1).astype(np.int32)
