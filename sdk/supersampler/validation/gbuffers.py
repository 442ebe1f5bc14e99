"""Pixel checks of the G-buffers that a method reads."""

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Float32, Frame
from supersampler.methods.gbuffers import GBUFFERS, BufferField
from supersampler.validation import mistakes
from supersampler.validation.mistakes import Mistake, where
from supersampler.validation.probe import pixel_grid

_MIN_PIXELS = 100
_RANGE_ERROR = 1e-3  # rounding error of half floats near 1
_LENGTH_ERROR = 0.05  # maximum error of a normal's length
_MIN_FRACTION = 0.01  # minimum fraction of wrong pixels
_MAX_RATIO = 1.25  # maximum ratio of depths at the two sizes
_MIN_SPREAD = 0.05  # minimum spread of log depth ratios that proves another kind of depth


def gbuffer_mistakes(frame: Frame, names: Collection[str]) -> Iterator[Mistake]:
    """Yield the mistakes in the frame's G-buffers with these tensor names, if they exist."""
    for place in (GBUFFERS[name] for name in names):
        array = place.find(frame)
        if array is None:
            continue
        bad = ~np.isfinite(array if array.ndim == 2 else array.sum(axis=-1, dtype=np.float32))  # Inf - Inf
        if bad.any():
            is_depth = place.key == "depth"
            mistake = mistakes.GBUFFER_DEPTH_NOT_FINITE if is_depth else mistakes.GBUFFER_NOT_FINITE
            yield mistake.found(place=place, where=where(bad))
        elif place.key == "depth":
            yield from _depth(place, array, frame)
        else:
            values = array[pixel_grid((array.shape[1], array.shape[0]))].astype(np.float32)
            yield from _normal(place, values) if place.key == "normal" else _fraction(place, values)


def _fraction(place: BufferField, values: Float32) -> Iterator[Mistake]:
    outside = float(np.mean((values < -_RANGE_ERROR) | (values > 1.0 + _RANGE_ERROR)))
    if outside > _MIN_FRACTION:
        low, high = float(values.min()), float(values.max())
        whole = low >= 0.0 and high > 2.0 and np.mean(values == np.rint(values)) > 0.99
        mistake = mistakes.GBUFFER_BYTES if whole else mistakes.GBUFFER_OUT_OF_RANGE
        yield mistake.found(place=place, share=outside, low=low, high=high)


def _normal(place: BufferField, values: Float32) -> Iterator[Mistake]:
    length = np.linalg.norm(values, axis=-1)
    wrong = (length > _LENGTH_ERROR) & (np.abs(length - 1.0) > _LENGTH_ERROR)
    if wrong.mean() <= _MIN_FRACTION:
        return
    decoded = np.linalg.norm(2.0 * values - 1.0, axis=-1)[wrong]
    decoded = decoded[decoded > _LENGTH_ERROR]  # the encoded sky is 0
    fitting = np.abs(decoded - 1.0) <= _LENGTH_ERROR
    encoded = values.min() >= -_RANGE_ERROR and 2 * fitting.sum() > len(decoded)
    mistake = mistakes.NORMAL_ENCODED if encoded else mistakes.NORMAL_NOT_UNIT
    lengths = length[wrong]
    yield mistake.found(place=place, share=wrong.mean(), low=lengths.min(), high=lengths.max())


def _depth(place: BufferField, array: Array, frame: Frame) -> Iterator[Mistake]:
    """Compare display-size depth with render-size depth, which must be of the same kind."""
    if array.min() < 0.0:
        yield mistakes.GBUFFER_DEPTH_NEGATIVE.found(place=place, low=float(array.min()))
        return
    rows, columns = pixel_grid(frame.size)
    own, other = frame.depth[rows, columns], _at_samples(array, frame, rows, columns)
    both = (own > 0.0) & (other > 0.0) & np.isfinite(own)
    if both.sum() < _MIN_PIXELS:
        return
    quotient, product = np.log(other[both] / own[both]), np.log(other[both] * own[both])
    scale = float(np.exp(np.median(quotient)))
    off, off_if_distance = _spread(quotient), _spread(product)
    if off > _MIN_SPREAD and off_if_distance < 0.25 * off:
        yield mistakes.GBUFFER_DEPTH_IS_DISTANCE.found(place=place)
    elif not 1.0 / _MAX_RATIO <= scale <= _MAX_RATIO:
        yield mistakes.GBUFFER_DEPTH_SCALED.found(place=place, scale=scale)


def _at_samples(array: Array, frame: Frame, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Float32:
    """Return display-size depth at the sample positions of these render pixels."""
    indices = []
    for axis, (index, jitter) in enumerate(((rows, frame.jitter[1]), (columns, frame.jitter[0]))):
        position = np.floor((index + 0.5 + jitter) * (array.shape[axis] / frame.depth.shape[axis]))
        indices.append(np.minimum(position.astype(np.intp), array.shape[axis] - 1))
    depth: Float32 = array[indices[0], indices[1]].astype(np.float32)
    return depth


def _spread(values: Float32) -> float:
    """Return the median absolute deviation."""
    return float(np.median(np.abs(values - np.median(values))))
