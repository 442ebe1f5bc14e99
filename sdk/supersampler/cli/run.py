"""Upscale a shot into a folder, frame by frame; a stopped run can continue."""

import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import NamedTuple, TypeAlias

import typer

from supersampler.aux_outputs import LEGENDS, aux_output_layers
from supersampler.cli.arguments import size_text
from supersampler.cli.job import EXPOSURE_FRAMES, FrameJob, FramePlan, UpscaleJob
from supersampler.cli.results import OutputImage, OutputQueue, Results
from supersampler.cli.terminal import RunProgress, frame_warnings
from supersampler.errors import FrameError, ShotError
from supersampler.frame import Float32, Frame, Size
from supersampler.history import StepResult
from supersampler.io.compare import ERROR_LEGEND, About, compare_layers, compare_page, versions_text
from supersampler.io.display import ExposureMeter, usable_exposure
from supersampler.io.files import check_apart, is_there
from supersampler.io.images import Bytes, Channel, Metadata, pixel_aspect, result_metadata
from supersampler.io.shot import ShotFrame
from supersampler.io.video import VideoWriter, video_writer
from supersampler.sequence.both_ways import BothWays, ChunkSize, buffers_of
from supersampler.sequence.interpolation import interpolator_of
from supersampler.upscaler import Upscaler

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


def run_job(job: UpscaleJob) -> Results:
    """Upscale the frames that are not complete yet, and print a summary.

    Raises:
        typer.Exit: 130 after Ctrl-C; complete frames are kept.
        SupersamplerError: a frame, a file or the model is not usable; or the output lies in the shot, or
            would replace files of another program.
    """
    if job.record is not None:
        check_apart(job.record, job.shot.source)
    with ExitStack() as stack:
        upscaler = stack.enter_context(job.upscaler())
        plan = job.plan(upscaler)
        upscaler.warm_up()  # raises for an unusable model or ratio before files are overwritten
        if job.record is not None and is_there(job.record):
            raise ShotError(job.record, "is there already", "Choose another name, or move it away.")

        def begin(results: Results, first: int) -> FrameRun:
            used = upscaler
            if job.record is not None:
                extra = {"extrapolation": job.extrapolation, "record": job.record}
                used = stack.enter_context(job.upscaler_like(upscaler, validate=job.validate, **extra))
            return _UpscaleRun(job, used, results, plan, first)

        return run_frames(job, plan, job.settings(upscaler), begin, all_frames=job.record is not None)


def run_frames(
    job: FrameJob,
    plan: FramePlan,
    settings: Mapping[str, object],
    begin: Callable[[Results, int], "FrameRun"],
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


class FrameRun:
    """One run: frames before position `first` are complete, and only rebuild the history of later ones.

    Subclasses yield the frames with their images, and describe the page.

    Attributes:
        activity: what progress calls a step.
    """

    activity: str

    def __init__(
        self, job: FrameJob, results: Results, plan: FramePlan, first: int, display_size: Size
    ) -> None:
        self._frame_job, self._shot, self._display_size = job, job.shot, display_size
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

    def about(self) -> About:
        """Describe the page."""
        raise NotImplementedError

    def copied(self, index: int) -> Mapping[str, Channel]:  # noqa: ARG002  # of subclasses
        """Return channels of a frame that its result holds as they are; called on threads."""
        return {}

    def page_layers(self, stack: ExitStack) -> PageLayers:
        """Return what makes layers and numbers of a frame for the page; `stack` ends with the page."""
        raise NotImplementedError

    def run(self, begins: int, *, page: bool, video: bool) -> None:
        """Compute the frames that lead to those from position `begins` on, and write them."""
        job, results, began, cpu = self._frame_job, self._results, time.perf_counter(), time.process_time()
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
        job, meter = self._frame_job, ExposureMeter()

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
            with frame_warnings(self._frame_job.console, number):
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
        job, number = self._frame_job, self._plan.numbers.first + position
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
            compare_page(self._results.begin_file(self._results.page), self.about()) as page,
            ExitStack() as stack,
        ):
            layers_of = self.page_layers(stack)

            def add(stepped: SteppedFrame, exposure: float) -> None:
                page.add(self._shot.first_number + stepped.index, *layers_of(stepped, exposure))

            yield add


