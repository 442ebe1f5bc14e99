"""Upscale a shot into a folder, frame by frame; a stopped run can continue."""

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import typer

from supersampler.cli.frame_plan import EXPOSURE_FRAMES, FramePlan, Segment
from supersampler.cli.image_options import OutputImage
from supersampler.cli.job import UpscaleJob
from supersampler.cli.output_queue import OutputQueue
from supersampler.cli.profile import print_profile
from supersampler.cli.progress import RunProgress
from supersampler.cli.results import Results
from supersampler.cli.run_page import RunPage, run_page
from supersampler.cli.segment_steps import SegmentSteps
from supersampler.history import StepResult
from supersampler.io.display import ExposureMeter, usable_exposure
from supersampler.io.files import check_apart
from supersampler.io.images import Bytes, Metadata, pixel_aspect, result_metadata
from supersampler.io.machine import StageTimes
from supersampler.io.video import VideoWriter, video_writer
from supersampler.upscaler import Upscaler

COMPARE_FRAMES = 64
"""Number of frames, the last ones, in a page: browsers load larger pages slowly."""


class Written(NamedTuple):
    """A frame of which all files are written."""

    position: int
    number: int
    shown: Bytes | None  # for the video
    seconds: float  # of the step


def run_job(job: UpscaleJob) -> Results:
    """Upscale the frames that are not complete yet, and print a summary.

    Raises:
        typer.Exit: 130 after Ctrl-C; complete frames are kept.
        SupersamplerError: a frame, a file or the model is not usable; or the output lies in the shot, or
            would replace files of another program.
    """
    results = Results(job.output, job.images)
    for written in filter(None, (None if job.holds_shot else job.output, job.record)):
        check_apart(written, job.shot.source)
    with ExitStack() as stack:
        upscaler = stack.enter_context(job.upscaler())
        plan = job.frames(upscaler)
        count = len(plan.numbers)
        upscaler.warm_up()  # raises for an unusable model or ratio before files are overwritten
        first = results.begin(
            job.settings(upscaler), count, overwrite=job.overwrite, page=job.compare, recording=job.record
        )
        if job.record is not None:
            upscaler = stack.enter_context(job.recording_upscaler(upscaler))
        page = job.compare and not (first == count and results.is_newest(results.page))
        video = job.images.video and not (first == count and results.is_newest(results.video))
        if first == count and not (page or video) and job.record is None:
            job.console.print(f"All {count} frames are there already.")
            with RunProgress(job.console, 0, json=job.json) as progress:
                progress.event("begin", shot=job.shot.name, frames=count, complete=count)
                progress.event("end", frames=0, seconds=0.0, cpu_seconds=0.0, stages={})
            return results
        begins = 0 if job.record or video else min(first, count - COMPARE_FRAMES) if page else first
        try:
            _Run(job, upscaler, results, plan, first).upscale(max(begins, 0), page=page, video=video)
        except KeyboardInterrupt:
            complete = results.count_complete(count)
            job.console.print(f"Stopped: {complete} of {count} frames are complete.")
            job.console.print("The same command, given again, continues.")
            raise typer.Exit(130) from None
    return results


