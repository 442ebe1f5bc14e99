"""Weights of samples in the mean of a pixel that stands still: its samples of one jitter period.

Each sample lies in one display pixel. A plain mean of a pixel's samples is biased, because they are not
centered on it. The weights here are the least change of equal weights whose first moments vanish, so that a
mean with them is exact where colour is linear over the pixel:

    weight = a + b * dx + c * dy,   sum(weight) = 1,   sum(weight * dx) = sum(weight * dy) = 0

with (dx, dy) the sample's place, display pixels from the centre of the pixel. Equivalently, the mean is the
intercept of a least-squares plane through the samples. At rational ratios many pixels have their samples at
the same places, and share (a, b, c): four pixels at ratio 2, nine at 1.5, besides those at the border. At
other ratios pixels share them whose places differ by less than 1 / MOST_KINDS samples.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.static_tiles import Jitter, StaticTiles
from supersampler.conventions.jitter import RATIOS, halton_jitter, jitter_phase_count
from supersampler.frame import Float32, Size

Float64 = NDArray[np.float64]

NONE = -1
"""In place of a sample's index: no sample of this frame lies in the pixel."""
_STEPS = 2.0**20
"""Offsets are rounded to 1 / _STEPS display pixels, so that equal places are equal numbers."""
_SINGULAR = 1e-3
"""Least variance of offsets along any direction, square display pixels, for a correction along it."""
MOST = 4.0
"""Largest weight of a sample, in units of an equal weight."""
MOST_KINDS = 512
"""Most different columns or rows with weights of their own, besides the first and the last."""
LEAST_SAMPLES = 4
"""Least number of samples a pixel, on average, of a period whose mean is better than a method's image."""


class StaticAxis(NamedTuple):
    """Samples in the pixels of one axis, by frame of the jitter sequence.

    Attributes:
        sample: (frames, n) int32, index of the sample that lies in each pixel, or NONE.
        offset: (frames, n) float32, its place in [-0.5, 0.5], display pixels; 0 where there is none.
        kind: (n,) int32; pixels of equal `kind` have their samples at the same or nearly the same places in
            all frames.
        kinds: number of different ones.
    """

    sample: NDArray[np.int32]
    offset: Float32
    kind: NDArray[np.int32]
    kinds: int


class StaticWeights:
    """Weights of all samples of a jitter sequence, in the pixels of a display.

    A sample of frame `i` at the pixel (x, y) is that of row `rows.sample[i, y]` and column
    `columns.sample[i, x]`; it has the weight `a + b * dx + c * dy` with (a, b, c) from
    `coefficients[:, rows.kind[y], columns.kind[x]]`.

    Args:
        display, render: (width, height) of images and frames; the ratio is at least 1 on each axis.
        jitter: (x, y) of each frame of one period, render pixels.

    Attributes:
        jitter: as given.
        frames: length of the period.
        per_pixel: mean number of samples in a pixel, of one frame.
        columns, rows: samples in the columns and rows of the display.
        coefficients: (3, row kinds, column kinds) float32 a, b, c; a is 0 where a pixel has no sample.
    """

    def __init__(self, display: Size, render: Size, jitter: Sequence[Jitter]) -> None:
        self.jitter, self._sizes = list(jitter), (display, render)
        self._phases = {_key(place): i for i, place in enumerate(jitter)}
        self.frames, self.per_pixel = len(jitter), samples_per_pixel(display, render)
        self.columns, self.rows = (
            static_axis(display[axis], render[axis], [place[axis] for place in jitter]) for axis in (0, 1)
        )
        self.coefficients = _solved(_places(self.rows), _places(self.columns))

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
        a, b, c = self.coefficients[:, self.rows.kind][:, :, self.columns.kind]
        x, y = self.columns, self.rows
        weights = a + b * x.offset[frame] + c * y.offset[frame][:, None]
        present = (x.sample[frame] != NONE) & (y.sample[frame] != NONE)[:, None]
        found: Float32 = np.where(present, weights, np.float32(0.0))
        return found


def samples_per_pixel(display: Size, render: Size) -> float:
    """Return the mean number of samples of a frame in a pixel of the display."""
    return (render[0] / display[0]) * (render[1] / display[1])


def weights_after(
    before: StaticWeights | None, jitter: Jitter, tiles: StaticTiles, display: Size, render: Size
) -> StaticWeights | None:
    """Return the weights for a frame: those of the jitter sequence that repeats.

    Before a jitter has repeated, the sequence is taken to be `halton_jitter`.

    Args:
        before: for the previous frame; None where there are none.
        jitter: of the frame.
        tiles: after the frame.
        display: size of the image.
        render: size of the frame.

    Returns:
        None where no sequence is known, or it has fewer than LEAST_SAMPLES samples a pixel.
    """
    if before is not None and before.serves(display, render, tiles):
        if before.phase(jitter) is not None or not tiles.period:
            return before
    elif tiles.frames == 1:
        ratio = _usual_ratio(display, render)
        usual = [halton_jitter(index, ratio) for index in range(jitter_phase_count(ratio))]
        return StaticWeights(display, render, usual) if jitter in usual else None
    sequence = tiles.latest_jitters(tiles.period)
    if len(sequence) * samples_per_pixel(display, render) < LEAST_SAMPLES:
        return None
    return StaticWeights(display, render, sequence)


