"""Upscale a shot into a folder, frame by frame; a stopped run can be resumed."""

import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Literal

from supersampler import __version__
from supersampler.arguments import AtRest, Precision, PresetName
from supersampler.aux_outputs import LEGENDS, aux_output_layers
from supersampler.cli import frame_run
from supersampler.cli.arguments import size_text
from supersampler.cli.frame_run import FrameJob, FramePlan, FrameRun, OnStep, SteppedFrame
from supersampler.cli.results import AT_REST, PREROLL, Results
from supersampler.cli.terminal import rate_text
from supersampler.conventions import jitter_phase_count
from supersampler.errors import ShotError
from supersampler.frame import Frame, Size
from supersampler.history import StepResult
from supersampler.io.compare import compare_layers
from supersampler.io.files import check_apart, is_there
from supersampler.io.images import Bytes
from supersampler.io.shot import Shot, ShotFrame
from supersampler.io.shot.numbered import FrameRange
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.model import Model
from supersampler.sequence.both_ways import BothWays, ChunkSize
from supersampler.upscaler import Upscaler, preset_model

MIN_PREROLL, MAX_PREROLL = 32, jitter_phase_count(4.0)
"""Bounds of the default preroll, in frames."""


@dataclass(frozen=True, kw_only=True)
class UpscaleJob(FrameJob):
    """Input, settings and output of one run that upscales.

    Attributes:
        preroll: number of frames before the written ones that build the history. None with `numbers` is
            `default_preroll`; without `numbers`, the history begins with the shot.
        model: name or folder.
        display_size: (width, height) of the images. None without `scale` takes the shot's, else the model's
            only ratio, else 2x.
        scale: display over render size, instead of `display_size`.
        maps: whether the page also shows auxiliary outputs.
        providers, threads, precision, preset, validate, skip: see `Upscaler`.
        at_rest: see `Upscaler`; None is "converge", or "off" with a preroll.
        passes: 2 merges a forward and a backward run.
        scratch: folder for frames that wait for the second pass; None is the system's.
        extrapolation: name or folder of the model for unshaded frames.
        record: new folder to record all frames to.
    """

    preroll: int | None = None
    model: str | Path | None = None
    display_size: Size | None = None
    scale: float | None = None
    maps: bool = False
    providers: str | Sequence[str] = "auto"
    threads: int = 0
    precision: Precision = "auto"
    at_rest: AtRest | None = None
    skip: bool = True
    preset: PresetName | None = None
    passes: int = 1
    scratch: Path | None = None
    extrapolation: str | Path | None = None
    validate: Literal["off", "warn", "strict"] = "warn"
    record: Path | None = None

    @property
    def _has_preroll(self) -> bool:
        """Whether the history depends on the preroll alone, so that chunks of a shot have equal images."""
        return self.numbers is not None or self.preroll is not None

    def upscaler(self) -> Upscaler:
        """Return the Upscaler of the run."""
        model, precision = preset_model(self.preset, self.model, self.precision)
        size = self.display_size or (self.shot.display_size if self.scale is None else None)
        info = model.info if isinstance(model, Model) else read_model_info(find_model(model))
        return Upscaler(
            model,
            display_size=size,
            scale=None if size else (info.only_ratio or 2.0) if self.scale is None else self.scale,
            render_size=self.shot.render_size,
            providers=self.providers,
            threads=self.threads,
            precision=precision,
            at_rest=self.at_rest or ("off" if self._has_preroll else "converge"),
            skip=self.skip,
            extrapolation=self.extrapolation if self.passes == 1 else None,
            validate=self.validate,
        )

    def upscaler_like(self, other: Upscaler, **arguments: Any) -> Upscaler:
        """Return an Upscaler with the model, sizes and static mode of another one, and these arguments."""
        return Upscaler(
            other.model, display_size=other.display_size, render_size=self.shot.render_size,
            at_rest=other.at_rest, skip=other.skip, **arguments,
        )  # fmt: skip

    def settings(self, upscaler: Upscaler) -> dict[str, object]:
        """Return the settings for `run_frames`."""
        name, model = self.extrapolation, upscaler.model
        return {
            "supersampler": __version__,
            "method": model.info.method,
            "model files": dict(model.info.files),
            "providers": list(model.providers),
            "executor": model.executor,
            "precision": model.precision,
            **self.shot_settings(),
            PREROLL: self.preroll_of(upscaler) if self._has_preroll else None,
            AT_REST: upscaler.at_rest,
            "passes": None if self.passes == 1 else self.passes,
            "extrapolation": None if name is None else dict(read_model_info(find_model(name)).files),
            "display size": size_text(upscaler.display_size),
        }

    def settled(self, count: int) -> int:
        """Return the number of images that later frames do not change; see `FrameJob`."""
        return count if self.passes == 1 else ChunkSize().settled(count)

    def preroll_of(self, upscaler: Upscaler) -> int:
        """Return the number of frames of the preroll."""
        size = upscaler.display_size or self.shot.render_size
        return default_preroll(size[0] / self.shot.render_size[0]) if self.preroll is None else self.preroll


def default_preroll(scale: float) -> int:
    """Return the number of frames that build the history of a range: one jitter period, at least 32.

    docs/how-to/farm.md compares the images with a run of the whole shot. `scale` is display size /
    render size.
    """
    return min(max(MIN_PREROLL, jitter_phase_count(scale)), MAX_PREROLL)


