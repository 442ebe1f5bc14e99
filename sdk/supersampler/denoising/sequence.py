"""Denoise the frames of a sequence: each by itself, then with its neighbours along their motion."""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from math import inf
from typing import Literal, NamedTuple, Self

import numpy as np

from supersampler.arguments import as_number, ieee_arithmetic
from supersampler.denoising.oidn import FrameDenoiser, Oidn
from supersampler.denoising.spec import DEFAULT_SAMPLES, REACH
from supersampler.denoising.temporal import (
    TemporalFilter,
    WindowFrame,
    nearest_motion,
    packed_aovs,
    packed_color,
    packed_guides,
)
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.frame import Array, Float32, Frame
from supersampler.io.display import ExposureMeter
from supersampler.io.shot import Shot
from supersampler.sequence.backward_motion import scattered_motion
from supersampler.sequence.both_ways import frames_of

PerFrame = Literal["oidn", "none"]
BUFFERS = frozenset(("gbuffer_base_color", "gbuffer_normal", "motion_next"))
"""Buffers that are read of each frame, by their names in `Shot.frames`."""


class Denoised(NamedTuple):
    """A frame and its denoised images.

    Attributes:
        frame: the frame, as it came.
        image: (h, w, 3) float32 linear RGB.
        aovs: (h, w, k) float32, averaged by the weights of the image; None where the frame has none.
    """

    frame: Frame
    image: Float32
    aovs: Float32 | None


@dataclass(eq=False)
class _Waiting:
    frame: Frame
    window: WindowFrame


class TemporalDenoiser:
    """Denoises frames in order; a context, which ends its threads.

    At most 2 * REACH + 1 frames are in memory, of 64 bytes a pixel and 16 for every four AOVs.

    Args:
        per_frame: denoiser of single frames: "oidn", or "none" for frames that are denoised already.
        lookahead: frames after a frame that are read before its image comes, 0 to REACH.
        samples: samples per pixel of the frames, > 0.
        threads: threads of the filter and of OIDN; 0 is one per core.

    Raises:
        ModuleNotFoundError: pyoidn is not installed: `pip install "supersampler[denoise]"`.
    """

    def __init__(
        self,
        *,
        per_frame: PerFrame = "oidn",
        lookahead: int = REACH,
        samples: float = DEFAULT_SAMPLES,
        threads: int = 0,
    ) -> None:
        self._stack, self._lookahead, self._samples = ExitStack(), lookahead, samples
        self._denoiser: FrameDenoiser | None = None
        if per_frame == "oidn":
            self._denoiser = self._stack.enter_context(Oidn(threads))
        self._filter = self._stack.enter_context(TemporalFilter(threads=threads))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(self, frames: Iterable[Frame], *, skip: int = 0) -> Iterator[Denoised]:
        """Yield the images of each frame, in order.

        Args:
            frames: frames in order, all of one size; `reset` marks the first one after a cut.
            skip: frames at the beginning that are neighbours only; they are not yielded.

        Raises:
            FrameError: a frame has no colour, is jittered, or differs in size from the one before.
        """
        previous: deque[_Waiting] = deque(maxlen=REACH)
        waiting: deque[_Waiting] = deque()
        last: _Waiting | None = None
        for index, frame in enumerate(frames):
            if frame.reset:
                yield from self._emptied(previous, waiting)
                previous.clear()  # frees memory: no motion leads there
                last = None
            last = self._prepared(frame, last)
            if index < skip:
                previous.append(last)
                continue
            waiting.append(last)
            while len(waiting) > self._lookahead:
                yield self._next(previous, waiting)
        yield from self._emptied(previous, waiting)

    def windows(self, frames: Iterable[Frame]) -> list[WindowFrame]:
        """Return all frames of one shot as the filter reads them."""
        found: list[_Waiting] = []
        for frame in frames:
            found.append(self._prepared(frame, None if frame.reset or not found else found[-1]))
        return [item.window for item in found]

    def _emptied(self, previous: deque[_Waiting], waiting: deque[_Waiting]) -> Iterator[Denoised]:
        while waiting:
            yield self._next(previous, waiting)

    @ieee_arithmetic
    def _prepared(self, frame: Frame, last: _Waiting | None) -> _Waiting:
        """Denoise a frame by itself, and link it to the one before."""
        if frame.color is None:
            raise FrameError("color", got=None, want="the colour of every frame: (h, w, 3)")
        if frame.jitter != (0.0, 0.0):
            hint = "`upscale --scale 1` accumulates jittered frames."
            raise FrameError("jitter", got=frame.jitter, want="(0, 0) in every frame", hint=hint)
        if last is not None and frame.size != last.frame.size:
            hint = "Mark a cut, or denoise each size apart."
            raise FrameError("color", got=frame.size, want=f"{last.frame.size}, the size before", hint=hint)
        factor = 1.0 / frame.pre_exposure
        color, (albedo, normal) = packed_color(frame.color, factor), guides_of(frame)
        if self._denoiser is not None:
            known = color[..., 3:].copy()
            color[..., :3], albedo, normal = self._denoiser.denoise(
                np.ascontiguousarray(color[..., :3]), albedo, normal
            )
            color = packed_color(color[..., :3])
            color *= known
        height, width = frame.depth.shape
        window = WindowFrame(
            color, packed_guides(albedo, normal, (height, width)), aovs=packed_aovs(frame.aovs)
        )
        if last is not None:
            window.to_previous = nearest_motion(frame.depth, frame.motion)
            given = last.frame.motion_next
            following = scattered_motion(last.frame, frame) if given is None else given
            last.window.to_next = nearest_motion(last.frame.depth, following)
        return _Waiting(frame, window)

    def _next(self, previous: deque[_Waiting], waiting: deque[_Waiting]) -> Denoised:
        """Return the images of the first waiting frame, and move it to the previous frames."""
        first = waiting.popleft()
        following = [item.window for item in list(waiting)[:REACH]]
        before = [item.window for item in reversed(previous)]
        exposure = ExposureMeter().read_frame(first.frame)  # of this frame alone: images depend on no other
        image, groups = self._filter.filter(first.window, before, following, exposure, self._samples)
        image *= np.float32(first.frame.pre_exposure)
        count = 0 if first.frame.aovs is None else first.frame.aovs.shape[2]
        aovs = np.concatenate(groups, axis=2)[..., :count] if groups else None
        previous.append(first)
        return Denoised(first.frame, image, aovs)


