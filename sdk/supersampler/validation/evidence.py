"""`Evidence`: one frame's luminance, depth, motion and jitter for checks and detection, and sample grids."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.factors import jitter_factor, motion_factor
from supersampler.conventions.srgb import srgb_decoded
from supersampler.errors import FrameError
from supersampler.frame import Array, Float32, Frame, Size, as_array
from supersampler.io.display import BT709

Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns (n,) of pixels."""
PLACES = 12_000
"""About how many pixels a check reads."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """One frame with row 0 on top and linear luminance; depth, motion and jitter are not converted.

    Attributes:
        light: (h, w) luminance without pre-exposure; None where the frame was not shaded.
        depth: (h, w).
        motion: (h, w, 2), or (H, W, 2) at display size.
        jitter: (x, y).
        reset: as in `Frame`.
        motion_next: (h, w, 2) of a `Frame`, or None.
    """

    light: Float32 | None
    depth: Array
    motion: Array
    jitter: tuple[float, float]
    reset: bool
    motion_next: Array | None = None

    @classmethod
    def of_frame(cls, frame: Frame) -> "Evidence":
        """Return the evidence of a `Frame`; its arrays are not copied."""
        light = None if frame.color is None else luminance(frame.color)
        if light is not None and frame.pre_exposure != 1.0:
            light = light / np.float32(frame.pre_exposure)
        return cls(light, frame.depth, frame.motion, frame.jitter, frame.reset, frame.motion_next)

    @classmethod
    def of_raw(cls, raw: RawFrame, stated: Conventions) -> "Evidence":
        """Return the evidence of a `RawFrame`, with rows and sRGB as stated; FrameError for wrong shapes."""
        depth, motion = _rows("depth", raw.depth, stated), _rows("motion", raw.motion, stated)
        if depth.ndim != 2 or motion.ndim != 3 or motion.shape[2] != 2:
            shapes = f"depth {depth.shape}, motion {motion.shape}"
            raise FrameError("motion", got=shapes, want="depth (h, w), motion (h, w, 2)")
        light = None
        if raw.color is not None:
            color = _rows("color", raw.color, stated)
            light = luminance(srgb_decoded(color) if stated.srgb else color) / np.float32(raw.pre_exposure)
        return cls(light, depth, motion, raw.jitter or (0.0, 0.0), raw.reset)

    @property
    def size(self) -> Size:
        """Render size (width, height)."""
        return self.depth.shape[1], self.depth.shape[0]

    def copied(self) -> "Evidence":
        """Return a copy for the comparison with the next frame: engines reuse their buffers."""
        following = None if self.motion_next is None else self.motion_next.copy()
        return replace(self, depth=self.depth.copy(), motion=self.motion.copy(), motion_next=following)

    def jitter_pixels(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return the jitter (x, y) in render pixels, interpreted by these conventions."""
        return np.multiply(self.jitter, jitter_factor(conventions, self.size))

    def vectors(self, conventions: Conventions, places: Places, *, swapped: bool = False) -> Float32:
        """Return (n, 2) motion in render pixels, interpreted by these conventions, with its jitter.

        Args:
            conventions: conventions of the motion.
            places: rows and columns of render pixels.
            swapped: exchange x and y.
        """
        own_height, own_width = self.motion.shape[:2]
        rows = (places[0] * 2 + 1) * own_height // (2 * self.size[1])
        columns = (places[1] * 2 + 1) * own_width // (2 * self.size[0])
        vectors = self.motion[rows, columns].astype(np.float32)
        factor = np.array(motion_factor(conventions, self.size, (own_width, own_height)), np.float32)
        result: Float32 = (vectors[:, ::-1] if swapped else vectors) * factor
        return result


def _rows(name: str, value: object, stated: Conventions) -> NDArray[Any]:
    array = as_array(name, value)
    return array[::-1] if stated.bottom_up else array


def luminance(color: Array) -> Float32:
    """Return (h, w) luminance of linear (h, w, 3) colour, as a new array."""
    with np.errstate(invalid="ignore", over="ignore"):  # NaN and Inf stay; `FramePair` skips them
        values: Float32 = color.astype(np.float32, copy=False) @ BT709
    return values


def grid(size: tuple[int, int], places: int) -> Places:
    """Return rows and columns (n,) of an even grid of about `places` pixels at most in (width, height)."""
    step = max(1, int(np.ceil(np.sqrt(size[0] * size[1] / places))))
    rows, columns = np.meshgrid(
        np.arange(step // 2, size[1], step), np.arange(step // 2, size[0], step), indexing="ij"
    )
    return rows.ravel(), columns.ravel()
