"""Measures of what the eye sees first: trails, thin things, shadow edges, speckle; shares of the error.

Means over all pixels hide them, as few pixels are concerned. Masks are made of a shot's planes of truth
(`Shot.read_truth`) alone, never of an image. Images are as metrics.py takes them; distances and bands are in
display pixels. Each measure has a weight, so that a mean over frames is that of all pixels at once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from supersampler.frame import Array, Float32
from supersampler.io.display import BT709
from supersampler_bench.quality.metrics import crop, warp
from supersampler_model.data.rendered import PixelTruth

Bool = NDArray[np.bool_]
Plane = NDArray[np.float32]

KINDS = ("thin", "silhouette", "shadow", "mover", "edge", "texture")
"""Kinds of pixels, each pixel is of the first that holds: see `kinds_of`."""
TRAIL_DISTANCE = 2  # render pixels from a thing beyond which its coverage is a trail
COVERED = 0.3  # coverage from which on a pixel counts as one of a thin thing
SOLID = 0.5  # coverage from which on the colour is mostly the thing's
SHADOW_CHANGE = 0.3  # of the unshadowed fraction; reprojecting a still edge changes it by up to 0.25
SHADOW_REACH = THIN_REACH = SILHOUETTE_REACH = 2
SPECKLE_BAND = 3
BESIDE = 12  # from a mover's trail, where the image's error has no part of it
REMEMBERED = 8  # frames for which a place counts as one where a thing was


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
    """Planes of truth of one frame, (H, W), and masks made of them and of the frames before.

    Attributes:
        thin_moving: coverage by thin things that move, [0, 1].
        thin: coverage by all thin things.
        far: farther than TRAIL_DISTANCE render pixels from all thin things.
        left: where a thin thing that moves was in the last REMEMBERED frames, and is far from now.
        beside: within BESIDE pixels of those, neither left nor close to a thin thing.
        shadow_edges: within SHADOW_REACH of where a shadow came or went.
        silhouettes: pixels that an outline of a mover, thin ones excepted, passes through.
        band: within SPECKLE_BAND of those.
        movers: pixels that are mostly of such a mover.
        window: side of the speckle's window: a sample's pixel fills less than half of it.
    """

    thin_moving: Plane
    thin: Plane
    far: Bool
    left: Bool
    beside: Bool
    shadow_edges: Bool
    silhouettes: Bool
    band: Bool
    movers: Bool
    window: int


class CornerTruths:
    """Makes the truth of the frames of a shot, in order, and remembers where things and shadows were.

    Args:
        ratio: display over render size.
    """

    def __init__(self, ratio: float) -> None:
        self._distance, self._window = round(TRAIL_DISTANCE * ratio), 2 * max(2, ceil(ratio)) - 1
        self._unshadowed: Plane | None = None
        self._age: Plane | None = None  # frames since a thin mover was there

    def next(
        self, planes: Mapping[str, Array], motion: Array, unclear: Bool, *, reset: bool
    ) -> CornerTruth | None:
        """Return the truth of the next frame; None where the shot has not all planes.

        Args:
            planes: of `Shot.read_truth`; those of `PixelTruth` are read.
            motion: (H, W, 2), display pixels, previous minus current.
            unclear: (H, W), where the motion is not that of one surface that was visible before.
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
            age = _least_around(self._age, motion) + 1.0
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
    """Return the coverage by thin movers where none is near, over the true coverage: 0 is none.

    Args:
        coverage: (H, W), as a method blends it.
        truth: of the frame.
        border: pixels at each side that do not count.
    """
    blended, thing, far = (crop(plane, border) for plane in (coverage, truth.thin_moving, truth.far))
    return Weighted.ratio(_sum(blended[far]), _sum(thing))


def color_trail(shown: Array, reference: Array, truth: CornerTruth, border: int = 0) -> Weighted:
    """Return the colour of thin movers where they were, over that of the movers themselves: 0 is none.

    Errors are projected on the difference between the movers' colour (the mean over pixels that are mostly
    theirs, weighted by coverage) and the reference: 1 is the whole difference. Their sum over what movers
    have left, less as many times the mean over what is beside it, is divided by the true coverage.
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
    """Return the blended over the true coverage by thin things, where that is above COVERED: 1 is all."""
    blended, thing = crop(coverage, border), crop(truth.thin, border)
    covered = thing > COVERED
    return Weighted.ratio(_sum(blended[covered]), _sum(thing[covered]))


def specks(shown: Array, window: int) -> Float32:
    """Return the luma, (H, W), that a median over `window` x `window` pixels takes from the image.

    Medians keep edges, however soft; they take single pixels, dots and stairs.
    """
    luma = shown.astype(np.float32) @ BT709
    around = sliding_window_view(np.pad(luma, window // 2, mode="edge"), (window, window))
    median = np.median(around.reshape(*luma.shape, -1), axis=-1)
    return np.asarray(np.abs(luma - median), np.float32)


def speckle(of_image: Array, of_reference: Array, truth: CornerTruth, border: int = 0) -> Weighted:
    """Return the mean of the image's specks, less those of the reference, in movers' bands: 0 is none.

    Args:
        of_image: (H, W), `specks` of the image.
        of_reference: (H, W), those of the reference.
        truth: of the frame.
        border: pixels at each side that do not count.
    """
    band, more = (crop(plane, border) for plane in (truth.band, of_image - of_reference))
    return Weighted.ratio(_sum(np.maximum(more[band], 0.0)), float(band.sum()))


def kinds_of(truth: CornerTruth, edges: Bool) -> dict[str, Bool]:
    """Return the pixels (H, W) of each of KINDS; each pixel is of one.

    Args:
        truth: of the frame.
        edges: (H, W), where outlines of any surface pass through the pixel.
    """
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
    """Return where a pixel of the mask is at most `reach` pixels away, between centres."""
    padded = np.pad(mask, reach)
    height, width = mask.shape
    found = np.zeros_like(mask)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if dx * dx + dy * dy <= reach * reach:
                found |= padded[reach + dy : reach + dy + height, reach + dx : reach + dx + width]
    return found


def _steps(mask: Bool) -> Bool:
    """Return pixels of the mask beside one that is not, and the other way round."""
    found = np.zeros_like(mask)
    across, down = mask[:, 1:] != mask[:, :-1], mask[1:] != mask[:-1]
    found[:, 1:] |= across
    found[:, :-1] |= across
    found[1:] |= down
    found[:-1] |= down
    return found


def _least_around(plane: Plane, motion: Array) -> Plane:
    """Return the least of the previous frame's four pixels around p + motion[p]; inf off screen."""
    height, width = plane.shape
    rows, columns = np.indices(plane.shape)
    x, y = (np.nan_to_num(base + motion[..., i], nan=np.inf) for i, base in enumerate((columns, rows)))
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    ends = [[end(values).astype(np.intp) for end in (np.floor, np.ceil)] for values in (x, y)]
    least = np.minimum.reduce([plane[row, column] for column in ends[0] for row in ends[1]])
    return np.where(inside, least, np.float32(np.inf))


def _sum(values: Any) -> float:
    return float(np.sum(values, dtype=np.float64))
