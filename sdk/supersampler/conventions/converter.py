"""`Converter`: `RawFrame` to `Frame` and back, for the frames of one sequence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import checked_size, ieee_arithmetic
from supersampler.conventions.encodings import (
    from_reversed_infinite,
    srgb_decoded,
    srgb_encoded,
    to_reversed_infinite,
)
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.frame import (
    Array,
    Frame,
    Size,
    as_array,
    checked_buffers,
    checked_frame,
    checked_jitter,
    checked_reset,
    pair_of,
)

if TYPE_CHECKING:
    from supersampler.conventions.conventions import Conventions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawFrame:
    """One frame in an engine's conventions, unchecked; `Converter.to_frame` checks and converts it.

    Attributes:
        depth: (h, w) at render size, of the kind `Conventions.depth`.
        motion: (h, w, 2), x then y; (H, W, 2) if `Conventions.motion_resolution` is "display".
        color: (h, w, 3) at render size, linear or sRGB; None on an unshaded frame.
        jitter: (x, y) in the unit `Conventions.jitter_unit`; None is no jitter.
        reset: True on the first frame after a cut.
        exposure: > 0, multiplies the colour before the tone curve, or None.
        pre_exposure: factor by which the renderer has multiplied the colour.
        reactive: (h, w) at render size, in [0, 1], or None.
        gbuffer: G-buffers at render size, with the names of `Frame`.
        gbuffer_display: G-buffers at display size, with the names of `Frame`; its depth is of `depth`'s kind.
        aovs: (h, w, k) at render size.
        motion_next: (h, w, 2) or (H, W, 2), as `motion`: to the next frame, in the unit and signs of `motion`
            and the direction `Conventions.motion_next_direction`.
        aov_names: names of the k AOVs' channels in files of results; None numbers them.
    """

    depth: Array
    motion: Array
    color: Array | None = None
    jitter: tuple[float, float] | None = None
    reset: bool = False
    exposure: float | None = None
    pre_exposure: float = 1.0
    reactive: Array | None = None
    gbuffer: Mapping[str, Array] | None = None
    gbuffer_display: Mapping[str, Array] | None = None
    aovs: Array | None = None
    aov_names: Sequence[str] | None = None
    motion_next: Array | None = None


_Pair = tuple[float, float]


class Converter:
    """Converts the frames of one sequence, in order; made by `Conventions.converter`.

    Its only state is the previous frame's jitter, for jittered motion vectors. A refused frame leaves it
    unchanged. The two directions are independent of each other.
    """

    def __init__(self, conventions: "Conventions", *, display_size: Size | None = None) -> None:
        self.conventions = conventions
        self.display_size = None if display_size is None else checked_size("display_size", display_size)
        self._previous_in: _Pair | None = None  # in UV, as the render size may change
        self._previous_out: _Pair | None = None

    @ieee_arithmetic
    def to_frame(self, raw: RawFrame) -> Frame:
        """Return the frame in this package's conventions. Unchanged arrays are not copied.

        Raises:
            FrameError: an input has a shape, type or range that these conventions do not allow.
            ArgumentError: it is no RawFrame.
        """
        if not isinstance(raw, RawFrame):
            raise ArgumentError("raw", got=shown(raw), want="a supersampler.RawFrame")
        depth = self._rows(_floating("depth", raw.depth))
        size = _render_size(depth)
        jitter = self._jitter_in(raw.jitter, size)
        reset = checked_reset(raw.reset)
        shift = self._shift(jitter, size, None if reset else self._previous_in)
        frame = Frame(
            depth=self._depth(depth),
            motion=self._vectors_in("motion", raw.motion, jitter, size, shift),
            motion_next=self._motion_next_in(raw, jitter, size),
            jitter=jitter,
            reset=reset,
            **self._converted(raw),
        )
        self._previous_in = _in_uv(jitter, size)
        return frame

    @ieee_arithmetic
    def from_frame(self, frame: Frame) -> RawFrame:
        """Return the frame in these conventions: the inverse of `to_frame`.

        Raises:
            FrameError: the depth has surfaces beyond the far plane.
            ArgumentError: it is no Frame; or motion is at display size and `display_size` was not given.
        """
        checked_frame(frame)
        shift = self._shift(frame.jitter, frame.size, None if frame.reset else self._previous_out)
        # Jittered vectors to the next frame would need its jitter, which is not known yet.
        no_next = frame.motion_next is None or self.conventions.motion_jittered
        scale_x, scale_y = self.conventions.jitter_factor(frame.size)
        raw = RawFrame(
            depth=self._rows(self._depth(frame.depth, encode=True)),
            motion=self._vectors_out("motion", frame, shift),
            motion_next=None if no_next else self._vectors_out("motion_next", frame),
            jitter=(frame.jitter[0] / scale_x, frame.jitter[1] / scale_y),
            reset=frame.reset,
            **self._converted(frame, encode=True),
        )
        self._previous_out = _in_uv(frame.jitter, frame.size)
        return raw

    def pass_over(self, jitter: tuple[float, float] | None, size: Size) -> None:
        """Skip a frame with this stored jitter and render size."""
        self._previous_in = self._previous_out = _in_uv(self._jitter_in(jitter, size), size)

    def _rows(self, array: Array) -> Array:
        return np.ascontiguousarray(array[::-1]) if self.conventions.bottom_up else array

    def _converted(self, source: RawFrame | Frame, *, encode: bool = False) -> dict[str, Any]:
        """Return the fields that both directions convert alike, but for sRGB and the kind of depth."""
        color, reactive, aovs = (
            None if array is None else self._rows(_floating(name, array))
            for name, array in (("color", source.color), ("reactive", source.reactive), ("aovs", source.aovs))
        )
        if color is not None and self.conventions.srgb:
            color = srgb_encoded(color) if encode else srgb_decoded(color)
        return {
            "color": color,
            "reactive": reactive,
            "aovs": aovs,
            "gbuffer": self._gbuffer("gbuffer", source.gbuffer, encode=encode),
            "gbuffer_display": self._gbuffer("gbuffer_display", source.gbuffer_display, encode=encode),
            "exposure": source.exposure,
            "pre_exposure": source.pre_exposure,
        }

    def _depth(self, depth: Array, *, encode: bool = False) -> NDArray[np.float32]:
        kind = self.conventions
        convert = from_reversed_infinite if encode else to_reversed_infinite
        return convert(depth, kind.depth, kind.near, kind.far)

    def _gbuffer(
        self, group: str, buffers: Mapping[str, Array] | None, *, encode: bool = False
    ) -> Mapping[str, Array] | None:
        if buffers is None:
            return None
        converted = {
            name: self._rows(_floating(f"{group}[{name!r}]", array))
            for name, array in checked_buffers(group, buffers).items()
        }
        if "depth" in converted:
            converted["depth"] = self._depth(converted["depth"], encode=encode)
        return converted

    def _jitter_in(self, jitter: _Pair | None, size: Size) -> _Pair:
        x, y = (0.0, 0.0) if jitter is None else pair_of(jitter)
        scale_x, scale_y = self.conventions.jitter_factor(size)
        return checked_jitter((_snapped(x * scale_x), _snapped(y * scale_y)))

    def _shift(self, jitter: _Pair, size: Size, previous: _Pair | None) -> _Pair:
        """Return what jitter adds to a vector: current minus previous jitter, in render pixels.

        The image moves by - jitter, so that previous minus current position changes by that.
        """
        if not self.conventions.motion_jittered or previous is None:
            return 0.0, 0.0
        return jitter[0] - previous[0] * size[0], jitter[1] - previous[1] * size[1]

    def _factor(self, name: str, size: Size, buffer_size: Size) -> _Pair:
        stated = self.conventions
        factor = stated.motion_factor if name == "motion" else stated.motion_next_factor
        return factor(size, buffer_size)

    def _vectors_in(
        self, name: str, stored: Array, jitter: _Pair, size: Size, shift: _Pair = (0.0, 0.0)
    ) -> Array:
        """Return the vectors of the render pixels, in render pixels."""
        vectors = self._rows(_floating(name, stored))
        buffer_size = _checked_motion_size(name, vectors, size, self.conventions.motion_resolution)
        if self.conventions.motion_resolution == "display":
            x, y = (
                (np.arange(size[axis]) + 0.5 + jitter[axis]) * buffer_size[axis] / size[axis]
                for axis in (0, 1)
            )
            vectors = _sampled(vectors, x, y)
        factor = self._factor(name, size, buffer_size)
        if factor == (1.0, 1.0) and shift == (0.0, 0.0):
            return vectors
        pixels: NDArray[np.float32] = vectors.astype(np.float32) * _vector(factor) - _vector(shift)
        return pixels

    def _vectors_out(self, name: str, frame: Frame, shift: _Pair = (0.0, 0.0)) -> Array:
        """Return the vectors of the buffer's pixels, in its unit."""
        vectors, size = getattr(frame, name), frame.size
        buffer_size = size
        if self.conventions.motion_resolution == "display":
            buffer_size = self._display_size(frame)
            x, y = (
                (np.arange(buffer_size[axis]) + 0.5) * size[axis] / buffer_size[axis] - frame.jitter[axis]
                for axis in (0, 1)
            )
            vectors = _sampled(vectors, x, y)
        factor = self._factor(name, size, buffer_size)
        if factor != (1.0, 1.0) or shift != (0.0, 0.0):
            vectors = (vectors.astype(np.float32) + _vector(shift)) / _vector(factor)
        return self._rows(vectors)

    def _motion_next_in(self, raw: RawFrame, jitter: _Pair, size: Size) -> Array | None:
        """Return `Frame.motion_next`; FrameError where it contains jitter, the next frame's."""
        if raw.motion_next is None:
            return None
        if self.conventions.motion_jittered:
            hint = "Leave it out, or write vectors without jitter."
            raise FrameError("motion_next", got="given, with jitter in it", want="without jitter", hint=hint)
        return self._vectors_in("motion_next", raw.motion_next, jitter, size)

    def _display_size(self, frame: Frame) -> Size:
        if self.display_size is None:
            hint = "Make the converter with conventions.converter(display_size=(width, height))."
            raise ArgumentError("display_size", got=None, want="the size of the motion vectors", hint=hint)
        if self.display_size[0] < frame.size[0] or self.display_size[1] < frame.size[1]:
            raise ArgumentError("display_size", got=self.display_size, want=f"at least {frame.size}")
        return self.display_size


