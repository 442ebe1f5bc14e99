"""Structs: arguments of the kernels of `guided-warp`."""

from typing import NamedTuple

from supersampler.backends.cpu.structs import Floats, Words


class UnshadedFrame(NamedTuple):
    """The frame to extrapolate, interleaved channels.

    Attributes:
        base_color, normal: (height, width, 3).
        depth: (height, width).
        motion: (height, width, 2) render pixels.
        width, height: size of the frame.
        samples_stride: samples from row to row of the shaded frame.
    """

    base_color: Floats
    normal: Floats
    depth: Floats
    motion: Floats
    width: int
    height: int
    samples_stride: int


class Rings(NamedTuple):
    """The samples among which each pixel chooses: the nearest one, then rings of eight.

    Attributes:
        x, y: (1 + 8 * rings,) offsets in samples.
        strides: (rings,) distance of each ring, in samples.
        rings: number of rings.
    """

    x: Floats
    y: Floats
    strides: Words
    rings: int


class ExtrapolationOutput(NamedTuple):
    """Outputs: motion to the shaded frame (2, height, width), and image (height, width, 3)."""

    motion: Floats
    image: Floats
