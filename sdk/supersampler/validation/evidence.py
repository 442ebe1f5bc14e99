"""Raw frames and pairs of them, ready to be read under any hypothesis."""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.factors import jitter_factor, motion_factor
from supersampler.conventions.srgb import srgb_decoded
from supersampler.errors import FrameError
from supersampler.frame import Float32, Size, as_array
from supersampler.validation.reprojection import Pair, luminance

Vectors = NDArray[np.float32]
Places = tuple[NDArray[np.intp], NDArray[np.intp]]


class Still:
    """One frame with row 0 on top and its light linear; motion, depth and jitter are as they came.

    Attributes:
        depth: (h, w).
        motion: (h, w, 2), or at display size.
        light: (h, w) luminance, or None where the frame was not shaded.
    """

    def __init__(self, raw: RawFrame, stated: Conventions) -> None:
        self.raw = raw
        self.depth = _rows("depth", raw.depth, stated)
        self.motion = _rows("motion", raw.motion, stated)
        if self.depth.ndim != 2 or self.motion.ndim != 3 or self.motion.shape[2] != 2:
            shapes = f"depth {self.depth.shape}, motion {self.motion.shape}"
            raise FrameError("motion", got=shapes, want="depth (h, w), motion (h, w, 2)")
        self.light: Float32 | None = None
        if raw.color is not None:
            color = _rows("color", raw.color, stated)
            self.light = luminance(srgb_decoded(color) if stated.srgb else color)

    @property
    def size(self) -> Size:
        """Render size (width, height)."""
        return self.depth.shape[1], self.depth.shape[0]

    def jitter(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return the jitter (x, y) in render pixels, read by these conventions."""
        return np.multiply(self.raw.jitter or (0.0, 0.0), jitter_factor(conventions, self.size))

    def vectors(self, conventions: Conventions, places: Places, *, swapped: bool = False) -> Vectors:
        """Return (n, 2) motion in render pixels, read by these conventions, jitter left in.

        Args:
            conventions: how to read it.
            places: rows and columns of render pixels.
            swapped: take y for x and x for y.
        """
        own_height, own_width = self.motion.shape[:2]
        rows = (places[0] * 2 + 1) * own_height // (2 * self.size[1])
        columns = (places[1] * 2 + 1) * own_width // (2 * self.size[0])
        vectors = self.motion[rows, columns].astype(np.float32)
        factor = np.array(motion_factor(conventions, self.size, (own_width, own_height)), np.float32)
        result: Vectors = (vectors[:, ::-1] if swapped else vectors) * factor
        return result


class Step:
    """Two neighbouring frames of one size, both shaded, and the places where their pictures are compared."""

    def __init__(self, before: Still, now: Still) -> None:
        self.before, self.now = before, now
        if now.light is None or before.light is None:
            raise FrameError("color", got=None, want="shaded frames")
        self.pair = Pair(now.light, before.light)
        self.places = self.pair.rows, self.pair.columns

    def shift(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return what jitter adds to an unjittered vector that leads to the same colour: (x, y) pixels."""
        return self.now.jitter(conventions) - self.before.jitter(conventions)


def steps(stills: list[Still]) -> list[Step]:
    """Return the neighbours that can be compared: no cut between, both shaded, of one size."""
    return [
        Step(before, now)
        for before, now in pairwise(stills)
        if not now.raw.reset and now.size == before.size and None not in (_shape(now), _shape(before))
    ]


def _shape(still: Still) -> tuple[int, ...] | None:
    return None if still.light is None else still.light.shape


def _rows(name: str, value: object, stated: Conventions) -> NDArray[Any]:
    array = as_array(name, value)
    return array[::-1] if stated.bottom_up else array
