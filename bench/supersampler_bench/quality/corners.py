"""Measures of what the eye sees first: trails, thin geometry, shadow edges, speckle; fractions of the error.

They concern few pixels, so means over the image hide them. Masks come from a shot's planes of truth
(`Shot.read_truth`), never from an image. Images are display values, as in metrics.py; planes and masks are
(H, W); distances are in display pixels. Each measure has a weight, so that the weighted mean over frames is
the mean over the pixels of all frames. `border` pixels on each side do not count.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from supersampler.frame import Array, Float32
from supersampler.io.display import BT709
from supersampler_bench.quality.metrics import Bool, crop, warp
from supersampler_model.data.rendered import PixelTruth

KINDS = ("thin", "silhouette", "shadow", "mover", "edge", "texture")
"""Kinds of pixels. A pixel is of the first kind that applies: see `kinds_of`."""
TRAIL_DISTANCE = 2  # render pixels; coverage farther than this from a thin object is a trail
COVERED = 0.3  # minimum coverage at which a pixel counts as part of a thin object
SOLID = 0.5  # minimum coverage at which the colour is mostly the object's
SHADOW_CHANGE = 0.3  # of the unshadowed fraction; reprojecting a still edge changes it by up to 0.25
SHADOW_REACH = THIN_REACH = SILHOUETTE_REACH = 2
SPECKLE_BAND = 3
BESIDE = 12  # width of the band beside a trail, whose error is not the trail's
REMEMBERED = 8  # frames


class Weighted(NamedTuple):
    """A measure of one frame, NaN without pixels to measure, and its weight in the mean over frames."""

    value: float
    weight: float

    @classmethod
    def ratio(cls, numerator: float, denominator: float) -> "Weighted":
        """Return a ratio of sums, weighted by its denominator."""
        return cls(numerator / denominator if denominator > 0.0 else float("nan"), denominator)


@dataclass(frozen=True)
class CornerTruth:
    """Planes of truth of one frame, and masks from them and from earlier frames. Movers are not thin."""

    thin_moving: Float32  # coverage by thin objects that move, [0, 1]
    thin: Float32  # coverage by all thin objects
    far: Bool  # farther than TRAIL_DISTANCE render pixels from all thin objects
    left: Bool  # far, but a moving thin object was there in the last REMEMBERED frames
    beside: Bool  # far and not left, but within BESIDE pixels of a left one
    shadow_edges: Bool  # within SHADOW_REACH of where a shadow came or went
    silhouettes: Bool  # pixels that the outline of a mover passes through
    band: Bool  # within SPECKLE_BAND of a silhouette
    movers: Bool  # pixels that are mostly of a mover
    window: int  # side of the speckle's window, of which the pixel of a sample fills less than half


class CornerTruths:
    """Computes the truth of a shot's frames, in order; remembers where objects and shadows were."""

    def __init__(self, ratio: float) -> None:
        self._distance, self._window = round(TRAIL_DISTANCE * ratio), 2 * max(2, ceil(ratio)) - 1
        self._unshadowed: Float32 | None = None
        self._age: Float32 | None = None  # frames since a moving thin object was there

    def next(
        self, planes: Mapping[str, Array], motion: Array, unclear: Bool, *, reset: bool
    ) -> CornerTruth | None:
        """Return the truth of the next frame; None if the shot lacks a plane.

        Args:
            planes: of `Shot.read_truth`; the fields of `PixelTruth` are read.
            motion: (H, W, 2), display pixels, previous minus current.
            unclear: where the motion is not that of a single surface that was visible before.
            reset: whether the frame is the first after a cut, or after one without planes.
        """
        if not planes.keys() >= set(PixelTruth.__slots__):
            return None
        still, thin_moving, moving, unshadowed = (
            np.asarray(planes[name], np.float32) for name in PixelTruth.__slots__
        )
        if reset:
            self._unshadowed = self._age = None
        thin = still + thin_moving
        far = ~near(thin > 0.0, self._distance)
        age = np.full(thin.shape, np.inf, np.float32)
        if self._age is not None:
            age = _min_around(self._age, motion) + 1.0
        left = far & (age <= REMEMBERED)
        silhouettes = (moving > 0.0) & (moving < 1.0) | _steps(moving > SOLID)
        changed = np.zeros(thin.shape, bool)
        if self._unshadowed is not None:
            before, inside = warp(self._unshadowed[..., None], motion)
            changed = inside & (np.abs(unshadowed - before[..., 0]) > SHADOW_CHANGE)
            changed &= ~(unclear | near(silhouettes | (thin > 0.0), 1))
        self._unshadowed = unshadowed
        self._age = np.where(thin_moving > 0.0, np.float32(0.0), age)
        return CornerTruth(
            thin_moving=thin_moving,
            thin=thin,
            far=far,
            left=left,
            beside=near(left, BESIDE) & far & ~left,
            shadow_edges=near(changed, SHADOW_REACH),
            silhouettes=silhouettes,
            band=near(silhouettes, SPECKLE_BAND),
            movers=moving > SOLID,
            window=self._window,
        )


