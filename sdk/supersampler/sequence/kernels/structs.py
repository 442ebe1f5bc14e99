"""Structs and constants of the kernels of sequences."""

from typing import NamedTuple

from supersampler.backends.cpu.structs import Floats

SAME_SURFACE = 0.1
"""Largest difference of two depths of one surface in neighbouring frames, relative to the larger one."""
HIDDEN = 1e30
"""Mismatch of a pixel that no sample reached."""
REACH = 4
"""Pixels to each side in which a surface's motion is looked for."""
OTHER_SURFACE = 2 * REACH * REACH + 1
"""Squared distance that another surface counts as, more than any."""


class ScatterTables(NamedTuple):
    """Two neighbouring frames, and the motion from the first to the second.

    Attributes:
        motion: (height, width, 2) written to: motion of the first frame's samples to the second frame.
        mismatch: (height, width) written to: relative difference of depth of the scattered sample.
        depth: (height, width) of the first frame.
        next_motion: (next_height, next_width, 2) of the second frame, back to the first.
        next_depth: (next_height, next_width).
        shift_x, shift_y: jitter of the second frame minus that of the first, in pixels of the first.
        scale_x, scale_y: size of the first frame / size of the second.
        width, height: of the first frame.
        next_width, next_height: of the second.
    """

    motion: Floats
    mismatch: Floats
    depth: Floats
    next_motion: Floats
    next_depth: Floats
    shift_x: float
    shift_y: float
    scale_x: float
    scale_y: float
    width: int
    height: int
    next_width: int
    next_height: int


class MergedImages(NamedTuple):
    """Two images of one frame, and their weights.

    Attributes:
        image: (pixels, 3) of the forward run, and written to: their weighted mean.
        other: (pixels, 3) of the backward run.
        weight, other_weight: (pixels,) of these.
        pixels: how many.
        exposure: multiplies the image before the tone curve; 0 for a mean without one.
    """

    image: Floats
    other: Floats
    weight: Floats
    other_weight: Floats
    pixels: int
    exposure: float
