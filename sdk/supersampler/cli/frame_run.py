"""Write the images of a run into a folder, frame by frame; a stopped run can be resumed."""

import time
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

import typer
from msgspec.structs import asdict

from supersampler.cli.arguments import size_text
from supersampler.cli.results import (
    FIRST,
    FRAMES,
    OTHER_RUN,
    READ,
    SOURCE,
    FramesRead,
    ImageOptions,
    OutputImage,
    OutputQueue,
    Results,
)
from supersampler.cli.terminal import RunProgress, Terminal, frame_warnings
from supersampler.errors import FrameError, ShotError, SupersamplerError
from supersampler.frame import Float32, Frame, Size
from supersampler.history import StepResult
from supersampler.io.compare import ERROR_LEGEND, About, ComparePage, Legend, compare_page, versions_text
from supersampler.io.display import ExposureMeter, usable_exposure
from supersampler.io.files import FolderLock, check_apart
from supersampler.io.images import Bytes, Channel, Metadata, pixel_aspect, result_metadata
from supersampler.io.shot import Shot
from supersampler.io.shot.numbered import FrameRange
from supersampler.io.video import video_writer
from supersampler.validation.mistakes import OF_SRGB

COMPARE_FRAMES = 64
"""Number of frames in a page, the last ones of the run: browsers load larger pages slowly."""
EXPOSURE_FRAMES = 96
"""Number of frames before a preroll from which the exposure is measured. A measured exposure moves a tenth of
the way in each frame, so that the exposure before these frames has a weight of 0.9^96, 4e-5."""
_PAGE_NOTES = (
    "JPEG of quality 92, small ones PNG. The input is as rendered, with its jitter.",
    "error: mean over r, g, b of |output − reference| of these images. PSNR: of the same images before "
    "rounding to 8 bits, whole frame.",
)


@dataclass(frozen=True)
class FramePlan:
    """The frames of a run.

    Attributes:
        numbers: numbers of the frames to write.
        first_number: number of the frame with index 0.
        start, stop: index of the first frame to step through, which has no history, and after the last.
        end: index after the last frame to read, >= `stop`: with two passes, the backward run begins there.
    """

    numbers: FrameRange
    first_number: int
    start: int
    stop: int
    end: int

    def position(self, index: int) -> int | None:
        """Return the position of the frame with this index among those to write; None for other frames."""
        number = self.first_number + index
        return number - self.numbers.first if number in self.numbers else None

    def index(self, position: int) -> int:
        """Return the index of the frame at a position among those to write."""
        return self.numbers.first + position - self.first_number


@dataclass(frozen=True, kw_only=True)
class FrameJob:
    """Input and output of one run.

    Attributes:
        shot: the frames.
        output: folder of the images.
        source: the options that opened the shot.
        images: names, formats and encodings of the images.
        numbers: numbers of the frames to write; None writes all.
        compare: whether to write the page.
        overwrite: whether to replace the files of an earlier run.
        holds_shot: whether the shot may be in a subfolder of `output`.
        json: whether to print each frame as a line of JSON.
        console: prints messages.
    """

    shot: Shot
    output: Path
    source: Mapping[str, str] = field(default_factory=dict)
    images: ImageOptions = field(default_factory=ImageOptions)
    numbers: FrameRange | None = None
    compare: bool = False
    overwrite: bool = False
    holds_shot: bool = False
    json: bool = False
    console: Terminal = field(default_factory=lambda: Terminal(stderr=True))

    def shot_settings(self) -> dict[str, object]:
        """Return the settings that the images of every method depend on: the frames and the file formats."""
        count = len(self.shot)
        return {
            "shot": str(self.shot.path.resolve()),
            "names": self.shot.info.file_names,
            "frame rate": self.shot.frame_rate,
            **({FIRST: self.shot.first_number} if self.numbers is None else {FRAMES: str(self.numbers)}),
            "render size": size_text(self.shot.render_size),
            "conventions": self.shot.conventions.to_json(),
            **self.images.to_json(),
            SOURCE: dict(self.source),
            READ: asdict(FramesRead(self.shot.first_number, count, self.shot.hashes(count))),
        }

    def kept(self, plan: FramePlan, before: FramesRead) -> int:
        """Return how many of the first images stay valid if an earlier run has read the frames `before`.

        Raises:
            ShotError: the shot has fewer frames, or states other facts about the same ones.
        """
        if before.first != self.shot.first_number:  # with --frames: the history begins with another frame
            return 0
        if before.count > len(self.shot):
            was = f"had frames {before.first} to {before.first + before.count - 1}, has"
            problem = f"images of another run are there: the shot {was} {len(self.shot)} of them"
            raise ShotError(self.output, problem, OTHER_RUN)
        for name, digest in self.shot.hashes(before.count).items():
            if before.hashes.get(name) != digest:
                problem = f"images of another run are there: its frames had other {name}"
                raise ShotError(self.output, problem, OTHER_RUN)
        if before.count == len(self.shot):
            return len(plan.numbers)
        cut = max(plan.start, self.shot.last_cut(before.count - 1))
        settled = before.count - cut
        if self.shot.last_cut(before.count) != before.count:  # the next frame continues the last one
            settled = self.settled(settled)
        return max(0, cut + settled - plan.index(0))

    def settled(self, count: int) -> int:
        """Return how many of the first `count` frames after a cut have images that no later frame changes."""
        return count


