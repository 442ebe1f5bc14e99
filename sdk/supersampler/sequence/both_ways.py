"""Forward and backward runs over the frames of a sequence, chunk by chunk, and their merged images."""

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from supersampler.arguments import ExecutorName, ieee_arithmetic
from supersampler.backends.cpu.library import cpu_library
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Float32, Frame, checked_frame
from supersampler.history import StepResult
from supersampler.io.display import ExposureMeter
from supersampler.io.shot import Shot, ShotFrame
from supersampler.io.shot.shot import path_hint
from supersampler.sequence.backward_motion import reversed_frame
from supersampler.sequence.frame_store import FrameStore, Stored, StoredFrame
from supersampler.sequence.interpolation import Interpolator, interpolator_of
from supersampler.upscaler import Upscaler

MOTION_NEXT = "motion_next"
"""Name of `Frame.motion_next` in the `gbuffers` of `Shot.frames`."""
WEIGHT_MAPS = ("count", "converged")
"""Auxiliary outputs that `weight_of` reads, if a method has them."""
MIN_COUNT = 0.05
"""Lower bound of the sample count in a weight, which keeps weights positive."""
WARM_UP_STEPS = 4
"""Steps after which a run's image has its full weight."""
CONVERGED = 255.0
"""Additional relative weight of a converged pixel. If only one run has converged, the merged image differs
from that run's by less than an 8-bit step."""

Direction = Literal["backward", "forward"]
Around = Callable[[int, Direction], AbstractContextManager[object]]


class ChunkSize(NamedTuple):
    """Number of frames that are merged at once, and of frames after them that start the backward run."""

    frames: int = 64
    overlap: int = 16

    def backward_steps(self, count: int) -> int:
        """Return the number of steps of the backward run over `count` frames without a cut."""
        steps = 0
        while count >= sum(self):
            steps, count = steps + sum(self), count - self.frames
        return steps + count

    def settled(self, count: int) -> int:
        """Return how many of the first `count` frames after a cut have images that no later frame changes."""
        return max(0, count - self.overlap) // self.frames * self.frames


class Merged(NamedTuple):
    """A frame, and the merged outputs of its steps."""

    frame: Frame
    result: StepResult


@dataclass
class _Window:
    """Frames that were read and are not merged yet.

    Attributes:
        first: index in the sequence of the first of them.
        frames: the frames, in order.
        ended: whether a cut or the end follows the last of them.
        following: the first frame after that cut.
    """

    first: int = 0
    frames: list[StoredFrame] = field(default_factory=list)
    ended: bool = False
    following: Frame | None = None


