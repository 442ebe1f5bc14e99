"""`easu` and `easu-rcas`: AMD's FSR 1, a spatial upscaler, by its published formulas and constants.

Source: ffx_fsr1.h of FidelityFX Super Resolution 1.0 (AMD, 2021, MIT); the code is ours. Two things differ:
samples lie at pixel centre + jitter, and divisions are exact.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions.encodings import srgb_decoded
from supersampler.errors import FrameError
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.display import auto_exposure, display_transform, usable_exposure
from supersampler_bench.fsr2 import inverse_tonemap, lerp, saturate, shifted

EASU, EASU_RCAS = "easu", "easu-rcas"
"""Names of the methods in `bench quality`: edge-adaptive upsampling, without and with sharpening."""
SHARPNESS = 0.2
"""Sharpness of RCAS, stops below the maximum; the default of AMD's sample."""
_RCAS_LIMIT = 0.25 - 1.0 / 16.0  # FSR_RCAS_LIMIT
_TAPS = ((0, -1), (1, -1), (-1, 0), (0, 0), (1, 0), (2, 0), (-1, 1), (0, 1), (1, 1), (2, 1), (0, 2), (1, 2))
"""The 12 texels (x, y) around a position whose upper left neighbour is (0, 0)."""
_NEAREST = ((0, 0), (1, 0), (0, 1), (1, 1))
_FLAT = 1.0 / 32768.0  # squared length of a gradient below which there is no direction
_MIN_DIVISOR = 1e-6
Indices = NDArray[np.intp]


class Fsr1:
    """FSR 1: EASU, followed by RCAS if it `sharpens`."""

    def __init__(self, display_size: Size, *, sharpens: bool) -> None:
        self.display_size, self.sharpens = display_size, sharpens

    def step(self, frame: Frame) -> tuple[Float32, Float32 | None]:
        """Return the image (H, W, 3), linear RGB, and the AOVs (H, W, k), upsampled by the image's filter.

        FSR 1 expects display values: colour is exposed, tone mapped and sRGB encoded before the filter.

        Raises:
            FrameError: the frame has no colour.
        """
        if frame.color is None:
            raise FrameError("color", got=None, want="a shaded frame")
        color = frame.color / np.float32(frame.pre_exposure)
        exposure = usable_exposure(frame.exposure) or auto_exposure(color)
        shown = display_transform(color, exposure)
        weights, columns, rows = easu_weights(luma(shown), frame.jitter, self.display_size)
        image = dering(filtered(shown, weights, columns, rows), shown, columns, rows)
        image = rcas(image) if self.sharpens else image
        linear = inverse_tonemap(srgb_decoded(saturate(image))) / np.float32(exposure)
        aovs = None
        if frame.aovs is not None:
            upsampled = filtered(frame.aovs.astype(np.float32), weights, columns, rows)
            aovs = dering(upsampled, frame.aovs, columns, rows)
        return np.asarray(linear * np.float32(frame.pre_exposure), np.float32), aovs


def luma(shown: Array) -> Array:
    """Return FSR 1's approximate luma (...) of RGB (..., 3): 0.5 R + G + 0.5 B."""
    return np.asarray(0.5 * shown[..., 0] + shown[..., 1] + 0.5 * shown[..., 2])


