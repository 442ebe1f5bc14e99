"""Unshaded frames, extrapolated and upscaled, compared with references and with two baselines.

Every second frame of a shot, or two of three, loses its colour. Each upscaler runs in these ways:

    shaded          all frames are shaded: the upper limit
    warp            unshaded frames show the last image, warped by motion
    warp, filled    like warp, with disoccluded pixels filled from the nearest background
    a model's name  the upscaler steps on the colour that the model extrapolates

The warping baselines upscale shaded frames only, with motion that spans the unshaded frames between them.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from supersampler import ArgumentError, ShotError, Upscaler
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.history import StepResult
from supersampler.io.shot import Shot, ShotFrame
from supersampler.methods.gbuffers import gbuffer_arrays, lacking, listed
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.methods.model_info import ModelInfo
from supersampler.sequence.both_ways import BothWays
from supersampler_bench.quality import masks, measure, metrics
from supersampler_bench.quality import scores as quality_scores
from supersampler_bench.quality.score_table import COLUMNS as QUALITY_COLUMNS
from supersampler_bench.quality.score_table import Column, sizes
from supersampler_bench.quality.score_table import markdown_table as scores_table

REACH = 32
"""Radius, display pixels, of the search for the background of a disoccluded pixel."""


def warped(image: Float32, frame: Frame) -> Float32:
    """Reproject the previous image (H, W, 3) by a frame's motion; the border repeats off screen."""
    height, width = image.shape[:2]
    motion = masks.display_motion(frame, (width, height))
    rows, columns = np.indices((height, width))
    x, y = np.clip(columns + motion[..., 0], 0, width - 1), np.clip(rows + motion[..., 1], 0, height - 1)
    found, _ = metrics.warp(image, np.stack([x - columns, y - rows], axis=-1))
    return found.astype(np.float32)


def with_background_filled(image: Float32, frame: Frame, before: Frame) -> Float32:
    """Fill disoccluded and off-screen pixels of a warped image (H, W, 3) from the nearest background.

    The background is the nearest pixel, within REACH, that was fully visible and is not closer to the camera
    than the filled one.
    """
    size = (image.shape[1], image.shape[0])
    occluded, in_part = (masks.disoccluded(frame, before, in_part=part) for part in (False, True))
    disoccluded, in_part, depth = (
        masks.to_display(plane, frame.jitter, size) for plane in (occluded, in_part, frame.depth)
    )
    filled, (rows, columns) = image.copy(), np.nonzero(disoccluded)
    for down, across in _outwards():
        y, x = rows + down, columns + across
        inside = (y >= 0) & (y < size[1]) & (x >= 0) & (x < size[0])
        y, x = np.clip(y, 0, size[1] - 1), np.clip(x, 0, size[0] - 1)
        behind = depth[y, x] <= masks.DEPTH_RATIO * depth[rows, columns]
        found = inside & ~in_part[y, x] & behind
        filled[rows[found], columns[found]] = image[y[found], x[found]]
        rows, columns = rows[~found], columns[~found]
        if not len(rows):
            break
    return filled


def motion_over_two_frames(frame: Frame, since: Array | None, jitter: tuple[float, float]) -> Array:
    """Return motion (h, w, 2) from a frame, over the previous one, to the frame that `since` leads to.

    `since` is the motion (h, w, 2) of the previous frame to an earlier one; with None, the result is the
    frame's own motion. `jitter` is that of the previous frame, whose size may differ.
    """
    if since is None:
        return frame.motion
    if since.shape != frame.motion.shape:  # resampled at the pixel centres of this frame
        ratio = np.divide(frame.size, since.shape[1::-1])
        since, jitter = masks.to_display(since, jitter, frame.size) * ratio, (0.0, 0.0)
    to_sample = frame.motion + np.subtract(frame.jitter, jitter)
    further, inside = metrics.warp(since, to_sample)
    total = np.where(inside[..., None], frame.motion + further, frame.motion)  # off screen: does not matter
    return total.astype(np.float32)


def _outwards() -> Iterator[tuple[int, int]]:
    """Yield offsets (down, across) within REACH of a pixel, the nearest first."""
    rows, columns = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1]
    far = np.hypot(rows, columns)
    order = np.argsort(far, axis=None, kind="stable")[1:]
    kept = order[far.ravel()[order] <= REACH]
    yield from zip(rows.ravel()[kept].tolist(), columns.ravel()[kept].tolist(), strict=True)


