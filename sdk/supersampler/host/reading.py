"""What a frame brings, on a processor: usable planes, exposure, toned samples, what is in front."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from supersampler.frame import Float32, Frame, Size
from supersampler.host.bands import Bands
from supersampler.host.compiler import Call
from supersampler.host.memory import address
from supersampler.host.tables import LANES, up_to

PAD = 16  # columns on either side of a plane that neighbourhoods reach into; see kernels.frame
READING = ("frame.measure", "frame.prepare", "frame.closest")
KEY, ADAPTATION = 0.18, 0.1  # see supersampler_model.color


class Planes(NamedTuple):
    """Arrays of a frame as kernels read them, C-contiguous float32."""

    color: Float32  # (h, w, 3)
    depth: Float32  # (h, w)
    motion: Float32  # (h, w, 2)

    @classmethod
    def of(cls, frame: Frame) -> "Planes":
        """Convert where needed."""
        return cls(*(np.ascontiguousarray(a, np.float32) for a in (frame.color, frame.depth, frame.motion)))


class Samples:
    """A frame's toned samples, depth and motion; see kernels.frame for what lies where."""

    def __init__(self, render: Size) -> None:
        w, h = render
        self.stride = stride = up_to(w, LANES)
        self.color = np.zeros((h, stride, LANES), np.float32)
        self.depths, self.across, self.down, self.eroded = np.zeros((4, h, stride + 2 * PAD), np.float32)
        self.front, self.own = np.zeros((2, h, stride, 4), np.float32)


class Reader:
    """What every method begins with.

    Args:
        kernels: READING.
        bands: threads.
    """

    def __init__(self, kernels: Mapping[str, Call], bands: Bands) -> None:
        self._bands = bands
        self._measure, self._prepare, self._closest = (kernels[name] for name in READING)

    def exposure(self, frame: Frame, color: Float32, before: float) -> float:
        """What the frame says, else 0.18 over its log-average luminance, adapting from `before` where > 0."""
        if frame.exposure:
            return float(np.float32(frame.exposure))
        h, w = color.shape[:2]
        rows = np.zeros((h, 2), np.float32)
        self._bands.run(h, lambda y0, y1, _: self._measure(address(color), w, y0, y1, address(rows)))
        logs, count = (float(total) for total in rows.sum(axis=0, dtype=float))
        target = KEY * math.exp(-logs / max(count, 1.0))
        if before > 0.0:
            target = before ** (1.0 - ADAPTATION) * target**ADAPTATION if count else before
        return float(np.float32(target))

    def read(self, planes: Planes, exposure: float, to: Samples) -> None:
        """Tone the samples; find what is in front."""
        (h, w), stride = planes.depth.shape, to.stride
        inputs = [address(plane) for plane in planes]
        color, depths, across, down = (address(a) for a in (to.color, to.depths, to.across, to.down))
        self._bands.run(
            h,
            lambda y0, y1, _: self._prepare(
                *inputs, exposure, w, stride, y0, y1, color, depths, across, down
            ),
        )
        found = [address(plane) for plane in (to.front, to.own, to.eroded)]
        self._bands.run(
            h, lambda y0, y1, _: self._closest(depths, across, down, w, h, stride, y0, y1, *found)
        )
