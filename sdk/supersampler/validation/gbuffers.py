"""Checks of the G-buffers that a method reads."""

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Float32, Frame
from supersampler.methods.gbuffers import GBUFFERS, Place
from supersampler.validation.mistake import Mistake, where
from supersampler.validation.reprojection import grid

_PLACES = 12_000
_FEW = 100  # places that say nothing about all others
_OUTSIDE = 1e-3  # rounding of halves near 1
_LENGTH = 0.05  # what shaders that do not normalise leave
_SHARE = 0.01  # of the places, that are no accident
_SCALE = 1.25  # by how much depths of two sizes may differ
_SPREAD = 0.05  # in the logarithm of depth: surfaces at more than one distance


def mistakes_of_gbuffers(frame: Frame, names: Collection[str]) -> Iterator[Mistake]:
    """Yield what is wrong with the G-buffers of these tensors, which the frame has."""
    for place in (GBUFFERS[name] for name in names):
        array = place.find(frame)
        if array is None:
            continue
        bad = _not_finite(array)
        if bad.any():
            hint = "Clear the target to 0 where nothing is drawn, and normalise no vector of length 0."
            if place.key == "depth":
                hint = "Is it a distance? The sky of near / distance is 0."
            got = f"NaN or Inf {where(bad)}"
            yield Mistake(kind=f"{place} not finite", field=str(place), got=got, want="finite", hint=hint)
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
    rows, columns = grid((array.shape[1], array.shape[0]), _PLACES)
    return array[rows, columns].astype(np.float32)


def _share(place: Place, array: Array) -> Iterator[Mistake]:
    values = _values(array)
    outside = float(np.mean((values < -_OUTSIDE) | (values > 1.0 + _OUTSIDE)))
    if outside > _SHARE:
        least, most = float(values.min()), float(values.max())
        hint = "It is a share of light or a parameter of the material, without lighting or exposure."
        if least >= 0.0 and most > 2.0 and np.mean(values == np.rint(values)) > 0.99:
            hint = "Are these bytes? Divide by 255; a base colour in sRGB is to be made linear, too."
        got = f"outside [0, 1] in {outside:.0%} of its values, from {least:.3g} to {most:.3g}"
        yield Mistake(
            kind=f"{place} out of range", field=str(place), got=got, want="linear, in [0, 1]", hint=hint
        )


def _normal(place: Place, array: Array) -> Iterator[Mistake]:
    values = _values(array)
    length = np.linalg.norm(values, axis=-1)
    drawn = length > _LENGTH
    wrong = drawn & (np.abs(length - 1.0) > _LENGTH)
    if wrong.mean() <= _SHARE:
        return
    decoded = np.linalg.norm(2.0 * values - 1.0, axis=-1)[wrong]
    decoded = decoded[decoded > _LENGTH]  # the sky, encoded, becomes 0
    fitting = np.abs(decoded - 1.0) <= _LENGTH
    encoded = values.min() >= -_OUTSIDE and 2 * fitting.sum() > len(decoded)
    lengths = f"from {length[wrong].min():.2g} to {length[wrong].max():.2g}"
    got = f"of a length that is neither 1 nor 0 in {wrong.mean():.0%} of its pixels, {lengths}"
    hint = "Normalise after the normal map is read, and do not average or resize."
    if encoded:
        got = "encoded: it fits n * 0.5 + 0.5"
        hint = "Decode it: 2 * normal - 1, and 0 at the sky."
    want = "world-space normals of unit length, 0 at the sky"
    yield Mistake(kind=f"{place} not unit", field=str(place), got=got, want=want, hint=hint)


def _depth(place: Place, array: Array, frame: Frame) -> Iterator[Mistake]:
    """Depth of display size is what the frame's own is, at more places."""
    want = "near / distance of the same near plane as frame.depth, 0 at the sky"
    if array.min() < 0.0:
        got = f"negative, as small as {float(array.min()):.3g}"
        yield Mistake(kind=f"{place} negative", field=str(place), got=got, want=want)
        return
    own, other = _same_places(frame, array)
    both = (own > 0.0) & (other > 0.0) & np.isfinite(own)
    if both.sum() < _FEW:
        return
    quotient, product = np.log(other[both] / own[both]), np.log(other[both] * own[both])
    scale = float(np.exp(np.median(quotient)))
    off, off_if_distance = _spread(quotient), _spread(product)
    if off > _SPREAD and off_if_distance < 0.25 * off:
        got = "a distance: it grows where frame.depth falls"
        hint = "Write near / distance, with the near plane of frame.depth."
    elif not 1.0 / _SCALE <= scale <= _SCALE:
        got = f"{scale:.3g} times frame.depth at the same places"
        hint = "Is it forward, a distance, or of another near plane? Write both by the same code."
    else:
        return
    yield Mistake(kind=f"{place} of another kind", field=str(place), got=got, want=want, hint=hint)


def _same_places(frame: Frame, array: Array) -> tuple[Float32, Float32]:
    """Depth of the frame at some samples, and what the display-size one has where they were taken."""
    rows, columns = grid(frame.size, _PLACES)
    there = []
    for axis, (index, jitter) in enumerate(((rows, frame.jitter[1]), (columns, frame.jitter[0]))):
        ratio = array.shape[axis] / frame.depth.shape[axis]
        position = np.floor((index + 0.5 + jitter) * ratio).astype(np.intp)
        there.append(np.clip(position, 0, array.shape[axis] - 1))
    return frame.depth[rows, columns], array[there[0], there[1]].astype(np.float32)


def _spread(values: Float32) -> float:
    """Median distance from the median."""
    return float(np.median(np.abs(values - np.median(values))))
