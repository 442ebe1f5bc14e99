"""Upscale a shot into a folder, frame by frame; a stopped run can continue."""

import time
from collections import deque
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import islice

from supersampler.aux_outputs import LEGENDS, aux_output_layers
from supersampler.cli.arguments import size_text
from supersampler.cli.frame_run import FrameRun, Layers, OnStep, PageLayers, SteppedFrame, run_frames
from supersampler.cli.job import FramePlan, UpscaleJob
from supersampler.cli.results import Results
from supersampler.errors import ShotError
from supersampler.frame import Frame
from supersampler.history import StepResult
from supersampler.io.compare import compare_layers
from supersampler.io.files import check_apart, is_there
from supersampler.io.shot import ShotFrame
from supersampler.sequence.both_ways import BothWays, ChunkSize, buffers_of
from supersampler.sequence.interpolation import interpolator_of
from supersampler.upscaler import Upscaler


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

        def begin(results: Results, first: int) -> FrameRun[UpscaleJob]:
            used = upscaler
            if job.record is not None:
                extra = {"extrapolation": job.extrapolation, "record": job.record}
                used = stack.enter_context(job.upscaler_like(upscaler, validate=job.validate, **extra))
            return _UpscaleRun(job, used, results, plan, first)

        return run_frames(job, plan, job.settings(upscaler), begin, all_frames=job.record is not None)


class _UpscaleRun(FrameRun[UpscaleJob]):
    activity = "upscaling"
    legends = LEGENDS

    def __init__(
        self, job: UpscaleJob, upscaler: Upscaler, results: Results, plan: FramePlan, first: int
    ) -> None:
        super().__init__(job, results, plan, first, upscaler.display_size or job.shot.render_size)
        self._upscaler, self._chunk = upscaler, ChunkSize()

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

    def facts(self) -> dict[str, str]:
        model, size = self._upscaler.model, self._display_size
        provider = model.providers[0].removesuffix("ExecutionProvider")
        return {
            "method": model.info.method,
            "size": f"{size_text(self._shot.render_size)} to {size_text(size)}".replace("x", " × "),
            "runs on": f"{provider} ({model.executor}, {model.precision})",
        }

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
