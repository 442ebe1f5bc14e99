"""Structs: arguments of the kernels of `taa`."""

from typing import NamedTuple

from supersampler.backends.cpu.structs import Floats, Words


class TaaSamples(NamedTuple):
    """The samples of a frame, and the variance box of the 3x3 samples around each.

    Attributes:
        planes: (height, TAA_PLANES, PAD + stride + PAD) toned YCoCg, motion in render pixels.
        boxes: (height, TAA_BOX, stride) minimum and maximum YCoCg of the box, the longest motion.
        reactive, has_reactive: see `FrameInputs`.
        gamma: half extent of the box, in standard deviations.
        width, height: size of the frame.
        stride: width, rounded up to whole vectors.
    """

    planes: Floats
    boxes: Floats
    reactive: Floats
    has_reactive: int
    gamma: float
    width: int
    height: int
    stride: int


class LinearAxis(NamedTuple):
    """Linear interpolation of samples at the display pixels of one axis; arrays are (pixels,).

    Attributes:
        first, second: the samples before and after the pixel.
        first_weight, second_weight: their weights.
        nearest: the nearest sample.
    """

    first: Words
    second: Words
    first_weight: Floats
    second_weight: Floats
    nearest: Words


class TaaScratch(NamedTuple):
    """Scratch of one thread: offsets and weights of the warp, the warped history, the image's pixels."""

    slots: Words
    weights: Floats
    warped: Floats
    out: Floats
