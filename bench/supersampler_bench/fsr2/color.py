"""Colour spaces of FSR2; all of (..., 3)."""

import numpy as np

from supersampler.frame import Array
from supersampler.io.display import BT709, MAX_HALF

_TONEMAP_EPSILON = 1.0 / MAX_HALF
_TO_YCOCG = np.array([[0.25, 0.5, 0.25], [0.5, 0.0, -0.5], [-0.25, 0.5, -0.25]], np.float32)
_FROM_YCOCG = np.array([[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]], np.float32)


def prepared(rgb: Array, exposure: float) -> Array:
    """Return exposed linear RGB in [0, 65504] of scene-linear RGB."""
    return np.asarray(np.clip(rgb * np.float32(exposure), 0.0, MAX_HALF))


def to_ycocg(rgb: Array) -> Array:
    """Convert RGB to YCoCg."""
    return np.asarray(rgb @ _TO_YCOCG.T)


def from_ycocg(ycocg: Array) -> Array:
    """Convert YCoCg to RGB."""
    return np.asarray(ycocg @ _FROM_YCOCG.T)


def luma(rgb: Array) -> Array:
    """Return the BT.709 luminance (...)."""
    return np.asarray(rgb @ BT709)


def perceived_luma(rgb: Array) -> Array:
    """Return CIE lightness / 100 (...) of linear RGB."""
    y = luma(rgb)
    lightness = np.where(y <= 216.0 / 24389.0, y * (24389.0 / 27.0), np.cbrt(y) * 116.0 - 16.0)
    return lightness.astype(np.float32) * np.float32(0.01)


def tonemap(rgb: Array) -> Array:
    """Divide by 1 + the largest component, or by 1 where all are negative."""
    largest = rgb.max(axis=-1, keepdims=True)
    return np.asarray(rgb / (np.maximum(largest, 0.0) + 1.0))


def inverse_tonemap(rgb: Array) -> Array:
    """Undo `tonemap`."""
    largest = rgb.max(axis=-1, keepdims=True)
    return np.asarray(rgb / np.maximum(1.0 - largest, _TONEMAP_EPSILON))
