"""Structs that kernels take: NamedTuples of arrays and numbers, packed into slots of eight bytes.

A field is a C-contiguous array (Floats, Halves, Bytes, Words), of which kernels see a pointer, int (64 bits),
float (32 bits), or a struct.
Imports no numba: the executors make structs, and most processes never compile a kernel.
"""

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.memory import address

Floats = NDArray[np.float32]
Halves = NDArray[np.uint16]
"""Half floats, as their bits."""
Bytes = NDArray[np.uint8]
Words = NDArray[np.int32]
"""int32, or four bytes each."""

SLOT = 8
"""Bytes of a field."""
_INT, _FLOAT = struct.Struct("=q"), struct.Struct("=f4x")


def pack(values: tuple[Any, ...]) -> bytes:
    """Return a struct as kernels take it. Keep its arrays while kernels use it.

    Args:
        values: a NamedTuple of arrays and numbers.
    """
    return b"".join(
        _packed(v, kind) for v, kind in zip(values, type(values).__annotations__.values(), strict=True)
    )


def _packed(value: Any, kind: Any) -> bytes:
    if isinstance(value, tuple):
        return pack(value)
    if isinstance(value, np.ndarray):
        return _INT.pack(address(value))
    return (_FLOAT if kind is float else _INT).pack(value)


class FrameInputs(NamedTuple):
    """The arrays of a frame of (height, width) samples.

    Attributes:
        color: (height, width, 3) linear RGB.
        depth: (height, width) reversed depth; see `Frame`.
        motion: (height, width, 2) render pixels.
        exposure: multiplies the color before the tone curve; 0 until it is known.
    """

    color: Floats
    depth: Floats
    motion: Floats
    exposure: float = 0.0


class FrameSamples(NamedTuple):
    """The samples of a frame, ready to be resampled.

    Rows of `wide` samples are PAD, stride, PAD; the padding repeats the border.

    Attributes:
        color: (height, SAMPLE_PLANES, wide) toned RGB, whether usable, YCoCg and its squares.
        depth, motion_x, motion_y: (height, wide); depth is -1 where it is unusable.
        eroded_depth: (height, wide) the farthest of 3x3.
        dilated: (height, stride, 4) depth and motion of the closest of 2x2 samples.
        own: (height, stride, 4) motion of the sample itself, range of depth in 3x3, 1 where one of these is
            over GLARING.
        glares: (height,) 1 where a sample of the row is over GLARING, else 0.
        width, height: of the frame.
        stride: width up to whole vectors.
    """

    color: Floats
    depth: Floats
    motion_x: Floats
    motion_y: Floats
    eroded_depth: Floats
    dilated: Floats
    own: Floats
    glares: Floats
    width: int
    height: int
    stride: int


class ResampleTables(NamedTuple):
    """Which samples display pixels look at, and with what weights; see `resample_tables.Axis`.

    Attributes:
        row_samples: (height, 4) the rows of samples around.
        row_weights: (filters, height, 4) of these.
        row_windows: (windows, height, 3) weights of the rows around the nearest.
        first_row, nearest_row: (height,).
        column_start: (width,) the sample at or before a pixel; -1 before the first.
        column_weights: (4 * filters, width) of the four samples around it.
        column_windows: (3 * windows, width) weights of the columns around the nearest.
        first_column, nearest_column: (width,).
    """

    row_samples: Words
    row_weights: Floats
    row_windows: Floats
    first_row: Words
    nearest_row: Words
    column_start: Words
    column_weights: Floats
    column_windows: Floats
    first_column: Words
    nearest_column: Words


class AxisSamples(NamedTuple):
    """Samples of a frame in the columns or rows of the display; see `static_weights.StaticAxis`.

    Attributes:
        sample: (n,) index of the sample in each, or -1.
        offset: (n,) its place, display pixels from the centre.
        kind: (n,) index of the weights.
    """

    sample: Words
    offset: Floats
    kind: Words


class AddedSamples(NamedTuple):
    """Samples of a frame that are added to the sums of tiles.

    Attributes:
        modes: (rows, columns) of tiles: 0 or a sum of KEEP and ADD.
        sums_before: (height, width, SUM_VALUES) of the previous frame.
        sums: likewise, written to.
        color: (samples down, samples across, 3) linear RGB.
        rows, columns: samples in these.
        coefficients: (3, row kinds, column kinds) of the weights.
        row_kinds, column_kinds: numbers of different ones.
        samples_across: of the frame.
        width, height: of the display.
    """

    modes: Bytes
    sums_before: Floats
    sums: Floats
    color: Floats
    rows: AxisSamples
    columns: AxisSamples
    coefficients: Floats
    row_kinds: int
    column_kinds: int
    samples_across: int
    width: int
    height: int


class MeanErrors(NamedTuple):
    """Errors of the means of tiles.

    Attributes:
        sums: (height, width, SUM_VALUES).
        errors: (rows, columns) of tiles, mean square errors, written to.
        width, height: of the display.
        share: variance of a mean as a part of that of its samples.
        exposure: of the frame.
    """

    sums: Floats
    errors: Floats
    width: int
    height: int
    share: float
    exposure: float


class Output(NamedTuple):
    """What a step writes.

    Attributes:
        next_history: (height, width, values of a pixel).
        image: (height, width, 3) linear RGB.
        weight: (height, pitch) weight of the history, in [0, 1]; written where `has_weight`.
        has_weight: 1 where the caller asked for the weight, else 0.
        width, height: of the display.
        pitch: width up to whole vectors.
    """

    next_history: Floats
    image: Floats
    weight: Floats
    has_weight: int
    width: int
    height: int
    pitch: int
