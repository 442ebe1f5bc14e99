"""`UpscaleJob`: input, settings and output of one run, its Upscalers, and the frames to step through."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from supersampler.cli.arguments import size_text
from supersampler.cli.results import FIRST, FRAMES, PREROLL, SOURCE, ImageOptions, model_settings
from supersampler.cli.terminal import Terminal
from supersampler.conventions import jitter_phase_count
from supersampler.errors import ShotError
from supersampler.frame import Size
from supersampler.io.shot import Shot
from supersampler.io.shot.numbered import FrameRange
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.model import AtRest, Model, Precision
from supersampler.upscaler import PresetName, Upscaler, preset_model

MIN_PREROLL, MAX_PREROLL = 32, jitter_phase_count(4.0)
"""Bounds of the default preroll, in frames."""
EXPOSURE_FRAMES = 96
"""Frames before a preroll from which the exposure is measured. A measured exposure moves a tenth of the way
in each frame: the exposure before these frames has a weight of 0.9^96, 4e-5."""


@dataclass(frozen=True)
class FramePlan:
    """The frames of a run.

    Attributes:
        numbers: numbers of the frames that are written.
        first_number: number of the frame with index 0.
        start, stop: indices of the frames to step through: `start`, which begins without a history, to
            `stop` - 1.
        end: two passes also read the frames up to `end` - 1, where the backward run begins; `stop` or later.
    """

    numbers: FrameRange
    first_number: int
    start: int
    stop: int
    end: int

    def position(self, index: int) -> int | None:
        """Return the position of a frame among the written ones, by its index; None if it is not written."""
        number = self.first_number + index
        return number - self.numbers.first if number in self.numbers else None

    def index(self, position: int) -> int:
        """Return the index of the frame that is written at a position."""
        return self.numbers.first + position - self.first_number

    def from_position(self, shot: Shot, position: int) -> "FramePlan":
        """Return the plan that writes the frames from a position on, from the last cut before them."""
        cut = shot.last_cut(min(max(self.index(position), self.start), self.stop - 1))
        return replace(self, start=max(self.start, cut))


@dataclass(frozen=True, kw_only=True)
class FrameJob:
    """Input and output of one run.

    Attributes:
        shot: the frames.
        output: folder of the images.
        source: the options by which the shot was opened, which its images depend on.
        images: names, formats and encodings of the images.
        numbers: numbers of the frames to write; None is all of them.
        compare: whether to write the page.
        overwrite: whether to replace the files of an earlier run.
        holds_shot: whether the shot may be in its own subfolder of `output`.
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
        """Return what the images of any method depend on: the frames, and how they are written."""
        return {
            "shot": str(self.shot.path.resolve()),
            "names": self.shot.info.file_names,
            "frame rate": self.shot.frame_rate,
            **({FIRST: self.shot.first_number} if self.numbers is None else {FRAMES: str(self.numbers)}),
            "render size": size_text(self.shot.render_size),
            "conventions": self.shot.conventions.to_json(),
            **self.images.to_json(),
            SOURCE: dict(self.source),
        }


