"""Keyframe animation of nodes."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from supersampler_model.data.scenes.gltf.accessors import floats
from supersampler_model.data.scenes.gltf.document import Document, Json
from supersampler_model.data.scenes.gltf.errors import MalformedError, at
from supersampler_model.data.values import Values

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """How one property of one node changes.

    Attributes:
        node: index in the file.
        path: "translation", "rotation" or "scale".
        times: (k,) seconds, ascending.
        values: (k, 3, width): tangent towards the keyframe, its value, tangent from it, per second; the
            tangents are 0 unless the interpolation is CUBICSPLINE.
    """

    node: int
    path: str
    interpolation: str
    times: Values
    values: Values

    def at(self, time: float) -> Values:
        """Return the property (width,); outside of the keyframes that of the nearest."""
        before = int(np.searchsorted(self.times, time, side="right")) - 1
        if before < 0 or before + 1 == len(self.times):
            return self._finished(self.values[max(before, 0), 1])
        start, end = self.values[before, 1], self.values[before + 1, 1]
        span = self.times[before + 1] - self.times[before]
        fraction = (time - self.times[before]) / span
        if self.interpolation == "STEP":
            return self._finished(start)
        if self.interpolation == "CUBICSPLINE":
            leaving, arriving = span * self.values[before, 2], span * self.values[before + 1, 0]
            return self._finished(_hermite(start, leaving, arriving, end, fraction))
        if self.path == "rotation":
            return _slerp(start, end, fraction)
        return np.asarray((1.0 - fraction) * start + fraction * end)

    def _finished(self, value: Values) -> Values:
        return value / np.linalg.norm(value) if self.path == "rotation" else value


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """One animation of a file.

    Attributes:
        name: as in the file, "" if it has none.
        duration: seconds, of the last keyframe.
    """

    name: str
    duration: float
    channels: tuple[Channel, ...]


def clips_of(document: Document) -> tuple[Clip, ...]:
    """Read the animations of a file."""
    clips = []
    for index in range(len(document.content.get("animations", []))):
        with at(document.name("animations", index)):
            content = document.item("animations", index)
            read = [_channel(document, content, number) for number in range(len(content["channels"]))]
            channels = tuple(channel for channel in read if channel is not None)
            duration = max((float(channel.times[-1]) for channel in channels), default=0.0)
            clips.append(Clip(str(content.get("name", "")), duration, channels))
    return tuple(clips)


def _channel(document: Document, content: Json, number: int) -> Channel | None:
    """Read a channel; None if it moves no node, or its weights: primitives with morph targets are refused."""
    channel = content["channels"][number]
    target, sampler = channel["target"], content["samplers"][channel["sampler"]]
    path = target["path"]
    if "node" not in target or path == "weights":
        return None
    with at(f"channel {number}"):
        node, interpolation = target["node"], sampler.get("interpolation", "LINEAR")
        if "matrix" in document.item("nodes", node):
            raise MalformedError(f"it moves {document.name('nodes', node)}, which is placed by a matrix")
        if path not in _WIDTHS or interpolation not in _INTERPOLATIONS:
            kinds = f"one of {', '.join(_INTERPOLATIONS)} of {', '.join(_WIDTHS)}"
            raise MalformedError(f"it is {interpolation!r} of {path!r}; want {kinds}")
        times = floats(document, sampler["input"], "SCALAR")[:, 0]
        if (np.diff(times) <= 0.0).any():
            raise MalformedError("its times do not ascend")
        return Channel(node, path, interpolation, times, _values(document, sampler, path, len(times)))


def _values(document: Document, sampler: Json, path: str, count: int) -> Values:
    width = _WIDTHS[path]
    values = floats(document, sampler["output"], f"VEC{width}")
    cubic = sampler.get("interpolation") == "CUBICSPLINE"
    if len(values) != (3 * count if cubic else count):
        raise MalformedError(f"it has {count} times and {len(values)} values")
    if cubic:
        triples = values.reshape(count, 3, width)
    else:
        triples = np.stack([np.zeros_like(values), values, np.zeros_like(values)], axis=1)
    if path == "rotation" and np.linalg.norm(triples[:, 1], axis=1).min() < 1e-3:
        raise MalformedError("one of its rotations is 0")
    return triples


def _hermite(start: Values, leaving: Values, arriving: Values, end: Values, s: float) -> Values:
    weights: tuple[Any, ...] = (
        2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, s**3 - s**2, 3 * s**2 - 2 * s**3
    )  # fmt: skip
    a, b, c, d = weights
    return np.asarray(a * start + b * leaving + c * arriving + d * end)


def _slerp(start: Values, end: Values, fraction: float) -> Values:
    """Interpolate two rotations spherically, along the shorter arc."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    cosine = float(start @ end)
    if cosine < 0.0:
        end, cosine = -end, -cosine
    if cosine > 0.9999:  # the angle is too small to divide by; linear interpolation is exact enough
        mixed = (1.0 - fraction) * start + fraction * end
        return np.asarray(mixed / np.linalg.norm(mixed))
    angle = np.arccos(cosine)
    return np.asarray(
        (np.sin((1.0 - fraction) * angle) * start + np.sin(fraction * angle) * end) / np.sin(angle)
    )
