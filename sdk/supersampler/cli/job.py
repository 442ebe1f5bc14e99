"""`UpscaleJob`: input, settings and output of one run, and the Upscaler for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from supersampler.cli.arguments import size_text
from supersampler.cli.frame_plan import FramePlan, default_preroll, plan_frames
from supersampler.cli.image_options import ImageOptions
from supersampler.cli.results import PREROLL, model_settings
from supersampler.cli.run_record import FIRST, FRAMES, SOURCE
from supersampler.cli.terminal import Terminal
from supersampler.frame import Size
from supersampler.io.shot import Shot
from supersampler.io.shot.numbered import FrameNumbers
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.model import AtRest, Model, Precision
from supersampler.upscaler import PresetName, Upscaler, preset_model


@dataclass(frozen=True, kw_only=True)
class UpscaleJob:
    """Input, settings and output of one run.

    Attributes:
        shot: the frames.
        output: folder of the images.
        source: the options by which the shot was opened, which its images depend on.
        images: their names, formats and encodings.
        numbers: of the frames to write; None is all of them.
        preroll: frames before those from which their history is built; None with `numbers` is
            `default_preroll`.
            Without both, the history begins with the shot, and images converge where nothing moves.
        model: name or folder.
        display_size: (width, height) of the images. Without it and `scale` it is the shot's; without one, the
            model's only ratio, or 2x.
        scale: instead of `display_size`.
        compare: whether to write the page.
        maps: whether the page has auxiliary outputs, too.
        providers, threads, precision, preset, validate: see `Upscaler`.
        at_rest: see `Upscaler`; None is "converge", or "off" with a preroll.
        skip: see `Upscaler`.
        passes: 2 merges a forward and a backward run.
        scratch: where the frames of two passes are kept meanwhile; None is the system's place.
        extrapolation: name or folder of the model for unshaded frames.
        record: a folder to record all frames to; the recording of an earlier run into `output` is replaced.
        overwrite: whether to replace the files of an earlier run.
        holds_shot: whether the shot may be in a subfolder of `output` of its own.
        profile: whether to print the times of the stages.
        json: whether to print each frame as a line of JSON.
        console: for people.
    """

    shot: Shot
    output: Path
    source: Mapping[str, str] = field(default_factory=dict)
    images: ImageOptions = field(default_factory=ImageOptions)
    numbers: FrameNumbers | None = None
    preroll: int | None = None
    model: str | Path | None = None
    display_size: Size | None = None
    scale: float | None = None
    compare: bool = False
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
    overwrite: bool = False
    holds_shot: bool = False
    profile: bool = False
    json: bool = False
    console: Terminal = field(default_factory=lambda: Terminal(stderr=True))

    @property
    def has_preroll(self) -> bool:
        """Whether images depend on the frames of the preroll only, so that chunks of a shot are equal."""
        return self.numbers is not None or self.preroll is not None

    def frames(self, upscaler: Upscaler) -> FramePlan:
        """Return the frames to step through; ShotError where the shot lacks one."""
        return plan_frames(self.shot, self.numbers, self._preroll(upscaler), self.passes)

    def upscaler(self) -> Upscaler:
        """Return an Upscaler for the run."""
        model, precision = preset_model(self.preset, self.model, self.precision)
        size = self.display_size or (self.shot.display_size if self.scale is None else None)
        info = model.info if isinstance(model, Model) else read_model_info(find_model(model))
        return Upscaler(
            model,
            display_size=size,
            scale=None if size else self.scale or info.only_ratio or 2.0,
            render_size=self.shot.render_size,
            providers=self.providers,
            threads=self.threads,
            precision=precision,
            at_rest=self.at_rest or ("off" if self.has_preroll else "converge"),
            skip=self.skip,
            extrapolation=self.extrapolation if self.passes == 1 else None,
            validate=self.validate,
        )

    def backward_upscaler(self, forward: Upscaler) -> Upscaler:
        """Return an Upscaler with the same model for the backward run of two passes."""
        return Upscaler(
            forward.model,
            display_size=forward.display_size,
            render_size=self.shot.render_size,
            at_rest=forward.at_rest,
            skip=forward.skip,
            validate="off",  # the forward run checks the frames
        )

    def _preroll(self, upscaler: Upscaler) -> int:
        if self.preroll is not None:
            return self.preroll
        size = upscaler.display_size or self.shot.render_size
        return default_preroll(size[0] / self.shot.render_size[0])

    def recording_upscaler(self, opened: Upscaler) -> Upscaler:
        """Return an Upscaler with the same model that records; an earlier run's recording is replaced."""
        from supersampler.recording.recorder import remove_recording

        assert self.record is not None  # noqa: S101 - checked by the caller
        remove_recording(self.record)  # `Results.begin` has checked that it is an earlier run's
        return Upscaler(
            opened.model,
            display_size=opened.display_size,
            render_size=self.shot.render_size,
            at_rest=opened.at_rest,
            skip=opened.skip,
            extrapolation=self.extrapolation,
            validate=self.validate,
            record=self.record,
        )

    def settings(self, upscaler: Upscaler) -> dict[str, object]:
        """Return all that the images depend on, but the number of frames: a shot may still grow."""
        extrapolation = (
            None if self.extrapolation is None else read_model_info(find_model(self.extrapolation))
        )
        return {
            **model_settings(upscaler.model),
            "shot": str(self.shot.path.resolve()),
            "names": self.shot.info.file_names,
            "frame rate": self.shot.frame_rate,
            **({FIRST: self.shot.first_number} if self.numbers is None else {FRAMES: str(self.numbers)}),
            PREROLL: self._preroll(upscaler) if self.has_preroll else None,
            "render size": size_text(self.shot.render_size),
            "conventions": self.shot.conventions.to_json(),
            "at rest": upscaler.at_rest,
            "passes": None if self.passes == 1 else self.passes,
            "extrapolation": None if extrapolation is None else dict(extrapolation.files),
            "display size": size_text(upscaler.display_size),
            **self.images.to_json(),
            SOURCE: dict(self.source),
        }