@dataclass(frozen=True, kw_only=True)
class UpscaleJob(FrameJob):
    """Input, settings and output of one run that upscales.

    Attributes:
        preroll: number of frames before those from which their history is built; None with `numbers` is
            `default_preroll`. Without both, the history begins with the shot, and static images converge.
        model: name or folder.
        display_size: (width, height) of the images; None without `scale` is the shot's, or the model's only
            ratio, or 2x.
        scale: instead of `display_size`.
        maps: whether the page has auxiliary outputs, too.
        providers, threads, precision, preset, validate, skip: see `Upscaler`.
        at_rest: see `Upscaler`; None is "converge", or "off" with a preroll.
        passes: 2 merges a forward and a backward run.
        scratch: folder for waiting frames of two passes; None is the system's.
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
        """Whether images depend on the frames of the preroll only, so that chunks of a shot are equal."""
        return self.numbers is not None or self.preroll is not None

    def plan(self, upscaler: Upscaler) -> FramePlan:
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
            at_rest=self.at_rest or ("off" if self._has_preroll else "converge"),
            skip=self.skip,
            extrapolation=self.extrapolation if self.passes == 1 else None,
            validate=self.validate,
        )

    def upscaler_like(self, other: Upscaler, **arguments: Any) -> Upscaler:
        """Return an Upscaler with the model and sizes of another one, and these other arguments."""
        return Upscaler(
            other.model, display_size=other.display_size, render_size=self.shot.render_size,
            at_rest=other.at_rest, skip=other.skip, **arguments,
        )  # fmt: skip

    def settings(self, upscaler: Upscaler) -> dict[str, object]:
        """Return all that the images depend on, but the number of frames: a shot may still grow."""
        name = self.extrapolation
        return {
            **model_settings(upscaler.model),
            **self.shot_settings(),
            PREROLL: self._preroll(upscaler) if self._has_preroll else None,
            "at rest": upscaler.at_rest,
            "passes": None if self.passes == 1 else self.passes,
            "extrapolation": None if name is None else dict(read_model_info(find_model(name)).files),
            "display size": size_text(upscaler.display_size),
        }

    def _preroll(self, upscaler: Upscaler) -> int:
        size = upscaler.display_size or self.shot.render_size
        return default_preroll(size[0] / self.shot.render_size[0]) if self.preroll is None else self.preroll


def default_preroll(scale: float) -> int:
    """Return the number of frames before a range that build its history: one jitter period, at least 32.

    docs/how-to/farm.md compares the images with those of a run of the whole shot.

    Args:
        scale: display size / render size.
    """
    return min(max(MIN_PREROLL, jitter_phase_count(scale)), MAX_PREROLL)


def open_for(
    numbers: FrameRange, preroll: int | None, open_frames: Callable[[tuple[int, int]], Shot], passes: int = 1
) -> tuple[Shot, str]:
    """Open what a run reads of a shot; gaps elsewhere do not matter.

    Args:
        numbers: numbers of the frames to write.
        preroll: frames before them that build the history; None is the default of the ratio.
        open_frames: opens the frames from a first to a last number; ShotError where one between is missing.
        passes: 2 also reads frames after the range, for the backward run, where there is no gap.

    Returns:
        The shot, and a note or "": where a frame before the preroll is missing, exposure is measured after
        it. Then there are no frames after the range, either.
    """
    before = (MAX_PREROLL if preroll is None else preroll) + EXPOSURE_FRAMES
    min_before = MIN_PREROLL if preroll is None else preroll
    after = min_before if passes == 2 else 0
    try:
        return open_frames((numbers.first - before, numbers.last + after)), ""
    except ShotError as error:
        shot = open_frames((numbers.first - min_before, numbers.last))
        return shot, f"History and exposure begin at frame {shot.first_number}: {error.problem}."


def plan_frames(shot: Shot, numbers: FrameRange | None, preroll: int, passes: int = 1) -> FramePlan:
    """Return the plan of a run; ShotError where the shot lacks one of the frames.

    Args:
        shot: the shot.
        numbers: numbers of the frames to write; None is all of them.
        preroll: number of frames before them that build the history, if they exist and no cut is among them.
            The backward run of two passes has as many after them.
        passes: 1 or 2.
    """
    own = FrameRange(shot.first_number, shot.first_number + len(shot) - 1)
    if numbers is None:
        return FramePlan(own, own.first, 0, len(shot), len(shot))
    for number in (numbers.first, numbers.last):
        if number not in own:
            problem = f"has no frame {number}"
            raise ShotError(shot.path, problem, f"Its frames are {own.first} to {own.last}.")
    index, stop = numbers.first - own.first, numbers.last - own.first + 1
    cut = shot.last_cut(index)
    start = max(cut, index - preroll)
    while start > cut and not shot.is_shaded(start):  # history begins with colour
        start -= 1
    end = stop
    while passes == 2 and end < min(stop + preroll, len(shot)) and shot.last_cut(end) != end:
        end += 1
    return FramePlan(numbers, own.first, start, stop, end)
