"""Structs that are arguments of kernels: NamedTuples, packed into slots of eight bytes.

A field is a C-contiguous array (Floats, Halves, Bytes, Words), which kernels get as a pointer; an int (64
bits); a float (32 bits); or a struct. Executors create structs, so this module does not import numba.
"""

import struct
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.memory import address

Floats = NDArray[np.float32]
Halves = NDArray[np.uint16]
"""The bits of half floats."""
Bytes = NDArray[np.uint8]
Words = NDArray[np.int32]
"""int32, or words of four bytes."""

SLOT = 8
"""Bytes of a field."""


def pack(values: tuple[Any, ...]) -> bytes:
    """Return a struct, a NamedTuple, in the format of kernels. The caller keeps its arrays alive."""
    return _layout(type(values)).pack(*_slots(values))


@lru_cache
def _layout(kind: type) -> struct.Struct:
    return struct.Struct("=" + "".join(_formats(kind)))


def _formats(kind: type) -> list[str]:
    """Return the format of each slot of a NamedTuple."""
    formats = []
    for field in kind.__annotations__.values():
        nested = isinstance(field, type) and issubclass(field, tuple)
        formats += _formats(field) if nested else ["f4x" if field is float else "q"]
    return formats


def _slots(values: tuple[Any, ...]) -> list[Any]:
    """Return the numbers of a NamedTuple, of arrays their addresses."""
    slots: list[Any] = []
    for value in values:
        if isinstance(value, np.ndarray):
            slots.append(address(value))
        elif isinstance(value, tuple):
            slots += _slots(value)
        else:
            slots.append(value)
    return slots


NO_MASK = np.zeros(1, np.float32)
"""In place of a reactive mask, where a frame has none."""


class FrameInputs(NamedTuple):
    """The arrays of a frame of (height, width) samples.

    Attributes:
        color: (height, width, 3) linear RGB without pre-exposure.
        depth: (height, width) reversed depth; see `Frame`.
        motion: (height, width, 2) render pixels.
        reactive: (height, width) reactive mask, 0 where a sample is missing.
        has_reactive: 1 if there is one, else 0.
        exposure: multiplies the color before the tone curve; 0 before it is known.
    """

    color: Floats
    depth: Floats
    motion: Floats
    reactive: Floats = NO_MASK
    has_reactive: int = 0
    exposure: float = 0.0


class FrameSamples(NamedTuple):
    """The preprocessed samples of a frame.

    Rows of `padded_width` = PAD + stride + PAD samples; the padding repeats the border.

    Attributes:
        color: (height, SAMPLE_PLANES, padded_width) toned RGB, 1 where usable, YCoCg, squares of YCoCg.
        depth, motion_x, motion_y: (height, padded_width); depth is -1 where it is unusable.
        eroded_depth: (height, padded_width) the farthest of 3x3.
        dilated: (height, stride, 4) depth and motion of the closest of 2x2 samples.
        own: (height, stride, 4) motion of the sample itself, range of depth in 3x3 samples, 1 where one of
            these is over GLARING.
        glares: (height,) 1 where a sample of the row is over GLARING, else 0.
        still_rows: (height,) 1 where a sample of the row does not move, else 0.
        reactive, has_reactive: see `FrameInputs`.
        width, height: size of the frame.
        stride: width, rounded up to whole vectors.
    """

    color: Floats
    depth: Floats
    motion_x: Floats
    motion_y: Floats
    eroded_depth: Floats
    dilated: Floats
    own: Floats
    glares: Floats
    still_rows: Floats
    reactive: Floats
    has_reactive: int
    width: int
    height: int
    stride: int


class ResampleTables(NamedTuple):
    """The samples that display pixels read, and their weights; see `resample_tables.Axis`.

    Attributes:
        row_samples: (height, 4) the four rows of samples around a pixel.
        row_weights: (filters, height, 4) weights of these.
        row_windows: (windows, height, 3) weights of the three rows around the nearest.
        first_row, nearest_row: (height,).
        column_start: (width,) the sample at or before a pixel; -1 before the first.
        column_weights: (4 * filters, width) weights of the four columns around a pixel.
        column_windows: (3 * windows, width) weights of the three columns around the nearest.
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
        sample: (n,) index of the sample near each, or -1.
        kind: (n,) index of the weights.
    """

    sample: Words
    kind: Words


