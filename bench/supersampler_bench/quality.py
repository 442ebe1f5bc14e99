"""Quality of methods on a shot: one pass, one frame at a time, all methods side by side.

What is measured and how: metrics.py and masks.py. Each frame's scores are kept for the whole picture ("full")
and without a border ("cropped"), summaries of all frames ("all") and without the first ones ("warm").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from supersampler.display import auto_exposure, decibels, display_transform
from supersampler.errors import ShotError
from supersampler.frame import Float32, Frame, Size
from supersampler.model import Precision
from supersampler.shot import ClassMaps, Shot, ShotFrame
from supersampler.upscaler import Upscaler
from supersampler_bench import masks, metrics

Bool = NDArray[np.bool_]
Scores = dict[str, float]
"""By the metric's name, and as `pixels_...` how many a masked PSNR saw. NaN where there was nothing."""

WARM_UP_FRAMES = 8
BORDER = 8  # display pixels
ORACLE = "oracle"
MASKED = ("disoccluded", "changing_light", "aliased", "moving")
METRICS = (
    "psnr",
    "ssim",
    "flip",
    "tpsnr",
    "warped_error_difference",
    *(f"psnr_{mask}" for mask in MASKED),
)


@dataclass(frozen=True)
class FrameScores:
    """One method's scores of one frame, for the whole picture and without a border of `BORDER` pixels."""

    frame: int
    full: Scores
    cropped: Scores


@dataclass(frozen=True)
class MethodScores:
    """One method's scores of a shot, over the frames that have a reference."""

    method: str
    frames: list[FrameScores]

    def summary(self, *, warm: bool = True, cropped: bool = True) -> Scores:
        """Return the mean of each metric over the frames that have it; NaN where none does.

        PSNR in a mask is that of the mean squared error over all its pixels of all frames, so that a frame
        with three such pixels does not weigh as one with three thousand.

        Args:
            warm: leave out the first `WARM_UP_FRAMES` of the shot.
            cropped: leave out the border.
        """
        frames = [f for f in self.frames if f.frame >= WARM_UP_FRAMES or not warm]
        scores = [f.cropped if cropped else f.full for f in frames]
        return {name: _pooled(name, scores) for name in METRICS}


@dataclass(frozen=True)
class MeanScores:
    """One method's scores of several shots, each of which weighs the same."""

    method: str
    shots: list[MethodScores]

    def summary(self, *, warm: bool = True, cropped: bool = True) -> Scores:
        """Return the mean of the shots' summaries that have a metric; NaN where none has."""
        found = [shot.summary(warm=warm, cropped=cropped) for shot in self.shots]
        columns = {name: [s[name] for s in found if not np.isnan(s[name])] for name in METRICS}
        return {name: float(np.mean(values)) if values else float("nan") for name, values in columns.items()}


def measure_quality(
    shot: Shot, methods: Sequence[str | Path], *, on_frame: Callable[[int], None] | None = None
) -> list[MethodScores]:
    """Step every method through the shot and score the frames that have a reference.

    Args:
        shot: at least one frame with a reference.
        methods: names of shipped models, or model folders, as they run by default or, with ":fp32" or ":int8"
            after them, in that precision; "oracle" for `oracle.Oracle`.
        on_frame: called with the number of frames done, after each.

    Returns:
        Scores in the order of `methods`.

    Raises:
        ShotError: no frame has a reference.
        ModelError, FrameError: see `Upscaler`.
    """
    display_size = reference_size(shot)
    steppers = [_stepper(method, display_size) for method in methods]
    results = [MethodScores(str(method), []) for method in methods]
    truths = _Truths(display_size)
    before: list[Float32 | None] = [None] * len(methods)
    for item in shot:
        truth = truths.next(item, shot.read_classes(item.index))
        for i, step in enumerate(steppers):
            image = step(item)
            if truth is not None:
                results[i].frames.append(_score(image, before[i], truth))
            before[i] = image if truth is not None else None
        if on_frame is not None:
            on_frame(item.index + 1)
    return results


def _stepper(method: str | Path, display_size: Size) -> Callable[[ShotFrame], Float32]:
    if method == ORACLE:
        from supersampler_bench.oracle import Oracle  # needs torch

        return Oracle(display_size).step
    name, precision = _split(str(method))
    upscaler = Upscaler(name, display_size=display_size, precision=precision, validate="off")
    return lambda item: upscaler.step(item.frame)


def _split(method: str) -> tuple[str, Precision]:
    """Name and precision; a colon may be part of a path."""
    name, _, last = method.rpartition(":")
    precisions: dict[str, Precision] = {"fp32": "fp32", "fp16": "fp16", "int8": "int8"}
    return (name, precisions[last]) if last in precisions else (method, "auto")


