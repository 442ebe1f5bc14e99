"""Weights of samples in the mean of a pixel that stands still: its samples of one jitter period.

The mean of a pixel is estimated from the samples in it and a little around it by block kriging with a linear
variogram (Matheron 1963; Cressie 1993, sections 3.2 and 3.4). That is the best linear estimate where the mean
square difference of two points of the image grows with their distance, as in images with edges:

    sum_j weight_j |p_i - p_j| + m + n . p_i = mean over the pixel of |p_i - q|   for all samples i
    sum(weight) = 1,   sum(weight p) = 0

with p the sample's place, display pixels from the centre of the pixel. By the second line a mean is exact
where colour is linear; plain means are biased, because samples are not centred on the pixel. Samples whose
weight would be negative are left out, so that no mean of samples >= 0 is below 0. At rational ratios many
pixels have their samples at the same places, and share weights: four pixels at ratio 2, nine at 1.5, besides
those at the border. At other ratios pixels share them whose samples are at nearly the same places.
"""

from collections.abc import Sequence
from functools import cached_property
from math import gcd
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.static_tiles import Jitter, StaticTiles
from supersampler.conventions.jitter import RATIOS, halton_jitter, jitter_phase_count
from supersampler.frame import Float32, Size

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

NONE = -1
"""In place of a sample's index: no sample of this frame lies in the pixel."""
REACH = 0.75
"""Largest distance of a sample from the centre of a pixel along each axis, display pixels. It was chosen by
error: with 0.5, only the samples in the pixel, means of rendered scenes are up to 2.5 dB worse; 1.0 gains
nothing."""
INSIDE = 0.5
"""The same for the samples in the pixel only."""
_STEPS = 2.0**20
"""Offsets are rounded to 1 / _STEPS display pixels, so that equal places are equal numbers."""
MOST_PAIRS = 400
"""Most pairs of different columns and rows with weights of their own, besides those at the border."""
_SIDE = 20
"""The same for columns or rows where both axes have many."""
_NUGGET = 1e-3
"""Variogram of samples at the same place, display pixels: they share a weight."""
_SOFT = 1e-9
"""Tolerance of the conditions, without which the equations of samples on one line have no solution."""
_ROUNDS = 6
"""How often samples with negative weights are left out."""
_BIAS = 1e-3
"""Largest first moment of weights that count as exact, display pixels."""
_POINTS = 8
"""Points along each side of a pixel, for means over it."""
LEAST_SAMPLES = 4
"""Least number of samples a pixel, on average, of a period whose mean is better than a method's image."""


class StaticAxis(NamedTuple):
    """The samples nearest to the pixels of one axis, by frame of the jitter sequence.

    Attributes:
        sample: (frames, n) int32, index of the sample nearest to each pixel, or NONE if none is within reach.
        offset: (frames, n) float32, its place in [-REACH, REACH], display pixels; 0 where there is none.
        kind: (n,) int32; pixels of equal `kind` have their samples at the same or nearly the same places in
            all frames.
        typical: (kinds,) index of a pixel of each kind.
    """

    sample: NDArray[np.int32]
    offset: Float32
    kind: NDArray[np.int32]
    typical: NDArray[np.int64]


