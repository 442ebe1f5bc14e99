"""Write the images of a run into a folder, frame by frame; a stopped run can be resumed."""

import time
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import ClassVar, NamedTuple

import typer

from supersampler.cli.results import OTHER_RUN, FramesRead, ImageOptions, OutputImage, OutputQueue, Results
from supersampler.cli.terminal import RunProgress, Terminal, frame_warnings
from supersampler.errors import FrameError, ShotError, SupersamplerError
from supersampler.frame import Float32, Frame, Size
from supersampler.history import StepResult
from supersampler.io.compare import ERROR_LEGEND, About, ComparePage, Legend, compare_page, versions_text
from supersampler.io.display import ExposureMeter, usable_exposure
from supersampler.io.display_transforms import DisplayTransform
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


@dataclass(kw_only=True, eq=False)
class FrameRun:
    """One run: its input, its settings and its output folder.

    Subclasses compute the images: their `write` calls `write_frames`.

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
        activity: name of a step in the progress bar.
        legends: legends of the page's layers other than "error".
        reach: maximum number of frames before a frame that its image depends on; None: all since the cut.
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
    activity: ClassVar[str]
    legends: ClassVar[Mapping[str, Legend]] = {}
    reach: ClassVar[int | None] = None
    _plan: FramePlan = field(init=False)
    _image_size: Size = field(init=False)
    _results: Results = field(init=False)
    _first: int = field(init=False)  # position of the first incomplete frame
    _needed: int = field(init=False)  # index of the first frame whose image is needed
    _progress: RunProgress = field(init=False)

    def write(self) -> Results:
        """Compute and write the frames that are not complete yet, and print a summary."""
        raise NotImplementedError

    def _begin(self) -> None:
        """Prepare the steps; called if a frame, the page or the video is to be written."""

    def _settled(self, count: int) -> int:
        """Return how many of the first `count` frames after a cut have images that no later frame changes."""
        return count

    def _step_count(self) -> int:
        """Return the number of steps."""
        raise NotImplementedError

    def _steps(self, *, references: bool) -> Generator[SteppedFrame]:
        """Yield each frame of the plan with its image; calls `_count_step` after each step."""
        raise NotImplementedError

    def _summary(self, wall: float) -> tuple[int, str]:
        """Return the number of computed frames, and a line of text on them; `wall` is the time, seconds."""
        raise NotImplementedError

    def _facts(self) -> dict[str, str]:
        """Return facts of the run for the page, by name; "method" is one."""
        raise NotImplementedError

    def _copied(self, index: int) -> Mapping[str, Channel]:  # noqa: ARG002  # of subclasses
        """Return channels of a frame that its EXR file keeps unchanged; called on threads."""
        return {}

    def _layers(self, stepped: SteppedFrame, exposure: float) -> tuple[Mapping[str, Bytes], dict[str, float]]:
        """Return the layers and numbers of a frame for the page, at an exposure."""
        raise NotImplementedError

    def plan_frames(self, preroll: int, passes: int = 1) -> FramePlan:
        """Return the plan of the run; ShotError if the shot lacks one of the frames.

        `preroll` is the number of frames before `numbers` that build the history; fewer after a cut. With two
        passes, as many frames after them build the history of the backward run.
        """
        shot, numbers = self.shot, self.numbers
        own = FrameRange(shot.first_number, shot.first_number + len(shot) - 1)
        if numbers is None:
            return FramePlan(own, own.first, 0, len(shot), len(shot))
        for number in (numbers.first, numbers.last):
            if number not in own:
                is_early = number < own.first  # `own` may lack frames that were not asked for
                ends = f"begins with frame {own.first}" if is_early else f"ends with frame {own.last}"
                raise ShotError(shot.path, f"has no frame {number}", f"It {ends}.")
        index, stop = numbers.first - own.first, numbers.last - own.first + 1
        cut = shot.last_cut(index)
        start = max(cut, index - preroll)
        while start > cut and not shot.is_shaded(start):  # history begins with colour
            start -= 1
        end = stop
        while passes == 2 and end < min(stop + preroll, len(shot)) and shot.last_cut(end) != end:
            end += 1
        return FramePlan(numbers, own.first, start, stop, end)

    def write_frames(
        self,
        plan: FramePlan,
        image_size: Size,
        settings: Mapping[str, object],
        *,
        all_frames: bool = False,
    ) -> Results:
        """Write the frames of a plan that are not complete yet.

        Args:
            plan: the frames.
            image_size: (width, height) of the images.
            settings: everything that the images depend on, except the number of frames: a shot may still
                grow.
            all_frames: whether to compute complete frames again.

        Raises:
            typer.Exit: code 130 after Ctrl-C; complete frames are kept.
            SupersamplerError: a frame or a file is not usable; or the output lies in the shot, or would
                replace files of another program.
        """
        self._plan, self._image_size = plan, image_size
        if not self.holds_shot:
            check_apart(self.output, self.shot.source)
        is_range = self.numbers is not None  # which has its own files
        with FolderLock(self.output, is_shared=is_range) as lock:
            return self._write_locked(settings, lock, all_frames=all_frames)

    def _write_locked(self, settings: Mapping[str, object], lock: FolderLock, *, all_frames: bool) -> Results:
        self._results, count = Results(self.output, self.images), len(self._plan.numbers)
        results = self._results
        self._first = first = results.begin(
            settings, count, self._kept, lock, overwrite=self.overwrite, page=self.compare
        )
        for note in self._changes():
            self.console.print(note, soft_wrap=True)
        page = self.compare and not (first == count and results.is_newest(results.record.page))
        video = self.images.video and not (first == count and results.is_newest(results.record.video))
        if self.images.video and not video:
            results.end_file(results.record.video, count)  # a run killed after its video has not stored it
        if first == count and not (page or video or all_frames):
            self.console.print(f"All {count} frames are complete already.")
            with RunProgress(self.console, 0, json=self.json) as progress:
                progress.event("begin", shot=self.shot.name, frames=count, complete=count)
                progress.event("end", frames=0, seconds=0.0, cpu_seconds=0.0)
            return results
        begins = 0 if all_frames or video else min(first, count - COMPARE_FRAMES) if page else first
        try:
            self._begin()
            self._run(max(begins, 0), page=page, video=video)
        except KeyboardInterrupt:
            complete = results.count_complete(count)
            results.end_without_files()
            self.console.print(f"Stopped: {complete} of {count} frames are complete.")
            self.console.print("Run the same command to resume.")
            raise typer.Exit(130) from None
        except SupersamplerError:
            results.end_without_files()
            raise
        return results

    def _kept(self, before: FramesRead) -> int:
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
            return len(self._plan.numbers)
        cut = max(self._plan.start, self.shot.last_cut(before.count - 1))
        settled = before.count - cut
        if self.shot.last_cut(before.count) != before.count:  # the next frame continues the last one
            settled = self._settled(settled)
        return max(0, cut + settled - self._plan.index(0))

    def _changes(self) -> Iterator[str]:
        """Yield notes on frames that are new, or have changed, since an earlier run wrote their images."""
        numbers = self._plan.numbers
        if self._results.has_outdated:
            again = f"Images from frame {numbers.first + self._first} on are computed again"
            yield f"{again}: they depend on new frames, or another run has replaced them."
        for position in range(self._first):
            changed = self.shot.changed_at(self._plan.index(position))
            if any(written < changed for written in self._results.written_at(position)):
                newer = f"Frame {numbers.first + position} has changed since its image was written"
                yield f"{newer}. --overwrite computes all images again."
                return

    def _run(self, begins: int, *, page: bool, video: bool) -> None:
        """Compute and write the frames from position `begins` on; frames before them build the history."""
        results, began, cpu = self._results, time.perf_counter(), time.process_time()
        count, self._needed = len(self._plan.numbers), self._plan.index(begins)
        start = max(self._plan.start, self.shot.last_cut(self._needed))
        start = start if self.reach is None else max(start, self._needed - self.reach)
        self._plan = replace(self._plan, start=start)
        with (
            self._page() if page else nullcontext() as compare,
            self._film() if video else nullcontext() as film,
            RunProgress(self.console, self._step_count(), json=self.json) as progress,
            OutputQueue[Written](partial(self._finish, film)) as queue,
        ):
            self._progress = progress
            progress.event("begin", shot=self.shot.name, frames=count, complete=self._first)
            self._queue_frames(queue, compare)
        if video:
            results.end_file(results.record.video, count)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
        frames, line = self._summary(wall)
        self.console.print(line)
        progress.event("end", frames=frames, seconds=round(wall, 3), cpu_seconds=round(cpu, 3))

    def _queue_frames(self, queue: OutputQueue[Written], page: ComparePage | None) -> None:
        plan, meter, exposure = self._plan, ExposureMeter(), 1.0
        with closing(self._steps(references=page is not None)) as steps:
            for stepped in steps:
                if self._measures_exposure:
                    exposure = meter.read_frame(stepped.frame) / stepped.frame.pre_exposure  # of the images
                position = plan.position(stepped.index)
                if position is None:
                    continue
                if position >= self._first:
                    self._results.list_files(position)
                if position >= self._first or self.images.video:
                    images = replace(self.images, transform=self._transform(stepped.frame))
                    values = stepped.index, stepped.aov_names, stepped.result, stepped.seconds
                    queue.put(partial(self._write, position, images, exposure, *values))
                if page is not None and position >= len(plan.numbers) - COMPARE_FRAMES:
                    page.add(self.shot.first_number + stepped.index, *self._layers(stepped, exposure))

    @property
    def _measures_exposure(self) -> bool:
        """Whether a file shows images at the exposure of their frame."""
        shows = self.compare or {*self.images.formats} != {"exr"}
        return shows and self.images.transform.stops is None

    def _count_step(self, index: int, direction: str = "forward") -> None:
        """Show that a step on the frame with this index is done."""
        position = self._plan.position(index)
        writes = position is not None and position >= self._first
        forward = self.activity if writes else "replaying"
        self._progress.advance("stepping backward" if direction == "backward" else forward)

    def _exposure_at(self, index: int, begins: int) -> float | None:
        """Return the exposure of a frame in a run of the whole shot; None if a cut begins at the frame.

        It is measured from EXPOSURE_FRAMES before `begins` on, the index at which an uninterrupted run
        starts, so that a resumed run has the same exposure.
        """
        cut = self.shot.last_cut(index)
        if cut == index:
            return None
        if (stated := usable_exposure(self.shot.exposure(index))) is not None:
            return stated
        meter, exposure, start = ExposureMeter(), 0.0, max(cut, begins - EXPOSURE_FRAMES)
        for item in self.shot.frames(start, index + 1, gbuffers=(), references=False):
            exposure = meter.read_frame(item.frame)
        return exposure

    @contextmanager
    def _named(self, index: int, only: Collection[str] | None = None) -> Iterator[None]:
        """Add the frame's number to its errors and warnings; `only` some kinds of warnings are printed."""
        number = self.shot.first_number + index
        ignored = OF_SRGB if self.shot.conventions.srgb else ()
        try:
            with frame_warnings(self.console, number, ignored, only):
                yield
        except FrameError as error:
            raise ShotError(self.shot.path, f"frame {number}: {error}") from error

    def _metadata(self, index: int) -> Metadata:
        shot = self.shot
        return result_metadata(
            shot.read_metadata(index), frame_rate=shot.frame_rate, render_size=shot.render_size,
            display_size=self._image_size,
        )  # fmt: skip

    def _film(self) -> AbstractContextManager[Callable[[Bytes], None]]:
        rate, aspect = self.shot.frame_rate or 24.0, pixel_aspect(self._metadata(0))
        path = self._results.begin_file(self._results.record.video)
        return video_writer(path, self._image_size, rate, aspect)

    def _transform(self, frame: Frame) -> DisplayTransform:
        """Return the display transform of a frame's images."""
        return self.images.transform.at_pre_exposure(frame.pre_exposure)

    def _write(
        self,
        position: int,
        images: ImageOptions,
        exposure: float,
        index: int,
        aov_names: Sequence[str] | None,
        result: StepResult,
        seconds: float,
    ) -> Written:
        """Write the files of a frame, on a thread of the queue."""
        number = self._plan.numbers.first + position
        output = OutputImage(
            image=result.image, exposure=exposure, aovs=result.aovs, aov_names=aov_names,
            metadata=self._metadata(index), copied=self._copied(index),
        )  # fmt: skip
        images = images if position >= self._first else replace(images, formats=("mp4",))
        return Written(position, number, images.write(self.output, number, output), seconds)

    def _finish(self, film: Callable[[Bytes], None] | None, written: Written) -> None:
        if film is not None and written.video_image is not None:
            film(written.video_image)
        if written.position >= self._first:
            places = {"index": written.position, "frames": len(self._plan.numbers)}
            self._progress.event("frame", number=written.number, **places, seconds=round(written.seconds, 4))

    def _page(self) -> AbstractContextManager[ComparePage]:
        shot, facts = self.shot, self._facts()
        sources = ". ".join(line.rstrip(".") for line in (*shot.info.attribution, shot.info.license) if line)
        about = About(
            title=shot.name,
            method=facts["method"],
            display_size=self._image_size,
            frame_rate=shot.frame_rate or 30.0,
            facts={**facts, "frames": str(len(self._plan.numbers))},
            legends={"error": ERROR_LEGEND, **self.legends},
            notes=[
                f"Images show {self.images.transform.description}.",
                *_PAGE_NOTES,
                *([f"Shot: {sources}."] if sources else []),
                versions_text(),
            ],
        )
        return compare_page(self._results.begin_file(self._results.record.page), about)
