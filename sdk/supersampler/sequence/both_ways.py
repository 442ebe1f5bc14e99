"""A forward and a backward run over the frames of a sequence, chunk by chunk, merged."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from supersampler.frame import Float32, Frame
from supersampler.history import StepResult
from supersampler.io.display import ExposureMeter
from supersampler.sequence.backward_motion import reversed_frame
from supersampler.sequence.frame_store import FrameStore, Stored, StoredFrame
from supersampler.sequence.interpolation import Interpolator
from supersampler.sequence.merge import merge_aovs, merge_images, weight_of, weight_outputs
from supersampler.upscaler import Upscaler

CHUNK, OVERLAP = 64, 16
"""Frames of a chunk, and frames after it from which its backward run begins: that many build its history."""

Direction = Literal["backward", "forward"]
Around = Callable[[int, Direction], AbstractContextManager[object]]


class ChunkSize(NamedTuple):
    """Frames that are merged at once, and further ones that the backward run begins with."""

    frames: int = CHUNK
    overlap: int = OVERLAP

    def backward_steps(self, count: int) -> int:
        """Return the steps of the backward run over so many frames without a cut."""
        steps = 0
        while count >= sum(self):
            steps, count = steps + sum(self), count - self.frames
        return steps + count


class Merged(NamedTuple):
    """A frame, and the merged outputs of its steps."""

    frame: Frame
    result: StepResult


@dataclass
class _Window:
    """Frames that were read and not merged yet.

    Attributes:
        first: index of the first one in the sequence.
        frames: in order.
        ended: whether a cut or the end follows the last one.
        following: the first frame after the cut, which was read to find it.
    """

    first: int = 0
    frames: list[StoredFrame] = field(default_factory=list)
    ended: bool = False
    following: Frame | None = None


class BothWays:
    """Merges a forward and a backward run of a model.

    Args:
        forward: steps through the frames in order; it keeps its history from chunk to chunk.
        backward: of the same model and display size; steps through each chunk's frames in reverse.
        store: keeps frames and backward images until they are merged.
        size: of the chunks.
        outputs: names of further outputs; all but "aovs" are those of the forward run.
        around: makes a context for each step, from the index of its frame and the direction.
        interpolator: computes the colour of frames that were not shaded; without one they are refused.
    """

    def __init__(
        self,
        forward: Upscaler,
        backward: Upscaler,
        store: FrameStore,
        size: ChunkSize,
        *,
        outputs: tuple[str, ...] = (),
        around: Around = lambda *_: nullcontext(),
        interpolator: Interpolator | None = None,
    ) -> None:
        self._interpolator = interpolator
        self._colors: dict[int, Stored] = {}  # of unshaded frames of the window, by place
        self._forward, self._backward, self._store = forward, backward, store
        self._size, self._around = size, around
        self._meter, self._steps = ExposureMeter(), 0  # of the forward run since the last cut
        self._asked = outputs
        self._weights = weight_outputs(forward.model.info.maps)

    def run(self, frames: Iterable[Frame], *, skip: int = 0) -> Iterator[Merged]:
        """Yield the outputs of each frame, in order; at most chunk + overlap frames are read ahead.

        Args:
            frames: in order, cut where they have `reset`.
            skip: number of frames at the beginning that only build the history: in chunks without others, the
                backward run is left out.
        """
        source, window = iter(frames), _Window()
        while self._fill(window, source):
            count = len(window.frames) if window.ended else self._size.frames
            wanted = window.first + count > skip
            self._compute_colors(window, count)
            images = self._step_backward(window, count) if wanted else [None] * count
            for place in range(count):
                yield self._merged(window.first + place, place, window.frames[place], images[place])
                self._store.drop(window.frames[place].stored)
            for stored in self._colors.values():
                self._store.drop(stored)
            window.frames, window.first = window.frames[count:], window.first + count

    def _fill(self, window: _Window, source: Iterator[Frame]) -> bool:
        """Read until the window is full or a cut ends it; return False at the end of the sequence."""
        if window.ended:  # all of its frames are merged
            window.ended = False
            if window.following is not None:
                window.frames.append(self._store.put_frame(window.following))
                window.following = None
        while len(window.frames) < sum(self._size):
            frame = next(source, None)
            if frame is None or (frame.reset and window.frames):
                window.ended, window.following = True, frame
                break
            window.frames.append(self._store.put_frame(frame))
        return bool(window.frames)

    def _compute_colors(self, window: _Window, count: int) -> None:
        """Store the colours of the window's unshaded frames."""
        self._colors = {}
        if self._interpolator is not None:
            self._colors = self._interpolator.colors(window.frames, count, self._store)

    def _step(self, upscaler: Upscaler, frame: Frame, place: int, outputs: tuple[str, ...]) -> StepResult:
        color: Float32 | None = None
        if frame.color is None and place in self._colors:
            color = self._store.get(self._colors[place])["color"]
        if color is None:
            result = upscaler.step(frame, outputs=outputs)
        else:
            result = upscaler.step_computed(frame, color, outputs=outputs)
        return result if isinstance(result, StepResult) else StepResult(result)

    def _outputs(self, frame: Frame) -> tuple[str, ...]:
        """Return the outputs that a merged step on this frame needs."""
        aovs = ("aovs",) * (frame.aovs is not None and "aovs" in self._asked)
        return *aovs, *self._weights

    def _step_backward(self, window: _Window, count: int) -> list[Stored | None]:
        """Step from the last frame to the first; return the images of the first `count`, in order."""
        found: list[Stored | None] = []
        following = None
        for steps, place in enumerate(reversed(range(len(window.frames))), start=1):
            frame = self._store.get_frame(window.frames[place])
            with self._around(window.first + place, "backward"):
                outputs = self._outputs(frame)
                result = self._step(self._backward, reversed_frame(frame, following), place, outputs)
            if place < count:
                arrays = {"image": result.image, "weight": weight_of(result, steps)}
                if result.aovs is not None:
                    arrays["aovs"] = result.aovs
                found.append(self._store.put(arrays))
            following = frame
        return found[::-1]

    def _merged(self, index: int, place: int, stored: StoredFrame, backward: Stored | None) -> Merged:
        """Step forward, and merge with the backward image."""
        frame = self._store.get_frame(stored)
        asked = [name for name in self._asked if name != "aovs"]
        outputs = tuple(dict.fromkeys((*self._outputs(frame), *asked)))
        with self._around(index, "forward"):
            result = self._step(self._forward, frame, place, outputs)
        self._steps = 1 if frame.reset else self._steps + 1
        exposure = self._meter.read(
            frame.color, given=frame.exposure, reset=frame.reset, pre_exposure=frame.pre_exposure
        )
        if backward is not None:
            other, weight = self._store.get(backward), weight_of(result, self._steps)
            self._store.drop(backward)
            merge_images(result.image, other["image"], weight, other["weight"], exposure / frame.pre_exposure)
            if result.aovs is not None:
                merge_aovs(result.aovs, other["aovs"], weight, other["weight"])
        return Merged(frame, result)
