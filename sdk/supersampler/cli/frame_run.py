"""Write the images of a run into a folder, frame by frame; a stopped run can continue."""

import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

import typer

from supersampler.cli.job import EXPOSURE_FRAMES, FrameJob, FramePlan
from supersampler.cli.results import OutputImage, OutputQueue, Results
from supersampler.cli.terminal import RunProgress, frame_warnings
from supersampler.errors import FrameError, ShotError
from supersampler.frame import Float32, Frame, Size
from supersampler.history import StepResult
from supersampler.io.compare import ERROR_LEGEND, About, Legend, compare_page, versions_text
from supersampler.io.display import ExposureMeter, usable_exposure
from supersampler.io.files import check_apart
from supersampler.io.images import Bytes, Channel, Metadata, pixel_aspect, result_metadata
from supersampler.io.video import VideoWriter, video_writer

COMPARE_FRAMES = 64
"""Number of frames, the last ones, in a page: browsers load larger pages slowly."""
_PAGE_NOTES = (
    "JPEG of quality 92, small ones PNG. The input is as rendered, with its jitter.",
    "error: mean over r, g, b of |output − reference| of these images. PSNR: of the same images before "
    "rounding to 8 bits, whole frame.",
)


@dataclass(frozen=True, eq=False)
class SteppedFrame:
    """A frame and the outputs of its step."""

    index: int
    frame: Frame
    reference: Float32 | None
    aov_names: Sequence[str] | None
    result: StepResult
    seconds: float  # of the forward step


class Written(NamedTuple):
    """A frame of which all files are written."""

    position: int
    number: int
    video_image: Bytes | None
    seconds: float  # of the step


_AddToPage: TypeAlias = Callable[[SteppedFrame, float], None]
Layers: TypeAlias = Mapping[str, Bytes]
PageLayers: TypeAlias = Callable[[SteppedFrame, float], tuple[Layers, Mapping[str, float]]]
"""Makes layers and numbers for the page of a frame, at an exposure."""
OnStep: TypeAlias = Callable[[int, str], None]
Job = TypeVar("Job", bound=FrameJob)


def run_frames(
    job: FrameJob,
    plan: FramePlan,
    settings: Mapping[str, object],
    begin: Callable[[Results, int], "FrameRun[Any]"],
    *,
    all_frames: bool = False,
) -> Results:
    """Write the frames of a plan that are not complete yet.

    Args:
        job: the job.
        plan: its frames.
        settings: all that the images depend on.
        begin: returns the run, given the folder and the position of the first incomplete frame.
        all_frames: whether to compute complete frames, too.

    Raises:
        typer.Exit: 130 after Ctrl-C; complete frames are kept.
        SupersamplerError: a frame or a file is not usable; or the output lies in the shot, or would replace
            files of another program.
    """
    results, count = Results(job.output, job.images), len(plan.numbers)
    if not job.holds_shot:
        check_apart(job.output, job.shot.source)
    first = results.begin(settings, count, overwrite=job.overwrite, page=job.compare)
    page = job.compare and not (first == count and results.is_newest(results.page))
    video = job.images.video and not (first == count and results.is_newest(results.video))
    if first == count and not (page or video or all_frames):
        job.console.print(f"All {count} frames are there already.")
        with RunProgress(job.console, 0, json=job.json) as progress:
            progress.event("begin", shot=job.shot.name, frames=count, complete=count)
            progress.event("end", frames=0, seconds=0.0, cpu_seconds=0.0)
        return results
    begins = 0 if all_frames or video else min(first, count - COMPARE_FRAMES) if page else first
    try:
        begin(results, first).run(max(begins, 0), page=page, video=video)
    except KeyboardInterrupt:
        complete = results.count_complete(count)
        job.console.print(f"Stopped: {complete} of {count} frames are complete.")
        job.console.print("The same command, given again, continues.")
        raise typer.Exit(130) from None
    return results


