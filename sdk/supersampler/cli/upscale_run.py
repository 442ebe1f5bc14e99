"""Upscale a shot into a folder, frame by frame; a stopped run can be resumed."""

import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Literal

from supersampler import __version__
from supersampler.arguments import AtRest, Precision, PresetName
from supersampler.aux_outputs import LEGENDS, aux_output_layers
from supersampler.cli.arguments import size_text
from supersampler.cli.frame_run import EXPOSURE_FRAMES, FrameRun, SteppedFrame
from supersampler.cli.results import AT_REST, PREROLL, Results, settings_of
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
    before = (MAX_PREROLL if preroll is None else preroll) + EXPOSURE_FRAMES
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


@dataclass(kw_only=True, eq=False)
class UpscaleRun(FrameRun):
    """One run that upscales a shot.

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
    activity = "upscaling"
    legends = LEGENDS
    _upscaler: Upscaler = field(init=False)
    _bicubic: Upscaler | None = field(default=None, init=False)
    _chunk: ChunkSize = field(default_factory=ChunkSize, init=False)
    _stack: ExitStack = field(default_factory=ExitStack, init=False)

    def write(self) -> Results:
        """Upscale the frames that are not complete yet, and print a summary; errors: see `write_frames`."""
        if self.record is not None:
            check_apart(self.record, self.shot.source)
            if self.output.resolve().is_relative_to(self.record.resolve()):
                raise ShotError(
                    self.record, f"is or holds the output, {self.output}", "Choose another folder."
                )
        with self._stack:
            self._upscaler = upscaler = self._stack.enter_context(self._new_upscaler())
            plan = self.plan_frames(self._preroll_frames(), self.passes)
            upscaler.warm_up()  # raises for an unusable model or ratio before files are overwritten
            if self.record is not None and is_there(self.record):
                raise ShotError(self.record, "already exists", "Choose another name, or move it away.")
            size = upscaler.display_size or self.shot.render_size
            return self.write_frames(plan, size, self._settings(), all_frames=self.record is not None)

    def _begin(self) -> None:
        """Open the recording, and the Upscaler of the page's layer `bicubic`."""
        upscaler = self._upscaler
        if self.record is not None:
            self._upscaler = self._stack.enter_context(
                Upscaler(
                    upscaler.model, display_size=upscaler.display_size, render_size=self.shot.render_size,
                    at_rest=upscaler.at_rest, skip=upscaler.skip, extrapolation=self.extrapolation,
                    validate=self.validate, record=self.record,
                )
            )  # fmt: skip
        if self.compare:
            bicubic = Upscaler("bicubic", display_size=self._image_size, threads=self.threads, validate="off")
            self._bicubic = self._stack.enter_context(bicubic)

    @property
    def _has_preroll(self) -> bool:
        """Whether the history depends on the preroll alone, so that chunks of a shot have equal images."""
        return self.numbers is not None or self.preroll is not None

    def _new_upscaler(self) -> Upscaler:
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

    def _settings(self) -> dict[str, object]:
        """Return the settings for `write_frames`."""
        name, upscaler, model = self.extrapolation, self._upscaler, self._upscaler.model
        return {
            "supersampler": __version__,
            "method": model.info.method,
            "model files": dict(model.info.files),
            "providers": list(model.providers),
            "executor": model.executor,
            "precision": model.precision,
            **settings_of(self.shot, self.numbers, self.source, self.images),
            PREROLL: self._preroll_frames() if self._has_preroll else None,
            AT_REST: upscaler.at_rest,
            "passes": None if self.passes == 1 else self.passes,
            "extrapolation": None if name is None else dict(read_model_info(find_model(name)).files),
            "display size": size_text(upscaler.display_size),
        }

    def _settled(self, count: int) -> int:
        """Return the number of images that later frames do not change."""
        return count if self.passes == 1 else self._chunk.settled(count)

    def _preroll_frames(self) -> int:
        size = self._upscaler.display_size or self.shot.render_size
        return default_preroll(size[0] / self.shot.render_size[0]) if self.preroll is None else self.preroll

    def _steps(self, *, references: bool) -> Generator[SteppedFrame]:
        return self._in_order(references) if self.passes == 1 else self._both_ways(references)

    def _summary(self, wall: float) -> tuple[int, str]:
        stats = self._upscaler.stats
        rate, steps = rate_text(stats.frames, wall), rate_text(stats.frames, stats.seconds)
        line = f"{stats.frames} frames in {wall:.1f} s: {rate}; the steps alone: {steps}"
        if stats.extrapolated:
            each = stats.extrapolation_seconds / stats.extrapolated
            line += f"\n{stats.extrapolated} were not shaded; extrapolating one took {each:.2f} s"
        return stats.frames, line

    def _facts(self) -> dict[str, str]:
        model, size = self._upscaler.model, self._image_size
        provider = model.providers[0].removesuffix("ExecutionProvider")
        return {
            "method": model.info.method,
            "size": f"{size_text(self.shot.render_size)} to {size_text(size)}".replace("x", " × "),
            "runs on": f"{provider} ({model.executor}, {model.precision})",
        }

    def _layers(self, stepped: SteppedFrame, exposure: float) -> tuple[Mapping[str, Bytes], dict[str, float]]:
        frame, reference, transform = stepped.frame, stepped.reference, self._transform(stepped.frame)
        bicubic = None
        if self._bicubic is not None and frame.color is not None:
            bicubic = self._bicubic.step(frame)
        layers, numbers = compare_layers(
            frame, stepped.result.image, reference, exposure, bicubic=bicubic, transform=transform
        )
        return {**layers, **aux_output_layers(stepped.result)}, numbers

    def _step_count(self) -> int:
        plan, needed = self._plan, self._needed
        total, start = plan.stop - plan.start, plan.start
        while self.passes == 2 and start < plan.end:
            stop = start + 1
            while stop < plan.end and self.shot.last_cut(stop) != stop:
                stop += 1
            skipped = max(0, needed - start) // self._chunk.frames * self._chunk.frames  # whole chunks
            total += self._chunk.backward_steps(max(0, stop - start - skipped))
            start = stop
        return total

    def _in_order(self, references: bool) -> Generator[SteppedFrame]:
        """Yield each frame of the plan with the outputs of its step."""
        upscaler, extrapolates = self._upscaler, self.extrapolation is not None
        for item in self._frames(upscaler.gbuffers, references=references):
            frame, before = item.frame, upscaler.stats.seconds
            step = upscaler.extrapolate if extrapolates and frame.color is None else upscaler.step
            aovs = () if frame.aovs is None else ("aovs",)
            with self._named(item.index):
                result = step(frame, outputs=(*self._maps(), *aovs))
            result = result if isinstance(result, StepResult) else StepResult(result)
            seconds, names = upscaler.stats.seconds - before, item.raw.aov_names
            yield SteppedFrame(item.index, frame, item.reference, names, result, seconds)
            self._count_step(item.index)

    def _both_ways(self, references: bool) -> Generator[SteppedFrame]:
        """Yield each frame of the plan with the merged outputs of a forward and a backward run.

        Chunks of only frames whose images are not needed have no backward run.
        """
        start, aov_names = self._plan.start, deque[Sequence[str] | None]()

        def read() -> Iterator[Frame]:
            for item in self._frames(runs.buffers, references=False):
                aov_names.append(item.raw.aov_names)
                yield item.frame

        @contextmanager
        def around(place: int, direction: str) -> Iterator[None]:
            with self._named(start + place):
                yield
            self._count_step(start + place, direction)

        runs = BothWays(
            self._upscaler, self._chunk, outputs=("aovs", *self._maps()), around=around,
            extrapolation=self.extrapolation, scratch=self.scratch,
        )  # fmt: skip
        merged, before = runs.run(read(), skip=self._needed - start), time.perf_counter()
        written = islice(merged, self._plan.stop - start)  # later frames only began the backward run
        for index, (frame, result) in enumerate(written, start):
            reference = self.shot.read_reference(index) if references else None
            seconds = time.perf_counter() - before
            yield SteppedFrame(index, frame, reference, aov_names.popleft(), result, seconds)
            before = time.perf_counter()

    def _frames(self, gbuffers: Collection[str], *, references: bool) -> Iterator[ShotFrame]:
        plan = self._plan
        exposure = self._exposure_at(plan.start, plan.start)
        frames = self.shot.frames(plan.start, plan.end, gbuffers=gbuffers, references=references)
        for item in frames:
            if item.index == plan.start and exposure is not None:
                item = replace(item, frame=replace(item.frame, reset=True, exposure=exposure))
            yield item

    def _maps(self) -> tuple[str, ...]:
        return tuple(self._upscaler.model.info.maps) if self.maps else ()
