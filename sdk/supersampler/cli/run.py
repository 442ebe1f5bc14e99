"""Upscale a shot into a folder, frame by frame; a stopped run can continue. For `upscale` and `demo`."""

import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from supersampler.aux_outputs import LEGENDS, aux_output_layers
from supersampler.cli.arguments import size_text
from supersampler.cli.frame_warnings import frame_warnings
from supersampler.cli.results import Results, model_settings
from supersampler.cli.run_record import FIRST, PAGE, VIDEO
from supersampler.errors import FrameError, ShotError
from supersampler.frame import Frame, Size
from supersampler.history import StepResult
from supersampler.io.atomic import check_apart
from supersampler.io.compare import ERROR_LEGEND, About, ComparePage, compare_layers, compare_page, versions
from supersampler.io.display import ExposureMeter
from supersampler.io.display_transforms import DisplayTransform
from supersampler.io.shot import Shot
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.model import Model, Precision, Skip
from supersampler.presets import PresetName, chosen
from supersampler.recording.folder import remove_recording
from supersampler.upscaler import Upscaler

COMPARE_FRAMES = 64
"""Number of frames, the last ones, in a page: browsers load larger pages slowly."""

_NOTES = (
    "Images after exposure, c / (1 + max(r, g, b)) and sRGB; JPEG of quality 92, small ones PNG. The input "
    "is as rendered, with its jitter.",
    "error: mean over r, g, b of |output − reference| of these images. PSNR: of the same images before "
    "rounding to 8 bits, whole frame.",
)


@dataclass(frozen=True, kw_only=True)
class UpscaleJob:
    """Input, settings and output of one run; sizes are (width, height).

    `extrapolation` is the name or folder of the model for unshaded frames. Without `display_size` and `scale`
    the images have the shot's display size; without one, the model's only ratio, or 2x. `record` is a folder
    to record all frames to; the recording of an earlier run into `output` is replaced. With `holds_shot`
    the shot may be in a subfolder of `output` of its own. `view` is what PNG files show. With
    `video` the caller writes one of them.
    """

    shot: Shot
    output: Path
    model: str | Path | None = None
    display_size: Size | None = None
    scale: float | None = None
    formats: Sequence[str] = ("exr",)
    compare: bool = False
    maps: bool = False
    providers: str | Sequence[str] = "auto"
    threads: int = 0
    precision: Precision = "auto"
    skip: Skip = "auto"
    preset: PresetName | None = None
    extrapolation: str | Path | None = None
    validate: Literal["off", "warn", "strict"] = "warn"
    record: Path | None = None
    overwrite: bool = False
    holds_shot: bool = False
    view: DisplayTransform | None = None
    video: bool = False
    console: Console = field(default_factory=lambda: Console(stderr=True, highlight=False))

    @property
    def single(self) -> list[str]:
        """Names of the files of SINGLE that the run writes."""
        return [name for name, wanted in ((PAGE, self.compare), (VIDEO, self.video)) if wanted]


def run_job(job: UpscaleJob) -> Results:
    """Upscale the frames that are not complete yet, and print a summary.

    Raises:
        typer.Exit: 130 after Ctrl-C; complete frames are kept.
        SupersamplerError: a frame, a file or the model is not usable; or the output lies in the shot, or
            would replace files of another program.
    """
    results, count = Results(job.output, job.formats, job.view), len(job.shot)
    for written in filter(None, (None if job.holds_shot else job.output, job.record)):
        check_apart(written, job.shot.source)
    with ExitStack() as stack:
        upscaler = stack.enter_context(_open_upscaler(job))
        upscaler.warm_up()  # raises for an unusable model or ratio before files are overwritten
        first = results.begin(
            _settings(job, upscaler), count, overwrite=job.overwrite, single=job.single, recording=job.record
        )
        if job.record is not None:
            upscaler = stack.enter_context(_recording_upscaler(job, upscaler))
        page_is_there = not job.compare or results.is_newest(PAGE)
        if first == count and page_is_there and job.record is None:
            job.console.print(f"All {count} frames are there already.")
            return results
        try:
            _upscale(job, upscaler, results, first)
        except KeyboardInterrupt:
            complete = results.count_complete(count)
            job.console.print(f"Stopped: {complete} of {count} frames are complete.")
            job.console.print("The same command, given again, continues.")
            raise typer.Exit(130) from None
    return results


def _open_upscaler(job: UpscaleJob) -> Upscaler:
    model, precision, skip = chosen(job.preset, job.model, job.precision, job.skip)
    size = job.display_size or (job.shot.display_size if job.scale is None else None)
    info = model.info if isinstance(model, Model) else read_model_info(find_model(model))
    return Upscaler(
        model,
        display_size=size,
        scale=None if size else job.scale or info.only_ratio or 2.0,
        render_size=job.shot.render_size,
        providers=job.providers,
        threads=job.threads,
        precision=precision,
        skip=skip,
        extrapolation=job.extrapolation,
        validate=job.validate,
    )


def _recording_upscaler(job: UpscaleJob, opened: Upscaler) -> Upscaler:
    """Return an Upscaler with the same model that records; an earlier run's recording is replaced."""
    assert job.record is not None  # noqa: S101 - checked by the caller
    remove_recording(job.record)  # `Results.begin` has checked that it is an earlier run's
    return Upscaler(
        opened.model,
        display_size=opened.display_size,
        render_size=job.shot.render_size,
        skip=opened.skip,
        extrapolation=job.extrapolation,
        validate=job.validate,
        record=job.record,
    )