class _UpscaleRun(FrameRun):
    activity = "upscaling"

    def __init__(
        self, job: UpscaleJob, upscaler: Upscaler, results: Results, plan: FramePlan, first: int
    ) -> None:
        super().__init__(job, results, plan, first, upscaler.display_size or job.shot.render_size)
        self._job, self._upscaler = job, upscaler
        self._chunk = ChunkSize()

    def plan_from(self, begins: int) -> FramePlan:
        return self._plan.from_position(self._shot, begins)

    def steps(
        self, plan: FramePlan, needed: int, on_step: OnStep, *, references: bool
    ) -> Generator[SteppedFrame]:
        if self._job.passes == 1:
            return self._in_order(plan, on_step, references=references)
        return self._both_ways(plan, needed, on_step, references=references)

    def summary(self, wall: float) -> tuple[int, str]:
        stats = self._upscaler.stats
        rates = f"{stats.frames / wall:.1f} per second; the steps alone {stats.frames / stats.seconds:.1f}"
        line = f"{stats.frames} frames in {wall:.1f} s: {rates}"
        if stats.extrapolated:
            each = stats.extrapolation_seconds / stats.extrapolated
            line += f"\n{stats.extrapolated} were not shaded; extrapolating one took {each:.2f} s"
        return stats.frames, line

    def about(self) -> About:
        job, shot, model, size = self._job, self._shot, self._upscaler.model, self._display_size
        provider = model.providers[0].removesuffix("ExecutionProvider")
        sources = ". ".join(line.rstrip(".") for line in (*shot.info.attribution, shot.info.license) if line)
        return About(
            title=shot.name,
            method=model.info.method,
            display_size=size,
            frame_rate=shot.frame_rate or 30.0,
            facts={
                "method": model.info.method,
                "size": f"{size_text(shot.render_size)} to {size_text(size)}".replace("x", " × "),
                "runs on": f"{provider} ({model.executor}, {model.precision})",
                "frames": str(len(job.numbers or shot)),
            },
            legends={"error": ERROR_LEGEND, **LEGENDS},
            notes=[
                f"Images show {job.images.transform.description}.",
                *_PAGE_NOTES,
                *([f"Shot: {sources}."] if sources else []),
                versions_text(),
            ],
        )

    def page_layers(self, stack: ExitStack) -> PageLayers:
        job, size = self._job, self._display_size
        bicubic = stack.enter_context(
            Upscaler("bicubic", display_size=size, threads=job.threads, validate="off")
        )

        def layers_of(stepped: SteppedFrame, exposure: float) -> tuple[Layers, Mapping[str, float]]:
            frame, image = stepped.frame, stepped.result.image
            plain = None if frame.color is None else bicubic.step(frame)
            layers, numbers = compare_layers(
                frame, image, stepped.reference, exposure, bicubic=plain, transform=job.images.transform
            )
            return {**layers, **aux_output_layers(stepped.result)}, numbers

        return layers_of

    def step_count(self, plan: FramePlan, needed: int) -> int:
        total, start = plan.stop - plan.start, plan.start
        while self._job.passes == 2 and start < plan.end:
            stop = start + 1
            while stop < plan.end and self._shot.last_cut(stop) != stop:
                stop += 1
            skipped = max(0, needed - start) // self._chunk.frames * self._chunk.frames  # whole chunks
            total += self._chunk.backward_steps(max(0, stop - start - skipped))
            start = stop
        return total

    def _in_order(self, plan: FramePlan, on_step: OnStep, *, references: bool) -> Generator[SteppedFrame]:
        """Yield each frame of a segment with the outputs of its step."""
        upscaler, extrapolates = self._upscaler, self._job.extrapolation is not None
        for item in self._frames(plan, upscaler.gbuffers, references=references):
            frame, before = item.frame, upscaler.stats.seconds
            step = upscaler.extrapolate if extrapolates and frame.color is None else upscaler.step
            aovs = () if frame.aovs is None else ("aovs",)
            with self._named(item.index):
                result = step(frame, outputs=(*self._maps(), *aovs))
            result = result if isinstance(result, StepResult) else StepResult(result)
            seconds, names = upscaler.stats.seconds - before, item.raw.aov_names
            yield SteppedFrame(item.index, frame, item.reference, names, result, seconds)
            on_step(item.index, "forward")

    def _both_ways(
        self, plan: FramePlan, needed: int, on_step: OnStep, *, references: bool
    ) -> Generator[SteppedFrame]:
        """Yield each frame of a segment with the merged outputs of a forward and a backward run.

        Chunks before `needed`, the index of the first frame whose image is needed, have no backward run.
        """
        job, forward, start = self._job, self._upscaler, plan.start
        interpolator = None if job.extrapolation is None else interpolator_of(job.extrapolation, forward)
        buffers = buffers_of(forward, interpolator)
        aov_names: deque[Sequence[str] | None] = deque()

        def read() -> Iterator[Frame]:
            for item in self._frames(plan, buffers, references=False):
                aov_names.append(item.raw.aov_names)
                yield item.frame

        @contextmanager
        def around(place: int, direction: str) -> Iterator[None]:
            with self._named(start + place):
                yield
            on_step(start + place, direction)

        with job.upscaler_like(forward, validate="off") as backward:  # the forward run checks the frames
            outputs = "aovs", *self._maps()
            runs = BothWays(
                forward, backward, self._chunk, outputs=outputs, around=around, interpolator=interpolator,
                scratch=job.scratch,
            )  # fmt: skip
            merged, before = runs.run(read(), skip=needed - start), time.perf_counter()
            written = islice(merged, plan.stop - start)  # later ones began the backward run
            for index, (frame, result) in enumerate(written, start):
                reference = self._shot.read_reference(index) if references else None
                seconds = time.perf_counter() - before
                yield SteppedFrame(index, frame, reference, aov_names.popleft(), result, seconds)
                before = time.perf_counter()

    def _frames(self, plan: FramePlan, gbuffers: Collection[str], *, references: bool) -> Iterator[ShotFrame]:
        exposure = self._exposure_at(plan.start)
        frames = self._shot.frames(plan.start, plan.end, gbuffers=gbuffers, references=references)
        for item in frames:
            if item.index == plan.start and exposure is not None:
                item = replace(item, frame=replace(item.frame, reset=True, exposure=exposure))
            yield item

    def _maps(self) -> tuple[str, ...]:
        return tuple(self._upscaler.model.info.maps) if self._job.maps else ()
