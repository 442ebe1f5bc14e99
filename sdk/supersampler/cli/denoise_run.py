"""Denoise a shot into a folder, frame by frame; a stopped run can continue."""

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Literal

from supersampler import __version__
from supersampler.cli.arguments import size_text
from supersampler.cli.frame_run import FrameRun, Layers, OnStep, PageLayers, SteppedFrame, run_frames
from supersampler.cli.job import EXPOSURE_FRAMES, FrameJob, FramePlan, plan_frames
from supersampler.cli.results import PREROLL, Results
from supersampler.denoising.sequence import (
    BUFFERS,
    PerFrame,
    TemporalDenoiser,
    checked_lookahead,
    missing_guides,
)
from supersampler.denoising.spec import REACH
from supersampler.errors import FrameError, MissingFramesError, ShotError
from supersampler.frame import Frame
from supersampler.history import StepResult
from supersampler.io.compare import compare_layers
from supersampler.io.images import Channel
from supersampler.io.shot import Shot, ShotFrame
from supersampler.io.shot.named_channels import is_id
from supersampler.io.shot.numbered import FrameRange


@dataclass(frozen=True, kw_only=True)
class DenoiseJob(FrameJob):
    """Input, settings and output of one run that denoises.

    Attributes:
        per_frame: denoiser of single frames: "oidn"; "none" for frames that are denoised already; "auto" is
            "none" if the shot states that they are, otherwise "oidn".
        passes: 1 uses previous frames only; 2 also following frames.
        lookahead: frames after a frame that are read; see `denoise_sequence`.
        threads: 0 is one per core.
    """

    per_frame: PerFrame | Literal["auto"] = "auto"
    passes: int = 2
    lookahead: int | None = None
    threads: int = 0

    @property
    def denoiser(self) -> PerFrame:
        """The denoiser of single frames that runs first: "oidn" or "none"."""
        if self.per_frame != "auto":
            return self.per_frame
        return "none" if self.shot.is_denoised else "oidn"

    def settings(self, after: int) -> dict[str, object]:
        """Return all that the images depend on, but the number of frames: a shot may still grow."""
        return {
            "supersampler": __version__,
            "method": "denoise",
            "per frame": self.denoiser,
            "frames after": after,
            PREROLL: REACH if self.numbers is not None else None,
            **self.shot_settings(),
        }


def run_denoise(job: DenoiseJob) -> Results:
    """Denoise the frames that are not complete yet, and print a summary.

    Raises:
        typer.Exit: 130 after Ctrl-C; complete frames are kept.
        SupersamplerError: a frame or a file is not usable; or the output lies in the shot, or would replace
            files of another program.
        ModuleNotFoundError: pyoidn is not installed.
    """
    after = checked_lookahead(job.passes, job.lookahead)
    plan = plan_frames(job.shot, job.numbers, REACH, 2 if after else 1)
    with TemporalDenoiser(per_frame=job.denoiser, lookahead=after, threads=job.threads) as denoiser:
        return run_frames(
            job,
            plan,
            job.settings(after),
            lambda results, first: _DenoiseRun(job, denoiser, results, plan, first),
        )


def parts_of(
    numbers: FrameRange | None, open_frames: Callable[..., Shot], passes: int
) -> Iterator[tuple[FrameRange | None, Shot, str]]:
    """Yield the numbers, the shot and a note of each part of a sequence: a missing frame is a cut.

    Args:
        numbers: numbers of the frames to write; None is all of them.
        open_frames: opens all frames, or those from a first to a last number.
        passes: 1 or 2.

    Raises:
        ShotError: there are no such frames, or they cannot be opened.
    """
    try:
        shot = open_frames() if numbers is None else _opened(numbers, open_frames, passes)
    except MissingFramesError as gap:
        low, high = gap.present if numbers is None else (numbers.first, numbers.last)
        (first, last), problem = gap.missing, gap.problem
    else:
        yield numbers, shot, ""
        return
    if low < first:
        yield from parts_of(FrameRange(low, first - 1), open_frames, passes)
    if last < high:
        for part, shot, note in parts_of(FrameRange(last + 1, high), open_frames, passes):
            yield part, shot, f"{problem}: a cut" if part is not None and part.first == last + 1 else note