def _floating(name: str, value: object) -> NDArray[Any]:
    """Return a float16 or float32 array; float64 is converted to float32, other types are refused."""
    array = as_array(name, value)
    if array.ndim < 2:
        raise FrameError(name, got=f"of shape {array.shape}", want="(h, w), or (h, w, channels)")
    if array.dtype == np.float64:
        return array.astype(np.float32)
    if array.dtype not in (np.float32, np.float16):
        hint = "Bring integers to their range first, for example pixels.astype(np.float32) / 255."
        raise FrameError(name, got=array.dtype, want="float32 or float16", hint=hint)
    return array


def _render_size(depth: NDArray[Any]) -> Size:
    if depth.ndim != 2 or 0 in depth.shape:
        hint = "Drop the last axis: array[..., 0]." if depth.ndim == 3 else ""
        raise FrameError("depth", got=f"of shape {depth.shape}", want="(h, w), at least one pixel", hint=hint)
    return depth.shape[1], depth.shape[0]


def _checked_motion_size(name: str, motion: NDArray[Any], size: Size, resolution: str) -> Size:
    height, width = motion.shape[:2] if motion.ndim == 3 and motion.shape[2] == 2 else (0, 0)
    if resolution == "display" and width >= size[0] and height >= size[1]:
        return width, height
    if resolution == "render" and (width, height) == size:
        return size
    wanted = f"({size[1]}, {size[0]}, 2)"
    larger = resolution == "render" and width >= size[0] and height >= size[1]
    raise FrameError(
        name,
        got=f"of shape {motion.shape}",
        want=f"{wanted}, as depth is" if resolution == "render" else f"(H, W, 2) of at least {wanted}",
        hint="Vectors at display size need Conventions(motion_resolution='display')." if larger else "",
    )


def _sampled(vectors: Array, x: NDArray[np.float64], y: NDArray[np.float64]) -> Array:
    """Return the vectors of the pixels that contain the positions, clamped to the image."""
    rows, columns = (
        np.clip(np.floor(position).astype(np.intp), 0, count - 1)
        for position, count in zip((y, x), vectors.shape, strict=False)
    )
    return vectors[rows[:, None], columns]


def _vector(pair: _Pair) -> NDArray[np.float32]:
    return np.array(pair, np.float32)


def _in_uv(jitter: _Pair, size: Size) -> _Pair:
    return jitter[0] / size[0], jitter[1] / size[1]


def _snapped(jitter: float) -> float:
    """Clamp a jitter that exceeds half a pixel by rounding: float32 UV or NDC is not exact."""
    return max(-0.5, min(0.5, jitter)) if abs(jitter) <= 0.5 + 1e-4 else jitter
