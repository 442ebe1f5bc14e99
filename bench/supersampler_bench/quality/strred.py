"""Spatio-temporal reduced-reference entropic differencing, STRRED: Soundararajan and Bovik 2013.

Two consecutive images are reduced to one subband of a steerable pyramid, whose 3x3 blocks are modelled as a
Gaussian scale mixture. The metric compares the information of each block with the reference's, in the band
(spatial, SRRED) and in the change between the two images (temporal, TRRED).

>>> pair = information(band(luma_before), band(luma))
>>> srred, trred = distance(pair, information(band(reference_luma_before), band(reference_luma)))

STRRED of a clip is mean SRRED times mean TRRED over its pairs, which do not overlap. It cannot detect what
the band does not pass: waves shorter than about 20 pixels, and flicker of the whole image's brightness, which
gives 0. Tables show it only beside other metrics.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from supersampler.frame import Array
from supersampler.io.display import BT709_WEIGHTS, to_uint8

Plane = NDArray[np.float64]

BAND_PIXELS = 8
"""Pixels of the image per pixel of the band, across and down."""

_LEVELS = 4  # of the pyramid; the band is taken from the coarsest
_BLOCK = 3
_NOISE = 0.1  # variance of the visual system's noise, grey levels squared
_RIDGE = 1e-6  # fraction of the mean variance added to the diagonal; repeating patterns have rank < 9
_ROUNDING = 1e-12  # variance, grey levels squared, below which a band is empty
_BT709 = np.array(BT709_WEIGHTS)

# sp5Filters of the steerable pyramid (Simoncelli and Freeman 1995), as pyrtools has them: upper left quarters
_INITIAL_LOWPASS = (
    (0.00341614, -0.01551246, -0.03848215),
    (-0.01551246, 0.05586982, 0.15925570),
    (-0.03848215, 0.15925570, 0.40304148),
)
_LOWPASS = (  # sums to 2: amplitudes double from level to level
    (0.00170808, -0.00489834, -0.00775624, -0.01888864, -0.01924108),
    (-0.00489834, -0.01046562, -0.01322234, 0.00821200, 0.02005976),
    (-0.00775624, -0.01322234, 0.02793492, 0.06554076, 0.07962786),
    (-0.01888864, 0.00821200, 0.06554076, 0.12852666, 0.16339236),
    (-0.01924108, 0.02005976, 0.07962786, 0.16339236, 0.20193080),
)
_BANDPASS = (  # antisymmetric from row to row; the middle row is 0
    (-0.00277643, -0.00496194, -0.01026699, -0.01455399),
    (0.00986904, 0.00893064, -0.01189859, -0.02755155),
    (0.01021852, 0.03075356, 0.08226445, 0.11732297),
    (0.0, 0.0, 0.0, 0.0),
)


class Information(NamedTuple):
    """Scaled entropies (n,) of the n whole blocks of a pair of bands."""

    spatial: Plane
    temporal: Plane


def luma255(shown: Array) -> Plane:
    """Return BT.709 luma (H, W), 0 to 255, of an image (H, W, 3) in [0, 1], which is rounded to 8 bits."""
    return np.asarray(to_uint8(shown) @ _BT709)


def band(luma: Plane) -> Plane:
    """Return the coarsest band (H / 8, W / 8), rounded up, of luma, filtered for changes from row to row."""
    plane = _filtered(luma, _INITIAL)
    for _ in range(_LEVELS - 1):
        plane = _filtered(plane, _LOW, step=2)
    return _filtered(plane, _BAND)


def information(previous: Plane, current: Plane) -> Information:
    """Return the scaled entropies of a pair of bands (h, w), the earlier one first."""
    variance, entropy = _scale_mixture(previous)
    change_variance, change_entropy = _scale_mixture(previous - current)
    weight = np.log2(1.0 + variance)
    return Information(entropy * weight, change_entropy * weight * np.log2(1.0 + change_variance))


def distance(pair: Information, reference: Information) -> tuple[float, float]:
    """Return SRRED and TRRED of a pair: means over the blocks, 0 if equal; NaN without blocks."""
    if not pair.spatial.size:
        return float("nan"), float("nan")
    srred = np.abs(pair.spatial - reference.spatial).mean()
    return float(srred), float(np.abs(pair.temporal - reference.temporal).mean())


def _scale_mixture(plane: Plane) -> tuple[Plane, Plane]:
    """Return the variance, relative to the band's, and the entropy of each 3x3 block: (n,) each.

    The entropy is a sum over the covariance's eigenvalues. It mixes log2 and log like the authors' code, so
    that values can be compared with published ones.
    """
    height, width = (side // _BLOCK * _BLOCK for side in plane.shape)
    values = _BLOCK * _BLOCK
    squares = plane[:height, :width].reshape(height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK)
    blocks = squares.swapaxes(1, 2).reshape(-1, values)
    if not blocks.size:
        return np.zeros(0), np.zeros(0)
    patches = sliding_window_view(plane[:height, :width], (_BLOCK, _BLOCK)).reshape(-1, values)
    patches = patches - patches.mean(axis=0)
    covariance = patches.T @ patches / len(patches)
    mean_variance = np.trace(covariance) / values
    if mean_variance < _ROUNDING:
        return np.zeros(len(blocks)), np.zeros(len(blocks))
    eigenvalues, directions = np.linalg.eigh(covariance + _RIDGE * mean_variance * np.eye(values))
    variance = ((blocks @ directions) ** 2 / eigenvalues).mean(axis=1)
    entropy = np.log2(variance[:, None] * eigenvalues + _NOISE) + np.log(2.0 * np.pi * np.e)
    return variance, entropy.sum(axis=1)


def _filtered(plane: Plane, taps: Plane, step: int = 1) -> Plane:
    """Correlate with (2 r + 1, 2 r + 1) taps at every `step` pixels; edges are mirrored, not repeated."""
    radius = len(taps) // 2
    height, width = plane.shape
    padded = np.pad(plane, radius, mode="reflect")
    total = np.zeros((-(-height // step), -(-width // step)))
    for (row, column), tap in np.ndenumerate(taps):
        if tap:
            total += tap * padded[row : row + height : step, column : column + width : step]
    return total


def _unfolded(quarter: tuple[tuple[float, ...], ...], lower: float = 1.0) -> Plane:
    """Mirror the upper left quarter of a filter to the right, then downwards with the factor `lower`."""
    upper = np.array([[*row, *row[-2::-1]] for row in quarter], np.float64)
    return np.concatenate([upper, lower * upper[-2::-1]])


_INITIAL = _unfolded(_INITIAL_LOWPASS)
_LOW = _unfolded(_LOWPASS)
_BAND = _unfolded(_BANDPASS, lower=-1.0)