class AddedSamples(NamedTuple):
    """Samples of a frame that are added to the sums of tiles.

    Attributes:
        modes: (rows, columns) of tiles: 0 or a sum of KEEP and ADD.
        sums_before: (height, width, SUM_VALUES) of the previous frame.
        sums: likewise, written to.
        color: (samples down, samples across, 3) linear RGB.
        rows, columns: samples in these.
        weights: (row kinds, column kinds) of the frame's samples.
        column_kinds: number of different ones.
        samples_across: of the frame.
        width, height: of the display.
    """

    modes: Bytes
    sums_before: Floats
    sums: Floats
    color: Floats
    rows: AxisSamples
    columns: AxisSamples
    weights: Floats
    column_kinds: int
    samples_across: int
    width: int
    height: int


class NoisyFrame(NamedTuple):
    """The samples of a frame that tiles with noise are measured by.

    Attributes:
        samples: color, and the places of the samples; see `AddedSamples`.
        depth, motion: see `FrameInputs`.
        exposure: of the statistics.
    """

    samples: AddedSamples
    depth: Floats
    motion: Floats
    exposure: float


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
    """The outputs of a step.

    Attributes:
        next_history: (height, width, values per pixel).
        image: (height, width, 3) linear RGB.
        weight: (height, pitch) weight of the history, in [0, 1].
        has_weight: 1 if `weight` is to be written, else 0.
        width, height: size of the image.
        pitch: width, rounded up to whole vectors.
    """

    next_history: Floats
    image: Floats
    weight: Floats
    has_weight: int
    width: int
    height: int
    pitch: int


class StillSamples(NamedTuple):
    """The samples of a frame for the mean where nothing moves; rows of `padded_width` as of `FrameSamples`.

    Attributes:
        color: (height, 4, padded_width) linear RGB of samples that are usable and do not glare; 1 for these.
        moving: (height, padded_width) 1 where the sample moves, else 0.
        moving_2x2: the same of any of it, its right, lower and lower right neighbour.
        opens: 1 where the sample contradicts the mean, DOUBTED where only the pattern around it does.
        opened: the largest of 5x5 samples.
        rows_opened: (height,) 1 where any of a row does.
        reactive, has_reactive: see `FrameInputs`.
        width, height: of the frame.
        padded_width: of a row.
        exposure: of the frame.
        learned_step: samples per display pixel that this frame adds to the learning time.
        counts: 1, or 0 if the frame is extrapolated, or has the previous one's jitter: no sample is added, no
            pattern is compared, and doubts stay.
    """

    color: Floats
    moving: Floats
    moving_2x2: Floats
    opens: Floats
    opened: Floats
    rows_opened: Floats
    reactive: Floats
    has_reactive: int
    width: int
    height: int
    padded_width: int
    exposure: float
    learned_step: float
    counts: float


class MeanHistory(NamedTuple):
    """The mean of the previous frames where nothing moves.

    Attributes:
        pixels: (display height, width, 4) linear RGB, and the weight.
        opening: (height, padded_width, 4) of the frame's size: range of the residuals, samples learned of.
        width: of the display.
        has_opening: 0 where the previous frame was of another size, so that `opening` does not apply.
    """

    pixels: Floats
    opening: Floats
    width: int
    has_opening: int


class SampleTables(NamedTuple):
    """The display pixels around each sample, and their bilinear weights.

    Attributes:
        columns: (2, columns_pitch) of the pixels to the left and right.
        column_weights: (2, columns_pitch).
        rows: (height, 2) of the pixels above and below.
        row_weights: (height, 2).
        columns_pitch: samples of a row, rounded up to whole vectors.
    """

    columns: Words
    column_weights: Floats
    rows: Words
    row_weights: Floats
    columns_pitch: int


class ConvergedOutput(NamedTuple):
    """What the mean is written to.

    Attributes:
        next_pixels: see `MeanHistory.pixels`.
        image: (height, width, 3) linear RGB, changed in place.
        converged: (height, pitch) fraction of the mean in the image.
        has_converged: 1 if `converged` is wanted, else 0.
        any_opened: 1 if any sample contradicts the mean.
        columns: (pitch,) of the pixels of a row; the last one is repeated.
        filter: index of the filter of the samples among those of `ResampleTables`.
        width, height: of the display.
        pitch: width, rounded up to whole vectors.
    """

    next_pixels: Floats
    image: Floats
    converged: Floats
    has_converged: int
    any_opened: int
    columns: Words
    filter: int
    width: int
    height: int
    pitch: int
