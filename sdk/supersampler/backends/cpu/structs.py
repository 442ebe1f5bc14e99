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
        fill: (down, across, 3) linear RGB of the missing samples of each window; see `missing_fill`.
        fill_across: windows in a row; 0 where no sample is missing.
        exposure: multiplies the color before the tone curve; 0 before it is known.
    """

    color: Floats
    depth: Floats
    motion: Floats
    reactive: Floats = NO_MASK
    has_reactive: int = 0
    fill: Floats = NO_MASK
    fill_across: int = 0
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
            these is over GLARE_TONED.
        glares: (height,) 1 where a sample of the row is over GLARE_TONED, else 0.
        still_rows: (height,) 1 where a sample of the row does not move, else 0.
        reactive, has_reactive: see `FrameInputs`.
        fill: (down, 3, `fill_pitch`) toned RGB of missing samples, by row of windows and column of the
            display: what is shown where no sample is near.
        fill_pitch: 0 where no sample is missing.
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
    fill: Floats
    fill_pitch: int
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


class RestSamples(NamedTuple):
    """The samples of a frame, and what `kernels.at_rest.sign_blocks` finds.

    Attributes:
        color, motion: see `FrameInputs`.
        reactive, has_reactive: (height, width) reactive mask; 1 if there is one, else 0.
        weights: (4, 48) weights of the values of four rows of sixteen samples in the last of a signature.
        moving: (down, across) written to: 1 where a sample of the block moves, else 0.
        signatures: (4, down, across) written to where none does.
        width, height: of the frame.
        across, down: blocks of the frame.
    """

    color: Floats
    motion: Floats
    reactive: Floats
    has_reactive: int
    weights: Floats
    moving: Bytes
    signatures: Floats
    width: int
    height: int
    across: int
    down: int


SUMS = 12
"""Sums of a block: samples; residuals, RGB; samples, RGB; the mean there, RGB; squares of the first two."""
KEEPS, ADDS, RESTARTS = 1, 2, 3
"""Modes of a block's mean: it stays, takes the samples, or begins with them. 0: it has none."""


class BlockSums(NamedTuple):
    """The samples of a frame and the mean of the display, whose residuals `sum_blocks` adds up.

    Attributes:
        color: (height, width, 3) linear RGB.
        mean: (display height, display width, 4).
        rows, row_weights: (height, 2) rows of the display around each row of samples, and their weights.
        columns, column_weights: (width, 2) columns of the display around each column of samples, and their
            weights.
        row_blocks, column_blocks: block of each row and column of the display.
        ages: (down, across) of blocks before this frame; where 0, there is no mean.
        wanted: (down, across) 1 for blocks to sum.
        sums: (SUMS, down, across) written to.
        width, height: of the frame.
        across, down: blocks of the frame.
        display_width: of the mean.
    """

    color: Floats
    mean: Floats
    rows: Words
    row_weights: Floats
    columns: Words
    column_weights: Floats
    row_blocks: Words
    column_blocks: Words
    ages: Floats
    wanted: Bytes
    sums: Floats
    width: int
    height: int
    across: int
    down: int
    display_width: int


class AddedSamples(NamedTuple):
    """Arguments of `kernels.at_rest.add_samples`.

    Attributes:
        color: (h, samples_across, 3) linear RGB.
        before, after: (height, width, 4) the mean before this frame, and after it.
        rows, row_weights: (height, 2) rows of samples around each row of the display, and their weights.
        columns, column_weights: (width, 2) columns of samples around each column of the display, and their
            weights.
        row_blocks, column_blocks: see `BlockSums`.
        modes: (down, across) of KEEPS, ADDS, RESTARTS, or 0.
        samples_across: width of the frame.
        across: blocks of a row.
        width: of the display.
    """

    color: Floats
    before: Floats
    after: Floats
    rows: Words
    row_weights: Floats
    columns: Words
    column_weights: Floats
    row_blocks: Words
    column_blocks: Words
    modes: Bytes
    samples_across: int
    across: int
    width: int


class ShownMean(NamedTuple):
    """Arguments of `kernels.at_rest.show_mean`.

    Attributes:
        mean: (height, width, 4).
        image: (height, width, 3) faded to the mean.
        shares, complete: (down, across); see `show_mean`; 1 where the mean has a whole period of samples.
        row_blocks, column_blocks: see `BlockSums`.
        row_moments: (phases, height, 2) weight of the samples near each row in each phase, and this times
            their offset.
        column_moments: (phases, 2, pitch) the same moments of the samples near each column.
        phases: of the jitter's period.
        pitch: width, rounded up to whole vectors.
        across: blocks of a row.
        width, height: of the image.
        noise_weight: see `methods.at_rest.NOISE_WEIGHT`.
    """

    mean: Floats
    image: Floats
    shares: Floats
    complete: Floats
    row_blocks: Words
    column_blocks: Words
    row_moments: Floats
    column_moments: Floats
    phases: int
    pitch: int
    across: int
    width: int
    height: int
    noise_weight: float
