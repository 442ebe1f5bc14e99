"""Structs that the kernels of `taau` take."""

from typing import NamedTuple

from supersampler.backends.cpu.structs import Floats, Words


class TaauHistoryInput(NamedTuple):
    """History as the kernels read it.

    Attributes:
        pixels: (display height, display width, TAAU_PIXEL).
        surface: (height, pitch, 4) as the kernel `shade` writes it.
        pitch: PAD + stride + PAD of the previous frame.
    """

    pixels: Floats
    surface: Floats
    pitch: int


class TaauScratch(NamedTuple):
    """Scratch of one thread: filtered rows; offsets and weights of the warp; warped and final pixels."""

    line: Floats
    slots: Words
    weights: Floats
    warped: Floats
    out: Floats
