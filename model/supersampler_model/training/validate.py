"""Validation: whole frames of sequences that are not trained on, stepped as an engine steps them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from supersampler.frame import Float32
from supersampler.io.display import decibels, display_transform
from supersampler_model.data.dataset import Dataset, TrainingFrame
from supersampler_model.data.dataset.description import SequenceEntry
from supersampler_model.methods.base import Method, Size
from supersampler_model.training.walk import SequenceRunner

WARM_UP = 8
BORDER = 8
CLASS_NAMES = ("ghost.none", "visibility", "shading", "alias.none", "geometry", "texture")


@dataclass(frozen=True)
class Validated:
    """Scores of one method, means over sequences.

    Attributes:
        psnr: of shown images after the warm-up, dB.
        tpsnr: of their changes from frame to frame, dB; NaN where none that follow each other were drawn.
        overlap: intersection over union per class; empty for methods without classes.
        kinds: PSNR of shaded and of hidden frames, apart; empty where all are of one kind.
        image: (H, W, 3) the last frame of the first sequence, as shown, above the reference.
    """

    psnr: float
    tpsnr: float
    overlap: dict[str, float]
    kinds: dict[str, float]
    picture: Float32

    @property
    def scores(self) -> dict[str, float]:
        """Those that are known, by name."""
        values = {"psnr": self.psnr, "tpsnr": self.tpsnr}
        return {name: value for name, value in values.items() if not np.isnan(value)} | self.kinds


def validation_entries(
    datasets: Sequence[Dataset], ratios: tuple[float, float]
) -> list[tuple[Dataset, SequenceEntry]]:
    """Sequences of the validation split within the ratios, those that are complete."""
    return [
        (d, e)
        for d in datasets
        for e in d.entries("validation")
        if ratios[0] - 0.02 <= e.ratio <= ratios[1] + 0.02 and d.complete(e) == e.spec.frames
    ]


def validate(
    method: Method,
    entries: Sequence[tuple[Dataset, SequenceEntry]],
    walk: Callable[[Method, Size], SequenceRunner] = SequenceRunner,
) -> Validated:
    """Step `method` through all `entries`, as `walk` goes."""
    rows, pictures = [], []
    counts = np.zeros((2, len(CLASS_NAMES)))
    for dataset, entry in entries:
        display = Size(*dataset.description.display_size)
        scores, picture = _sequence(method, dataset.frames(entry), walk(method, display), counts)
        rows.append(scores)
        pictures.append(picture)
    psnr, tpsnr, shaded, hidden = (_mean([row[i] for row in rows]) for i in range(4))
    kinds = {} if np.isnan(shaded + hidden) else {"psnr_shaded": shaded, "psnr_hidden": hidden}
    overlap = {}
    if counts.any():
        overlap = {n: float(a / max(b, 1.0)) for n, a, b in zip(CLASS_NAMES, *counts, strict=True)}
    return Validated(psnr, tpsnr, overlap, kinds, pictures[0])


def _sequence(
    method: Method, frames: Iterable[TrainingFrame], walk: SequenceRunner, counts: "np.ndarray"
) -> tuple[tuple[float, ...], Float32]:
    squared: tuple[list[float], list[float]] = [], []  # of shaded frames, of hidden ones
    changed, before, off_before = [], -1, None
    picture = np.zeros((1, 1, 3), np.float32)
    for index, frame in enumerate(frames):
        image = walk.step(frame)
        if image is None:
            continue
        shown = display_transform(image[0].permute(1, 2, 0).numpy(), frame.exposure)
        truth = display_transform(walk.truth(frame).astype(np.float32), frame.exposure)
        off = (shown - truth)[BORDER:-BORDER, BORDER:-BORDER]
        if np.isnan(off).any():  # a frame of a user's shot without a reference
            continue
        if index >= WARM_UP:
            squared[walk.hidden].append(_psnr(off))
            if off_before is not None and before == index - 1 and not frame.reset:
                changed.append(_psnr(off - off_before))
        before, off_before, picture = index, off, np.concatenate([shown, truth])
        if "classes" in method.history:
            _count(walk.history[list(method.history).index("classes")], frame, counts)
    of = ([*squared[0], *squared[1]], changed, *squared)
    return tuple(float(np.mean(values)) if values else float("nan") for values in of), picture


def _count(classes: Tensor, frame: TrainingFrame, counts: "np.ndarray") -> None:
    """Add to the intersections and unions of each class, on every second pixel."""
    for group, truth in enumerate((frame.ghost, frame.alias)):
        said = classes[0, 3 * group : 3 * group + 3].argmax(dim=0).numpy()
        said = said if said.shape != truth.shape else said[::2, ::2]
        true = truth[::2, ::2]
        for c in range(3):
            a, b = said == c, true == c
            counts[:, 3 * group + c] += (a & b).sum(), (a | b).sum()


def _mean(values: list[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")


def _psnr(off: Float32) -> float:
    return decibels(float(np.square(off, dtype=np.float64).mean()))
