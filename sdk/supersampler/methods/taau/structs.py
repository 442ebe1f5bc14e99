"""Structs: arguments of the kernels of `taau`."""

from typing import NamedTuple

from supersampler.backends.cpu.structs import Floats, Words


class TaauHistoryInput(NamedTuple):
    """The history that the kernels read.

    Attributes:
        pixels: (display height, display width, TAAU_PIXEL).
        surface: (height, pitch, 4) of the previous frame, see the kernel `shade`.
        pitch: samples from row to row: PAD + stride + PAD.
        kept: (blocks down, `kept_pitch`) number of samples that are kept, by column of the display.
        kept_rows: (display height,) row of `kept`.
        has_kept: 1 where `kept` has numbers, else 0.
    """

    pixels: Floats
    surface: Floats
    pitch: int
    kept: Floats
    kept_rows: Words
    kept_pitch: int
    has_kept: int


class ComparedBlocks(NamedTuple):
    """Arguments of the kernel `compare_with_history`.

    Attributes:
        pixels: (display height, display width, TAAU_PIXEL) of the history.
        columns, rows: the pixel nearest to each column and row of samples.
        sums: (6, blocks down, `pitch`) RGB of the difference of samples and history, toned; of the history.
        across, pitch: blocks of a row; rounded up to whole vectors.
        down: rows of blocks.
        width: of the display.
        exposure: of this frame.
    """

    pixels: Floats
    columns: Words
    rows: Words
    sums: Floats
    across: int
    pitch: int
    down: int
    width: int
    exposure: float


class TaauScratch(NamedTuple):
    """Scratch of one thread: filtered rows; offsets and weights of the warp; warped and final pixels."""

    line: Floats
    slots: Words
    weights: Floats
    warped: Floats
    out: Floats
