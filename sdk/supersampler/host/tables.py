"""Where rows and columns of a display look in a frame, and with what weights: one axis at a time.

Twins of `supersampler_model.sampling.positions`, `nearest` and `taps`, in the same single precision.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32

Int32 = NDArray[np.int32]
Kernel = Callable[[Float32], Float32]
LANES = 16


class Filter(NamedTuple):
    """A separable filter of samples.

    Attributes:
        kernel: weight at a distance.
        scaled: whether distances are in display pixels, else in render pixels.
        channels: how many it filters.
    """

    kernel: Kernel
    scaled: bool
    channels: int


class Axis:
    """How the display pixels of one axis look at the samples of a frame; filled anew for each jitter.

    Attributes:
        near: (n,) nearest sample of each pixel, int32, like all indices; ends in copies of the last, up to a
            multiple of LANES.
        first: the same, the one at or before where it looks.
        samples: (n, 4) the four samples around it.
        weights: (n, 4, LANES) their weights, channel by channel.
        window: (3, n) or, along a column, (n, 3) Gaussian weights of the three samples around the nearest.
    """

    def __init__(
        self, display: int, render: int, filters: Sequence[Filter], window: Kernel, *, rows: bool
    ) -> None:
        self.display, self.render = display, render
        self._filters, self._window, self._rows = filters, window, rows
        padded = display + -display % LANES
        self.near, self.first = np.zeros(padded, np.int32), np.zeros(padded, np.int32)
        self.samples = np.zeros((display, 4), np.int32)
        self.weights = np.zeros((display, 4, LANES), np.float32)
        self.window = np.zeros((display, 3) if rows else (3, padded), np.float32)
        self._pixel = np.arange(display, dtype=np.float32)

    def look(self, jitter: float) -> None:
        """Fill for a frame's jitter on this axis."""
        half = np.float32(0.5)
        position = (self._pixel + half) * np.float32(self.render) / np.float32(self.display) - half
        position -= np.float32(jitter)
        near, first = np.floor(position + half), np.floor(position)
        last = self.render - 1
        self.near[: self.display], self.near[self.display :] = np.clip(near, 0, last), 0
        self.first[: self.display], self.first[self.display :] = np.clip(first, 0, last), 0
        samples = (first - 1)[:, None] + np.arange(4, dtype=np.float32)
        self.samples[:] = np.clip(samples, 0, last)
        distance = samples - position[:, None]
        lane = 0
        for kernel, scaled, channels in self._filters:
            scale = np.float32(self.display / self.render if scaled else 1.0)
            self.weights[:, :, lane : lane + channels] = kernel(distance * scale)[:, :, None]
            lane += channels
        near = np.clip(near, 0, last).astype(np.float32)
        around = near[:, None] + np.arange(-1, 2, dtype=np.float32) - position[:, None]
        if self._rows:
            self.window[:] = self._window(around)
        else:
            self.window[:, : self.display] = self._window(around).T


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