class BothWays:
    """Merges a forward and a backward run of a model.

    Args:
        forward: the Upscaler of the forward run, which keeps its history from chunk to chunk. The backward
            run has its model and settings, and restarts with each chunk.
        chunk: sizes of the chunks.
        outputs: auxiliary outputs to return. "aovs" are merged, the others are the forward run's.
        around: makes a context for each step, from the index of its frame and the direction.
        extrapolation: model for the colour of unshaded frames, see `interpolator_of`; without one they are
            refused.
        executor: backend of `extrapolation`.
        memory: see `FrameStore`.
        scratch: see `FrameStore`.

    Attributes:
        buffers: names of the buffers of a frame that are read, as in `Shot.frames`.

    Raises:
        ModelError, ArgumentError: see `interpolator_of`.
        ShotError: `scratch` is not a folder.
    """

    def __init__(
        self,
        forward: Upscaler,
        chunk: ChunkSize | None = None,
        *,
        outputs: tuple[str, ...] = (),
        around: Around = lambda *_: nullcontext(),
        extrapolation: str | Path | None = None,
        executor: ExecutorName = "auto",
        memory: float | None = None,
        scratch: Path | None = None,
    ) -> None:
        self._forward, self._chunk, self._outputs = forward, chunk or ChunkSize(), outputs
        self._around = around
        self._interpolator: Interpolator | None = None
        if extrapolation is not None:
            self._interpolator = interpolator_of(extrapolation, forward, executor)
        of_unshaded = () if self._interpolator is None else self._interpolator.gbuffers
        self.buffers = frozenset((*forward.gbuffers, *of_unshaded, MOTION_NEXT))
        self._store = FrameStore(memory=memory, folder=scratch, names=self.buffers)
        self._colors: dict[int, Stored] = {}  # of the unshaded frames of the window
        self._meter, self._steps = ExposureMeter(), 0  # steps of the forward run since the last cut
        self._weights = tuple(name for name in WEIGHT_MAPS if name in forward.model.info.maps)

    def run(self, frames: Iterable[Frame], *, skip: int = 0) -> Iterator[Merged]:
        """Yield the outputs of each frame, in order; at most chunk + overlap frames are read ahead.

        Args:
            frames: frames in order; `reset` marks the first frame after a cut.
            skip: number of first frames whose images are not needed: a chunk of only such frames has no
                backward run.
        """
        source, window, forward = iter(frames), _Window(), self._forward
        if (first := next(source, None)) is None:
            return
        source = chain([first], source)
        # of the first frame, although the backward run begins with a later one, which may have another size
        size = forward.display_size_for(first.size)
        backward = Upscaler(  # the forward run checks the same frames
            forward.model, display_size=size, at_rest=forward.at_rest, skip=forward.skip, validate="off"
        )
        with self._store, backward:
            while self._fill(window, source):
                count = len(window.frames) if window.ended else self._chunk.frames
                if self._interpolator is not None:
                    self._colors = self._interpolator.colors(window.frames, count, self._store)
                is_needed = window.first + count > skip
                images = self._step_backward(backward, window, count) if is_needed else [None] * count
                for place in range(count):
                    yield self._merged(window, place, images[place])
                    self._store.drop(window.frames[place].stored)
                for stored in self._colors.values():
                    self._store.drop(stored)
                window.frames, window.first = window.frames[count:], window.first + count

    def _fill(self, window: _Window, source: Iterator[Frame]) -> bool:
        """Read until the window is full or ends with a cut; return False at the end of the sequence."""
        if window.ended:  # all of its frames were merged
            window.ended = False
            if window.following is not None:
                window.frames.append(self._store.put_frame(window.following))
                window.following = None
        while len(window.frames) < sum(self._chunk):
            frame = next(source, None)
            if frame is None or (frame.reset and window.frames):
                window.ended, window.following = True, frame
                break
            window.frames.append(self._store.put_frame(frame))
        return bool(window.frames)

    def _step_backward(self, backward: Upscaler, window: _Window, count: int) -> list[Stored | None]:
        """Step from the last frame to the first; return the images of the first `count`, in order."""
        found: list[Stored | None] = []
        following = None
        for steps, place in enumerate(reversed(range(len(window.frames))), start=1):
            frame = self._store.get_frame(window.frames[place])
            with self._around(window.first + place, "backward"):
                result = self._step(backward, reversed_frame(frame, following), place)
            if place < count:
                arrays = {"image": result.image, "weight": weight_of(result, steps)}
                if result.aovs is not None:
                    arrays["aovs"] = result.aovs
                found.append(self._store.put(arrays))
            following = frame
        return found[::-1]

    @ieee_arithmetic
    def _merged(self, window: _Window, place: int, backward: Stored | None) -> Merged:
        """Step forward, and merge with the backward image."""
        frame = self._store.get_frame(window.frames[place])
        with self._around(window.first + place, "forward"):
            result = self._step(self._forward, frame, place, self._outputs)
        self._steps = 1 if frame.reset else self._steps + 1
        exposure = self._meter.read_frame(frame)
        if backward is not None:
            other, weight = self._store.get(backward), weight_of(result, self._steps)
            self._store.drop(backward)
            merge_images(result.image, other["image"], weight, other["weight"], exposure / frame.pre_exposure)
            if result.aovs is not None:
                share = other["weight"] / (weight + other["weight"])
                result.aovs[...] += share[..., None] * (other["aovs"] - result.aovs)
        return Merged(frame, result)

    def _step(
        self, upscaler: Upscaler, frame: Frame, place: int, outputs: tuple[str, ...] = ()
    ) -> StepResult:
        """Step with `outputs` and those that the merge needs, on the interpolated colour if there is one."""
        aovs = ("aovs",) * (frame.aovs is not None and "aovs" in self._outputs)
        others = (name for name in outputs if name != "aovs")
        names = tuple(dict.fromkeys((*aovs, *self._weights, *others)))
        if frame.color is None and place in self._colors:
            color = self._store.get(self._colors[place])["color"]
            result = upscaler.step_computed(frame, color, outputs=names)
        else:
            result = upscaler.step(frame, outputs=names)
        return result if isinstance(result, StepResult) else StepResult(result)


def checked_frames(frames: Shot | Iterable[Frame]) -> Shot | Iterable[Frame]:
    """Return a Shot or an iterable of Frames; ArgumentError for anything else, such as a path."""
    if isinstance(frames, Shot) or (isinstance(frames, Iterable) and not isinstance(frames, str | bytes)):
        return frames
    want = "a Shot, or an iterable of Frames"
    raise ArgumentError("frames", got=shown(frames), want=want, hint=path_hint(frames))


def frames_of(frames: Shot | Iterable[Frame], names: Collection[str]) -> Iterator[Frame]:
    """Yield the frames of a shot, with these buffers, or the checked frames of an iterable."""
    if isinstance(frames, Shot):
        yield from (item.frame for item in frames.frames(gbuffers=names, references=False))
        return
    for frame in frames:
        yield checked_frame(frame.frame if isinstance(frame, ShotFrame) else frame)


@ieee_arithmetic
def weight_of(result: StepResult, steps: int) -> Float32:
    """Return the weight (H, W) of a run's image in the merge, > 0.

    It is the sample count, if the method has one, and is reduced in a run's first steps. Thus the other run
    dominates where this one has just started or a pixel was disoccluded; elsewhere both are averaged.

    Args:
        result: result with those outputs of WEIGHT_MAPS that the method has.
        steps: number of steps of the run since its history started, including this one.
    """
    weight = np.full(result.image.shape[:2], min(steps / WARM_UP_STEPS, 1.0), np.float32)
    if result.count is not None:
        weight *= np.maximum(result.count, np.float32(MIN_COUNT))
    if result.converged is not None and result.converged.any():
        weight *= 1.0 + np.float32(CONVERGED) * np.square(result.converged)
    return weight


@ieee_arithmetic
def merge_images(
    image: Float32, other: Float32, weight: Float32, other_weight: Float32, exposure: float
) -> None:
    """Write the weighted mean of two images to `image`.

    The mean is taken of c / (1 + max(c)) of exposed colours, because in a mean of linear values the brighter
    one would dominate on a display. Images are (H, W, 3) float32 linear RGB; weights are (H, W).
    """
    height, width = weight.shape
    arrays = [np.ascontiguousarray(array, np.float32) for array in (image, other, weight, other_weight)]
    addresses = [array.ctypes.data for array in arrays]
    cpu_library().call("ss_merge_images", *addresses, width, height, exposure)
    if arrays[0] is not image:
        np.copyto(image, arrays[0])
