"""The filter of `classifier-large` to the display: its tables, and the arguments of its kernel."""

from typing import NamedTuple

import numpy as np

from supersampler.backends.cpu.layout import LANES
from supersampler.backends.cpu.memory import aligned
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.structs import Floats, Words
from supersampler.frame import Float32, Size
from supersampler.methods.classifier_large.spec import LANCZOS_SCALE, LANCZOS_SLOPE, REACH, SHARPNESS
from supersampler.methods.spec import large_size

TAPS = 2 * REACH
"""Rows and columns of the image that a pixel of the display reads."""
RING = 8
"""Toned rows of the image that a thread keeps; a power of 2, at least TAPS."""


class DownsamplingTables:
    """The filter to a display, and buffers of each thread.

    Attributes:
        image: (large height, large width, 3) to filter.
        rows, row_weights, columns, column_weights: see `Downsampling`.
        scratch: (threads, ...) RING rows and one more, of four values per pixel.
    """

    def __init__(self, display: Size, threads: int) -> None:
        large = large_size(display)
        self.image = aligned((large[1], large[0], 3))
        rows, row_weights = _axis(display[1], large[1])
        self.rows, self.row_weights = np.ascontiguousarray(rows.T), np.ascontiguousarray(row_weights.T)
        pitch = up_to(display[0], LANES)
        self.columns, self.column_weights = aligned((TAPS, pitch), np.int32), aligned((TAPS, pitch))
        self.columns[:, : display[0]], self.column_weights[:, : display[0]] = _axis(display[0], large[0])
        self.scratch = aligned((threads, (RING + 1) * 4 * up_to(large[0], LANES) + 4 * LANES))


def _axis(display: int, large: int) -> tuple[Words, Float32]:
    """Return the pixels that each pixel of the display reads along an axis, and weights: (TAPS, display)."""
    half = np.float32(0.5)
    position = (np.arange(display, dtype=np.float32) + half) * np.float32(large) / np.float32(display) - half
    taps = np.arange(1 - REACH, REACH + 1, dtype=np.float32)[:, None]
    pixels = np.floor(position) + taps
    weights = _lanczos((pixels - position) * np.float32(SHARPNESS * display / large))
    weights /= weights.sum(axis=0)
    return np.clip(pixels, 0, large - 1).astype(np.int32), weights


def _lanczos(distance: Float32) -> Float32:
    """Lanczos filter of two lobes, as a polynomial."""
    squared = np.minimum(distance * distance, np.float32(4.0))
    base, window = (
        np.float32(LANCZOS_SLOPE) * squared - np.float32(1.0),
        np.float32(0.25) * squared - np.float32(1.0),
    )
    found: Float32 = (
        (np.float32(LANCZOS_SCALE) * base * base - np.float32(LANCZOS_SCALE - 1.0)) * window * window
    )
    return found


class Downsampling(NamedTuple):
    """An image, and its filter to the display.

    Attributes:
        image: (large height, large_width, 3) linear RGB.
        output: (height, width, 3) linear RGB; written to.
        rows: (height, TAPS) rows of the image that a row of the display reads.
        row_weights: (height, TAPS) weights of these rows.
        columns: (TAPS, pitch) columns of the image that a column of the display reads.
        column_weights: (TAPS, pitch) weights of these columns.
        width: of the display.
        pitch: width, rounded up to whole vectors.
        large_width, large_height: of the image.
        exposure: multiplies colours before the tone curve.
    """

    image: Floats
    output: Floats
    rows: Words
    row_weights: Floats
    columns: Words
    column_weights: Floats
    width: int
    pitch: int
    large_width: int
    large_height: int
    exposure: float