class FrameRun(Generic[Job]):
    """One run: frames before position `first` are complete, and only rebuild the history of later ones.

    Subclasses yield the frames with their images, and describe the page.

    Attributes:
        activity: name of a step in the progress bar.
        legends: legends of the page's layers beside "error".
    """

    activity: str
    legends: Mapping[str, Legend] = {}

    def __init__(self, job: Job, results: Results, plan: FramePlan, first: int, display_size: Size) -> None:
        self._job, self._shot, self._display_size = job, job.shot, display_size
        self._results, self._plan, self._first = results, plan, first

    def plan_from(self, begins: int) -> FramePlan:
        """Return the frames to read for those from position `begins` on."""
        raise NotImplementedError

    def step_count(self, plan: FramePlan, needed: int) -> int:
        """Return the number of steps; `needed` is the index of the first frame whose image is needed."""
        raise NotImplementedError

    def steps(
        self, plan: FramePlan, needed: int, on_step: OnStep, *, references: bool
    ) -> Generator["SteppedFrame"]:
        """Yield each frame of a plan with its images; `on_step` is called after each step."""
        raise NotImplementedError

    def summary(self, wall: float) -> tuple[int, str]:
        """Return the number of frames that were computed in `wall` seconds, and a line on them."""
        raise NotImplementedError

    def facts(self) -> dict[str, str]:
        """Return facts of the run for the page, by name; "method" is one."""
        raise NotImplementedError

    def copied(self, index: int) -> Mapping[str, Channel]:  # noqa: ARG002  # of subclasses
        """Return channels of a frame that its result holds as they are; called on threads."""
        return {}

    def page_layers(self, stack: ExitStack) -> PageLayers:
        """Return the function that makes a frame's layers and numbers for the page; `stack` ends with it."""
        raise NotImplementedError

    def run(self, begins: int, *, page: bool, video: bool) -> None:
        """Compute the frames that lead to those from position `begins` on, and write them."""
        job, results, began, cpu = self._job, self._results, time.perf_counter(), time.process_time()
        plan, count = self.plan_from(begins), len(self._plan.numbers)
        needed = min(max(plan.index(begins), plan.start), plan.stop)  # the first one whose image is needed
        with (
            self._page() if page else nullcontext() as add_to_page,
            self._film() if video else nullcontext() as film,
            RunProgress(job.console, self.step_count(plan, needed), json=job.json) as progress,
            OutputQueue[Written](partial(self._finish, film, progress)) as queue,
        ):
            progress.event("begin", shot=self._shot.name, frames=count, complete=self._first)
            self._write_frames(plan, needed, queue, add_to_page, progress)
        if video:
            results.end_file(results.video, count)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
        frames, line = self.summary(wall)
        job.console.print(line)
        progress.event("end", frames=frames, seconds=round(wall, 3), cpu_seconds=round(cpu, 3))

    def _write_frames(
        self,
        plan: FramePlan,
        needed: int,
        queue: OutputQueue[Written],
        add_to_page: _AddToPage | None,
        progress: RunProgress,
    ) -> None:
        job, meter = self._job, ExposureMeter()

        def on_step(index: int, direction: str) -> None:
            position = plan.position(index)
            writes = position is not None and position >= self._first
            forward = self.activity if writes else "replaying"
            progress.advance("stepping backward" if direction == "backward" else forward)

        steps = self.steps(plan, needed, on_step, references=add_to_page is not None)
        with closing(steps):
            for stepped in steps:
                exposure = meter.read_frame(stepped.frame) / stepped.frame.pre_exposure  # of the images
                position = plan.position(stepped.index)
                if position is None:
                    continue
                if position >= self._first:
                    self._results.list_files(position)
                if position >= self._first or job.images.video:
                    values = stepped.index, stepped.aov_names, stepped.result, stepped.seconds
                    queue.put(partial(self._write, position, exposure, *values))
                if add_to_page is not None and position >= len(plan.numbers) - COMPARE_FRAMES:
                    add_to_page(stepped, exposure)

    def _exposure_at(self, index: int) -> float | None:
        """Return the exposure that a run of the whole shot has at a frame; None where a cut begins there."""
        cut = self._shot.last_cut(index)
        if cut == index:
            return None
        if (stated := usable_exposure(self._shot.exposure(index))) is not None:
            return stated
        meter, exposure, start = ExposureMeter(), 0.0, max(cut, index - EXPOSURE_FRAMES)
        for item in self._shot.frames(start, index + 1, gbuffers=(), references=False):
            exposure = meter.read_frame(item.frame)
        return exposure

    @contextmanager
    def _named(self, index: int) -> Iterator[None]:
        """Add the frame's number to its errors and warnings."""
        number = self._shot.first_number + index
        try:
            with frame_warnings(self._job.console, number):
                yield
        except FrameError as error:
            raise ShotError(self._shot.path, f"frame {number}: {str(error).rstrip('.')}") from error

    def _metadata(self, index: int) -> Metadata:
        shot = self._shot
        return result_metadata(
            shot.read_metadata(index), frame_rate=shot.frame_rate, render_size=shot.render_size,
            display_size=self._display_size,
        )  # fmt: skip

    def _film(self) -> AbstractContextManager[VideoWriter]:
        rate, aspect = self._shot.frame_rate or 24.0, pixel_aspect(self._metadata(0))
        return video_writer(self._results.begin_file(self._results.video), self._display_size, rate, aspect)

    def _write(
        self,
        position: int,
        exposure: float,
        index: int,
        aov_names: Sequence[str] | None,
        result: StepResult,
        seconds: float,
    ) -> Written:
        """Write the files of a frame; on a thread of the queue."""
        job, number = self._job, self._plan.numbers.first + position
        output = OutputImage(
            image=result.image, exposure=exposure, aovs=result.aovs, aov_names=aov_names,
            metadata=self._metadata(index), copied=self.copied(index),
        )  # fmt: skip
        images = job.images if position >= self._first else replace(job.images, formats=("mp4",))
        return Written(position, number, images.write(job.output, number, output), seconds)

    def _finish(self, film: VideoWriter | None, progress: RunProgress, written: Written) -> None:
        if film is not None and written.video_image is not None:
            film.write(written.video_image)
        if written.position >= self._first:
            places = {"index": written.position, "frames": len(self._plan.numbers)}
            progress.event("frame", number=written.number, **places, seconds=round(written.seconds, 4))

    @contextmanager
    def _page(self) -> Iterator[_AddToPage]:
        """Write compare.html; it appears when the block ends without an error."""
        with (
            compare_page(self._results.begin_file(self._results.page), self._about()) as page,
            ExitStack() as stack,
        ):
            layers_of = self.page_layers(stack)

            def add(stepped: SteppedFrame, exposure: float) -> None:
                page.add(self._shot.first_number + stepped.index, *layers_of(stepped, exposure))

            yield add

    def _about(self) -> About:
        """Describe the page."""
        shot, facts = self._shot, self.facts()
        sources = ". ".join(line.rstrip(".") for line in (*shot.info.attribution, shot.info.license) if line)
        return About(
            title=shot.name,
            method=facts["method"],
            display_size=self._display_size,
            frame_rate=shot.frame_rate or 30.0,
            facts={**facts, "frames": str(len(self._plan.numbers))},
            legends={"error": ERROR_LEGEND, **self.legends},
            notes=[
                f"Images show {self._job.images.transform.description}.",
                *_PAGE_NOTES,
                *([f"Shot: {sources}."] if sources else []),
                versions_text(),
            ],
        )
