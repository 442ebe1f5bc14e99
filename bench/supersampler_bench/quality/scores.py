"""Scores of methods on shots: of frames, their summaries, and their rows in records."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.io.display import decibels
from supersampler.io.shot import ClassMaps, Shot
from supersampler_bench.quality.corners import KINDS
from supersampler_bench.quality.metrics import crop
from supersampler_bench.record import BenchRecord

Scores = dict[str, float]
"""Values by the metric's name; also `pixels_...`, the number of pixels of a masked PSNR, `weight_...` of
WEIGHTED measures, and `srred` and `trred`, whose product is STRRED. Unknown metrics are NaN or missing."""
Counts = NDArray[np.int64]
"""(2, 3, 3): pixels by group, true class and predicted class."""

WARM_UP_FRAMES = 8
BORDER = 8  # display pixels
CLASS_MASKS = ("disoccluded", "changing_light", "aliased", "thin", "moving")
MASKED = (*CLASS_MASKS, "shadow_edges", *(f"kind_{kind}" for kind in KINDS))
"""Masks of pixels; `psnr_...` is measured in each."""
WEIGHTED = ("trail", "color_trail", "thin_kept", "speckle")
"""Measures of corners.py; `weight_...` is their weight in the mean over frames."""
FRAME_METRICS = (
    *("psnr", "ssim", "flip", "tpsnr", "warped_error_difference", "strred", "psnr_first"),
    *(f"psnr_{mask}" for mask in MASKED),
    *WEIGHTED,
)
SUMMARY_VARIANTS = {
    f"{'warm' if warm else 'all'}_{'cropped' if cropped else 'full'}": {"warm": warm, "cropped": cropped}
    for warm, cropped in product((True, False), repeat=2)
}
"""The four summaries: with or without the warm-up frames, with or without the border."""
CLASSES: Mapping[str, tuple[str, str, str]] = {
    "ghosting": ("none", "visibility", "shading"),
    "aliasing": ("none", "geometry", "texture"),
}
"""The classes of each group, in the order of `StepResult.class_map` and by the numbers of `ClassMaps`."""


def count_classes(class_map: Float32, truth: ClassMaps, border: int = 0) -> Counts:
    """Count display pixels (H, W) by true and predicted class, without `border` pixels on each side.

    The prediction is the most probable class. A class map is (H / 2, W / 2, 6), sizes rounded up (see
    `StepResult.class_map`), or (H, W, 6) from `classifier-paper`. A map of half the size predicts one class
    for 2x2 pixels, so finer areas never match completely.

    Raises:
        ArgumentError: the map has another size.
    """
    counts = np.zeros((2, 3, 3), np.int64)
    full = truth.ghost.shape
    half = (full[0] + 1) // 2, (full[1] + 1) // 2
    if class_map.shape[:2] not in (full, half):
        raise ArgumentError("class_map", got=f"of {class_map.shape[:2]} pixels", want=f"{half} or {full}")
    side = 1 if class_map.shape[:2] == full else 2
    for group, labels in enumerate((truth.ghost, truth.alias)):
        coarse = class_map[..., 3 * group : 3 * group + 3].argmax(axis=-1)
        predicted = coarse.repeat(side, axis=0).repeat(side, axis=1)[: full[0], : full[1]]
        true = crop(labels, border).astype(np.intp)
        cells = np.bincount((3 * true + crop(predicted, border)).ravel(), minlength=9)
        counts[group] = cells.reshape(3, 3)
    return counts


def overlap(matrix: Counts) -> NDArray[np.float64]:
    """Return intersection over union of each class, (3, 3) to (3,); NaN if neither present nor predicted."""
    together = np.diagonal(matrix).astype(np.float64)
    either = matrix.sum(axis=0) + matrix.sum(axis=1) - together
    return np.asarray(np.divide(together, either, out=np.full(3, np.nan), where=either > 0))


def fractions(matrix: Counts) -> NDArray[np.float64]:
    """Return each row as fractions of its true class's pixels; NaN for a class without pixels."""
    there = matrix.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(matrix, there, out=np.full((3, 3), np.nan), where=there > 0))


@dataclass(frozen=True)
class FrameScores:
    """A method's scores of one frame, for the whole image and without a border of `BORDER` pixels."""

    frame: int
    full: Scores
    cropped: Scores
    full_classes: Counts | None = None
    cropped_classes: Counts | None = None