class StaticWeights:
    """Weights of all samples of a jitter sequence, in the pixels of a display.

    A sample of frame `i` at the pixel (x, y) is that of row `rows.sample[i, y]` and column
    `columns.sample[i, x]`; it has the weight `table[i, rows.kind[y], columns.kind[x]]`.

    Args:
        display, render: (width, height) of images and frames; the ratio is at least 1 on each axis.
        jitter: (x, y) of each frame of one period, render pixels.
        reach: largest distance of a sample from a pixel's centre along each axis, display pixels; half the
            distance between samples if that is less.

    Attributes:
        jitter: as given.
        frames: length of the period.
        per_pixel: mean number of samples in a pixel, of one frame.
        columns, rows: samples near the columns and rows of the display.
    """

    def __init__(
        self, display: Size, render: Size, jitter: Sequence[Jitter], *, reach: float = REACH
    ) -> None:
        self.jitter, self._sizes = list(jitter), (display, render)
        self._phases = {_key(place): i for i, place in enumerate(jitter)}
        self.frames, self.per_pixel = len(jitter), samples_per_pixel(display, render)
        fewest = [min(display[axis] // gcd(display[axis], render[axis]), _SIDE) for axis in (0, 1)]
        self.columns, self.rows = (
            static_axis(
                display[axis], render[axis], [place[axis] for place in jitter], reach,
                MOST_PAIRS // fewest[1 - axis],
            )
            for axis in (0, 1)
        )  # fmt: skip

    @cached_property
    def table(self) -> Float32:
        """(frames, row kinds, column kinds) weights, 0 where there is no sample; solved when first read."""
        rows, columns = _places(self.rows), _places(self.columns)
        found = np.zeros((self.frames, rows.present.shape[1], columns.present.shape[1]), np.float32)
        for k, present in enumerate(rows.present.T):
            frames = np.flatnonzero(present)
            across, there = columns.offset[frames].T, columns.present[frames].T
            down = np.broadcast_to(rows.offset[frames, k], across.shape)
            found[frames, k] = solve_weights(np.stack([across, down], axis=-1), there).T
        return found

    def phase(self, jitter: Jitter) -> int | None:
        """Return the index of a jitter in the period; None where it is no part of it."""
        return self._phases.get(_key(jitter))

    def serves(self, display: Size, render: Size, tiles: StaticTiles) -> bool:
        """Whether frames still have these sizes and take their jitter from this sequence.

        Args:
            display: size of the image.
            render: size of the frame.
            tiles: after the last frame.
        """
        if self._sizes != (display, render):
            return False
        if tiles.frames == tiles.period + 1:  # the first jitter has repeated: so many there are
            return {_key(jitter) for jitter in tiles.latest_jitters(tiles.period)} == {*self._phases}
        if not tiles.period or tiles.frames % self.frames or tiles.frames < 2 * self.frames:
            return True  # until the next period ends
        return {_key(jitter) for jitter in tiles.latest_jitters(2 * self.frames)} >= {*self._phases}

    def of_frame(self, frame: int) -> Float32:
        """Return the weights of the samples of one frame of the period: (H, W), 0 where there is none."""
        x, y = self.columns, self.rows
        weights = self.table[frame][y.kind][:, x.kind]
        present = (x.sample[frame] != NONE) & (y.sample[frame] != NONE)[:, None]
        found: Float32 = np.where(present, weights, np.float32(0.0))
        return found


def samples_per_pixel(display: Size, render: Size) -> float:
    """Return the mean number of samples of a frame in a pixel of the display."""
    return (render[0] / display[0]) * (render[1] / display[1])


def weights_after(
    before: StaticWeights | None,
    jitter: Jitter,
    tiles: StaticTiles,
    display: Size,
    render: Size,
    least_samples: float = LEAST_SAMPLES,
) -> StaticWeights | None:
    """Return the weights for a frame: those of the jitter sequence that repeats.

    Before a jitter has repeated, the sequence is taken to be `halton_jitter`.

    Args:
        before: for the previous frame; None where there are none.
        jitter: of the frame.
        tiles: after the frame.
        display: size of the image.
        render: size of the frame.
        least_samples: see there.

    Returns:
        None where no sequence is known, or it has fewer than `least_samples` a pixel.
    """
    if before is not None and before.serves(display, render, tiles):
        if before.phase(jitter) is not None or not tiles.period:
            return before
    elif tiles.frames == 1:
        ratio = _usual_ratio(display, render)
        usual = [halton_jitter(index, ratio) for index in range(jitter_phase_count(ratio))]
        return StaticWeights(display, render, usual) if jitter in usual else None
    sequence = tiles.latest_jitters(tiles.period)
    if len(sequence) * samples_per_pixel(display, render) < least_samples:
        return None
    return StaticWeights(display, render, sequence)


def _usual_ratio(display: Size, render: Size) -> float:
    """Return the vendors' ratio that a render size may be rounded from, else the ratio of the sizes."""
    for ratio in RATIOS.values():
        if all(abs(full / ratio - size) < 1.0 for full, size in zip(display, render, strict=True)):
            return ratio
    return float(samples_per_pixel(display, render) ** -0.5)


def static_axis(
    display: int, render: int, jitter: Sequence[float], reach: float = REACH, most_kinds: int = MOST_PAIRS
) -> StaticAxis:
    """Find the samples nearest to the pixels of one axis.

    Args:
        display: number of pixels.
        render: number of samples, at most `display`.
        jitter: of each frame on this axis, in samples.
        reach: see `StaticWeights`.
        most_kinds: most different kinds, besides the first and the last pixel.
    """
    spacing, centres = display / render, np.arange(display) + 0.5
    start = np.asarray(jitter, np.float64)[:, None] + 0.5
    sample = np.rint(centres / spacing - start)
    offset = np.round(((sample + start) * spacing - centres) * _STEPS) / _STEPS
    reach = min(reach, 0.5 * spacing)
    near = (offset >= -reach) & (offset < reach) & (sample >= 0) & (sample < render)
    return StaticAxis(
        np.where(near, sample, NONE).astype(np.int32),
        np.where(near, offset, 0.0).astype(np.float32),
        *_kinds(display, render, most_kinds),
    )


def _kinds(display: int, render: int, most: int) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return `StaticAxis.kind` and `typical`: pixels at the same place between samples share a kind."""
    places = (np.arange(display) * render % display) / display
    places[0], places[-1] = -1.0, -2.0  # a sample at the border may belong to neither pixel beside it
    shared = places
    if len(np.unique(places)) > most + 2:
        shared = (np.floor(places * most) + 0.5) / most
    by_kind = np.lexsort((np.abs(places - shared), shared))
    _, first, kind = np.unique(shared[by_kind], return_index=True, return_inverse=True)
    kinds = np.empty(display, np.int32)
    kinds[by_kind] = kind.reshape(-1)
    return kinds, by_kind[first]


def _key(jitter: Jitter) -> tuple[int, int]:
    """Return a jitter rounded as places are."""
    return round(jitter[0] * _STEPS), round(jitter[1] * _STEPS)


class _Places(NamedTuple):
    """Of each kind of pixel of an axis, (frames, kinds): whether a sample is near, and its offset."""

    present: Bool
    offset: Float64


def _places(axis: StaticAxis) -> _Places:
    return _Places(axis.sample[:, axis.typical] != NONE, axis.offset[:, axis.typical].astype(np.float64))


def solve_weights(places: Float64, present: Bool) -> Float64:
    """Return the weights of samples in means over pixels: (pixels, n), >= 0, with the sum 1 or no sample.

    Args:
        places: (pixels, n, 2) places of the samples, display pixels from the centre of the pixel.
        present: (pixels, n) which of them there are.
    """
    used = present.copy()
    weights = _kriged(places, used, unbiased=True)
    for _ in range(_ROUNDS):
        again = np.flatnonzero((weights < 0.0).any(axis=1))
        if not again.size:
            break
        used[again] &= weights[again] >= 0.0
        weights[again] = _kriged(places[again], used[again], unbiased=True)
    bias = np.abs(np.einsum("pn,pnk->pk", weights, places)).max(axis=1, initial=0.0)
    wrong = np.flatnonzero((weights.min(axis=1, initial=0.0) < 0.0) | (bias > _BIAS))
    if wrong.size:
        weights[wrong] = np.maximum(_kriged(places[wrong], present[wrong], unbiased=False), 0.0)
    total: Float64 = weights / np.maximum(weights.sum(axis=1, keepdims=True), _SOFT)
    return total


def _kriged(places: Float64, present: Bool, *, unbiased: bool) -> Float64:
    """Solve the equations of this module, with vanishing first moments or without: (pixels, n)."""
    count, n = present.shape
    both = present[:, :, None] & present[:, None]
    x, y = np.moveaxis(places[:, :, None] - places[:, None], -1, 0)
    apart = np.hypot(x, y)  # not linalg.norm, which turns what a signal handler raises into a TypeError
    system = np.zeros((count, n + 3, n + 3))
    system[:, :n, :n] = np.where(both, np.maximum(apart, _NUGGET), 0.0)
    each = np.arange(n)
    system[:, each, each] = np.where(present, 0.0, 1.0)
    conditions = np.concatenate([np.ones((count, n, 1)), places], axis=2) * present[:, :, None]
    if not unbiased:
        conditions[:, :, 1:] = 0.0
    system[:, :n, n:], system[:, n:, :n] = conditions, conditions.transpose(0, 2, 1)
    last = np.arange(n, n + 3)
    system[:, last, last] = -_SOFT
    wanted = np.zeros((count, n + 3))
    wanted[:, :n] = np.where(present, _distance_to_pixel(places), 0.0)
    wanted[:, n] = 1.0
    solved: Float64 = np.linalg.solve(system, wanted[..., None])[:, :n, 0]
    return solved


def _distance_to_pixel(places: Float64) -> Float64:
    """Return the mean distance of places from the points of the pixel, display pixels."""
    grid = (np.arange(_POINTS) + 0.5) / _POINTS - 0.5
    x, y = (places[..., axis, None] - grid for axis in (0, 1))
    distance: Float64 = np.hypot(x[..., None], y[..., None, :]).mean(axis=(-2, -1))
    return distance
