"""A forward and a backward run over the frames of a sequence, chunk by chunk, merged."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from supersampler.frame import Frame
from supersampler.history import StepResult
from supersampler.io.display import ExposureMeter
from supersampler.sequence.backward_motion import reversed_frame
from supersampler.sequence.frame_store import FrameStore, Stored, StoredFrame
from supersampler.sequence.merge import merge_aovs, merge_images, weight_of, weight_outputs
from supersampler.upscaler import Upscaler

CHUNK, OVERLAP = 64, 16
"""Frames of a chunk, and frames after it from which its backward run begins: that many build its history."""


class ChunkSize(NamedTuple):
    """Frames that are merged at once, and further ones that the backward run begins with."""

    frames: int = CHUNK
    overlap: int = OVERLAP


@dataclass
class _Window:
    """Frames that were read and not merged yet.

    Attributes:
        frames: in order.
        ended: whether a cut or the end follows the last one.
        following: the first frame after the cut, which was read to find it.
    """

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
        on_step: called after each step of either run, with "backward" or "forward".
    """

    def __init__(
        self,
        forward: Upscaler,
        backward: Upscaler,
        store: FrameStore,
        size: ChunkSize,
        outputs: tuple[str, ...] = (),
        on_step: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._forward, self._backward, self._store = forward, backward, store
        self._size, self._on_step = size, on_step
        self._meter = ExposureMeter()
        weights = weight_outputs(forward.model.info.maps)
        self._backward_outputs = tuple(dict.fromkeys(("aovs",) * ("aovs" in outputs) + weights)) or ("work",)
        self._outputs = tuple(dict.fromkeys((*outputs, *weights))) or ("work",)

    def run(self, frames: Iterable[Frame]) -> Iterator[StepResult]:
        """Yield the merged result of each frame, in order; at most chunk + overlap frames are read ahead."""
        source, window = iter(frames), _Window()
        while self._fill(window, source):
            count = len(window.frames) if window.ended else self._size.frames
            images = self._step_backward(window.frames, count)
            for frame, backward in zip(window.frames[:count], images, strict=True):
                yield self._merged(frame, backward)
                self._store.drop(frame.stored)
            window.frames = window.frames[count:]

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

    def _step_backward(self, frames: list[StoredFrame], count: int) -> list[Stored]:
        """Step from the last frame to the first; return the images of the first `count`, in order."""
        found: list[Stored] = []
        following = None
        for index in reversed(range(len(frames))):
            frame = self._store.get_frame(frames[index])
            wanted = index < count
            turned = reversed_frame(frame, following)
            result = self._backward.step(turned, outputs=self._backward_outputs if wanted else ())
            if wanted and isinstance(result, StepResult):
                arrays = {"image": result.image, "weight": weight_of(result)}
                if result.aovs is not None:
                    arrays["aovs"] = result.aovs
                found.append(self._store.put(arrays))
            following = frame
            self._on_step("backward")
        return found[::-1]

    def _merged(self, stored: StoredFrame, backward: Stored) -> StepResult:
        """Step forward, and merge with the backward image."""
        frame = self._store.get_frame(stored)
        result = self._forward.step(frame, outputs=self._outputs)
        exposure = self._meter.read(frame.color, given=frame.exposure, reset=frame.reset)
        other, weight = self._store.get(backward), weight_of(result)
        self._store.drop(backward)
        merge_images(result.image, other["image"], weight, other["weight"], exposure)
        if result.aovs is not None:
            merge_aovs(result.aovs, other["aovs"], weight, other["weight"])
        self._on_step("forward")
        return result