def reference_size(shot: Shot) -> Size:
    """Return the (width, height) of a shot's references.

    Raises:
        ShotError: it has none.
    """
    if not shot.reference_indices or shot.display_size is None:
        hint = "Render some frames with many samples a pixel at display size and list them in shot.json."
        raise ShotError(shot.path, "no frame has a reference to measure against", hint)
    return shot.display_size


@dataclass(frozen=True)
class _Truth:
    """What the pictures of one frame are held against, the same for all methods."""

    frame: int
    exposure: float
    shown: Float32  # (H, W, 3), as a screen shows the reference
    previous: Float32 | None  # the same of the frame before, at this frame's exposure; None without one
    motion: Float32  # (H, W, 2), display pixels
    masks: dict[str, Bool]  # (H, W) each; those that are known


class _Truths:
    """Follows the frames of a shot and remembers what the next one needs of the last."""

    def __init__(self, display_size: Size) -> None:
        self._display_size = display_size
        self._frame: Frame | None = None
        self._reference: Float32 | None = None

    def next(self, item: ShotFrame, classes: ClassMaps | None) -> _Truth | None:
        """Return the truth of the next frame in order; None where it has no reference."""
        truth = None if item.reference is None else self._truth(item, item.reference, classes)
        self._frame, self._reference = item.frame, item.reference
        return truth

    def _truth(self, item: ShotFrame, reference: Float32, classes: ClassMaps | None) -> _Truth:
        frame = item.frame
        exposure = frame.exposure or auto_exposure(reference)
        known = {"moving": self._to_display(masks.moving(frame), frame)}
        if classes is None:
            known["disoccluded"] = self._to_display(masks.disoccluded(frame, self._frame), frame)
        else:
            known |= masks.of_classes(classes)
        previous = None if frame.reset else self._reference
        return _Truth(
            frame=item.index,
            exposure=exposure,
            shown=display_transform(reference, exposure),
            previous=None if previous is None else display_transform(previous, exposure),
            motion=masks.display_motion(frame, self._display_size),
            masks=known,
        )

    def _to_display(self, mask: Bool, frame: Frame) -> Bool:
        return masks.to_display(mask, frame.jitter, self._display_size)


def _score(image: Float32, before: Float32 | None, truth: _Truth) -> FrameScores:
    shown = display_transform(image, truth.exposure)
    previous = None if before is None else display_transform(before, truth.exposure)
    flip = metrics.flip_map(shown, truth.shown)
    return FrameScores(
        truth.frame,
        full=_scores(shown, previous, truth, flip, 0),
        cropped=_scores(shown, previous, truth, flip, BORDER),
    )


def _scores(shown: Float32, previous: Float32 | None, truth: _Truth, flip: Float32, border: int) -> Scores:
    """Score one picture without `border` pixels; what looks at neighbours has seen them before the crop."""
    picture, reference = metrics.crop(shown, border), metrics.crop(truth.shown, border)
    scores = {
        "psnr": metrics.psnr(picture, reference),
        "ssim": metrics.ssim(picture, reference),
        "flip": float(metrics.crop(flip, border).mean(dtype=np.float64)),
        "tpsnr": float("nan"),
        "warped_error_difference": float("nan"),
    }
    for name in MASKED:
        mask = metrics.crop(truth.masks.get(name, np.zeros(shown.shape[:2], bool)), border)
        scores[f"psnr_{name}"] = metrics.psnr(picture, reference, mask)
        scores[f"pixels_{name}"] = float(mask.sum())
    if previous is not None and truth.previous is not None:
        earlier, earlier_reference = metrics.crop(previous, border), metrics.crop(truth.previous, border)
        scores["tpsnr"] = metrics.tpsnr(picture, earlier, reference, earlier_reference)
        valid = np.zeros_like(truth.masks["disoccluded"])
        metrics.crop(valid, border)[...] = ~metrics.crop(truth.masks["disoccluded"], border)
        scores["warped_error_difference"] = metrics.warped_error_difference(
            shown, previous, truth.shown, truth.previous, truth.motion, valid
        )
    return scores


def _pooled(name: str, scores: list[Scores]) -> float:
    values = np.array([s[name] for s in scores])
    known = ~np.isnan(values)
    if not known.any():
        return float("nan")
    if name.removeprefix("psnr_") not in MASKED:
        return float(values[known].mean())
    pixels = np.array([s[name.replace("psnr", "pixels")] for s in scores])
    squared_errors = 10.0 ** (-values[known] / 10.0)
    return decibels(float(np.average(squared_errors, weights=pixels[known])))