def guides_of(frame: Frame) -> tuple[Float32 | None, Float32 | None]:
    """Return albedo and normal of a frame, (h, w, 3) float32 without NaN; None where it has none."""
    buffers = frame.gbuffer or {}

    def read(name: str) -> Float32 | None:
        array: Array | None = buffers.get(name)
        if array is None:
            return None
        return np.nan_to_num(np.asarray(array, np.float32), nan=0.0, posinf=1.0, neginf=-1.0)

    return read("base_color"), read("normal")


def denoise_sequence(
    frames: Shot | Iterable[Frame],
    *,
    per_frame: PerFrame = "oidn",
    passes: int = 2,
    lookahead: int | None = None,
    samples: float | None = None,
    threads: int = 0,
) -> Iterator[Float32]:
    """Denoise path-traced frames: each by itself, then averaged with up to 8 frames on either side.

    Each neighbouring frame is resampled once, along the motion of the frames between. Its weight depends on
    how well albedo, normal and patches of colour agree. Frames have the size of the images, and no jitter.

    >>> for image in denoise_sequence(shot):
    ...     show(image)  # (h, w, 3) float32, linear RGB

    Albedo is `gbuffer["base_color"]`, the normal `gbuffer["normal"]`. Without them, surfaces of similar
    colour may blur into each other. A frame without `motion_next` gets it from the motion of the next frame.

    Args:
        frames: a `Shot`, or Frames in order, all of one size. `reset` marks the first one after a cut.
        per_frame: "oidn" denoises each frame first, by Open Image Denoise (`pip install
            "supersampler[denoise]"`); "none" is for frames that are denoised already.
        passes: 2 uses previous and following frames; 1 previous frames only, for live use.
        lookahead: with two passes, frames after a frame that are read before its image comes, 1 to 8;
            None is 8.
        samples: samples per pixel of the frames: the more, the less a neighbour that differs counts. None is
            `Shot.samples`, or 8 where that is unknown.
        threads: threads that compute; 0 is one per core.

    Returns:
        An iterator over the images, (h, w, 3) float32 linear RGB, in order; each may be kept.

    Raises:
        ArgumentError: an argument is not usable; before anything is read.
        FrameError: a frame breaks the contract, is jittered, or has another size than the one before.
        ShotError: a frame cannot be read.
        ModuleNotFoundError: pyoidn is not installed.
    """
    steps = checked_lookahead(passes, lookahead)
    if per_frame not in ("oidn", "none"):
        raise ArgumentError("per_frame", got=shown(per_frame), want='"oidn" or "none"')
    if not isinstance(frames, Shot) and not isinstance(frames, Iterable):
        raise ArgumentError("frames", got=shown(frames), want="a Shot, or an iterable of Frames")
    if samples is None and isinstance(frames, Shot):
        samples = frames.samples
    denoiser = TemporalDenoiser(
        per_frame=per_frame, lookahead=steps, samples=checked_samples(samples), threads=threads
    )
    return _images(denoiser, frames)


def _images(denoiser: TemporalDenoiser, frames: Shot | Iterable[Frame]) -> Iterator[Float32]:
    with denoiser:
        for denoised in denoiser.run(frames_of(frames, BUFFERS)):
            yield denoised.image


def checked_lookahead(passes: int, lookahead: int | None) -> int:
    """Return the number of later frames that are read; ArgumentError where one of the two is not usable."""
    if type(passes) is not int or passes not in (1, 2):
        raise ArgumentError("passes", got=shown(passes), want="1 or 2")
    if passes == 1:
        if lookahead is not None:
            want = "None, because one pass reads no later frame"
            raise ArgumentError("lookahead", got=shown(lookahead), want=want)
        return 0
    if lookahead is None:
        return REACH
    if type(lookahead) is not int or not 1 <= lookahead <= REACH:
        want = f"a whole number of frames from 1 to {REACH}, or None"
        raise ArgumentError("lookahead", got=shown(lookahead), want=want)
    return lookahead


def checked_samples(samples: float | None) -> float:
    """Return samples per pixel, DEFAULT_SAMPLES for None; ArgumentError where it is no positive number."""
    number = as_number(DEFAULT_SAMPLES if samples is None else samples)
    if number is None or not 0.0 < number < inf:
        raise ArgumentError("samples", got=shown(samples), want="a number above 0, or None")
    return number


def missing_guides(frame: Frame) -> list[str]:
    """Return the names of the guides that a frame lacks: "albedo", "normal"."""
    return [name for name, guide in zip(("albedo", "normal"), guides_of(frame), strict=True) if guide is None]
