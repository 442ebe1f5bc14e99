"""Denoise the frames of a sequence, each with its neighbours along their motion."""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from math import inf
from typing import Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from supersampler import arguments
from supersampler.denoising import temporal
from supersampler.denoising.oidn import FrameDenoiser, Guides, Oidn
from supersampler.denoising.spec import ACCUMULATED, AGREEMENT, DEFAULT_SAMPLES, REACH
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.frame import Array, Float32, Frame
from supersampler.io.display import ExposureMeter
from supersampler.io.shot import Shot
from supersampler.sequence.backward_motion import scattered_motion
from supersampler.sequence.both_ways import checked_frames, frames_of

PerFrame = Literal["oidn", "none"]
BUFFERS = frozenset(("gbuffer_base_color", "gbuffer_normal", "motion_next"))
"""Buffers that are read of each frame, by their names in `Shot.frames`."""


class Denoised(NamedTuple):
    """A frame and its denoised images.

    Attributes:
        frame: the frame, unchanged.
        image: (h, w, 3) float32 linear RGB.
        aovs: (h, w, k) float32, averaged by the weights of the image; None where the frame has none.
    """

    frame: Frame
    image: Float32
    aovs: Float32 | None


@dataclass(eq=False)
class _Item:
    """A frame on its way through the stages."""

    frame: Frame  # unchanged
    window: temporal.WindowFrame
    guides: Guides  # without noise
    exposure: float  # of this frame alone: images depend on no other


