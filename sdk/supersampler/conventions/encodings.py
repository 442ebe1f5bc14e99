"""Conversion between kinds of depth, and between linear and sRGB-encoded colour."""

from typing import Literal

import numpy as np

from supersampler.errors import FrameError
from supersampler.frame import Array, Float32

DepthKind = Literal["reversed_infinite", "reversed", "forward_infinite", "forward", "linear"]


def to_reversed_infinite(depth: Array, kind: DepthKind, near: float, far: float | None) -> Float32:
    """Return (h, w) near / view distance, 0 at the sky. NaN stays NaN.

    Args:
        depth: (h, w) of `kind`: values of the depth buffer in [0, 1], or view distance for "linear", where
            0 is the sky, too.
        kind: see `Conventions.depth`.
        near: distance of the near plane, > 0, in the unit of linear depth.
        far: distance of the far plane; None if `kind` needs none.
    """
    values = depth.astype(np.float32, copy=False)
    if kind == "reversed_infinite":
        return values
    if kind == "linear":
        # renderers write 0 at the sky
        inverse = np.divide(np.float32(near), values, out=np.zeros_like(values), where=values != 0)
        return inverse if far is None else np.where(values >= far, np.float32(0), inverse)
    if kind.startswith("forward"):
        values = np.float32(1) - values
    ratio = np.float32(0 if far is None else near / far)
    return np.where(values <= 0, np.float32(0), values * (1 - ratio) + ratio)


def from_reversed_infinite(depth: Array, kind: DepthKind, near: float, far: float | None) -> Float32:
    """Return (h, w) depth of `kind`: the inverse of `to_reversed_infinite`.

    Raises:
        FrameError: a surface lies beyond the far plane, which this kind of depth cannot represent.
    """
    values = depth.astype(np.float32, copy=False)
    if kind == "reversed_infinite":
        return values
    if kind == "linear":
        distance = np.float32(near) / values
        return distance if far is None else np.where(values == 0, np.float32(far), distance)
    if far is not None:
        ratio, surfaces = near / far, values[values > 0]
        if surfaces.size and surfaces.min() < ratio * (1 - 1e-5):  # 1e-5: rounding at the far plane
            raise FrameError(
                "depth",
                got=f"as small as {surfaces.min():.3g}, beyond the far plane",
                want=f">= near / far = {ratio:.3g}, or 0 at the sky",
                hint="Give Conventions a larger far, or a depth with an infinite far plane.",
            )
        values = np.where(values == 0, np.float32(0), (values - np.float32(ratio)) / np.float32(1 - ratio))
    return np.float32(1) - values if kind.startswith("forward") else values


def srgb_decoded(values: Array) -> Float32:
    """Decode sRGB values of any shape to linear."""
    encoded = values.astype(np.float32, copy=False)
    size = np.abs(encoded)
    curve = ((size + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.copysign(np.where(size <= 0.04045, size / np.float32(12.92), curve), encoded)


def srgb_encoded(values: Array) -> Float32:
    """Encode linear values of any shape as sRGB."""
    linear = values.astype(np.float32, copy=False)
    size = np.abs(linear)
    curve = np.float32(1.055) * size ** np.float32(1 / 2.4) - np.float32(0.055)
    return np.copysign(np.where(size <= 0.0031308, size * np.float32(12.92), curve), linear)