PSNR_SHADED = "psnr_shaded"
"""PSNR of the shaded frames, whose history passed through unshaded ones."""
_OMITTED = ("tpsnr", "warped_error_difference", "psnr_aliased")
COLUMNS = (
    *(column for column in QUALITY_COLUMNS if column.name not in _OMITTED),
    Column(PSNR_SHADED, "PSNR dB, shaded frames", 2),
    Column("tpsnr", "tPSNR dB, all frames", 2),
)
_TWO_PASSES = ":x2"
TEMPORAL_METRICS = ("tpsnr", "warped_error_difference", "strred")
"""Metrics of changes from frame to frame, over all frames."""


class Alternation:
    """Pattern of unshaded frames: a fixed number after each shaded one; a frame after a cut is shaded.

    The text gives unshaded to shaded frames: in "1:1" every second frame is unshaded, in "2:1" two of three.

    Raises:
        ArgumentError: the text is something else.
    """

    def __init__(self, text: str) -> None:
        unshaded, _, shaded = text.partition(":")
        if not unshaded.isdecimal() or int(unshaded) < 1 or shaded != "1":
            want = "unshaded to shaded frames, as 1:1 or 2:1"
            raise ArgumentError("--alternation", got=repr(text), want=want)
        self._period = int(unshaded) + 1
        self.indices: set[int] = set()
        self._since: dict[int, int] = {}  # frames since the last shaded one

    def leaves_unshaded(self, item: ShotFrame) -> bool:
        """Return whether a frame is unshaded. Frames come in order; each may come several times."""
        before = self._since.get(item.index - 1)
        if item.frame.reset or before is None:
            self._since[item.index] = 0
            return False
        self._since[item.index] = since = (before + 1) % self._period
        if since:
            self.indices.add(item.index)
        return since > 0


@dataclass(frozen=True)
class UnshadedScores(quality_scores.MethodScores):
    """Scores of the unshaded frames, and of the shaded ones.

    Summaries are of the unshaded frames, plus PSNR_SHADED. TEMPORAL_METRICS are over all frames.
    """

    shaded: quality_scores.MethodScores

    @classmethod
    def of(cls, scores: quality_scores.MethodScores, unshaded: Collection[int]) -> "UnshadedScores":
        """Split the scores of a method by the indices of its unshaded frames."""
        frames = [frame for frame in scores.frames if frame.frame in unshaded]
        shaded = [frame for frame in scores.frames if frame.frame not in unshaded]
        return cls(scores.method, frames, quality_scores.MethodScores(scores.method, shaded))

    def summary(self, *, warm: bool = True, cropped: bool = True) -> quality_scores.Scores:
        """See `MethodScores`."""
        unshaded = super().summary(warm=warm, cropped=cropped)
        shaded = self.shaded.summary(warm=warm, cropped=cropped)
        every = quality_scores.MethodScores(self.method, [*self.frames, *self.shaded.frames])
        changes = every.summary(warm=warm, cropped=cropped)
        temporal = {name: changes[name] for name in TEMPORAL_METRICS}
        return unshaded | temporal | {PSNR_SHADED: shaded["psnr"]}

    def classes(self, *, warm: bool = True, cropped: bool = True) -> None:
        """Return None: only shaded frames have classes."""


def measure_extrapolation(
    shot: Shot,
    upscalers: Sequence[str],
    models: Sequence[str],
    alternations: Sequence[str],
    *,
    on_left_out: Callable[[str], None] = lambda _: None,
    on_frame: Callable[[], None] = lambda: None,
) -> dict[str, list[UnshadedScores]]:
    """Remove the colour of some frames of a shot, extrapolate them in all ways; return scores by alternation.

    All frames are shaded, and have the G-buffers that the models read. Upscalers are as `parse_spec` takes
    them, alternations as `Alternation` does; models of two passes end in ":x2".

    Raises:
        ShotError: no frame has a reference, or G-buffers are missing.
        ArgumentError: no upscaler is left, or an alternation is invalid.
    """
    display, available = measure.reference_size(shot), gbuffer_arrays(shot.read_raw(0))
    for model in models:
        if missing := lacking(_info(model).gbuffers, available):
            hint = f"{model} reads them. The shots of `bench shots` have all."
            raise ShotError(shot.path, f"frames have no {listed(missing)}", hint)
    upscalers = measure.runnable(shot, upscalers, on_left_out)
    scores = {}
    for text in alternations:
        alternation = Alternation(text)
        steppers = [s for name in upscalers for s in _ways(shot, name, models, display, alternation)]
        found = measure.measure_steppers(shot, steppers, on_frame=on_frame)
        scores[text] = [UnshadedScores.of(one, alternation.indices) for one in found]
    return scores


def _info(model: str) -> ModelInfo:
    return read_model_info(find_model(model.removesuffix(_TWO_PASSES)))


