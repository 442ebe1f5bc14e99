"""Where rows and columns of a display look in a frame, and with what weights: one axis at a time.

Twins of `supersampler_model.sampling.positions`, `nearest` and `taps`, in the same single precision.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32
from supersampler.host.layout import LANES

Int32 = NDArray[np.int32]
Kernel = Callable[[Float32], Float32]


class Filter(NamedTuple):
    """A separable filter of samples: its kernel, and whether distances are in display pixels."""

    kernel: Kernel
    scaled: bool


class Axis:
    """How the display pixels of one axis look at the samples of a frame.

    Attributes:
        near: nearest sample of each pixel; like `start` and `first` in whole LANES.
        start: the one at or before where it looks, -1 at first where that is before the first.
        first: the same, or the first.
        samples: (n, 4) the four around.
    """

    def __init__(self, display: int, render: int) -> None:
        self.display, self.render = display, render
        padded = up_to(display, LANES)
        self.near, self.start, self.first = np.zeros((3, padded), np.int32)
        self.samples = np.zeros((display, 4), np.int32)
        self._pixel = np.arange(display, dtype=np.float32)
        self._position = self._pixel
        self._distance = np.zeros((display, 4), np.float32)

    def look(self, jitter: float) -> None:
        """Look at a frame with this jitter on this axis, in samples."""
        half = np.float32(0.5)
        position = (self._pixel + half) * np.float32(self.render) / np.float32(self.display) - half
        position -= np.float32(jitter)
        first = _within_vectors(np.floor(position))
        self.near[: self.display] = self._inside(_within_vectors(np.floor(position + half)))
        self.start[: self.display] = first
        self.first[: self.display] = self._inside(first)
        samples = first[:, None] + np.arange(-1.0, 3.0, dtype=np.float32)
        self.samples[:] = self._inside(samples)
        self._position, self._distance = position, samples - position[:, None]

    def weights(self, kernel: Kernel, *, scaled: bool = False) -> Float32:
        """(n, 4) of the samples around; `scaled`: the kernel is one of display pixels."""
        scale = np.float32(self.display / self.render if scaled else 1.0)
        return kernel(self._distance * scale)

    def window(self, kernel: Kernel) -> Float32:
        """(n, 3) of the three samples around the nearest, as if there were samples beyond the border."""
        beside = np.arange(-1, 2, dtype=np.float32)
        distance: Float32 = self.near[: self.display, None].astype(np.float32) + beside
        distance -= self._position[:, None]
        return kernel(distance)

    def _inside(self, index: Float32) -> Float32:
        return np.clip(index, 0, self.render - 1)


def _within_vectors(index: NDArray[Any]) -> NDArray[Any]:
    """Samples that pixels look at, none farther from that of the first of eight or sixteen than the pixel is.

    So kernels find it (`vector.picked`). At a ratio of one a pixel between two samples may be rounded to the
    later, and the first to the earlier: either has what the pixel looks at beside it.
    """
    lanes = np.arange(len(index))
    for count in (LANES, LANES // 2):
        firsts = np.repeat(index[::count], count)[: len(index)]
        index = np.minimum(index, firsts + (lanes % count).astype(np.float32))
    return index


def columns_of(table: Float32) -> Float32:
    """(n, k) as k rows of whole LANES."""
    rows = np.zeros((table.shape[1], up_to(len(table), LANES)), np.float32)
    rows[:, : len(table)] = table.T
    return rows


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


def linear(distance: Float32) -> Float32:
    """Tent."""
    return np.maximum(np.float32(1.0) - np.abs(distance), np.float32(0.0))


def up_to(count: int, multiple: int) -> int:
    """The next multiple."""
    return -(-count // multiple) * multiple
