"""The display transform from linear light to sRGB, and the exposure that goes into it.

    exposed = color * exposure
    toned   = exposed / (1 + max(exposed.r, exposed.g, exposed.b))
    shown   = clip(sRGB(toned), 0, 1)

PNG files, pages and metrics use it. The tone curve keeps hue and maps every highlight below 1. If the engine
gives no exposure, `auto_exposure` measures it, by the formula of the models' graphs.
"""

from collections.abc import Callable
from functools import reduce
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import as_number, ieee_arithmetic
from supersampler.conventions.encodings import srgb_encoded
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Array, Float32, Frame, as_array

EXPOSURE_KEY = 0.18
"""Middle grey: the log-average luminance that `auto_exposure` maps an image to."""

MIN_EXPOSURE, MAX_EXPOSURE = 2.0**-24, 2.0**24
"""Range of exposures that a frame can give; outside of it, exposure is measured. It maps any half float to
middle grey, with at least two stops to spare."""

EXPOSURE_ADAPTATION = 0.1
"""Fraction of the difference in stops that a measured exposure moves in one frame."""

EXPOSURE_OUTLIER = 64.0
"""Maximum ratio of the exposures of two frames; a larger change needs a second frame to confirm it."""

DARKEST = 1e-4
"""Pixels up to this luminance are left out of the logarithmic average. A black background or letterbox
bars would otherwise raise the exposure."""

MAX_HALF = 65504.0
"""Largest half float, to which light is clamped."""

BT709_WEIGHTS = (0.2126, 0.7152, 0.0722)
"""Weights of linear red, green and blue in luminance."""

BT709 = np.array(BT709_WEIGHTS, np.float32)

CEILING_DB = 100.0
"""The PSNR of equal images, finite for means and JSON."""

_ROWS = 32  # rows per block, which stay in the cache
_Number = TypeVar("_Number", bound=np.generic)
_MAX_FACTOR = 1e30  # maximum exposure; its product with an image fits single precision


@ieee_arithmetic
def display_transform(image: Array, exposure: float = 1.0) -> Float32:
    """Apply exposure, tone curve and sRGB encoding to linear RGB.

    Args:
        image: (h, w, 3) linear RGB. Negative values and NaN count as 0, Inf as 65504.
        exposure: > 0, multiplies the image first.

    Returns:
        (h, w, 3) float32 in [0, 1], sRGB encoded.

    Raises:
        ArgumentError: the image is not of that shape, or has no numbers; or `exposure` is not a number > 0.
    """
    number = as_number(exposure)
    if number is None or not 0.0 < number <= _MAX_FACTOR:
        raise ArgumentError("exposure", got=shown(exposure), want=f"a number > 0, at most {_MAX_FACTOR:g}")

    def encoded(rows: NDArray[Any]) -> Float32:
        toned = np.nan_to_num(rows.astype(np.float32, copy=False), nan=0.0, posinf=MAX_HALF, neginf=0.0)
        np.clip(toned, 0.0, MAX_HALF, out=toned)
        toned *= np.float32(number)
        toned /= 1.0 + reduce(np.maximum, np.moveaxis(toned, -1, 0))[..., None]
        return srgb_encoded(toned).clip(0.0, 1.0)

    return by_rows(encoded, checked_image("image", image), np.float32)


def by_rows(
    function: Callable[[NDArray[Any]], NDArray[Any]], image: NDArray[Any], kind: type[_Number]
) -> NDArray[_Number]:
    """Return the results of a function of pixels, computed in blocks of rows, which stay in the cache."""
    results = np.empty(image.shape, kind)
    for row in range(0, len(image), _ROWS):
        results[row : row + _ROWS] = function(image[row : row + _ROWS])
    return results


def checked_image(name: str, image: Array) -> NDArray[Any]:
    """Return (h, w, 3) numbers of any type as an array; ArgumentError for anything else."""
    array = as_array(name, image, ArgumentError)
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "iuf":
        raise ArgumentError(name, got=shown(array), want="(h, w, 3) numbers, linear RGB")
    return array


def decibels(mean_squared_error: float) -> float:
    """Return the PSNR (dB, peak 1) of a mean squared error >= 0, at most `CEILING_DB`."""
    return float(-10.0 * np.log10(max(mean_squared_error, 10.0 ** (-CEILING_DB / 10.0))))


@ieee_arithmetic
def to_uint8(shown: Array) -> NDArray[np.uint8]:
    """Round values in [0, 1] to 0..255, to nearest; values outside are clamped."""
    return by_rows(lambda rows: np.clip(rows, 0.0, 1.0) * 255.0 + 0.5, shown, np.uint8)


