"""Validation: whole frames of sequences that are not trained on, stepped as an engine steps them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.display import decibels, display_transform
from supersampler.frame import Float32
from supersampler_model.data.dataset import Dataset, TrainingFrame
from supersampler_model.data.dataset.description import SequenceEntry
from supersampler_model.method import Method, Size
from supersampler_model.train.frame_inputs import frame_inputs

WARM_UP = 8
BORDER = 8
CLASS_NAMES = ("ghost.none", "visibility", "shading", "alias.none", "geometry", "texture")


class Drawn(NamedTuple):
    """What a method made of one frame."""

    number: int  # of the frame, from 0
    frame: TrainingFrame
    image: Tensor  # (1, 3, H, W) linear RGB
    truth: NDArray[Any]  # (H, W, 3)
    history: list[Tensor]


@dataclass(frozen=True)
class Validated:
    """Scores of one method, means over sequences.

    Attributes:
        psnr: of shown pictures after the warm-up, dB.
        tpsnr: of their changes from frame to frame, dB; NaN where none that follow each other were drawn.
        overlap: intersection over union per class; empty for methods without classes.
        picture: (H, W, 3) the last frame of the first sequence, as shown, above the reference.
    """

    psnr: float
    tpsnr: float
    overlap: dict[str, float]
    picture: Float32

    @property
    def scores(self) -> dict[str, float]:
        """Those that are known, by name."""
        values = {"psnr": self.psnr, "tpsnr": self.tpsnr}
        return {name: value for name, value in values.items() if not np.isnan(value)}


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


def validate(method: Method, entries: Sequence[tuple[Dataset, SequenceEntry]]) -> Validated:
    """Step `method` through all `entries`."""
    rows, pictures = [], []
    counts = np.zeros((2, len(CLASS_NAMES)))
    for dataset, entry in entries:
        scores, picture = _sequence(method, dataset.frames(entry), dataset.description.display_size, counts)
        rows.append(scores)
        pictures.append(picture)
    psnr, tpsnr = (_mean([row[i] for row in rows]) for i in range(2))
    overlap = {}
    if counts.any():
        overlap = {n: float(a / max(b, 1.0)) for n, a, b in zip(CLASS_NAMES, *counts, strict=True)}
    return Validated(psnr, tpsnr, overlap, pictures[0])


def _sequence(
    method: Method, frames: Iterable[TrainingFrame], display_size: tuple[int, int], counts: "np.ndarray"
) -> tuple[tuple[float, float], Float32]:
    squared, changed = [], []
    before, off_before = -1, None
    picture = np.zeros((1, 1, 3), np.float32)
    hidden = method.extrapolates()
    drawn = hidden_frames(method, frames) if hidden else all_frames(method, frames, Size(*display_size))
    for number, frame, image, truth, history in drawn:
        shown = display_transform(image[0].permute(1, 2, 0).numpy(), frame.exposure)
        wanted = display_transform(truth.astype(np.float32), frame.exposure)
        off = (shown - wanted)[BORDER:-BORDER, BORDER:-BORDER]
        if np.isnan(off).any():  # a frame of a user's shot without a reference
            continue
        if number >= WARM_UP:
            squared.append(_psnr(off))
            if off_before is not None and before == number - 1 and not frame.reset:
                changed.append(_psnr(off - off_before))
        before, off_before, picture = number, off, np.concatenate([shown, wanted])
        if "classes" in method.history:
            _count(history[list(method.history).index("classes")], frame, counts)
    psnr, tpsnr = (float(np.mean(values)) if values else float("nan") for values in (squared, changed))
    return (psnr, tpsnr), picture


def all_frames(method: Method, frames: Iterable[TrainingFrame], display: Size) -> Iterator[Drawn]:
    """Step a method that upscales through every frame."""
    history: list[Tensor] = []
    for index, frame in enumerate(frames):
        if frame.reset or not history:
            history = method.first_history(display, Size(*frame.depth.shape[::-1]))
        with torch.no_grad():
            image, history, _ = method.step(*frame_inputs(frame, method.inputs()), *history)
        yield Drawn(index, frame, image, frame.reference, history)


def hidden_frames(method: Method, frames: Iterable[TrainingFrame]) -> Iterator[Drawn]:
    """Hide every second frame's colour, and have a method that extrapolates draw it."""
    names = ["color", *method.inputs()]
    history: list[Tensor] | None = None
    for index, frame in enumerate(frames):
        inputs = dict(zip(names, frame_inputs(frame, names), strict=True))
        if index % 2 == 0 or frame.reset or history is None:
            history = method.after_shaded(inputs, None if frame.reset else history)
            continue
        with torch.no_grad():
            image, history, _ = method.step(*(inputs[name] for name in method.inputs()), *history)
        yield Drawn(index, frame, image, frame.color, history)


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