def _opened(numbers: FrameRange, open_frames: Callable[..., Shot], passes: int) -> Shot:
    """Open a range of frames and those around it that its images depend on, up to the next gap."""
    first, last = numbers.first - REACH - EXPOSURE_FRAMES, numbers.last + (REACH if passes == 2 else 0)
    while True:
        try:
            return open_frames((first, last))
        except MissingFramesError as gap:
            if gap.missing[1] < numbers.first:
                first = gap.missing[1] + 1
            elif gap.missing[0] > numbers.last:
                last = gap.missing[0] - 1
            else:
                raise


class _DenoiseRun(FrameRun[DenoiseJob]):
    activity = "denoising"

    def __init__(
        self, job: DenoiseJob, denoiser: TemporalDenoiser, results: Results, plan: FramePlan, first: int
    ) -> None:
        super().__init__(job, results, plan, first, job.shot.render_size)
        self._denoiser, self._count, self._reading = denoiser, 0, plan.start

    def plan_from(self, begins: int) -> FramePlan:
        first = self._plan.index(begins)
        start = max(self._plan.start, self._shot.last_cut(first), first - REACH)
        return replace(self._plan, start=start)

    def step_count(self, plan: FramePlan, needed: int) -> int:
        return plan.stop - needed

    def steps(
        self, plan: FramePlan, needed: int, on_step: OnStep, *, references: bool
    ) -> Generator[SteppedFrame]:
        names: deque[Sequence[str] | None] = deque()

        def read() -> Iterator[Frame]:
            for item in self._shot.frames(plan.start, plan.end, gbuffers=BUFFERS, references=False):
                frame, self._reading = item.frame, item.index
                if item.index == plan.start:
                    self._warn(item)
                    frame = replace(frame, reset=True)
                if item.index >= needed:
                    names.append(item.raw.aov_names)
                yield frame

        try:
            yield from self._denoised(read(), plan, needed, names, on_step, references=references)
        except FrameError as error:  # of the frame that was read last
            number = self._shot.first_number + self._reading
            raise ShotError(self._shot.path, f"frame {number}: {str(error).rstrip('.')}") from error

    def _denoised(
        self,
        frames: Iterator[Frame],
        plan: FramePlan,
        needed: int,
        names: deque[Sequence[str] | None],
        on_step: OnStep,
        *,
        references: bool,
    ) -> Generator[SteppedFrame]:
        exposure = self._exposure_at(needed)
        before = time.perf_counter()
        for index, denoised in enumerate(self._denoiser.run(frames, skip=needed - plan.start), needed):
            if index >= plan.stop:  # later ones are neighbours only
                return
            reference = self._shot.read_reference(index) if references else None
            frame = denoised.frame
            if index == needed and exposure is not None:  # that of a run of the whole shot
                frame = replace(frame, exposure=exposure)
            result = StepResult(denoised.image, aovs=denoised.aovs)
            seconds = time.perf_counter() - before
            self._count += 1
            yield SteppedFrame(index, frame, reference, names.popleft(), result, seconds)
            on_step(index, "forward")
            before = time.perf_counter()

    def summary(self, wall: float) -> tuple[int, str]:
        return self._count, f"{self._count} frames in {wall:.1f} s: {self._count / wall:.2f} per second"

    def facts(self) -> dict[str, str]:
        return {
            "method": "temporal denoiser",
            "size": size_text(self._display_size).replace("x", " × "),
            "each frame first": {"oidn": "Open Image Denoise", "none": "as it came"}[self._job.denoiser],
        }

    def page_layers(self, stack: ExitStack) -> PageLayers:  # noqa: ARG002  # nothing is to be closed
        transform = self._job.images.transform

        def layers_of(stepped: SteppedFrame, exposure: float) -> tuple[Layers, Mapping[str, float]]:
            image, reference = stepped.result.image, stepped.reference
            return compare_layers(stepped.frame, image, reference, exposure, transform=transform)

        return layers_of

    def copied(self, index: int) -> Mapping[str, Channel]:
        names = [name for name in self._shot.ignored_channels if is_id(name)]
        return self._shot.read_channels(index, names) if names else {}

    def _warn(self, item: ShotFrame) -> None:
        """Say what the first frame lacks."""
        missing = missing_guides(item.frame)
        if missing:
            lost = "edges between surfaces of similar colour may blur"
            self._job.console.print(f"The frames have no {' and no '.join(missing)}: {lost}.", soft_wrap=True)
