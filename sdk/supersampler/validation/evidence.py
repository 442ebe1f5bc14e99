"""What one frame shows and how two neighbours compare, for the checks of `Frame` and the detector alike."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.factors import jitter_factor, motion_factor
from supersampler.conventions.srgb import srgb_decoded
from supersampler.errors import FrameError
from supersampler.frame import Array, Float32, Frame, Size, as_array
from supersampler.validation.depth_order import DepthOrder, uncovered
from supersampler.validation.reprojection import Places, Reprojection, grid, luminance, moving


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """One frame with row 0 on top and linear luminance; depth, motion and jitter are as they came.

    Attributes:
        light: (h, w) luminance; None where the frame was not shaded.
        depth: (h, w).
        motion: (h, w, 2), or at display size.
        jitter: (x, y).
        reset: as in `Frame`.
    """

    light: Float32 | None
    depth: Array
    motion: Array
    jitter: tuple[float, float]
    reset: bool

    @classmethod
    def of_frame(cls, frame: Frame) -> "Evidence":
        """Return a frame's own arrays; its colour becomes luminance."""
        light = None if frame.color is None else luminance(frame.color)
        return cls(light, frame.depth, frame.motion, frame.jitter, frame.reset)

    @classmethod
    def of_raw(cls, raw: RawFrame, stated: Conventions) -> "Evidence":
        """Return a raw frame with rows and sRGB as stated.

        Raises:
            FrameError: depth or motion is of a wrong shape, or not an array.
        """
        depth, motion = _rows("depth", raw.depth, stated), _rows("motion", raw.motion, stated)
        if depth.ndim != 2 or motion.ndim != 3 or motion.shape[2] != 2:
            shapes = f"depth {depth.shape}, motion {motion.shape}"
            raise FrameError("motion", got=shapes, want="depth (h, w), motion (h, w, 2)")
        light = None
        if raw.color is not None:
            color = _rows("color", raw.color, stated)
            light = luminance(srgb_decoded(color) if stated.srgb else color)
        return cls(light, depth, motion, raw.jitter or (0.0, 0.0), raw.reset)

    @property
    def size(self) -> Size:
        """Render size (width, height)."""
        return self.depth.shape[1], self.depth.shape[0]

    def copied(self) -> "Evidence":
        """Return it in memory of its own, for the next frame: engines reuse their buffers."""
        return replace(self, depth=self.depth.copy(), motion=self.motion.copy())

    def jitter_pixels(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return the jitter (x, y) in render pixels, read by these conventions."""
        return np.multiply(self.jitter, jitter_factor(conventions, self.size))

    def vectors(self, conventions: Conventions, places: Places, *, swapped: bool = False) -> Float32:
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
        result: Float32 = (vectors[:, ::-1] if swapped else vectors) * factor
        return result


class FramePair:
    """Two neighbouring frames of one size, both shaded.

    Attributes:
        before, now: the frames.
        reprojection: compares their luminance.
    """

    def __init__(self, before: Evidence, now: Evidence) -> None:
        self.before, self.now = before, now
        if now.light is None or before.light is None:
            raise FrameError("color", got=None, want="shaded frames")
        self.reprojection = Reprojection(now.light, before.light)

    def shift(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return what jitter adds to an unjittered vector that leads to the same colour: (x, y) pixels."""
        return self.now.jitter_pixels(conventions) - self.before.jitter_pixels(conventions)

    def offset(
        self,
        conventions: Conventions,
        places: Places | None = None,
        *,
        motion_swapped: bool = False,
        jitter_swapped: bool = False,
    ) -> NDArray[np.float64]:
        """Return (n, 2) pixels from each place to its place in the previous frame.

        Args:
            conventions: how to read motion and jitter.
            places: rows and columns; those that `reprojection` compares where None.
            motion_swapped: take y for x and x for y in motion.
            jitter_swapped: likewise in jitter.
        """
        places = self.reprojection.places if places is None else places
        offset = self.now.vectors(conventions, places, swapped=motion_swapped).astype(np.float64)
        if conventions.motion_jittered:
            return offset
        shift = self.shift(conventions)
        return offset + (shift[::-1] if jitter_swapped else shift)

    def moving(self, conventions: Conventions) -> NDArray[np.bool_]:
        """Return (n,) which of the places compared move."""
        return moving(self.now.vectors(conventions, self.reprojection.places))

    def uncovered(self, order: DepthOrder, conventions: Conventions, places: int) -> tuple[int, int]:
        """Count uncovered places that (closer, farther) surfaces hid before, of at most about `places`."""
        looked_at = grid(self.now.size, places)
        offset = self.offset(conventions, looked_at)
        return uncovered(self.now.depth, self.before.depth, order, looked_at, offset)


def frame_pairs(frames: Sequence[Evidence]) -> list[FramePair]:
    """Return the neighbours that can be compared: no cut between, both shaded, of one size."""
    return [
        FramePair(before, now)
        for before, now in pairwise(frames)
        if not now.reset and now.size == before.size and now.light is not None and before.light is not None
    ]


def _rows(name: str, value: object, stated: Conventions) -> NDArray[Any]:
    array = as_array(name, value)
    return array[::-1] if stated.bottom_up else array