def trail(coverage: Array, truth: CornerTruth, border: int = 0) -> Weighted:
    """Return the blended coverage by moving thin objects far from them, over the true coverage: 0 is best."""
    blended, thing, far = (crop(plane, border) for plane in (coverage, truth.thin_moving, truth.far))
    return Weighted.ratio(_sum(blended[far]), _sum(thing))


def color_trail(shown: Array, reference: Array, truth: CornerTruth, border: int = 0) -> Weighted:
    """Return the colour of moving thin objects left behind them, over the true coverage: 0 is best.

    Errors are projected on the difference between the objects' colour (the mean over pixels that are mostly
    theirs, weighted by coverage) and the reference: 1 is the whole difference. The mean error beside the left
    pixels is subtracted from their mean error, and the difference is summed over the left pixels.
    """
    thing, left, beside = (crop(plane, border) for plane in (truth.thin_moving, truth.left, truth.beside))
    image, true = (crop(plane, border).astype(np.float64) for plane in (shown, reference))
    solid = np.where(thing > SOLID, thing, 0.0)
    if not (left.any() and beside.any() and solid.any()):
        return Weighted(float("nan"), 0.0)
    difference = np.tensordot(solid, true, 2) / _sum(solid) - true
    contrast = (difference**2).sum(axis=-1)
    projected = ((image - true) * difference).sum(axis=-1)
    share_left, share_beside = (_sum(projected[m]) / max(_sum(contrast[m]), 1e-6) for m in (left, beside))
    return Weighted.ratio(float(left.sum()) * (share_left - share_beside), _sum(thing))


def thin_kept(coverage: Array, truth: CornerTruth, border: int = 0) -> Weighted:
    """Return the blended over the true coverage by thin objects, where that is above COVERED: 1 is best."""
    blended, thing = crop(coverage, border), crop(truth.thin, border)
    covered = thing > COVERED
    return Weighted.ratio(_sum(blended[covered]), _sum(thing[covered]))


def specks(shown: Array, window: int) -> Float32:
    """Return the luma that a median over `window` x `window` pixels removes from the image.

    Medians keep edges, however soft; they remove single pixels, dots and stairs.
    """
    luma = shown.astype(np.float32) @ BT709
    around = sliding_window_view(np.pad(luma, window // 2, mode="edge"), (window, window))
    median = np.median(around.reshape(*luma.shape, -1), axis=-1)
    return np.asarray(np.abs(luma - median), np.float32)


def speckle(of_image: Array, of_reference: Array, truth: CornerTruth, border: int = 0) -> Weighted:
    """Return the mean excess of the image's `specks` over the reference's in the movers' bands; 0 is best."""
    band, more = (crop(plane, border) for plane in (truth.band, of_image - of_reference))
    return Weighted.ratio(_sum(np.maximum(more[band], 0.0)), float(band.sum()))


def kinds_of(truth: CornerTruth, edges: Bool) -> dict[str, Bool]:
    """Return the mask of each of KINDS. `edges` are pixels that outlines of any surface pass through."""
    found = {
        "thin": near(truth.thin > 0.0, THIN_REACH),
        "silhouette": near(truth.silhouettes, SILHOUETTE_REACH),
        "shadow": truth.shadow_edges,
        "mover": truth.movers,
        "edge": edges,
        "texture": np.ones_like(edges),
    }
    taken = np.zeros_like(edges)
    for kind in KINDS:
        found[kind], taken = found[kind] & ~taken, taken | found[kind]
    return found


def near(mask: Bool, reach: int) -> Bool:
    """Return the pixels within `reach` pixels, between centres, of a pixel of the mask."""
    padded = np.pad(mask, reach)
    height, width = mask.shape
    found = np.zeros_like(mask)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if dx * dx + dy * dy <= reach * reach:
                found |= padded[reach + dy : reach + dy + height, reach + dx : reach + dx + width]
    return found


def _steps(mask: Bool) -> Bool:
    """Return pixels that differ from one of their four neighbours."""
    found = np.zeros_like(mask)
    across, down = mask[:, 1:] != mask[:, :-1], mask[1:] != mask[:-1]
    found[:, 1:] |= across
    found[:, :-1] |= across
    found[1:] |= down
    found[:-1] |= down
    return found


def _min_around(plane: Float32, motion: Array) -> Float32:
    """Return the minimum of the previous frame's four pixels around p + motion[p]; inf off screen."""
    height, width = plane.shape
    rows, columns = np.indices(plane.shape)
    x, y = (np.nan_to_num(base + motion[..., i], nan=np.inf) for i, base in enumerate((columns, rows)))
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    ends = [[end(values).astype(np.intp) for end in (np.floor, np.ceil)] for values in (x, y)]
    smallest = np.minimum.reduce([plane[row, column] for column in ends[0] for row in ends[1]])
    return np.where(inside, smallest, np.float32(np.inf))


def _sum(values: Any) -> float:
    return float(np.sum(values, dtype=np.float64))
