"""Interpolation of the colour of unshaded frames between the shaded frames before and after.

A model such as `guided-warp` extrapolates the light of both shaded frames onto the surfaces of the unshaded
frame: from the earlier one by motion to the previous frame, from the later one by motion to the next frame.
Both images have the reflectance of the same pixels, so their mean interpolates the light. It is weighted by
the distance in time, and by the visibility of the surface in the shaded frame.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import ExecutorName, ieee_arithmetic
from supersampler.errors import ArgumentError
from supersampler.extrapolation import Extrapolator, ShadedHistory, extrapolator_beside
from supersampler.frame import Float32, Frame
from supersampler.sequence.backward_motion import reversed_frame
from supersampler.sequence.frame_store import FrameStore, Stored, StoredFrame
from supersampler.upscaler import Upscaler

SURFACE_SIGMA, DEPTH_SIGMA = 0.1, 0.02
"""Standard deviations of base colour and normal, and of relative depth, within a surface."""
MIN_AGREEMENT = 1e-3
"""Agreement of a surface that was not visible in the shaded frame."""
_REQUIRED = tuple(f"history.{name}" for name in ("motion", "jitter", "depth", "base_color", "normal"))


class Side(NamedTuple):
    """Colour of an unshaded frame, extrapolated from one shaded frame.

    Attributes:
        color: (h, w, 3) linear RGB.
        agreement: (h, w) similarity of its surfaces to the shaded frame's, MIN_AGREEMENT to 1.
        frames: distance to the shaded frame, in frames.
    """

    color: Float32
    agreement: Float32
    frames: int


class Interpolator:
    """Computes the colours of unshaded frames of a sequence, window by window.

    `gbuffers` are the G-buffers of unshaded frames that it and the upscaler read.

    Raises:
        ArgumentError: the model's history lacks surfaces of the shaded frame.
    """

    def __init__(self, extrapolator: Extrapolator, gbuffers: tuple[str, ...]) -> None:
        missing = {*_REQUIRED} - {entry.name for entry in extrapolator.info.history}
        if missing:
            got = f"{extrapolator.info.method!r}, without {', '.join(sorted(missing))}"
            raise ArgumentError("extrapolation", got=got, want="a model such as guided-warp for two passes")
        self._extrapolator, self.gbuffers = extrapolator, gbuffers
        self._history: ShadedHistory | None = None  # before the window
        self._since = 0  # number of unshaded frames since the last shaded one, before the window

    @ieee_arithmetic
    def colors(self, frames: Sequence[StoredFrame], next_start: int, store: FrameStore) -> dict[int, Stored]:
        """Return the colours of unshaded frames by index in `frames`, stored as arrays "color".

        Args:
            frames: consecutive frames; only the first one may follow a cut.
            next_start: index of the first frame of the next call; len(frames) if a cut follows.
            store: store of the frames and of the colours.

        Raises:
            FrameError: the first frame after a cut is not shaded, or a frame lacks a G-buffer.
        """
        if not any("color" not in frame.stored.arrays for frame in frames):
            last = store.get_frame(frames[next_start - 1])
            self._history, self._since = self._extrapolator.after_shaded(last), 0
            return {}
        before = self._sides_before(frames, next_start, store)
        found = {index: stored for index, (stored, _) in before.items()}
        for index, after in self._sides_after(frames, store):
            stored, since = before[index]
            arrays = store.get(stored)
            side = Side(arrays["color"], arrays["agreement"], since)
            found[index] = store.put({"color": interpolated(side, after)})
            store.drop(stored)
        return found

    def _sides_before(
        self, frames: Sequence[StoredFrame], next_start: int, store: FrameStore
    ) -> dict[int, tuple[Stored, int]]:
        """Extrapolate from earlier shaded frames; keep the history for the next window.

        Returns:
            For each unshaded frame, by index, its colour and agreement, and the distance.
        """
        history, since = (None, 0) if frames[0].values["reset"] else (self._history, self._since)
        found: dict[int, tuple[Stored, int]] = {}
        for index, stored in enumerate(frames):
            if index == next_start:
                self._history, self._since = history, since
            frame = store.get_frame(stored)
            if frame.color is None:
                side, history = self._side(frame, history, since + 1)
                since = side.frames
                found[index] = store.put({"color": side.color, "agreement": side.agreement}), since
            else:
                history, since = self._extrapolator.after_shaded(frame, history), 0
        return found

    def _sides_after(self, frames: Sequence[StoredFrame], store: FrameStore) -> Iterator[tuple[int, Side]]:
        """Extrapolate from later shaded frames, last frame first; yield index and side.

        Frames after the last shaded one are left out.
        """
        history: ShadedHistory | None = None
        following: Frame | None = None
        since = 0
        for index in reversed(range(len(frames))):
            frame = store.get_frame(frames[index])
            if frame.color is not None:
                turned = frame if history is None else reversed_frame(frame, following)
                history, since = self._extrapolator.after_shaded(turned, history), 0
            elif history is not None:
                side, history = self._side(reversed_frame(frame, following), history, since + 1)
                since = side.frames
                yield index, side
            following = frame

    def _side(self, frame: Frame, history: ShadedHistory | None, since: int) -> tuple[Side, ShadedHistory]:
        color, following = self._extrapolator.extrapolate(frame, history)
        arrays = self._extrapolator.save(following)
        return Side(color, surface_agreement(frame, arrays), since), following


def interpolator_of(model: str | Path, upscaler: Upscaler, executor: ExecutorName = "auto") -> Interpolator:
    """Return an Interpolator with the providers and threads of an Upscaler.

    Raises:
        ModelError: the model does not exist, or does not extrapolate.
    """
    extrapolator = extrapolator_beside(upscaler.model, model, executor)
    return Interpolator(
        extrapolator, (*extrapolator.info.gbuffers, *upscaler.model.on_extrapolated.info.gbuffers)
    )


@ieee_arithmetic
def interpolated(before: Side, after: Side) -> Float32:
    """Return the mean of both sides, (h, w, 3), weighted by agreement and closeness in time."""
    a = before.agreement * np.float32(after.frames)
    b = after.agreement * np.float32(before.frames)
    result: Float32 = before.color + (b / (a + b))[..., None] * (after.color - before.color)
    return result


def surface_agreement(frame: Frame, history: dict[str, NDArray[Any]]) -> Float32:
    """Return the similarity of each surface of a frame to a shaded frame's, (h, w), MIN_AGREEMENT to 1.

    The most similar of the four samples around the reprojected position counts.

    Args:
        frame: a frame with base colour and normals.
        history: history tensors after the extrapolation of `frame`: the shaded frame, and the motion to it.
    """
    motion, jitter = history["history.motion"][0], history["history.jitter"][0]
    height, width = frame.depth.shape
    shaded_depth = history["history.depth"][0, 0]
    shaded_height, shaded_width = shaded_depth.shape
    columns, rows = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)[:, None]
    x = (columns + motion[0] + np.float32(frame.jitter[0] + 0.5)) * np.float32(shaded_width / width)
    y = (rows + motion[1] + np.float32(frame.jitter[1] + 0.5)) * np.float32(shaded_height / height)
    x, y = x - np.float32(jitter[0] + 0.5), y - np.float32(jitter[1] + 0.5)
    on_screen = (x > -1.0) & (x < shaded_width) & (y > -1.0) & (y < shaded_height)
    column, row = (np.where(on_screen, np.floor(each), 0).astype(np.intp) for each in (x, y))
    min_difference = np.full((height, width), np.float32(np.inf))
    for down, right in product((0, 1), repeat=2):
        near_row = np.clip(row + down, 0, shaded_height - 1)
        near_column = np.clip(column + right, 0, shaded_width - 1)
        difference = _difference(frame, history, near_row * shaded_width + near_column)
        np.fmin(min_difference, difference, out=min_difference)
    agreement = np.exp(-0.5 * np.minimum(min_difference, np.float32(100.0)))
    lowest = np.float32(MIN_AGREEMENT)
    result: Float32 = np.where(on_screen, np.maximum(agreement, lowest), lowest)
    return result


def _difference(frame: Frame, history: dict[str, NDArray[Any]], place: NDArray[np.intp]) -> Float32:
    """Return the squared difference of each surface from a shaded sample, in standard deviations."""
    gbuffer = frame.gbuffer or {}
    depth = history["history.depth"][0, 0].ravel()[place]
    larger = np.maximum(np.maximum(depth, frame.depth), np.float32(1e-30))
    squares: Float32 = np.square((depth - frame.depth) / larger / np.float32(DEPTH_SIGMA))
    for name in ("base_color", "normal"):
        samples = history[f"history.{name}"][0].reshape(3, -1)
        for channel in range(3):
            difference = samples[channel][place] - gbuffer[name][..., channel]
            squares = squares + np.square(difference / np.float32(SURFACE_SIGMA))
    return squares