class _Run:
    """One run: frames before position `first` are complete, and only rebuild what later ones need."""

    def __init__(
        self, job: UpscaleJob, upscaler: Upscaler, results: Results, plan: FramePlan, first: int
    ) -> None:
        self._job, self._upscaler, self._results, self._plan = job, upscaler, results, plan
        self._first, self._times = first, StageTimes()

    def upscale(self, begins: int, *, page: bool, video: bool) -> None:
        """Step through the frames that lead to those from position `begins` on."""
        job, began, cpu = self._job, time.perf_counter(), time.process_time()
        segments = self._plan.rest(job.shot, begins)
        steps = SegmentSteps(job, self._upscaler, self._times)
        total = sum(steps.count(segment, self._needed(segment, begins)) for segment in segments)
        with (
            run_page(job, self._upscaler, self._results) if page else nullcontext() as compare,
            self._video() if video else nullcontext() as film,
            RunProgress(job.console, total, json=job.json) as progress,
            OutputQueue[Written](partial(self._finish, film, progress)) as queue,
        ):
            progress.event("begin", shot=job.shot.name, frames=len(self._plan.numbers), complete=self._first)
            for segment in segments:
                self._step_through(steps, segment, self._needed(segment, begins), queue, compare, progress)
        if video:
            self._results.end_file(self._results.video, len(self._plan.numbers))
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
        self._print_summary(wall)
        if job.profile:
            print_profile(job.console, self._times, self._upscaler.stats.frames, wall, cpu)
        progress.event(
            "end",
            frames=self._upscaler.stats.frames,
            seconds=round(wall, 3),
            cpu_seconds=round(cpu, 3),
            stages=self._times.to_json(),
        )

    def _video(self) -> AbstractContextManager[VideoWriter]:
        shot, size = self._job.shot, self._upscaler.display_size or self._job.shot.render_size
        path = self._results.begin_file(self._results.video)
        return video_writer(path, size, shot.frame_rate or 24.0, pixel_aspect(self._metadata(0)))

    def _metadata(self, index: int) -> Metadata:
        shot = self._job.shot
        return result_metadata(
            shot.read_metadata(index),
            frame_rate=shot.frame_rate,
            render_size=shot.render_size,
            display_size=self._upscaler.display_size or shot.render_size,
        )

    def _exposure_at(self, segment: Segment) -> float | None:
        """Return the exposure that a run of the whole shot has at the first frame of a segment.

        None where a cut begins it.
        """
        shot, start = self._job.shot, segment.start
        cut = shot.last_cut(start)
        if cut == start:
            return None
        if (stated := usable_exposure(shot.exposure(start))) is not None:
            return stated
        meter, exposure = ExposureMeter(), 0.0
        frames = shot.frames(
            max(cut, start - EXPOSURE_FRAMES), start + 1, gbuffers=(), references=False, times=self._times
        )
        for item in frames:
            frame = item.frame
            with self._times.measure("exposure"):
                exposure = meter.read(
                    frame.color, given=frame.exposure, reset=frame.reset, pre_exposure=frame.pre_exposure
                )
        return exposure

    def _needed(self, segment: Segment, begins: int) -> int:
        """Return the index of the first frame of a segment whose image is needed."""
        index = self._plan.numbers[begins] - self._plan.first_number
        return min(max(index, segment.start), segment.stop)

    def _step_through(
        self,
        steps: SegmentSteps,
        segment: Segment,
        needed: int,
        queue: OutputQueue[Written],
        page: RunPage | None,
        progress: RunProgress,
    ) -> None:
        job, meter = self._job, ExposureMeter()

        def advance(index: int, direction: str) -> None:
            position = self._plan.position(index)
            writes = position is not None and position >= self._first
            what = "upscaling" if writes and index < segment.stop else "replaying"
            what = "stepping backward" if direction == "backward" else what
            progress.advance(what)

        exposure_at_start, references = self._exposure_at(segment), page is not None
        with closing(
            steps.run(segment, exposure_at_start, needed, references=references, on_step=advance)
        ) as stepped:
            for item, aov_names, result, seconds in stepped:
                frame = item.frame
                exposure = meter.read(
                    frame.color, given=frame.exposure, reset=frame.reset, pre_exposure=frame.pre_exposure
                )
                exposure /= frame.pre_exposure  # of the images
                position = self._plan.position(item.index)
                if position is None:
                    continue
                if position >= self._first:
                    self._results.list_files(position)
                if position >= self._first or job.images.video:
                    written = item.index, aov_names, position, result, exposure, seconds
                    queue.put(partial(self._write, *written))
                if page is not None and position >= len(self._plan.numbers) - COMPARE_FRAMES:
                    with self._times.measure("page"):
                        page.add(item, result, exposure)

    def _write(
        self,
        index: int,
        aov_names: Sequence[str] | None,
        position: int,
        result: StepResult,
        exposure: float,
        seconds: float,
    ) -> Written:
        """Write the files of a frame; on a thread of the queue."""
        job, number = self._job, self._plan.numbers[position]
        with self._times.measure("write"):
            output = OutputImage(
                image=result.image,
                exposure=exposure,
                aovs=result.aovs,
                aov_names=aov_names,
                metadata=self._metadata(index),
            )
            images = job.images if position >= self._first else replace(job.images, formats=())
            shown = images.write(job.output, number, output)
        return Written(position, number, shown, seconds)

    def _finish(self, film: VideoWriter | None, progress: RunProgress, written: Written) -> None:
        if film is not None and written.shown is not None:
            with self._times.measure("video"):
                film.write(written.shown)
        if written.position >= self._first:
            progress.event(
                "frame",
                number=written.number,
                index=written.position,
                frames=len(self._plan.numbers),
                seconds=round(written.seconds, 4),
            )

    def _print_summary(self, seconds: float) -> None:
        stats, console = self._upscaler.stats, self._job.console
        rates = f"{stats.frames / seconds:.1f} a second, the method alone {stats.frames / stats.seconds:.1f}"
        console.print(f"{stats.frames} frames in {seconds:.1f} s: {rates}")
        if stats.extrapolated:
            each = stats.extrapolation_seconds / stats.extrapolated
            console.print(f"{stats.extrapolated} were not shaded; extrapolating one took {each:.2f} s")
