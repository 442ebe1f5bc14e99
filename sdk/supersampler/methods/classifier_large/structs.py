"""Structs that are arguments of the kernels of `classifier-large`."""

from typing import NamedTuple

from supersampler.backends.cpu.structs import Floats, Words


class Downsampling(NamedTuple):
    """An image, and its filter to the display.

    Attributes:
        image: (large height, large_width, 3) linear RGB.
        output: (height, width, 3) likewise, written to.
        rows: (height, TAPS) rows of the image that a row of the display reads.
        row_weights: (height, TAPS).
        columns: (TAPS, pitch) likewise for columns.
        column_weights: (TAPS, pitch).
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
