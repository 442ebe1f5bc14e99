"""Image metrics against a reference: each metric one function, range and unit in its docstring.

All but `warp` take display values, `display_transform(linear, exposure)`: (H, W, 3) float in [0, 1], sRGB
encoded, output and reference with the same exposure. The caller removes the border with `crop`.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ArgumentError, SupersamplerError
from supersampler.frame import Array, Float32
from supersampler.io.display import BT709_WEIGHTS, decibels

Bool = NDArray[np.bool_]

_BT709 = np.array(BT709_WEIGHTS)
_WINDOW = 11  # SSIM, Wang et al. 2004: 11x11 Gaussian of sigma 1.5
_SIGMA = 1.5


def crop(image: NDArray[Any], border: int) -> NDArray[Any]:
    """Return (H - 2 border, W - 2 border, ...) without `border` >= 0 pixels on every side."""
    height, width = image.shape[:2]
    return image[border : height - border, border : width - border]


def psnr(image: Array, reference: Array, mask: Bool | None = None) -> float:
    """Peak signal-to-noise ratio over RGB, peak 1, in dB: 0 to 100 (`CEILING_DB`), higher is better.

    Only True pixels of the mask (H, W) count; NaN if it has none.
    """
    squared = (_double(image) - _double(reference)) ** 2
    if mask is not None:
        squared = squared[mask]
    return decibels(float(squared.mean())) if squared.size else float("nan")


def ssim(image: Array, reference: Array) -> float:
    """Structural similarity of BT.709 luma (Wang et al. 2004): -1 to 1, 1 is equal.

    Windows are 11x11 Gaussians of sigma 1.5; the mean is over those that lie wholly inside. Variances are
    weighted and biased.

    Raises:
        ArgumentError: the images are smaller than the window.
    """
    if min(image.shape[:2]) < _WINDOW:
        hint = "Measure at a larger display size."
        raise ArgumentError("image", got=image.shape, want="at least 11 x 11 pixels", hint=hint)
    x, y = _double(image) @ _BT709, _double(reference) @ _BT709
    mean_x, mean_y = _window_mean(x), _window_mean(y)
    variance_x = _window_mean(x * x) - mean_x**2
    variance_y = _window_mean(y * y) - mean_y**2
    covariance = _window_mean(x * y) - mean_x * mean_y
    c1, c2 = 0.01**2, 0.03**2
    luminance = (2 * mean_x * mean_y + c1) / (mean_x**2 + mean_y**2 + c1)
    structure = (2 * covariance + c2) / (variance_x + variance_y + c2)
    return float((luminance * structure).mean())


def flip_map(image: Array, reference: Array) -> Float32:
    """LDR-FLIP of every pixel, (H, W): 0 to 1, 0 is equal. Papers give its mean.

    The viewing distance is the package's default, 67 pixels a degree (0.7 m from a 0.7 m wide 4K screen).

    Raises:
        SupersamplerError: flip-evaluator is not installed.
    """
    try:
        import flip_evaluator
    except ImportError as error:
        raise SupersamplerError(
            "FLIP needs the package flip-evaluator; install it with: pip install 'supersampler[bench]'"
        ) from error
    error_map, _, _ = flip_evaluator.evaluate(
        np.ascontiguousarray(reference, np.float32),
        np.ascontiguousarray(image, np.float32),
        "LDR",
        applyMagma=False,
        computeMeanError=False,
    )
    return np.asarray(error_map, np.float32).reshape(image.shape[:2])


def tpsnr(
    image: Array, previous: Array, reference: Array, previous_reference: Array, mask: Bool | None = None
) -> float:
    """PSNR of the change from frame to frame, not warped, in dB: 0 to 100, higher is steadier.

    A fixed error cancels; flicker and lag do not. The frames are consecutive; for `mask`, see `psnr`.
    """
    change = _double(image) - _double(previous)
    return psnr(change, _double(reference) - _double(previous_reference), mask)


def warped_error(image: Array, previous: Array, motion: Array, valid: Bool) -> float:
    """Mean absolute change along the motion, 0 to 1: E_w = mean over valid |image - W(previous)|.

    Blur lowers it: compare it with the reference's (`warped_error_difference`). `motion` is (H, W, 2) in
    display pixels, previous minus current. `valid` (H, W) is False where the surface was occluded in the
    previous frame; pixels whose previous position is off screen never count. NaN if no pixel is valid.
    """
    warped, inside = warp(previous, motion)
    change = np.abs(_double(image) - warped)[valid & inside]
    return float(change.mean()) if change.size else float("nan")


def warped_error_difference(
    image: Array, previous: Array, reference: Array, previous_reference: Array, motion: Array, valid: Bool
) -> float:
    """|E_w of the image - E_w of the reference|, 0 to 1; 0 if changes along the motion are alike."""
    own = warped_error(reference, previous_reference, motion, valid)
    return abs(warped_error(image, previous, motion, valid) - own)


def warp(image: Array, motion: Array) -> tuple[NDArray[np.float64], Bool]:
    """Reproject the previous image (H, W, C): resample it bilinearly at p + motion[p].

    `motion` is (H, W, 2), pixels (x right, y down), previous minus current. Returns the warped image and a
    mask (H, W), True where p + motion[p] is on screen.
    """
    height, width = image.shape[:2]
    rows, columns = np.indices((height, width))
    x, y = columns + _double(motion[..., 0]), rows + _double(motion[..., 1])
    inside = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)  # NaN fails too
    x, y = np.clip(np.where(inside, x, 0), 0, width - 1), np.clip(np.where(inside, y, 0), 0, height - 1)
    left, top = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    fx, fy = (x - left)[..., None], (y - top)[..., None]
    upper = image[top, left] * (1 - fx) + image[top, right] * fx
    lower = image[bottom, left] * (1 - fx) + image[bottom, right] * fx
    return upper * (1 - fy) + lower * fy, inside


def _window_mean(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gaussian mean of each window that lies wholly inside: (H, W) to (H - 10, W - 10)."""
    offsets = np.arange(_WINDOW) - _WINDOW // 2
    taps = np.exp(-0.5 * (offsets / _SIGMA) ** 2)
    taps /= taps.sum()
    height, width = (side - _WINDOW + 1 for side in plane.shape)
    across = sum(tap * plane[:, i : i + width] for i, tap in enumerate(taps))
    return np.asarray(sum(tap * across[i : i + height] for i, tap in enumerate(taps)))


def _double(image: NDArray[Any]) -> NDArray[np.float64]:
    return image.astype(np.float64, copy=False)