def open_for(
    numbers: FrameRange, preroll: int | None, open_frames: Callable[[tuple[int, int]], Shot], passes: int = 1
) -> tuple[Shot, str]:
    """Open the frames of a shot that a run reads; missing frames elsewhere do not matter.

    Args:
        numbers: numbers of the frames to write.
        preroll: frames before them that build the history; None is the default of the ratio.
        open_frames: opens the frames from a first to a last number; ShotError if one is missing.
        passes: 2 also opens frames after the range, for the backward run.

    Returns:
        The shot, and a note or "". If a frame before the preroll or after the range is missing, the shot
        begins with the preroll and ends with the range, and the note says so.
    """
    before = (MAX_PREROLL if preroll is None else preroll) + frame_run.EXPOSURE_FRAMES
    min_before = MIN_PREROLL if preroll is None else preroll
    after = min_before if passes == 2 else 0
    try:
        return open_frames((numbers.first - before, numbers.last + after)), ""
    except ShotError as error:
        try:
            shot = open_frames((numbers.first - min_before, numbers.last))
        except ShotError:
            open_frames((numbers.first, numbers.last))  # an error about the range itself names its numbers
            raise
        return shot, f"History and exposure begin at frame {shot.first_number}: {error.problem}."


def run_upscale(job: UpscaleJob) -> Results:
    """Upscale the frames that are not complete yet, and print a summary; for errors see `run_frames`."""
    if job.record is not None:
        check_apart(job.record, job.shot.source)
        if job.output.resolve().is_relative_to(job.record.resolve()):
            raise ShotError(job.record, f"is or holds the output, {job.output}", "Choose another folder.")
    with ExitStack() as stack:
        upscaler = stack.enter_context(job.upscaler())
        plan = frame_run.plan_frames(job.shot, job.numbers, job.preroll_of(upscaler), job.passes)
        upscaler.warm_up()  # raises for an unusable model or ratio before files are overwritten
        if job.record is not None and is_there(job.record):
            raise ShotError(job.record, "already exists", "Choose another name, or move it away.")

        def begin(results: Results, first: int) -> FrameRun[UpscaleJob]:
            used, bicubic = upscaler, None
            if job.record is not None:
                extra = {"extrapolation": job.extrapolation, "record": job.record}
                used = stack.enter_context(job.upscaler_like(upscaler, validate=job.validate, **extra))
            if job.compare:
                size = upscaler.display_size or job.shot.render_size
                bicubic = Upscaler("bicubic", display_size=size, threads=job.threads, validate="off")
                stack.enter_context(bicubic)
            return _UpscaleRun(job, used, bicubic, results, plan, first)

        settings, records = job.settings(upscaler), job.record is not None
        return frame_run.run_frames(job, plan, settings, begin, all_frames=records)


class _UpscaleRun(FrameRun[UpscaleJob]):
    activity = "upscaling"
    legends = LEGENDS

    def __init__(
        self,
        job: UpscaleJob,
        upscaler: Upscaler,
        bicubic: Upscaler | None,
        results: Results,
        plan: FramePlan,
        first: int,
    ) -> None:
        super().__init__(job, results, plan, first, upscaler.display_size or job.shot.render_size)
        self._upscaler, self._bicubic, self._chunk = upscaler, bicubic, ChunkSize()

    def steps(
        self, plan: FramePlan, needed: int, on_step: OnStep, *, references: bool
    ) -> Generator[SteppedFrame]:
        if self._job.passes == 1:
            return self._in_order(plan, on_step, references=references)
        return self._both_ways(plan, needed, on_step, references=references)

    def summary(self, wall: float) -> tuple[int, str]:
        stats = self._upscaler.stats
        rate, steps = rate_text(stats.frames, wall), rate_text(stats.frames, stats.seconds)
        line = f"{stats.frames} frames in {wall:.1f} s: {rate}; the steps alone: {steps}"
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

    def layers(self, stepped: SteppedFrame, exposure: float) -> tuple[Mapping[str, Bytes], dict[str, float]]:
        frame, reference, transform = stepped.frame, stepped.reference, self._job.images.transform
        bicubic = None
        if self._bicubic is not None and frame.color is not None:
            bicubic = self._bicubic.step(frame)
        layers, numbers = compare_layers(
            frame, stepped.result.image, reference, exposure, bicubic=bicubic, transform=transform
        )
        return {**layers, **aux_output_layers(stepped.result)}, numbers

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
        """Yield each frame of the plan with the outputs of its step."""
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
        """Yield each frame of the plan with the merged outputs of a forward and a backward run.

        Chunks of frames before `needed` have no backward run: nothing uses their images.
        """
        start, aov_names = plan.start, deque[Sequence[str] | None]()

        def read() -> Iterator[Frame]:
            for item in self._frames(plan, runs.buffers, references=False):
                aov_names.append(item.raw.aov_names)
                yield item.frame

        @contextmanager
        def around(place: int, direction: str) -> Iterator[None]:
            with self._named(start + place):
                yield
            on_step(start + place, direction)

        runs = BothWays(
            self._upscaler, self._chunk, outputs=("aovs", *self._maps()), around=around,
            extrapolation=self._job.extrapolation, scratch=self._job.scratch,
        )  # fmt: skip
        merged, before = runs.run(read(), skip=needed - start), time.perf_counter()
        written = islice(merged, plan.stop - start)  # later frames only began the backward run
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
