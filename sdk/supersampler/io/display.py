"""From linear light to what a screen shows: exposure, tone curve, sRGB; for pages, PNGs and metrics alike.

    exposed = color * exposure
    toned   = exposed / (1 + max(exposed.r, exposed.g, exposed.b))
    shown   = clip(sRGB(toned), 0, 1)

The tone curve keeps hue, and no highlight is brighter than 1. Without an exposure of the engine's own,
`auto_exposure` measures one, by the formula of the models' graphs.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import as_number
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Array, Float32, as_array

EXPOSURE_KEY = 0.18
"""The log-average luminance that `auto_exposure` maps an image to: middle grey."""

EXPOSURES = (2.0**-24, 2.0**24)
"""The least and the largest exposure that a frame can give: they bring any half float to middle grey and go
two stops farther at least. In place of one outside, exposure is measured, as where none is given."""

CEILING_DB = 100.0
"""The PSNR of equal images: finite, so that means and JSON can hold it."""

_DARKEST = 1e-4  # luminance below which black stays black instead of pulling the average to nothing
_MAX_HALF = 65504.0
_LARGEST = 1e30  # exposure, of which single precision can hold the product with an image
_ADAPTATION = 0.1
_OUTLIER = 64.0  # factor between two frames' exposures from which on one frame alone is not followed
_BT709 = np.array([0.2126, 0.7152, 0.0722], np.float32)


def display_transform(image: Array, exposure: float = 1.0) -> Float32:
    """Return what a screen shows of linear RGB.

    Args:
        image: (h, w, 3) linear RGB. Negative values and NaN count as 0, Inf as 65504.
        exposure: > 0, multiplies the image first.

    Returns:
        (h, w, 3) float32 in [0, 1], sRGB encoded.

    Raises:
        ArgumentError: the image is not of that shape, or has no numbers; or `exposure` is no number > 0.
    """
    number = as_number(exposure)
    if number is None or not 0.0 < number <= _LARGEST:
        raise ArgumentError("exposure", got=shown(exposure), want=f"a number > 0, at most {_LARGEST:g}")
    light = checked_image("image", image)
    exposed = np.nan_to_num(light.astype(np.float32, copy=False), nan=0.0, posinf=_MAX_HALF, neginf=0.0)
    exposed = np.clip(exposed, 0.0, _MAX_HALF) * np.float32(number)
    toned = exposed / (1.0 + exposed.max(axis=-1, keepdims=True))
    return np.clip(srgb_oetf(toned), 0.0, 1.0)


def checked_image(name: str, image: Array) -> NDArray[Any]:
    """Return (h, w, 3) of any numbers as an array.

    Raises:
        ArgumentError: it is not of that shape, or has no numbers.
    """
    array = as_array(name, image, ArgumentError)
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "iuf":
        raise ArgumentError(name, got=shown(array), want="(h, w, 3) numbers, linear RGB")
    return array


def decibels(mean_squared_error: float) -> float:
    """Return the PSNR (dB, peak 1) of a mean squared error >= 0, at most `CEILING_DB`."""
    return float(-10.0 * np.log10(max(mean_squared_error, 10.0 ** (-CEILING_DB / 10.0))))


def srgb_oetf(linear: Array) -> Float32:
    """Encode linear light in [0, 1] as sRGB (IEC 61966-2-1), element by element."""
    linear = np.asarray(linear, np.float32)
    bright = 1.055 * np.maximum(linear, 0.0031308) ** np.float32(1.0 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, bright).astype(np.float32)


def to_uint8(shown: Array) -> NDArray[np.uint8]:
    """Round values in [0, 1] to 0..255, to nearest; values outside are clamped."""
    return (np.clip(shown, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def auto_exposure(color: NDArray[Any]) -> float:
    """Return the exposure that brings an image's log-average luminance to 0.18.

    0.18 / exp(mean(log(max(luminance, 1e-4)))) with BT.709 luminance, over the pixels whose components are
    all numbers in [0, 65504].

    Args:
        color: (h, w, 3) linear RGB.

    Returns:
        > 0, at most 1800 (a black image, or one without a usable pixel).

    Raises:
        ArgumentError: it is not of that shape, or has no numbers.
    """
    color = checked_image("color", color)
    usable = color[((color >= 0.0) & (color <= _MAX_HALF)).all(axis=-1)].astype(np.float32, copy=False)
    if not usable.size:
        return EXPOSURE_KEY / _DARKEST
    logs = np.log(np.maximum(usable @ _BT709, _DARKEST))
    return float(EXPOSURE_KEY * np.exp(-logs.mean(dtype=np.float64)))


def usable_exposure(given: float | None) -> float | None:
    """Return the exposure that a frame gives; None, which is to measure it, where it is not in EXPOSURES."""
    return given if given is not None and EXPOSURES[0] <= given <= EXPOSURES[1] else None


def followed_exposure(given: float | None, target: float | None, before: float) -> float:
    """Return what the next frame wants back as `before`; its absolute value is the exposure to use.

    That is the given one, else one a tenth of the way, in stops, from that of the frame before to the
    measured one. An exposure that differs from the one before by more than six stops is an outlier: the one
    before holds for that frame. What a second frame wants in a row is used at once. The models' graphs do
    the same.

    Args:
        given: by the frame, in EXPOSURES; None: it is measured.
        target: what was measured, > 0; None where no pixel is usable, which keeps the one before.
        before: what this function returned for the frame before: negative where no second frame has confirmed
            it, 0 where there was none.
    """
    known = abs(before)
    wanted = given or target or known or EXPOSURE_KEY
    if not known > 0.0:
        return -wanted
    if not known / _OUTLIER <= wanted <= known * _OUTLIER:
        return wanted if before < 0.0 else -known
    if given is not None or target is None:
        return wanted
    return float(known ** (1.0 - _ADAPTATION) * target**_ADAPTATION)


def is_flash(given: float | None, followed: float, before: float) -> bool:
    """Return whether a measured exposure is an outlier: the light of the whole frame is unconfirmed.

    Args:
        given: by the frame, in EXPOSURES; None: it is measured.
        followed: what `followed_exposure` returned.
        before: what it returned for the frame before; 0 where there was none.
    """
    known, used = abs(before), abs(followed)
    is_outlier = followed < 0.0 or not known / _OUTLIER <= used <= known * _OUTLIER
    return given is None and known > 0.0 and is_outlier


class ExposureMeter:
    """The exposure of each frame of a sequence: the engine's, or measured and smoothed as the models do.

    A measured exposure moves a tenth of the way to its target in each frame, in stops, so that a light that
    flickers does not make the whole image pump; a cut starts anew. See `followed_exposure` for outliers.
    """

    def __init__(self) -> None:
        self._before = 0.0

    def read(self, color: Array | None, *, given: float | None = None, reset: bool = False) -> float:
        """Return this frame's exposure and remember it.

        Args:
            color: (h, w, 3) linear RGB; None on a frame that was not shaded, which keeps the one before.
            given: the engine's exposure.
            reset: True on the first frame after a cut.
        """
        if reset:
            self._before = 0.0
        given = usable_exposure(given)
        if given is None and color is None:
            return abs(self._before) or 1.0
        target = auto_exposure(color) if given is None and color is not None else None
        self._before = followed_exposure(given, target, self._before)
        return abs(self._before)