@ieee_arithmetic
def to_uint16(shown: Array) -> NDArray[np.uint16]:
    """Round values in [0, 1] to 0..65535, to nearest; values outside are clamped."""
    return by_rows(lambda rows: np.clip(rows, 0.0, 1.0) * 65535.0 + 0.5, shown, np.uint16)


@ieee_arithmetic
def luminance(color: Float32) -> Float32:
    """Return the BT.709 luminance (...) of linear RGB (..., 3); NaN and Inf stay."""
    red, green, blue = np.moveaxis(color, -1, 0)
    # not a product of matrices: BLAS would start threads, which wait busily afterwards
    return np.asarray(BT709[0] * red + BT709[1] * green + BT709[2] * blue)


@ieee_arithmetic
def auto_exposure(color: NDArray[Any]) -> float:
    """Return the exposure that maps an image's log-average luminance to 0.18.

    0.18 / exp(mean(log(luminance))), with BT.709 luminance of the pixels clamped to [0, 65504]. Pixels up to
    1e-4, and those with a NaN, do not count.

    Args:
        color: (h, w, 3) linear RGB.

    Returns:
        > 0, below 1800; 0.18 for an image without a pixel that counts.

    Raises:
        ArgumentError: the image has another shape, or does not hold numbers.
    """
    return _measured_exposure(color) or EXPOSURE_KEY


def _measured_exposure(color: NDArray[Any]) -> float | None:
    """Return the result of `auto_exposure`; None if no pixel counts."""
    color = checked_image("color", color)
    missing = missing_pixels(color)
    usable = color[~missing] if missing.any() else color.reshape(-1, 3)
    light = luminance(usable.astype(np.float32, copy=False).clip(0.0, MAX_HALF))
    lit = light[light > DARKEST]
    return float(EXPOSURE_KEY * np.exp(-np.log(lit).mean(dtype=np.float64))) if lit.size else None


def missing_pixels(color: NDArray[Any]) -> NDArray[np.bool_]:
    """Return a mask (h, w), True where a colour (h, w, 3) has a NaN."""
    red, green, blue = np.moveaxis(np.isnan(color), -1, 0)  # faster than `any` over three values
    return np.asarray(red | green | blue)


def usable_exposure(given: float | None) -> float | None:
    """Return the frame's exposure; None if it is missing or out of range, so that it is measured."""
    return given if given is not None and MIN_EXPOSURE <= given <= MAX_EXPOSURE else None


def followed_exposure(given: float | None, target: float | None, before: float) -> float:
    """Return a frame's signed exposure: its absolute value is used, and the next call takes it as `before`.

    A given exposure is used unchanged. A measured exposure moves a tenth of the way, in stops, from the
    previous exposure to the target. An exposure more than six stops from the previous one is an outlier: this
    frame keeps the previous exposure, and a second outlier in a row is used at once. The models' graphs
    compute the same.

    Args:
        given: the frame's exposure, in [MIN_EXPOSURE, MAX_EXPOSURE]; None: it is measured.
        target: measured exposure, > 0; None if no pixel is lit, which keeps the previous exposure.
        before: result for the previous frame: negative after an unconfirmed outlier, 0 for the first frame.
    """
    known = abs(before)
    exposure = given or target or known or EXPOSURE_KEY
    if not known > 0.0:
        return -exposure
    if not known / EXPOSURE_OUTLIER <= exposure <= known * EXPOSURE_OUTLIER:
        return exposure if before < 0.0 else -known
    if given is not None or target is None:
        return exposure
    return float(known ** (1.0 - EXPOSURE_ADAPTATION) * target**EXPOSURE_ADAPTATION)


def is_flash(given: float | None, followed: float, before: float) -> bool:
    """Return whether a measured exposure is an outlier: the light of the whole frame is unconfirmed.

    `given` and `before` are arguments of `followed_exposure`, `followed` is its result for this frame.
    """
    known, used = abs(before), abs(followed)
    is_outlier = followed < 0.0 or not known / EXPOSURE_OUTLIER <= used <= known * EXPOSURE_OUTLIER
    return given is None and known > 0.0 and is_outlier


class ExposureMeter:
    """Exposure of each frame of a sequence: given, or measured and smoothed; see `followed_exposure`."""

    def __init__(self) -> None:
        self._before = 0.0

    @ieee_arithmetic
    def read_frame(self, frame: Frame) -> float:
        """Return a frame's exposure, for colour without pre-exposure, and keep it for the next frame.

        A frame that was not shaded keeps the previous exposure.
        """
        if frame.reset:
            self._before = 0.0
        given, color, target = usable_exposure(frame.exposure), frame.color, None
        if given is None and color is None:
            return abs(self._before) or 1.0
        if given is None and color is not None:
            factor = frame.pre_exposure
            target = _measured_exposure(color if factor == 1.0 else color / np.float32(factor))
        self._before = followed_exposure(given, target, self._before)
        return abs(self._before)