def _settings(job: UpscaleJob, upscaler: Upscaler) -> dict[str, object]:
    """Return all that the images depend on. The number of frames is left out, as a shot may still grow."""
    extrapolation = None if job.extrapolation is None else read_model_info(find_model(job.extrapolation))
    return {
        **model_settings(upscaler.model),
        "shot": str(job.shot.path.resolve()),
        FIRST: job.shot.first_number,
        "render size": size_text(job.shot.render_size),
        "conventions": job.shot.conventions.to_json(),
        "skip": upscaler.skip,
        "extrapolation": None if extrapolation is None else dict(extrapolation.files),
        "display size": size_text(upscaler.display_size),
        "formats": list(job.formats),
        "view": None if job.view is None else job.view.to_json(),
    }


def _upscale(job: UpscaleJob, upscaler: Upscaler, results: Results, first: int) -> None:
    """Step through the frames; frames before `first` only rebuild the history and fill the page."""
    count = len(job.shot)
    page_start = max(0, count - COMPARE_FRAMES) if job.compare else count
    start = 0 if job.record else _last_cut(job.shot, min(first, page_start))
    meter, began = ExposureMeter(), time.perf_counter()
    with _page(job, upscaler, results) as page, _progress(job.console) as progress:
        task = progress.add_task("", total=count - start)
        for item in job.shot.frames(start, gbuffers=upscaler.gbuffers):
            progress.update(task, description="upscaling" if item.index >= first else "replaying")
            frame, number = item.frame, job.shot.first_number + item.index
            with _named(job, number):
                result = _step(job, upscaler, frame)
            exposure = meter.read(frame.color, given=frame.exposure, reset=frame.reset)
            if item.index >= first:
                names, metadata = item.raw.aov_names, job.shot.read_metadata(item.index)
                results.write(
                    item.index, result.image, exposure, result.aovs, aov_names=names, metadata=metadata
                )
            if page is not None and item.index >= page_start:
                layers, numbers = compare_layers(frame, result.image, item.reference, exposure)
                page.add(number, {**layers, **aux_output_layers(result)}, numbers)
            progress.advance(task)
    stats, seconds = upscaler.stats, time.perf_counter() - began
    rates = f"{stats.frames / seconds:.1f} a second, the method alone {stats.frames / stats.seconds:.1f}"
    job.console.print(f"{stats.frames} frames in {seconds:.1f} s: {rates}")
    if stats.extrapolated:
        each = stats.extrapolation_seconds / stats.extrapolated
        job.console.print(f"{stats.extrapolated} were not shaded; extrapolating one took {each:.2f} s")
    if stats.work < stats.frames:
        job.console.print(f"{1 - stats.work / stats.frames:.0%} of the work was skipped: nothing moved.")


def _step(job: UpscaleJob, upscaler: Upscaler, frame: Frame) -> StepResult:
    """Step with the auxiliary outputs that the files and the page show."""
    maps = [*upscaler.model.info.maps, "work"] if job.maps else []
    step = upscaler.extrapolate if job.extrapolation and frame.color is None else upscaler.step
    result = step(frame, outputs=(*maps, *(["aovs"] if frame.aovs is not None else [])))
    return result if isinstance(result, StepResult) else StepResult(result)


def _last_cut(shot: Shot, index: int) -> int:
    """Return the last frame up to `index` that resets the history, which can be rebuilt from there."""
    while 0 < index < len(shot) and not shot.read_raw(index, gbuffers=()).reset:
        index -= 1
    return index


def _page(
    job: UpscaleJob, upscaler: Upscaler, results: Results
) -> AbstractContextManager[ComparePage | None]:
    if not job.compare:
        return nullcontext()
    shot, model, info = job.shot, upscaler.model, upscaler.model.info
    display_size = upscaler.display_size or shot.render_size
    sizes = f"{size_text(shot.render_size)} to {size_text(display_size)}".replace("x", " × ")
    provider = model.providers[0].removesuffix("ExecutionProvider")
    facts = {
        "method": info.method,
        "size": sizes,
        "runs on": f"{provider} ({model.executor}, {model.precision})",
        "frames": str(len(shot)),
    }
    sources = ". ".join(line.rstrip(".") for line in (*shot.attribution, shot.license) if line)
    about = About(
        title=shot.name,
        method=info.method,
        display_size=display_size,
        frame_rate=shot.frame_rate or 30.0,
        facts=facts,
        legends={"error": ERROR_LEGEND, **LEGENDS},
        notes=[*_NOTES, *([f"Shot: {sources}."] if sources else []), versions()],
    )
    return compare_page(results.begin_file(PAGE), about)


class _FramesPerSecond(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.1f} frames/s")


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _FramesPerSecond(),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        transient=True,
        disable=not console.is_terminal,  # log files get only the summary
    )


@contextmanager
def _named(job: UpscaleJob, number: int) -> Iterator[None]:
    """Add the frame's number to its errors and warnings."""
    try:
        with frame_warnings(job.console, number):
            yield
    except FrameError as error:
        raise ShotError(job.shot.path, f"frame {number}: {str(error).rstrip('.')}") from error
