"""Frames rounded so that they compress well."""

from dataclasses import replace

import numpy as np

from supersampler.frame import Array, Frame


def compact(frame: Frame) -> Frame:
    """Round depth to 12 bits, colour to 7, and motion to 1 / 64 pixel."""
    assert frame.color is not None
    motion = np.round(frame.motion * 64.0) / 64.0
    return replace(
        frame,
        color=_rounded(frame.color, 7).astype(np.float16),
        depth=_rounded(frame.depth, 12),
        motion=motion.astype(np.float16),
    )


def cropped(frame: Frame, width: int, height: int) -> Frame:
    """Return the middle of the frame, at most this large."""
    assert frame.color is not None
    w, h = frame.size
    top, left = max(0, h - height) // 2, max(0, w - width) // 2
    part = slice(top, top + height), slice(left, left + width)
    return replace(frame, color=frame.color[part], depth=frame.depth[part], motion=frame.motion[part])


def _rounded(values: Array, bits: int) -> Array:
    fraction, exponent = np.frexp(values.astype(np.float32))
    rounded: Array = np.ldexp(np.round(np.ldexp(fraction, bits)), exponent - bits).astype(np.float32)
    return rounded