def plan_frames(shot: Shot, numbers: FrameRange | None, preroll: int, passes: int = 1) -> FramePlan:
    """Return the plan of a run; ShotError if the shot lacks one of the frames.

    Args:
        shot: the shot.
        numbers: numbers of the frames to write; None writes all.
        preroll: number of frames before them that build the history; fewer after a cut. With two passes, as
            many frames after them build the history of the backward run.
        passes: 1 or 2.
    """
    own = FrameRange(shot.first_number, shot.first_number + len(shot) - 1)
    if numbers is None:
        return FramePlan(own, own.first, 0, len(shot), len(shot))
    for number in (numbers.first, numbers.last):
        if number not in own:
            problem = f"has no frame {number}"
            raise ShotError(shot.path, problem, f"It has frames {own.first} to {own.last}.")
    index, stop = numbers.first - own.first, numbers.last - own.first + 1
    cut = shot.last_cut(index)
    start = max(cut, index - preroll)
    while start > cut and not shot.is_shaded(start):  # history begins with colour
        start -= 1
    end = stop
    while passes == 2 and end < min(stop + preroll, len(shot)) and shot.last_cut(end) != end:
        end += 1
    return FramePlan(numbers, own.first, start, stop, end)


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
    """A frame whose files are written."""

    position: int
    number: int
    video_image: Bytes | None
    seconds: float  # of the step


