"""Unshaded frames, extrapolated and upscaled, compared with references and with two baselines.

The colour of every second frame of a shot is removed, or of two of three. Each upscaler runs in these ways:

    shaded          all frames are shaded: the upper limit
    warp            unshaded frames show the last image, warped by motion
    warp, filled    the same, with disoccluded pixels filled from the nearest background
    a model's name  the upscaler steps on the colour that the model extrapolates

The warping baselines upscale shaded frames alone, with motion that spans the unshaded frames between them.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.shot import Shot, ShotFrame
from supersampler.methods.gbuffers import listed, names_of
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.upscaler import Upscaler
from supersampler_bench.quality.confusion import Counts
from supersampler_bench.quality.measure import StepImage, Stepper, measure_steppers, reference_size, runnable
from supersampler_bench.quality.score_record import RecordedScores, scores_record, shot_record
from supersampler_bench.quality.score_table import Column, sizes
from supersampler_bench.quality.score_table import markdown_table as scores_table
from supersampler_bench.quality.summaries import (
    BORDER,
    WARM_UP_FRAMES,
    MeanScores,
    MethodScores,
    Scores,
    Summarized,
)
from supersampler_bench.quality.warping import motion_over_two_frames, warped, with_background_filled
from supersampler_bench.record import Record
from supersampler_bench.specs import parse_spec

EVERY_SECOND = "1:1"
"""One unshaded frame after each shaded one."""
PSNR_SHADED = "psnr_shaded"
"""PSNR of the shaded frames, whose history passed through unshaded ones."""
COLUMNS = (
    Column("psnr", "PSNR dB ↑", 2, True),
    Column("ssim", "SSIM ↑", 4, True),
    Column("flip", "FLIP ↓", 4, False),
    Column("psnr_disoccluded", "PSNR dB, disoccluded ↑", 2, True),
    Column("psnr_changing_light", "PSNR dB, changing light ↑", 2, True),
    Column("psnr_moving", "PSNR dB, moving ↑", 2, True),
    Column(PSNR_SHADED, "PSNR dB, shaded frames ↑", 2, True),
    Column("tpsnr", "tPSNR dB, all frames ↑", 2, True),
)
TEMPORAL_METRICS = ("tpsnr", "warped_error_difference", "strred")
"""Metrics of changes from frame to frame, over all frames."""


class Alternation:
    """Which frames of a shot are unshaded: a fixed number after each shaded one; never the first after a cut.

    Args:
        text: unshaded to shaded frames: "1:1" leaves out every second frame, "2:1" two of three.

    Raises:
        ArgumentError: it is something else.
    """

    def __init__(self, text: str) -> None:
        unshaded, _, shaded = text.partition(":")
        if not unshaded.isdecimal() or int(unshaded) < 1 or shaded != "1":
            want = "unshaded to shaded frames, as 1:1 or 2:1"
            raise ArgumentError("--alternation", got=repr(text), want=want)
        self.text, self._hidden = text, int(unshaded)
        self.indices: set[int] = set()
        self._since: dict[int, int] = {}  # frames since the last shaded one

    def leaves_unshaded(self, item: ShotFrame) -> bool:
        """Return whether a frame is unshaded; frames come in order, each any number of times."""
        before = self._since.get(item.index - 1)
        since = 0 if item.frame.reset or before is None else (before + 1) % (self._hidden + 1)
        self._since[item.index] = since
        if since:
            self.indices.add(item.index)
        return since > 0


@dataclass(frozen=True)
class UnshadedScores:
    """Scores of unshaded frames, PSNR of the shaded ones, and changes from frame to frame over all frames.

    Attributes:
        scores: of all frames.
        unshaded: indices of the unshaded ones.
    """

    scores: MethodScores
    unshaded: frozenset[int]

    @property
    def method(self) -> str:
        """Its name."""
        return self.scores.method

    def summary(self, *, warm: bool = True, cropped: bool = True) -> Scores:
        """See `MethodScores`."""
        alone, between = (
            MethodScores(
                self.method, [f for f in self.scores.frames if (f.frame in self.unshaded) is unshaded]
            )
            for unshaded in (True, False)
        )
        every = self.scores.summary(warm=warm, cropped=cropped)
        found = alone.summary(warm=warm, cropped=cropped) | {name: every[name] for name in TEMPORAL_METRICS}
        return found | {PSNR_SHADED: between.summary(warm=warm, cropped=cropped)["psnr"]}

    def classes(self, *, warm: bool = True, cropped: bool = True) -> Counts | None:  # noqa: ARG002
        """None: an extrapolated colour is no sample that has a class."""
        return None


@dataclass(frozen=True)
class Extrapolated:
    """The scores of all ways on one shot.

    Attributes:
        shot: what was measured on.
        origin: what else is known of the shot's pixels, ready for JSON.
        alternations: scores by alternation, as its text.
    """

    shot: Shot
    origin: dict[str, Any]
    alternations: dict[str, list[UnshadedScores]]


def measure_extrapolation(
    shot: Shot,
    upscalers: Sequence[str],
    models: Sequence[str],
    alternations: Sequence[str],
    *,
    origin: dict[str, Any] | None = None,
    on_left_out: Callable[[str], None] = lambda _: None,
    on_frame: Callable[[int], None] | None = None,
) -> Extrapolated:
    """Remove the colour of some frames of a shot, extrapolate them in all ways, and score them.

    Args:
        shot: all of its frames are shaded and have the G-buffers that the models read.
        upscalers: as `parse_spec` reads them.
        models: that extrapolate: their names, or folders.
        alternations: as `Alternation` reads them.
        origin: see `Extrapolated`.
        on_left_out: called with the name of each upscaler that cannot upscale the shot, and why.
        on_frame: called with the number of frames done, after each.

    Raises:
        ShotError: no frame has a reference, or G-buffers are missing.
        ArgumentError: no upscaler is left, or an alternation is none.
        ModelError, FrameError: see `Upscaler`.
    """
    display = reference_size(shot)
    for model in models:
        check_gbuffers(shot, model)
    upscalers = runnable(shot, upscalers, on_left_out)
    scores = {}
    for alternation in map(Alternation, alternations):
        steppers = [s for name in upscalers for s in _ways(name, models, display, alternation)]
        found = measure_steppers(shot, steppers, on_frame=on_frame)
        scores[alternation.text] = [UnshadedScores(s, frozenset(alternation.indices)) for s in found]
    return Extrapolated(shot, origin or {}, scores)


def check_gbuffers(shot: Shot, model: str) -> None:
    """Fail where a shot lacks G-buffers that a model reads.

    Raises:
        ShotError: it does.
    """
    there = names_of(shot.read_raw(0))
    lacking = [name for name in read_model_info(find_model(model)).gbuffers if name not in there]
    if lacking:
        hint = f"{model} reads them. The shots of `bench shots` have all."
        raise ShotError(shot.path, f"frames have no {listed(lacking)}", hint)


def _ways(upscaler: str, models: Sequence[str], display: Size, alternation: Alternation) -> list[Stepper]:
    shaded = _made(upscaler, display)
    plain, filled = (WarpBaseline(_made(upscaler, display), alternation, filled=f) for f in (False, True))

    def way(name: str, show: Callable[[ShotFrame], Float32], gbuffers: Collection[str]) -> Stepper:
        return Stepper(f"{upscaler}, {name}", lambda item: StepImage(show(item)), gbuffers)

    def extrapolated(model: str) -> Stepper:
        extrapolating = _made(upscaler, display, extrapolation=model)

        def show(item: ShotFrame) -> Float32:
            if alternation.leaves_unshaded(item):
                return extrapolating.extrapolate(replace(item.frame, color=None))
            return extrapolating.step(item.frame)

        return way(read_model_info(find_model(model)).method, show, extrapolating.gbuffers)

    return [
        way("shaded", lambda item: shaded.step(item.frame), shaded.gbuffers),
        way("warp", plain.step, shaded.gbuffers),
        way("warp, filled", filled.step, shaded.gbuffers),
        *map(extrapolated, models),
    ]


def _made(upscaler: str, display: Size, extrapolation: str | None = None) -> Upscaler:
    spec = parse_spec(upscaler)
    return Upscaler(
        spec.model,
        display_size=display,
        precision=spec.precision,
        skip=spec.skip,
        extrapolation=extrapolation,
        validate="off",
    )


class WarpBaseline:
    """Upscales shaded frames alone, and warps the last image on the others.

    Args:
        upscaler: of the shaded ones.
        alternation: which frames are unshaded.
        filled: whether disoccluded pixels are filled from the nearest background.
    """

    def __init__(self, upscaler: Upscaler, alternation: Alternation, *, filled: bool) -> None:
        self._upscaler, self._alternation, self._filled = upscaler, alternation, filled
        self._last: tuple[Frame, Float32] | None = None
        self._since: Array | None = None  # motion of the previous frame to the last shaded one

    def step(self, item: ShotFrame) -> Float32:
        """Return the image of the next frame."""
        frame, since, unshaded = item.frame, None, self._alternation.leaves_unshaded(item)
        if frame.reset or self._last is None:
            image = self._upscaler.step(frame)
        else:
            before, last = self._last
            since = motion_over_two_frames(frame, self._since, before.jitter)
            if unshaded:
                image = warped(last, frame)
                image = with_background_filled(image, frame, before) if self._filled else image
            else:
                image, since = self._upscaler.step(replace(frame, motion=since)), None
        self._last, self._since = (frame, image), since
        return image


def extrapolation_record(measured: Sequence[Extrapolated], models: Sequence[str]) -> dict[str, Any]:
    """Return all values, ready for JSON.

    Args:
        measured: the shots; of several each knows its ratio, and there is a mean at each.
        models: that extrapolate.
    """
    ratios = dict.fromkeys(m.origin["ratio"] for m in measured) if len(measured) > 1 else ()
    return {
        "bench": "extrapolation",
        "models": list(models),
        "warm_up_frames": WARM_UP_FRAMES,
        "border": BORDER,
        "shots": [
            {
                **shot_record(m.shot),
                **m.origin,
                "alternations": [
                    {"alternation": text, "methods": [scores_record(s) for s in scores]}
                    for text, scores in m.alternations.items()
                ],
            }
            for m in measured
        ],
        "means": [
            {"ratio": ratio, "alternation": text, "methods": [scores_record(s) for s in scores]}
            for ratio in ratios
            for text, scores in _means([m for m in measured if m.origin["ratio"] == ratio])
        ],
    }


def _means(measured: Sequence[Extrapolated]) -> list[tuple[str, list[MeanScores]]]:
    found = []
    for text in measured[0].alternations:
        by_method = zip(*(m.alternations[text] for m in measured), strict=True)
        found.append((text, [MeanScores(scores[0].method, scores) for scores in by_method]))
    return found


def markdown_table(record: Record) -> str:
    """Return the tables of a record as Markdown, one an alternation, with captions."""
    tables = []
    if record["means"]:
        for mean in record["means"]:
            names = ", ".join(s["name"] for s in record["shots"] if s["ratio"] == mean["ratio"])
            about = f"Mean of the shots {names} at ratio {mean['ratio']:g}"
            tables.append(_table(about, mean))
    else:
        shot = record["shots"][0]
        tables = [_table(sizes(shot), a) for a in shot["alternations"]]
    return "\n\n".join(tables)


def _table(about: str, row: Record) -> str:
    results: list[Summarized] = [RecordedScores(method) for method in row["methods"]]
    caption = (
        f"{about}, {row['alternation']} unshaded to shaded frames. "
        "Scores are of the unshaded ones; tPSNR is of all; "
        f"without the first {WARM_UP_FRAMES} frames and a border of {BORDER} pixels"
    )
    return scores_table(caption, results, COLUMNS)