@dataclass(frozen=True)
class MethodScores:
    """A method's scores of a shot: of the frames that have a reference, in order."""

    method: str
    frames: list[FrameScores]
    jod: float = field(default=float("nan"), kw_only=True)
    """ColorVideoVDP of the frames after the warm-up, without the border; NaN if not measured."""

    def summary(self, *, warm: bool = True, cropped: bool = True) -> Scores:
        """Return the mean of each metric over the frames that have it; NaN if none does.

        PSNR in a mask is computed from the mean squared error over the mask's pixels of all frames. STRRED is
        the mean SRRED times the mean TRRED. Each kind of pixel also has `error_share_...`, its fraction of
        the squared error, and `pixel_share_...`, its fraction of the pixels.

        Args:
            warm: leave out the first `WARM_UP_FRAMES` of the shot, except from the PSNR of first images.
            cropped: leave out the border.
        """
        scores = [f.cropped if cropped else f.full for f in self._counted(warm)]
        summary = {name: _pooled(name, scores) for name in FRAME_METRICS}
        first = [f.cropped if cropped else f.full for f in self.frames]
        jod = self.jod if warm and cropped else float("nan")
        return {**summary, **_shares(scores), "psnr_first": _pooled("psnr_first", first), "jod": jod}

    def classes(self, *, warm: bool = True, cropped: bool = True) -> Counts | None:
        """Return the class counts of the pixels that `summary` counts; None if classes are unknown."""
        counts = [f.cropped_classes if cropped else f.full_classes for f in self._counted(warm)]
        known = [c for c in counts if c is not None]
        return np.sum(known, axis=0) if known else None

    def _counted(self, warm: bool) -> list[FrameScores]:
        return [f for f in self.frames if f.frame >= WARM_UP_FRAMES or not warm]


def _pooled(name: str, scores: list[Scores]) -> float:
    if name == "strred":
        return _mean([s["srred"] for s in scores]) * _mean([s["trred"] for s in scores])
    known = [s for s in scores if not np.isnan(s.get(name, np.nan))]
    if not known:
        return float("nan")
    mask = name.removeprefix("psnr_")
    if mask in MASKED:
        weights = [s[f"pixels_{mask}"] for s in known]
        return decibels(float(np.average([_squared_error(s[name]) for s in known], weights=weights)))
    values = [s[name] for s in known]
    if name in WEIGHTED:
        return float(np.average(values, weights=[s[f"weight_{name}"] for s in known]))
    return _mean(values)


def _squared_error(psnr: float) -> float:
    return float(10.0 ** (-psnr / 10.0))


def _shares(scores: list[Scores]) -> Scores:
    """Return the fraction of the squared error and of the pixels of each of KINDS; NaN if unknown."""
    pixels, errors = dict.fromkeys(KINDS, 0.0), dict.fromkeys(KINDS, 0.0)
    for kind in KINDS:
        for one in scores:
            if count := one.get(f"pixels_kind_{kind}", 0.0):
                pixels[kind] += count
                errors[kind] += count * _squared_error(one[f"psnr_kind_{kind}"])
    shares = {f"error_share_{kind}": _fraction(errors[kind], errors) for kind in KINDS}
    return shares | {f"pixel_share_{kind}": _fraction(pixels[kind], pixels) for kind in KINDS}


def _fraction(part: float, of: Mapping[str, float]) -> float:
    whole = sum(of.values())
    return part / whole if whole else float("nan")


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")


@dataclass(frozen=True)
class ClassCounts:
    """Pixels of a group of classes, by true and predicted class, and the overlap of each class."""

    classes: list[str]
    pixels_by_true_and_predicted_class: list[list[int]]
    intersection_over_union: list[float | None]

    @classmethod
    def of(cls, counts: Counts | None) -> dict[str, Self] | None:
        """Return the counts of each group."""
        if counts is None:
            return None
        return {
            group: cls(list(names), matrix.tolist(), overlap(matrix).tolist())
            for (group, names), matrix in zip(CLASSES.items(), counts, strict=True)
        }


