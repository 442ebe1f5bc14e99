"""Steps through a segment of a shot, in one pass or in two."""

import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

from supersampler.cli.frame_plan import Segment
from supersampler.cli.frame_warnings import frame_warnings
from supersampler.cli.job import UpscaleJob
from supersampler.errors import FrameError, ShotError
from supersampler.frame import Float32, Frame
from supersampler.history import StepResult
from supersampler.io.machine import StageTimes
from supersampler.io.shot import ShotFrame
from supersampler.sequence.both_ways import BothWays, ChunkSize
from supersampler.sequence.frame_store import FrameStore
from supersampler.sequence.interpolation import interpolator_of
from supersampler.sequence.upscaling import buffers_of
from supersampler.upscaler import Upscaler

OnStep = Callable[[int, str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SteppedFrame:
    """What is kept of a `ShotFrame` until its image is written.

    Attributes:
        index, frame, reference: see `ShotFrame`.
    """

    index: int
    frame: Frame
    reference: Float32 | None


class Stepped(NamedTuple):
    """A frame and the outputs of its step."""

    item: SteppedFrame
    aov_names: Sequence[str] | None
    result: StepResult
    seconds: float  # of the forward step


class SegmentSteps:
    """Steps a job's Upscaler through segments of its shot.

    Args:
        job: the run.
        upscaler: its own.
        times: takes the times of the stages.
    """

    def __init__(self, job: UpscaleJob, upscaler: Upscaler, times: StageTimes) -> None:
        self._job, self._upscaler, self._times = job, upscaler, times
        self._size = ChunkSize()

    def count(self, segment: Segment, needed: int) -> int:
        """Return the number of steps of both passes; see `run`."""
        total = segment.stop - segment.start
        if self._job.passes == 1:
            return total
        start = segment.start
        while start < segment.end:
            stop = start + 1
            while stop < segment.end and self._job.shot.last_cut(stop) != stop:
                stop += 1
            skipped = max(0, needed - start) // self._size.frames * self._size.frames  # whole chunks
            total += self._size.backward_steps(max(0, stop - start - skipped))
            start = stop
        return total

    def run(
        self,
        segment: Segment,
        exposure_at_start: float | None,
        needed: int,
        *,
        references: bool,
        on_step: OnStep,
    ) -> Generator[Stepped]:
        """Yield each frame of a segment with the outputs of its step, in order.

        Args:
            segment: the frames.
            exposure_at_start: exposure of the first frame; None keeps its own.
            needed: index of the first frame whose image is needed: chunks before it have no backward run.
            references: whether to read those, too.
            on_step: called after each step with the index of its frame, and "forward" or "backward".
        """
        if self._job.passes == 1:
            yield from self._in_order(segment, exposure_at_start, references, on_step)
        else:
            yield from self._both_ways(segment, exposure_at_start, needed, references, on_step)

    def _frames(
        self,
        segment: Segment,
        exposure_at_start: float | None,
        gbuffers: Collection[str],
        *,
        references: bool,
    ) -> Iterator[ShotFrame]:
        frames = self._job.shot.frames(
            segment.start,
            segment.end,
            gbuffers=gbuffers,
            references=references,
            times=self._times,
        )
        for item in frames:
            if item.index == segment.start and exposure_at_start is not None:
                item = replace(item, frame=replace(item.frame, reset=True, exposure=exposure_at_start))
            yield item

    def _in_order(
        self, segment: Segment, exposure_at_start: float | None, references: bool, on_step: OnStep
    ) -> Generator[Stepped]:
        for item in self._frames(segment, exposure_at_start, self._upscaler.gbuffers, references=references):
            before = self._upscaler.stats.seconds
            with self._named(item.index), self._times.measure("step"):
                result = self._step(item.frame)
            kept = SteppedFrame(index=item.index, frame=item.frame, reference=item.reference)
            yield Stepped(kept, item.raw.aov_names, result, self._upscaler.stats.seconds - before)
            on_step(item.index, "forward")

    def _both_ways(
        self,
        segment: Segment,
        exposure_at_start: float | None,
        needed: int,
        references: bool,
        on_step: OnStep,
    ) -> Generator[Stepped]:
        job, forward = self._job, self._upscaler
        names: deque[Sequence[str] | None] = deque()
        interpolator = None if job.extrapolation is None else interpolator_of(job.extrapolation, forward)
        buffers = buffers_of(forward, interpolator)

        def read() -> Iterator[Frame]:
            for item in self._frames(segment, exposure_at_start, buffers, references=False):
                names.append(item.raw.aov_names)
                yield item.frame

        @contextmanager
        def around(place: int, direction: str) -> Iterator[None]:
            index = segment.start + place
            with self._named(index), self._times.measure("step"):
                yield
            on_step(index, direction)

        with (
            job.backward_upscaler(forward) as backward,
            FrameStore(folder=job.scratch, names=buffers) as store,
        ):
            runs = BothWays(
                forward,
                backward,
                store,
                self._size,
                outputs=("aovs", *self._maps()),
                around=around,
                interpolator=interpolator,
            )
            index, before = segment.start, time.perf_counter()
            merged = runs.run(read(), skip=needed - segment.start)
            for frame, result in islice(
                merged, segment.stop - segment.start
            ):  # others began the backward run
                reference = job.shot.read_reference(index) if references else None
                item = SteppedFrame(index=index, frame=frame, reference=reference)
                yield Stepped(item, names.popleft(), result, time.perf_counter() - before)
                index, before = index + 1, time.perf_counter()

    def _maps(self) -> tuple[str, ...]:
        return tuple(self._upscaler.model.info.maps) if self._job.maps else ()

    def _step(self, frame: Frame) -> StepResult:
        """Step with the auxiliary outputs that the files and the page show."""
        job, upscaler = self._job, self._upscaler
        step = upscaler.extrapolate if job.extrapolation and frame.color is None else upscaler.step
        result = step(frame, outputs=(*self._maps(), *(["aovs"] if frame.aovs is not None else [])))
        return result if isinstance(result, StepResult) else StepResult(result)

    @contextmanager
    def _named(self, index: int) -> Iterator[None]:
        """Add the frame's number to its errors and warnings."""
        shot = self._job.shot
        number = shot.first_number + index
        try:
            with frame_warnings(self._job.console, number):
                yield
        except FrameError as error:
            raise ShotError(shot.path, f"frame {number}: {str(error).rstrip('.')}") from error
