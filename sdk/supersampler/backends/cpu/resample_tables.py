"""Resampling tables: the samples that each row and column of the display reads, and their filter weights.

Same as `supersampler_model.ops.sampling.positions` and `nearest`, with the same float32 arithmetic.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import LANES
from supersampler.backends.cpu.memory import aligned, held_bytes
from supersampler.conventions.jitter import jitter_phase_count
from supersampler.frame import Float32, Size

Kernel = Callable[[Float32], Float32]

MAX_PHASES = 128
"""Largest number of jitter phases of which tables are kept."""


class Filter(NamedTuple):
    """A separable filter: its kernel, and whether distances are in display pixels instead of samples."""

    kernel: Kernel
    scaled: bool


class Axis:
    """The tables of one axis with n display pixels, in the layout of rows.

    Args:
        display, render: number of pixels and of samples.
        filters: filters of the four samples around a pixel.
        windows: kernels for the three samples around the nearest, as if samples continued beyond the border.
        jitter: jitter of the frame on this axis, in samples.

    Attributes:
        near: (n,) the nearest sample of each pixel. This and the next two are padded to whole vectors.
        start: (n,) the sample at or before the pixel's position, -1 before the first sample.
        first: (n,) the same, clamped to the first sample.
        samples: (1, n, 4) the four samples around the position, clamped to the border.
        weights: (filters, n, 4) their weights.
        windows: (windows, n, 3) weights of the three samples around the nearest.
    """

    def __init__(
        self, display: int, render: int, filters: Sequence[Filter], windows: Sequence[Kernel], jitter: float
    ) -> None:
        half = np.float32(0.5)
        position = (np.arange(display, dtype=np.float32) + half) * np.float32(render) / np.float32(display)
        position -= half
        position -= np.float32(jitter)
        first = _within_vectors(np.floor(position))
        near = np.clip(_within_vectors(np.floor(position + half)), 0, render - 1)
        self.near, self.start, self.first = aligned((3, up_to(display, LANES)), np.int32)
        self.near[:display], self.start[:display] = near, first
        self.first[:display] = np.clip(first, 0, render - 1)
        samples = first[:, None] + np.arange(-1.0, 3.0, dtype=np.float32)
        self.samples = self._layout(np.clip(samples, 0, render - 1).astype(np.int32)[None])
        distance = samples - position[:, None]
        scales = [np.float32(display / render if scaled else 1.0) for _, scaled in filters]
        weights = [kernel(distance * scale) for (kernel, _), scale in zip(filters, scales, strict=True)]
        self.weights = self._layout(np.array(weights, np.float32).reshape(-1, display, 4))
        beside = near[:, None] + np.arange(-1.0, 2.0, dtype=np.float32) - position[:, None]
        around = np.array([kernel(beside) for kernel in windows], np.float32)
        self.windows = self._layout(around.reshape(-1, display, 3))

    @staticmethod
    def _layout(tables: NDArray[Any]) -> NDArray[Any]:
        """Return (m, n, k) tables of n pixels in the layout of this class."""
        return tables


class Columns(Axis):
    """Tables in the layout of columns: samples (4, n), weights (4 * filters, n), windows (3 * windows, n)."""

    @staticmethod
    def _layout(tables: NDArray[Any]) -> NDArray[Any]:
        m, n, k = tables.shape
        rows = aligned((m * k, up_to(n, LANES)), tables.dtype.type)
        rows[:, :n] = tables.transpose(0, 2, 1).reshape(m * k, n)
        return rows


class ResampleTableCache:
    """A cache of the tables for frames of one size, for one period of the jitter.

    Args:
        render, display: sizes.
        filters, windows: see `Axis`.
        rows: class, and so layout, of the tables of rows.
    """

    def __init__(
        self,
        render: Size,
        display: Size,
        filters: Sequence[Filter],
        windows: Sequence[Kernel] = (),
        rows: type[Axis] = Axis,
    ) -> None:
        self._phases = min(jitter_phase_count(display[0] / render[0]), MAX_PHASES)
        keep = lru_cache(self._phases)
        self._x = keep(partial(Columns, display[0], render[0], filters, windows))
        self._y = keep(partial(rows, display[1], render[1], filters, windows))

    def at(self, jitter: tuple[float, float]) -> tuple[Axis, Axis]:
        """Return the tables of columns and of rows for frames with this jitter."""
        return self._x(jitter[0]), self._y(jitter[1])

    def most_bytes(self) -> int:
        """Return the bytes of a full cache."""
        return self._phases * held_bytes(self.at((0.0, 0.0)))


def _within_vectors(index: NDArray[Any]) -> NDArray[Any]:
    """Limit the sample of each pixel so that eight neighbouring pixels read from eight neighbouring samples.

    `vector.gather_nearby` requires that. Only rounding at a ratio of one can violate it, and then either of
    two samples is right.
    """
    lanes = np.arange(len(index))
    for count in (LANES, LANES // 2):
        firsts = np.repeat(index[::count], count)[: len(index)]
        index = np.minimum(index, firsts + (lanes % count).astype(np.float32))
    return index


def gaussian(sigma: float) -> Kernel:
    """Return a Gaussian with maximum 1."""
    scale = np.float32(-0.5 / (sigma * sigma))
    return lambda distance: np.exp(distance * distance * scale)


def line_filters(sigma: float) -> list[Kernel]:
    """Return filters that fit a line to samples under a Gaussian: its mean, its slope, and its shift.

    Same as `supersampler_model.methods.taau.PlaneAxis`. The shift is the same for all samples.
    """
    window = gaussian(sigma)

    def position(distance: Float32) -> tuple[Float32, Float32, Float32]:
        """Return normalised weights, and mean and deviation of the positions."""
        weights = window(distance)
        weights = weights / weights.sum(-1, keepdims=True)
        mean = (distance * weights).sum(-1, keepdims=True)
        return weights, mean, np.sqrt((distance * distance * weights).sum(-1, keepdims=True) - mean * mean)

    def slope(distance: Float32) -> Float32:
        weights, mean, deviation = position(distance)
        return (distance - mean) * weights / deviation

    def shift(distance: Float32) -> Float32:
        _, mean, deviation = position(distance)
        return np.broadcast_to(mean / deviation, distance.shape)

    return [lambda distance: position(distance)[0], slope, shift]


def catmull_rom(distance: Float32) -> Float32:
    """Catmull-Rom cubic, with support [-2, 2]."""
    d = np.abs(distance)
    near = (np.float32(1.5) * d - np.float32(2.5)) * d * d + np.float32(1.0)
    far = ((np.float32(-0.5) * d + np.float32(2.5)) * d - np.float32(4.0)) * d + np.float32(2.0)
    found: Float32 = np.where(d < 1.0, near, np.where(d < 2.0, far, np.float32(0.0)))
    return found


def linear(distance: Float32) -> Float32:
    """Tent, with support [-1, 1]."""
    return np.maximum(np.float32(1.0) - np.abs(distance), np.float32(0.0))


def up_to(count: int, multiple: int) -> int:
    """Round a count up to a multiple."""
    return -(-count // multiple) * multiple