@dataclass(frozen=True)
class MethodRow:
    """Scores of one method in a record."""

    method: str
    summary: dict[str, dict[str, float | None]]  # metrics by SUMMARY_VARIANTS; None or NaN if unknown
    classes: dict[str, dict[str, ClassCounts] | None]  # counts by SUMMARY_VARIANTS and group
    frames: list[dict[str, Any]] = field(default_factory=list)  # scores of frames, not in published records
    ratio: float | None = None  # of a mean over shots

    @classmethod
    def of(cls, scores: MethodScores) -> Self:
        """Return the summaries of one method."""
        variants = SUMMARY_VARIANTS.items()
        return cls(
            scores.method,
            {name: dict(scores.summary(**variant)) for name, variant in variants},
            {name: ClassCounts.of(scores.classes(**variant)) for name, variant in variants},
        )

    @classmethod
    def mean(cls, rows: Sequence[Self], ratio: float | None = None) -> Self:
        """Return the mean of one method over several shots: for each metric, over the shots that have it."""
        summary: dict[str, dict[str, float | None]] = {}
        classes: dict[str, dict[str, ClassCounts] | None] = {}
        for name in SUMMARY_VARIANTS:
            known = [row.known(name) for row in rows]
            summary[name] = {key: _mean([s.get(key, np.nan) for s in known]) for key in rows[0].summary[name]}
            counts = [c for row in rows if (c := row.counts(name)) is not None]
            classes[name] = ClassCounts.of(np.sum(counts, axis=0) if counts else None)
        return cls(rows[0].method, summary, classes, ratio=ratio)

    def known(self, variant: str = "warm_cropped") -> Scores:
        """Return the known metrics of a summary."""
        return {k: v for k, v in self.summary[variant].items() if v is not None and not np.isnan(v)}

    def counts(self, variant: str = "warm_cropped") -> Counts | None:
        """Return the class counts of a summary; None if classes are unknown."""
        groups = self.classes[variant]
        if groups is None:
            return None
        return np.array([groups[group].pixels_by_true_and_predicted_class for group in CLASSES], np.int64)


@dataclass(frozen=True)
class Alternated:
    """Scores of methods with one alternation of unshaded and shaded frames."""

    alternation: str
    methods: list[MethodRow]
    ratio: float | None = None  # of a mean over shots


@dataclass(frozen=True)
class ShotRow:
    """Scores of methods on one shot in a record."""

    name: str
    shot_json_sha256: str | None  # None for a shot without a shot.json
    frames: int
    reference_frames: list[int]  # numbers of the frames that have a reference
    render_size: Size
    display_size: Size
    masks: str  # "truth classes" or "depth and motion"
    ratio: float | None = None  # this and the next three fields: of the test shots, see `PublicShot.origin`
    driver: str | None = None
    pixels_sha256: str | None = None
    as_frozen: bool | None = None
    methods: list[MethodRow] = field(default_factory=list)  # of `bench quality`
    alternations: list[Alternated] = field(default_factory=list)  # of `bench extrapolation`

    @classmethod
    def of(cls, shot: Shot, origin: Mapping[str, Any] | None = None, **rows: Any) -> Self:
        """Return the row of a shot; for `origin`, see `PublicShot.origin`."""
        file = shot.path if shot.path.is_file() else shot.path / "shot.json"
        references = shot.reference_indices
        classes = shot.read_classes(references[0]) if references else None
        return cls(
            name=shot.name,
            shot_json_sha256=hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None,
            frames=len(shot),
            reference_frames=list(references),
            render_size=shot.render_size,
            display_size=shot.display_size or (0, 0),
            masks="depth and motion" if classes is None else "truth classes",
            **(origin or {}),
            **rows,
        )

    @property
    def real_ratio(self) -> float:
        """Display over render width."""
        return self.display_size[0] / self.render_size[0]


@dataclass(frozen=True)
class ScoresRecord(BenchRecord):
    """Scores on shots."""

    shots: list[ShotRow]
    warm_up_frames: int = field(default=WARM_UP_FRAMES, kw_only=True)
    border: int = field(default=BORDER, kw_only=True)


def shots_by_ratio(shots: Sequence[ShotRow]) -> dict[float, list[ShotRow]]:
    """Return the shots of each ratio; nothing for a single shot, which has no mean."""
    groups: dict[float, list[ShotRow]] = {}
    for shot in shots if len(shots) > 1 else ():
        groups.setdefault(shot.ratio or shot.real_ratio, []).append(shot)
    return groups


def shot_row(shot: Shot, methods: Sequence[MethodScores], origin: Mapping[str, Any] | None = None) -> ShotRow:
    """Return the row of a shot in a quality record, with the scores of single frames."""
    rows = []
    for scores in methods:
        frames = [{"frame": f.frame, "full": f.full, "cropped": f.cropped} for f in scores.frames]
        rows.append(replace(MethodRow.of(scores), frames=frames))
    return ShotRow.of(shot, origin, methods=rows)


def mean_rows(shots: Sequence[ShotRow]) -> Iterator[MethodRow]:
    """Yield the mean of each method at each ratio. Shots of a ratio have the same methods."""
    for ratio, group in shots_by_ratio(shots).items():
        for rows in zip(*(shot.methods for shot in group), strict=True):
            yield MethodRow.mean(rows, ratio)