def _ways(
    shot: Shot, upscaler: str, models: Sequence[str], display: Size, alternation: Alternation
) -> Iterator[measure.Stepper]:
    def way(name: str, step: Callable[[ShotFrame], Float32], gbuffers: Collection[str]) -> measure.Stepper:
        return measure.Stepper(f"{upscaler}, {name}", lambda item: StepResult(step(item)), gbuffers)

    def extrapolating(model: str) -> measure.Stepper:
        both = measure.upscaler_of(upscaler, display, extrapolation=model)

        def step(item: ShotFrame) -> Float32:
            if alternation.leaves_unshaded(item):
                return both.extrapolate(replace(item.frame, color=None))
            return both.step(item.frame)

        return way(model, step, both.gbuffers)

    def both_ways(model: str | None) -> measure.Stepper:
        runs = BothWays(measure.upscaler_of(upscaler, display), extrapolation=model)

        def frames() -> Iterator[Frame]:
            for item in shot.frames(gbuffers=runs.buffers, references=False):
                unshaded = model is not None and alternation.leaves_unshaded(item)
                yield replace(item.frame, color=None) if unshaded else item.frame

        images = runs.run(frames())
        name = f"{upscaler}, {model or 'shaded'} x2"
        return measure.Stepper(name, lambda _: next(images).result, runs.buffers)

    shaded = measure.upscaler_of(upscaler, display)
    yield way("shaded", lambda item: shaded.step(item.frame), shaded.gbuffers)
    for name, filled in (("warp", False), ("warp, filled", True)):
        baseline = WarpBaseline(measure.upscaler_of(upscaler, display), alternation, filled=filled)
        yield way(name, baseline.step, shaded.gbuffers)
    yield from (extrapolating(model) for model in models if not model.endswith(_TWO_PASSES))
    twice = [model.removesuffix(_TWO_PASSES) for model in models if model.endswith(_TWO_PASSES)]
    yield from map(both_ways, [None, *twice] if twice else [])


class WarpBaseline:
    """Upscales shaded frames, and warps the last image at unshaded ones.

    With `filled`, disoccluded pixels of warped images are filled from the nearest background.
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
                image = warped(last, frame) * np.float32(frame.pre_exposure / before.pre_exposure)
                image = with_background_filled(image, frame, before) if self._filled else image
            else:
                image, since = self._upscaler.step(replace(frame, motion=since)), None
        self._last, self._since = (frame, image), since
        return image


@dataclass(frozen=True)
class ExtrapolationRecord(quality_scores.ScoresRecord):
    """Scores of unshaded frames on shots, and their means at each ratio and alternation."""

    models: list[str]  # extrapolation models
    means: list[quality_scores.Alternated]
    BENCH = "extrapolation"

    @classmethod
    def of(cls, shots: Sequence[quality_scores.ShotRow], models: Sequence[str]) -> "ExtrapolationRecord":
        """Return the record of rows by `unshaded_row`."""
        means = []
        for ratio, group in quality_scores.shots_by_ratio(shots).items():
            for same in zip(*(shot.alternations for shot in group), strict=True):
                by_method = zip(*(row.methods for row in same), strict=True)
                methods = [quality_scores.MethodRow.mean(rows) for rows in by_method]
                means.append(quality_scores.Alternated(same[0].alternation, methods, ratio))
        return cls(list(shots), list(models), means)

    def table(self) -> str:
        """Return a Markdown table for each alternation."""
        if not self.means:
            return "\n\n".join(self._table(sizes(self.shots[0]), row) for row in self.shots[0].alternations)
        tables = []
        for mean in self.means:
            names = ", ".join(shot.name for shot in self.shots if shot.ratio == mean.ratio)
            tables.append(self._table(f"Mean of the shots {names} at ratio {mean.ratio:g}", mean))
        return "\n\n".join(tables)

    def _table(self, about: str, row: quality_scores.Alternated) -> str:
        caption = (
            f"{about}, {row.alternation} unshaded to shaded frames. Scores are of the unshaded ones; "
            f"tPSNR is of all; without the first {quality_scores.WARM_UP_FRAMES} frames and a border of "
            f"{quality_scores.BORDER} pixels"
        )
        return scores_table(caption, row.methods, COLUMNS)


def unshaded_row(
    shot: Shot, alternations: Mapping[str, Sequence[UnshadedScores]], origin: Mapping[str, Any] | None = None
) -> quality_scores.ShotRow:
    """Return the row of a shot in a record; for `origin`, see `PublicShot.origin`."""
    rows = [
        quality_scores.Alternated(text, [quality_scores.MethodRow.of(s) for s in scores])
        for text, scores in alternations.items()
    ]
    return quality_scores.ShotRow.of(shot, origin, alternations=rows)
