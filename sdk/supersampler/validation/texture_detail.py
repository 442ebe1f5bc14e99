"""Check of the mip bias: whether textures have detail between the samples of a frame."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions
from supersampler.validation.reprojection import FramePair

_SIDE = 12  # render pixels of a block
_BLOCKS = 250  # about how many are read
_MIN_BLOCKS = 30  # of all pairs: fewer say nothing about a scene
_MIN_CONTRAST = 4e-4  # mean squared change of tone-mapped luminance over two pixels
_FINE = 0.3  # of that change, already over one pixel; magnified textures and shading have less
_SAME_SURFACE = 1.15  # of depths in reach: edges of things are sharp with any mip bias
_DISTANCES = (0.25, 0.5)  # render pixels from a sample to that of the previous frame; edges change by 2 then
_CROSS = ((0, 0), (1, 0), (-1, 0), (2, 0), (-2, 0), (0, 1), (0, -1), (0, 2), (0, -2))
_FILTERED = (1.35, 1.72)  # the median; smooth patterns have less, correct sequences had 1.79 and more
_MIN_RATIO = 1.4  # display over render size: below, the bias is too small to be seen


def texture_detail(pair: FramePair) -> NDArray[np.float64]:
    """Return how much each textured block changes between samples, relative to a smooth image.

    Jitter places the samples of the previous frame less than a pixel from those of this one. Where textures
    are smooth between samples, the squared difference is that of neighbouring pixels times the squared
    distance: 1. Textures that are filtered for display pixels change by a multiple of it. Noise, light and
    wrong motion add to it.
    """
    height, width = pair.now.depth.shape
    step = max(_SIDE, int(np.sqrt(height * width / _BLOCKS)))
    tops, lefts = np.meshgrid(
        np.arange(2, height - 1 - _SIDE, step), np.arange(2, width - 1 - _SIDE, step), indexing="ij"
    )
    rows = (tops.ravel()[:, None, None] + np.arange(_SIDE)[:, None] + 0 * np.arange(_SIDE)).ravel()
    columns = (lefts.ravel()[:, None, None] + np.arange(_SIDE) + 0 * np.arange(_SIDE)[:, None]).ravel()
    offset = pair.offset(Conventions(), (rows, columns))
    x, y = columns + offset[:, 0], rows + offset[:, 1]
    usable = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)  # False where NaN
    x, y = np.where(usable, x, 0.0), np.where(usable, y, 0.0)
    near_x, near_y = np.rint(x).astype(np.intp), np.rint(y).astype(np.intp)
    squared = (x - near_x) ** 2, (y - near_y) ** 2
    distance = np.sqrt(squared[0] + squared[1])
    usable &= (distance >= _DISTANCES[0]) & (distance <= _DISTANCES[1])
    depths = np.stack(
        [pair.before.depth[near_y, near_x], *(pair.now.depth[rows + dy, columns + dx] for dx, dy in _CROSS)]
    )
    with np.errstate(invalid="ignore"):  # NaN compares False
        usable &= (depths.min(axis=0) > 0) & (depths.max(axis=0) <= _SAME_SURFACE * depths.min(axis=0))
    around = {(dx, dy): pair.tone[rows + dy + 1, columns + dx + 1] for dx, dy in _CROSS}

    def change(by: int, axis: int) -> NDArray[np.float64]:
        offsets = [(sign * by * (1 - axis), sign * by * axis) for sign in (-1, 1)]
        before, after = ((around[o] - around[0, 0]) ** 2 for o in offsets)
        mean: NDArray[np.float64] = (before + after) / 2
        return mean

    difference = (pair.tone_before[near_y + 1, near_x + 1] - around[0, 0]) ** 2
    smooth = squared[0] * change(1, 0) + squared[1] * change(1, 1)
    one, two = change(1, 0) + change(1, 1), change(2, 0) + change(2, 1)

    def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
        known = np.where(usable & np.isfinite(values), values, 0.0)
        total: NDArray[np.float64] = known.reshape(-1, _SIDE * _SIDE).sum(axis=1)
        return total

    count, two_sum, smooth_sum = sums(np.ones(len(rows))), sums(two), sums(smooth)
    textured = (count >= 0.8 * _SIDE**2) & (two_sum > 2 * _MIN_CONTRAST * count)
    textured &= (sums(one) > _FINE * two_sum) & (smooth_sum > 0)
    detail: NDArray[np.float64] = sums(difference)[textured] / smooth_sum[textured]
    return detail


def lacks_detail(details: Sequence[NDArray[np.float64]], ratio: float) -> bool:
    """Return whether textures, by `texture_detail` of several pairs, are filtered for render pixels.

    Args:
        details: of each pair.
        ratio: display over render size.
    """
    values = np.concatenate([*details, []])
    if ratio < _MIN_RATIO or len(values) < _MIN_BLOCKS:
        return False
    return _FILTERED[0] < float(np.median(values)) < _FILTERED[1]