class TemporalDenoiser:
    """Denoises frames in order; a context, which ends its threads.

    Each frame is denoised by itself. These images give the weights by which the noisy colours of a frame and
    its neighbours are averaged, along their motion. The mean is denoised; where no neighbour agrees, the
    frame denoised by itself replaces it. The results are averaged with those of neighbours. Both averages
    have as many frames on one side as on the other, because fast changes of light would lag otherwise;
    `lookahead` is the sum of these numbers. With lookahead 0 the denoised frames are averaged, each with
    REACH frames before it. Frames that are denoised already are averaged with `lookahead` frames after and
    REACH before.

    At most 2 * REACH + 1 frames are in memory, of 104 bytes a pixel and 16 for every four AOVs, and half as
    many means of them, of 16 bytes a pixel and 16 for every four AOVs.

    Args:
        per_frame: denoiser of single frames: "oidn", another one, or "none" for frames that are denoised
            already.
        lookahead: number of later frames that are read before a frame's image is returned, 0 to REACH.
        samples: samples per pixel of the frames, > 0.
        threads: threads of the filter and of OIDN; 0 is one per core.

    Raises:
        ArgumentError: `threads` is not a number of threads.
        ModuleNotFoundError: pyoidn is not installed: `pip install "supersampler[denoise]"`.
    """

    def __init__(
        self,
        *,
        per_frame: PerFrame | FrameDenoiser = "oidn",
        lookahead: int = REACH,
        samples: float = DEFAULT_SAMPLES,
        threads: int = 0,
    ) -> None:
        threads = arguments.checked_threads(threads)
        self._stack, self._lookahead, self._samples = ExitStack(), lookahead, samples
        self._denoiser = None if isinstance(per_frame, str) else per_frame
        if per_frame == "oidn":
            self._denoiser = self._stack.enter_context(Oidn(threads))
        self._filter = self._stack.enter_context(temporal.TemporalFilter(threads=threads))

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
            FrameError: a frame has no colour, is jittered, or differs in size or number of AOVs from the one
                before.
        """
        items, reach, ahead, samples = self._linked(frames), REACH, self._lookahead, self._samples
        if self._accumulates:
            reach = ahead = self._lookahead // 2
            first = max(0, skip - reach)
            items, skip = self._accumulated(items, self._lookahead - ahead, first), skip - first
            samples *= ACCUMULATED
        for near in _neighbourhoods(items, reach, ahead, skip):
            (image, aovs), frame = self._averaged(near, samples), near.item.frame
            image = image[..., :3] * np.float32(frame.pre_exposure)
            count = _aov_count(frame)
            yield Denoised(frame, image, np.concatenate(aovs, axis=2)[..., :count] if aovs else None)

    def windows(self, frames: Iterable[Frame]) -> list[temporal.WindowFrame]:
        """Return all frames of one shot, each denoised by itself, as the filter reads them."""
        return [item.window for item in self._linked(frames)]

    def _linked(self, frames: Iterable[Frame]) -> Iterator[_Item]:
        """Yield each frame, denoised by itself and linked to the one before."""
        last: _Item | None = None
        for frame in frames:
            last = self._prepared(frame, None if frame.reset else last)
            yield last

    @arguments.ieee_arithmetic
    def _prepared(self, frame: Frame, last: _Item | None) -> _Item:
        if frame.color is None:
            raise FrameError("color", got=None, want="the colour of every frame: (h, w, 3)")
        if frame.jitter != (0.0, 0.0):
            hint = "`upscale --scale 1` accumulates jittered frames."
            raise FrameError("jitter", got=frame.jitter, want="(0, 0) in every frame", hint=hint)
        if last is not None and frame.size != last.frame.size:
            hint = "Mark a cut, or denoise each size apart."
            raise FrameError("color", got=frame.size, want=f"{last.frame.size}, the size before", hint=hint)
        if last is not None and _aov_count(frame) != _aov_count(last.frame):  # kernels read as many of each
            want = f"{_aov_count(last.frame)} channels as before, or a cut"
            raise FrameError("aovs", got=f"{_aov_count(frame)} channels", want=want)
        noisy, guides = temporal.packed_color(frame.color, 1.0 / frame.pre_exposure), guides_of(frame)
        if self._denoiser is not None:
            guides = self._denoiser.clean_guides(*guides)
        window = temporal.WindowFrame(
            color=self._denoised(noisy, guides),
            guides=temporal.packed_guides(*guides, frame.depth.shape),
            aovs=temporal.packed_aovs(frame.aovs),
            noisy=noisy if self._accumulates else None,
        )
        item = _Item(frame, window, guides, ExposureMeter().read_frame(frame))
        if last is not None:
            item.window.to_previous = temporal.nearest_motion(frame.depth, frame.motion)
            given = last.frame.motion_next
            following = scattered_motion(last.frame, frame) if given is None else given
            last.window.to_next = temporal.nearest_motion(last.frame.depth, following)
        return item

    def _denoised(self, color: Float32, guides: Guides) -> Float32:
        """Return `WindowFrame.color` without noise; missing samples stay missing."""
        if self._denoiser is None:
            return color
        missing = color[..., 3] <= 0.0
        given = filled(color) if missing.any() else color[..., :3]
        clean = temporal.packed_color(self._denoiser.denoise(given, *guides))
        clean[missing] = 0.0
        return clean

    @property
    def _accumulates(self) -> bool:
        """Whether noisy colours are averaged before they are denoised again."""
        return self._denoiser is not None and self._lookahead > 0

    def _accumulated(self, items: Iterable[_Item], reach: int, skip: int) -> Iterator[_Item]:
        """Yield the frames with the denoised means of their noisy colours, from the frame `skip` on."""
        for near in _neighbourhoods(items, reach, reach, skip):
            mean, aovs = self._averaged(near, self._samples)
            window = near.item.window
            share = np.clip((mean[..., 3] - 1.0) / AGREEMENT, 0.0, 1.0)
            share[window.color[..., 3] <= 0.0] = 1.0
            color = window.color
            if share.any():
                color = self._denoised(mean, near.item.guides)
                for channel in range(3):  # faster than all at once
                    own = window.color[..., channel]
                    color[..., channel] = own + share * (color[..., channel] - own)
            yield replace(near.item, window=replace(window, color=color, noisy=None, aovs=aovs))

    def _averaged(self, near: "_Neighbourhood", samples: float) -> tuple[Float32, list[Float32]]:
        """Return the result of the temporal filter."""
        item, *sides = near
        previous, following = ([other.window for other in side] for side in sides)
        return self._filter.filter(item.window, previous, following, item.exposure, samples)


def _aov_count(frame: Frame) -> int:
    return 0 if frame.aovs is None else frame.aovs.shape[2]


class _Neighbourhood(NamedTuple):
    item: _Item
    previous: list[_Item]  # the nearest one first
    following: list[_Item]


def _neighbourhoods(items: Iterable[_Item], behind: int, ahead: int, skip: int) -> Iterator[_Neighbourhood]:
    """Yield each frame with those before it and after it; nothing crosses a cut.

    Args:
        items: frames in order.
        behind: maximum number of previous frames.
        ahead: maximum number of following frames.
        skip: frames at the beginning that are neighbours only.
    """
    previous: deque[_Item] = deque(maxlen=behind)
    waiting: deque[_Item] = deque()

    def first() -> _Neighbourhood:
        item = waiting.popleft()
        found = _Neighbourhood(item, list(previous)[::-1], list(waiting))
        previous.append(item)
        return found

    for index, item in enumerate(items):
        if item.frame.reset:
            while waiting:
                yield first()
            previous.clear()  # frees memory: no motion leads there
        (previous if index < skip else waiting).append(item)
        while len(waiting) > ahead:
            yield first()
    while waiting:
        yield first()


def filled(color: Float32) -> Float32:
    """Return colour (h, w, 3) of `WindowFrame.color`, with missing samples filled by the known ones nearby.

    A denoiser would spread their black. Samples without any in the 5x5 pixels around stay black.
    """
    known = color[..., 3:] > 0.0
    total = np.concatenate([np.where(known, color[..., :3], 0.0), known], axis=2, dtype=np.float32)
    for axis in (0, 1):
        widths = [(2, 2) if each == axis else (0, 0) for each in range(3)]
        total = sliding_window_view(np.pad(total, widths), 5, axis).sum(axis=-1)
    return np.where(known, color[..., :3], total[..., :3] / np.maximum(total[..., 3:], 1.0))


def guides_of(frame: Frame) -> Guides:
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
    """Denoise path-traced frames, each with up to 5 frames on either side.

    The noise of a frame and its neighbours is averaged along their motion before it is denoised, and the
    denoised images are averaged again, so that they do not flicker. The weight of a neighbour depends on how
    well albedo, normal and patches of colour agree. Frames have the size of the images, and no jitter.

    >>> for image in denoise_sequence(shot):
    ...     show(image)  # (h, w, 3) float32, linear RGB

    Albedo is `gbuffer["base_color"]`, the normal `gbuffer["normal"]`. Without them, surfaces of similar
    colour may blur into each other. A frame without `motion_next` gets it from the motion of the next frame.

    Args:
        frames: a `Shot`, or Frames in order, all of one size. `reset` marks the first one after a cut. Of a
            shot that Cycles has denoised, "oidn" reads the noisy colour.
        per_frame: "oidn" denoises frames and means of frames by Open Image Denoise (`pip install
            "supersampler[denoise]"`); "none" is for frames that are denoised already.
        passes: 2 uses previous and following frames; 1 previous frames only, for live use: each frame is
            denoised once, and averaged with the frames before it.
        lookahead: with two passes, number of later frames that are read before a frame's image is
            returned, 1 to 5; None is 5.
        samples: samples per pixel of the frames: the more, the less a differing neighbour counts. None is
            `Shot.samples`, or 8 where that is unknown.
        threads: threads that compute; 0 is one per core.

    Returns:
        An iterator over the images, (h, w, 3) float32 linear RGB, in order; each may be kept.

    Raises:
        ArgumentError: an argument is not usable; before anything is read.
        FrameError: a frame breaks the contract, is jittered, or has another size or number of AOVs than the
            one before.
        ShotError: a frame cannot be read.
        ModuleNotFoundError: pyoidn is not installed.
    """
    after = frames_after(passes, lookahead)
    arguments.checked_choice("per_frame", per_frame, get_args(PerFrame))
    frames = checked_frames(frames)
    if isinstance(frames, Shot):
        samples = frames.samples if samples is None else samples
        frames = frames.with_noise() if per_frame == "oidn" else frames
    denoiser = TemporalDenoiser(
        per_frame=per_frame, lookahead=after, samples=checked_samples(samples), threads=threads
    )
    return _images(denoiser, frames)


def _images(denoiser: TemporalDenoiser, frames: Shot | Iterable[Frame]) -> Iterator[Float32]:
    with denoiser:
        for denoised in denoiser.run(frames_of(frames, BUFFERS)):
            yield denoised.image


def frames_after(passes: int, lookahead: int | None) -> int:
    """Return the number of following frames that are read; ArgumentError if one of the two is not usable."""
    checked = arguments.checked_lookahead(passes, lookahead, REACH)
    return REACH if checked is None else checked


def checked_samples(samples: float | None) -> float:
    """Return samples per pixel, DEFAULT_SAMPLES for None; ArgumentError if it is not positive."""
    number = arguments.as_number(DEFAULT_SAMPLES if samples is None else samples)
    if number is None or not 0.0 < number < inf:
        raise ArgumentError("samples", got=shown(samples), want="a number above 0, or None")
    return number