def _usual_ratio(display: Size, render: Size) -> float:
    """Return the vendors' ratio that a render size may be rounded from, else the ratio of the sizes."""
    for ratio in RATIOS.values():
        if all(abs(full / ratio - size) < 1.0 for full, size in zip(display, render, strict=True)):
            return ratio
    return float(samples_per_pixel(display, render) ** -0.5)


def static_axis(display: int, render: int, jitter: Sequence[float]) -> StaticAxis:
    """Find the samples in the pixels of one axis.

    Args:
        display: number of pixels.
        render: number of samples, at most `display`.
        jitter: of each frame on this axis, in samples.
    """
    samples = np.arange(render)
    places = (samples + 0.5 + np.asarray(jitter, np.float64)[:, None]) * (display / render)
    places = np.round(places * _STEPS) / _STEPS
    pixels = np.floor(places).astype(np.int64)
    sample = np.full((len(jitter), display), NONE, np.int32)
    offset = np.zeros((len(jitter), display), np.float32)
    frame, inside = np.arange(len(jitter))[:, None].repeat(render, 1), (pixels >= 0) & (pixels < display)
    at = frame[inside], pixels[inside]
    sample[at] = np.broadcast_to(samples, pixels.shape)[inside]
    offset[at] = (places - pixels - 0.5)[inside]
    kind = _kinds(display, render)
    return StaticAxis(sample, offset, kind, int(kind.max()) + 1)


def _kinds(display: int, render: int) -> NDArray[np.int32]:
    """Return which pixels of an axis share weights: those at the same place between samples, (n,)."""
    places = (np.arange(display) * render % display) / display
    places[0], places[-1] = -1.0, -2.0  # a sample at the border may belong to neither pixel beside it
    kinds = np.unique(places, return_inverse=True)[1]
    if kinds.max() > MOST_KINDS + 2:
        kinds = np.unique(np.floor(places * MOST_KINDS), return_inverse=True)[1]
    return kinds.reshape(-1).astype(np.int32)


def _key(jitter: Jitter) -> tuple[int, int]:
    """Return a jitter rounded as places are."""
    return round(jitter[0] * _STEPS), round(jitter[1] * _STEPS)


class _Places(NamedTuple):
    """Of each kind of pixel of an axis, (frames, kinds): 1 where a sample is, and its offset."""

    present: Float64
    offset: Float64


def _places(axis: StaticAxis) -> _Places:
    _, first = np.unique(axis.kind, return_index=True)
    return _Places(
        (axis.sample[:, first] != NONE).astype(np.float64), axis.offset[:, first].astype(np.float64)
    )


def _solved(rows: _Places, columns: _Places) -> Float32:
    """Return a, b, c of all pairs of kinds: (3, row kinds, column kinds)."""
    y, x = (((p.present, p.offset, p.offset * p.offset)) for p in (rows, columns))
    count = np.maximum(y[0].T @ x[0], 1e-9)
    mean_x, mean_y = y[0].T @ x[1] / count, y[1].T @ x[0] / count
    xx = y[0].T @ x[2] / count - mean_x**2
    yy = y[2].T @ x[0] / count - mean_y**2
    xy = y[1].T @ x[1] / count - mean_x * mean_y
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    known = half - apart >= _SINGULAR  # the smaller eigenvalue of the covariance
    scale = np.where(known, -1.0 / np.maximum(xx * yy - xy * xy, _SINGULAR**2), 0.0)
    # weight * count = 1 + slope . (offset - mean), with covariance @ slope = -mean
    slope_x, slope_y = scale * (yy * mean_x - xy * mean_y), scale * (xx * mean_y - xy * mean_x)
    part = _part_within_bounds(rows, columns, (mean_x, mean_y), (slope_x, slope_y))
    slope_x, slope_y = part * slope_x, part * slope_y
    seen = count >= 0.5
    a = np.where(seen, (1.0 - slope_x * mean_x - slope_y * mean_y) / count, 0.0)
    return np.stack([a, slope_x / count, slope_y / count]).astype(np.float32)


def _part_within_bounds(
    rows: _Places, columns: _Places, mean: tuple[Float64, Float64], slope: tuple[Float64, Float64]
) -> Float64:
    """Return the largest part of the slopes, in [0, 1], with which all weights are in [0, MOST] / count."""
    reach = np.abs(slope[0]) * (0.5 + np.abs(mean[0])) + np.abs(slope[1]) * (0.5 + np.abs(mean[1]))
    y, x = np.nonzero(reach > 1.0)  # no offset is above 0.5, so elsewhere no weight can be out of bounds
    mean_x, mean_y, slope_x, slope_y = (values[y, x] for values in (*mean, *slope))
    least, most = np.zeros((2, len(y)))
    for row, column, there_y, there_x in zip(
        rows.offset, columns.offset, rows.present, columns.present, strict=True
    ):
        change = slope_x * (column[x] - mean_x) + slope_y * (row[y] - mean_y)
        change *= there_y[y] * there_x[x]
        least, most = np.minimum(least, change), np.maximum(most, change)
    parts = np.ones_like(mean[0])
    parts[y, x] = np.minimum(1.0 / np.maximum(-least, 1.0), (MOST - 1.0) / np.maximum(most, MOST - 1.0))
    return parts
