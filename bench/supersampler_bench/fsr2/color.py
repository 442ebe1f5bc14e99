"""Colour spaces of FSR2; all of (..., 3)."""

import numpy as np

from supersampler.frame import Float32
from supersampler.io.display import BT709, MAX_HALF

_TONEMAP_EPSILON = 1.0 / MAX_HALF
_TO_YCOCG = np.array([[0.25, 0.5, 0.25], [0.5, 0.0, -0.5], [-0.25, 0.5, -0.25]], np.float32)
_FROM_YCOCG = np.array([[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]], np.float32)


def prepared(rgb: Float32, exposure: float) -> Float32:
    """Return exposed linear RGB in [0, 65504] of scene-linear RGB."""
    return np.clip(rgb * np.float32(exposure), np.float32(0.0), np.float32(MAX_HALF))


def to_ycocg(rgb: Float32) -> Float32:
    """Convert RGB to YCoCg."""
    return rgb @ _TO_YCOCG.T


def from_ycocg(ycocg: Float32) -> Float32:
    """Convert YCoCg to RGB."""
    return ycocg @ _FROM_YCOCG.T


def luma(rgb: Float32) -> Float32:
    """Return the BT.709 luminance (...)."""
    return rgb @ BT709


def perceived_luma(rgb: Float32) -> Float32:
    """Return CIE lightness / 100 (...) of linear RGB."""
    y = luma(rgb)
    lightness = np.where(y <= 216.0 / 24389.0, y * (24389.0 / 27.0), np.cbrt(y) * 116.0 - 16.0)
    return lightness.astype(np.float32) * np.float32(0.01)


def tonemap(rgb: Float32) -> Float32:
    """Divide by 1 + the largest component, or by 1 where all are negative."""
    return rgb / (np.maximum(rgb.max(axis=-1, keepdims=True), 0.0) + 1.0)


def inverse_tonemap(rgb: Float32) -> Float32:
    """Undo `tonemap`."""
    return rgb / np.maximum(1.0 - rgb.max(axis=-1, keepdims=True), np.float32(_TONEMAP_EPSILON))