def easu_weights(
    lumas: Array, jitter: tuple[float, float], display_size: Size
) -> tuple[list[Array], list[Indices], list[Indices]]:
    """Return the normalized weights (H, W) of each of _TAPS, and the columns and rows of their texels.

    Columns and rows have the offsets -1, 0, 1, 2, for each column and row of the display. The edge direction
    comes from the bilinearly weighted gradients at the four nearest texels. The kernel is a windowed
    Lanczos2, stretched along straight edges.
    """
    height, width = lumas.shape
    columns, fx = _texels(display_size[0], width, jitter[0])
    rows, fy = _texels(display_size[1], height, jitter[1])
    px, py = fx[None], fy[:, None]
    gradient_x, straight_x = (_at_nearest(plane, px, py, columns, rows) for plane in _gradient(lumas, 1))
    gradient_y, straight_y = (_at_nearest(plane, px, py, columns, rows) for plane in _gradient(lumas, 0))
    square = gradient_x**2 + gradient_y**2
    is_flat = square < _FLAT
    size = np.where(is_flat, 1.0, np.sqrt(np.maximum(square, _FLAT)))
    along_x, along_y = np.where(is_flat, 1.0, gradient_x) / size, gradient_y / size
    straightness = (0.5 * (straight_x + straight_y)) ** 2
    stretch = (along_x**2 + along_y**2) / np.maximum(np.maximum(abs(along_x), abs(along_y)), _MIN_DIVISOR)
    length_x, length_y = 1.0 + (stretch - 1.0) * straightness, 1.0 - 0.5 * straightness
    lobe = 0.5 + ((0.25 - 0.04) - 0.5) * straightness
    weights = []
    for x, y in _TAPS:
        dx, dy = x - px, y - py
        across = (dx * along_x + dy * along_y) * length_x
        beside = (dy * along_x - dx * along_y) * length_y
        distance = np.minimum(across**2 + beside**2, 1.0 / lobe)
        base = 25.0 / 16.0 * (2.0 / 5.0 * distance - 1.0) ** 2 - (25.0 / 16.0 - 1.0)
        weights.append(base * (lobe * distance - 1.0) ** 2)
    total = np.sum(weights, axis=0)
    return [np.asarray(weight / total, np.float32) for weight in weights], columns, rows


def filtered(image: Array, weights: Sequence[Array], columns: list[Indices], rows: list[Indices]) -> Array:
    """Return the sum (H, W, k) of an image's texels (h, w, k) under the weights of _TAPS."""
    terms = (
        weight[..., None] * image[rows[y + 1][:, None], columns[x + 1]]
        for weight, (x, y) in zip(weights, _TAPS, strict=True)
    )
    return np.asarray(sum(terms))


def dering(upsampled: Array, image: Array, columns: list[Indices], rows: list[Indices]) -> Float32:
    """Clamp to the range of the four nearest texels."""
    near = [image[rows[y + 1][:, None], columns[x + 1]] for x, y in _NEAREST]
    return np.asarray(np.clip(upsampled, np.minimum.reduce(near), np.maximum.reduce(near)), np.float32)


def rcas(image: Array) -> Array:
    """Sharpen an image (H, W, 3) in [0, 1] by the four neighbours, without leaving that range."""
    ring = [shifted(image, dx, dy) for dx, dy in ((0, -1), (-1, 0), (1, 0), (0, 1))]
    low, high = np.minimum.reduce(ring), np.maximum.reduce(ring)
    hit_low = np.minimum(low, image) / np.maximum(4.0 * high, _MIN_DIVISOR)
    hit_high = (1.0 - np.maximum(high, image)) / np.minimum(4.0 * low - 4.0, -_MIN_DIVISOR)
    lobe = np.maximum(-hit_low, hit_high).max(axis=-1, keepdims=True)
    lobe = np.clip(lobe, -_RCAS_LIMIT, 0.0) * 2.0**-SHARPNESS
    return np.asarray((lobe * sum(ring) + image) / (4.0 * lobe + 1.0))


def _texels(display: int, render: int, jitter: float) -> tuple[list[Indices], Array]:
    """Return the texels at the offsets -1, 0, 1, 2 of each display pixel, and its position from 0 to 1."""
    position = (np.arange(display) + 0.5) * render / display - 0.5 - jitter
    first = np.floor(position)
    indices = first.astype(np.intp)
    return [np.clip(indices + k, 0, render - 1) for k in (-1, 0, 1, 2)], (position - first).astype(np.float32)


def _gradient(lumas: Array, axis: int) -> tuple[Array, Array]:
    """Return the gradient along an axis, and its straightness: 1 on a ramp, 0 on a ridge."""
    dx, dy = (1, 0) if axis == 1 else (0, 1)
    before, after = shifted(lumas, -dx, -dy), shifted(lumas, dx, dy)
    steps = np.maximum(abs(after - lumas), abs(lumas - before))
    gradient = after - before
    return gradient, saturate(abs(gradient) / np.maximum(steps, _MIN_DIVISOR)) ** 2


def _at_nearest(plane: Array, px: Array, py: Array, columns: list[Indices], rows: list[Indices]) -> Array:
    """Return the bilinear mean over the four nearest texels."""
    corners = [plane[rows[y + 1][:, None], columns[x + 1]] for x, y in _NEAREST]
    return lerp(lerp(corners[0], corners[1], px), lerp(corners[2], corners[3], px), py)