OnStep: TypeAlias = Callable[[int, str], None]
"""Function that is called after each step with the frame's index and "forward" or "backward"."""
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
        settings: everything that the images depend on, except the number of frames: a shot may still grow.
        begin: returns the run, given the folder and the position of the first incomplete frame.
        all_frames: whether to compute complete frames again.

    Raises:
        typer.Exit: code 130 after Ctrl-C; complete frames are kept.
        SupersamplerError: a frame or a file is not usable; or the output lies in the shot, or would replace
            files of another program.
    """
    if not job.holds_shot:
        check_apart(job.output, job.shot.source)
    with FolderLock(job.output, is_shared=job.numbers is not None) as lock:  # ranges have their own files
        return _run_locked(job, plan, settings, begin, lock, all_frames=all_frames)


def _run_locked(
    job: FrameJob,
    plan: FramePlan,
    settings: Mapping[str, object],
    begin: Callable[[Results, int], "FrameRun[Any]"],
    lock: FolderLock,
    *,
    all_frames: bool,
) -> Results:
    results, count = Results(job.output, job.images), len(plan.numbers)
    kept = partial(job.kept, plan)
    first = results.begin(settings, count, kept, overwrite=job.overwrite, page=job.compare)
    lock.take()  # of a new folder
    for note in _changes(job, plan, results, first):
        job.console.print(note, soft_wrap=True)
    page = job.compare and not (first == count and results.is_newest(results.record.page))
    video = job.images.video and not (first == count and results.is_newest(results.record.video))
    if first == count and not (page or video or all_frames):
        job.console.print(f"All {count} frames are complete already.")
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
        job.console.print("Run the same command to resume.")
        raise typer.Exit(130) from None
    except SupersamplerError:
        results.end_without_files()
        raise
    return results


def _changes(job: FrameJob, plan: FramePlan, results: Results, first: int) -> Iterator[str]:
    """Yield notes on frames that are new, or have changed, since an earlier run wrote `first` images."""
    if results.has_outdated:
        again = f"Images from frame {plan.numbers.first + first} on are computed again"
        yield f"{again}: they depend on new frames."
    for position in range(first):
        changed = job.shot.changed_at(plan.index(position))
        if any(written < changed for written in results.written_at(position)):
            newer = f"Frame {plan.numbers.first + position} has changed since its image was written"
            yield f"{newer}. --overwrite computes all images again."
            return


class FrameRun(Generic[Job]):
    """One run. Frames before position `first` are complete and only rebuild the history of later frames.

    Subclasses yield the frames with their images, and describe the page.

    Attributes:
        activity: name of a step in the progress bar.
        legends: legends of the page's layers other than "error".
        reach: maximum number of frames before a frame that its image depends on; None: all since the cut.
    """

    activity: str
    legends: Mapping[str, Legend] = {}
    reach: int | None = None

    def __init__(self, job: Job, results: Results, plan: FramePlan, first: int, display_size: Size) -> None:
        self._job, self._shot, self._display_size = job, job.shot, display_size
        self._results, self._plan, self._first = results, plan, first

    def step_count(self, plan: FramePlan, needed: int) -> int:
        """Return the number of steps; `needed` is the index of the first frame whose image is needed."""
        raise NotImplementedError

    def steps(
        self, plan: FramePlan, needed: int, on_step: OnStep, *, references: bool
    ) -> Generator["SteppedFrame"]:
        """Yield each frame of a plan with its image; calls `on_step` after each step."""
        raise NotImplementedError

    def summary(self, wall: float) -> tuple[int, str]:
        """Return the number of computed frames, and a line of text on them; `wall` is the time, seconds."""
        raise NotImplementedError

    def facts(self) -> dict[str, str]:
        """Return facts of the run for the page, by name; "method" is one."""
        raise NotImplementedError

    def copied(self, index: int) -> Mapping[str, Channel]:  # noqa: ARG002  # of subclasses
        """Return channels of a frame that its EXR file keeps unchanged; called on threads."""
        return {}

    def layers(self, stepped: SteppedFrame, exposure: float) -> tuple[Mapping[str, Bytes], dict[str, float]]:
        """Return the layers and numbers of a frame for the page, at an exposure."""
        raise NotImplementedError

    def run(self, begins: int, *, page: bool, video: bool) -> None:
        """Compute and write the frames from position `begins` on; frames before them build the history."""
        job, results, began, cpu = self._job, self._results, time.perf_counter(), time.process_time()
        count, needed = len(self._plan.numbers), self._plan.index(begins)
        start = max(self._plan.start, self._shot.last_cut(needed))
        start = start if self.reach is None else max(start, needed - self.reach)
        plan = replace(self._plan, start=start)
        with (
            self._page() if page else nullcontext() as compare,
            self._film() if video else nullcontext() as film,
            RunProgress(job.console, self.step_count(plan, needed), json=job.json) as progress,
            OutputQueue[Written](partial(self._finish, film, progress)) as queue,
        ):
            progress.event("begin", shot=self._shot.name, frames=count, complete=self._first)
            self._write_frames(plan, needed, queue, compare, progress)
        if video:
            results.end_file(results.record.video, count)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
        frames, line = self.summary(wall)
        job.console.print(line)
        progress.event("end", frames=frames, seconds=round(wall, 3), cpu_seconds=round(cpu, 3))

    def _write_frames(
        self,
        plan: FramePlan,
        needed: int,
        queue: OutputQueue[Written],
        page: ComparePage | None,
        progress: RunProgress,
    ) -> None:
        job, meter = self._job, ExposureMeter()

        def on_step(index: int, direction: str) -> None:
            position = plan.position(index)
            writes = position is not None and position >= self._first
            forward = self.activity if writes else "replaying"
            progress.advance("stepping backward" if direction == "backward" else forward)

        steps = self.steps(plan, needed, on_step, references=page is not None)
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
                if page is not None and position >= len(plan.numbers) - COMPARE_FRAMES:
                    page.add(self._shot.first_number + stepped.index, *self.layers(stepped, exposure))

    def _exposure_at(self, index: int) -> float | None:
        """Return the exposure of a frame in a run of the whole shot; None if a cut begins at the frame."""
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
    def _named(self, index: int, only: Collection[str] | None = None) -> Iterator[None]:
        """Add the frame's number to its errors and warnings; `only` some kinds of warnings are printed."""
        number = self._shot.first_number + index
        ignored = OF_SRGB if self._shot.conventions.srgb else ()
        try:
            with frame_warnings(self._job.console, number, ignored, only):
                yield
        except FrameError as error:
            raise ShotError(self._shot.path, f"frame {number}: {error}") from error

    def _metadata(self, index: int) -> Metadata:
        shot = self._shot
        return result_metadata(
            shot.read_metadata(index), frame_rate=shot.frame_rate, render_size=shot.render_size,
            display_size=self._display_size,
        )  # fmt: skip

    def _film(self) -> AbstractContextManager[Callable[[Bytes], None]]:
        rate, aspect = self._shot.frame_rate or 24.0, pixel_aspect(self._metadata(0))
        path = self._results.begin_file(self._results.record.video)
        return video_writer(path, self._display_size, rate, aspect)

    def _write(
        self,
        position: int,
        exposure: float,
        index: int,
        aov_names: Sequence[str] | None,
        result: StepResult,
        seconds: float,
    ) -> Written:
        """Write the files of a frame, on a thread of the queue."""
        job, number = self._job, self._plan.numbers.first + position
        output = OutputImage(
            image=result.image, exposure=exposure, aovs=result.aovs, aov_names=aov_names,
            metadata=self._metadata(index), copied=self.copied(index),
        )  # fmt: skip
        images = job.images if position >= self._first else replace(job.images, formats=("mp4",))
        return Written(position, number, images.write(job.output, number, output), seconds)

    def _finish(self, film: Callable[[Bytes], None] | None, progress: RunProgress, written: Written) -> None:
        if film is not None and written.video_image is not None:
            film(written.video_image)
        if written.position >= self._first:
            places = {"index": written.position, "frames": len(self._plan.numbers)}
            progress.event("frame", number=written.number, **places, seconds=round(written.seconds, 4))

    def _page(self) -> AbstractContextManager[ComparePage]:
        shot, facts = self._shot, self.facts()
        sources = ". ".join(line.rstrip(".") for line in (*shot.info.attribution, shot.info.license) if line)
        about = About(
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
        return compare_page(self._results.begin_file(self._results.record.page), about)
