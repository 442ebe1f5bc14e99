"""Pixel checks of the G-buffers that a method reads."""

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Float32, Frame
from supersampler.methods.gbuffers import GBUFFERS, Place
from supersampler.validation import mistakes
from supersampler.validation.evidence import PLACES, grid
from supersampler.validation.mistakes import Mistake, where

_MIN_PLACES = 100  # minimum number of places
_RANGE_ERROR = 1e-3  # rounding error of half floats near 1
_LENGTH_ERROR = 0.05  # accepted error of a normal's length
_MIN_FRACTION = 0.01  # minimum fraction of wrong places
_MAX_RATIO = 1.25  # accepted ratio of depths at two sizes
_MIN_SPREAD = 0.05  # of log depth, from which on surfaces have several distances


def gbuffer_mistakes(frame: Frame, names: Collection[str]) -> Iterator[Mistake]:
    """Yield the mistakes in the frame's G-buffers of these tensor names; missing ones are skipped."""
    for place in (GBUFFERS[name] for name in names):
        array = place.find(frame)
        if array is None:
            continue
        bad = _not_finite(array)
        if bad.any():
            is_depth = place.key == "depth"
            mistake = mistakes.GBUFFER_DEPTH_NOT_FINITE if is_depth else mistakes.GBUFFER_NOT_FINITE
            yield mistake.found(place=place, where=where(bad))
        elif place.key == "normal":
            yield from _normal(place, array)
        elif place.key == "depth":
            yield from _depth(place, array, frame)
        else:
            yield from _share(place, array)


def _not_finite(array: Array) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", over="ignore"):  # Inf - Inf
        return ~np.isfinite(array if array.ndim == 2 else array.sum(axis=-1, dtype=np.float32))


def _values(array: Array) -> Float32:
    rows, columns = grid((array.shape[1], array.shape[0]), PLACES)
    return array[rows, columns].astype(np.float32)


def _share(place: Place, array: Array) -> Iterator[Mistake]:
    values = _values(array)
    outside = float(np.mean((values < -_RANGE_ERROR) | (values > 1.0 + _RANGE_ERROR)))
    if outside > _MIN_FRACTION:
        least, most = float(values.min()), float(values.max())
        whole = least >= 0.0 and most > 2.0 and np.mean(values == np.rint(values)) > 0.99
        mistake = mistakes.GBUFFER_BYTES if whole else mistakes.GBUFFER_OUT_OF_RANGE
        yield mistake.found(place=place, share=outside, least=least, most=most)


def _normal(place: Place, array: Array) -> Iterator[Mistake]:
    values = _values(array)
    length = np.linalg.norm(values, axis=-1)
    wrong = (length > _LENGTH_ERROR) & (np.abs(length - 1.0) > _LENGTH_ERROR)
    if wrong.mean() <= _MIN_FRACTION:
        return
    decoded = np.linalg.norm(2.0 * values - 1.0, axis=-1)[wrong]
    decoded = decoded[decoded > _LENGTH_ERROR]  # the encoded sky is 0
    fitting = np.abs(decoded - 1.0) <= _LENGTH_ERROR
    encoded = values.min() >= -_RANGE_ERROR and 2 * fitting.sum() > len(decoded)
    lengths = length[wrong]
    mistake = mistakes.NORMAL_ENCODED if encoded else mistakes.NORMAL_NOT_UNIT
    yield mistake.found(place=place, share=wrong.mean(), least=lengths.min(), most=lengths.max())


def _depth(place: Place, array: Array, frame: Frame) -> Iterator[Mistake]:
    """Compare display-size depth with render-size depth, which must be of the same kind."""
    if array.min() < 0.0:
        yield mistakes.GBUFFER_DEPTH_NEGATIVE.found(place=place, least=float(array.min()))
        return
    own, other = _same_places(frame, array)
    both = (own > 0.0) & (other > 0.0) & np.isfinite(own)
    if both.sum() < _MIN_PLACES:
        return
    quotient, product = np.log(other[both] / own[both]), np.log(other[both] * own[both])
    scale = float(np.exp(np.median(quotient)))
    off, off_if_distance = _spread(quotient), _spread(product)
    if off > _MIN_SPREAD and off_if_distance < 0.25 * off:
        yield mistakes.GBUFFER_DEPTH_IS_DISTANCE.found(place=place)
    elif not 1.0 / _MAX_RATIO <= scale <= _MAX_RATIO:
        yield mistakes.GBUFFER_DEPTH_SCALED.found(place=place, scale=scale)


def _same_places(frame: Frame, array: Array) -> tuple[Float32, Float32]:
    """Return render-size depth at some pixels, and display-size depth at their sample positions."""
    rows, columns = grid(frame.size, PLACES)
    indices = []
    for axis, (index, jitter) in enumerate(((rows, frame.jitter[1]), (columns, frame.jitter[0]))):
        ratio = array.shape[axis] / frame.depth.shape[axis]
        position = np.floor((index + 0.5 + jitter) * ratio).astype(np.intp)
        indices.append(np.clip(position, 0, array.shape[axis] - 1))
    return frame.depth[rows, columns], array[indices[0], indices[1]].astype(np.float32)


def _spread(values: Float32) -> float:
    """Return the median absolute deviation."""
    return float(np.median(np.abs(values - np.median(values))))
