"""Validation on whole frames of held-out sequences, in order, as in an engine."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.frame import Float32
from supersampler.io.display import decibels, display_transform
from supersampler.methods.at_rest import ADDS_SAMPLES
from supersampler.methods.spec import FRAME_INPUTS
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset, SequenceEntry, TrainingFrame
from supersampler_model.methods.base import Method
from supersampler_model.training.datasets import UNKNOWN, gbuffers, method_inputs

WARM_UP = 8
BORDER = 8
CLASS_NAMES = ("ghost.none", "visibility", "shading", "alias.none", "geometry", "texture")


class SequenceRunner:
    """Runs a method over frames, in order.

    Attributes:
        history: the method's history tensors after the last frame.
        unshaded: whether the last frame was unshaded.
    """

    def __init__(self, method: Method, display: ops.Size) -> None:
        self._method, self._display = method, display
        self.history: list[Tensor] = []
        self.unshaded = False

    @torch.no_grad()
    def step(self, frame: TrainingFrame) -> Tensor | None:
        """Return the image of the next frame, (1, 3, H, W) linear RGB, or None if the method makes none."""
        if frame.reset or not self.history:
            self.history = self._method.first_history(self._display, ops.Size(*frame.depth.shape[::-1]))
        return self._image(frame)

    def truth(self, frame: TrainingFrame) -> NDArray[Any]:
        """Return the reference of the image, (H, W, 3) linear RGB."""
        return frame.reference

    def _image(self, frame: TrainingFrame) -> Tensor | None:
        method = self._method
        image, self.history, _ = method.step(*method_inputs(frame, method.inputs()).values(), *self.history)
        return image


class AlternatingRunner(SequenceRunner):
    """Treats every second frame after a cut as unshaded, and extrapolates its colour.

    The method steps on shaded frames. On extrapolated frames, it or its `on_extrapolated` steps.
    """

    def __init__(self, method: Method, display: ops.Size, extrapolator: Method) -> None:
        super().__init__(method, display)
        self._on_unshaded, self._extrapolator = method.on_extrapolated() or method, extrapolator
        self._extrapolator_history: list[Tensor] | None = None

    def _image(self, frame: TrainingFrame) -> Tensor | None:
        history = None if frame.reset else self._extrapolator_history
        self.unshaded = history is not None and not self.unshaded
        given = method_inputs(frame, [*FRAME_INPUTS, ADDS_SAMPLES, *gbuffers(frame)])
        method = self._method
        if history is not None and self.unshaded:
            inputs = [given[name] for name in self._extrapolator.inputs()]
            given["color"], self._extrapolator_history, _ = self._extrapolator.step(*inputs, *history)
            given[ADDS_SAMPLES] = torch.zeros(1)
            method = self._on_unshaded
        else:
            self._extrapolator_history = self._extrapolator.after_shaded(given, history)
        image, self.history, _ = method.step(*(given[name] for name in method.inputs()), *self.history)
        return image


class ExtrapolationRunner(SequenceRunner):
    """Steps an extrapolating method on every second frame after a cut."""

    @torch.no_grad()
    def step(self, frame: TrainingFrame) -> Tensor | None:
        """Return the image of the next frame; None for shaded frames."""
        history = self.history if self.history and not frame.reset else None
        self.unshaded = history is not None and not self.unshaded
        method = self._method
        if self.unshaded:
            return self._image(frame)
        given = method_inputs(frame, ["color", *method.inputs()])
        self.history = method.after_shaded(given, history)
        return None

    def truth(self, frame: TrainingFrame) -> NDArray[Any]:
        """Return the shaded colour, at render size."""
        return frame.color


@dataclass(frozen=True)
class Validated:
    """Scores of one method, means over sequences."""

    psnr: float  # of display values after the warm-up, dB
    tpsnr: float  # of their changes from frame to frame, dB; NaN without consecutive images
    overlap: dict[str, float]  # intersection over union of each class that was seen or inferred
    kinds: dict[str, float]  # PSNR of shaded and of unshaded frames; empty if all are of one kind
    image: Float32  # (2 H, W, 3) display values of the first sequence's last frame, above the reference

    @property
    def scores(self) -> dict[str, float]:
        """Known scores by name."""
        values = {"psnr": self.psnr, "tpsnr": self.tpsnr}
        return {name: value for name, value in values.items() if not np.isnan(value)} | self.kinds


def validation_entries(
    datasets: Sequence[Dataset], ratios: tuple[float, float]
) -> list[tuple[Dataset, SequenceEntry]]:
    """Return the complete sequences of the validation split within the ratios."""
    return [
        (d, e)
        for d in datasets
        for e in d.entries("validation")
        if e.within(ratios) and d.complete(e) == e.spec.frames
    ]


def validate(
    method: Method,
    entries: Sequence[tuple[Dataset, SequenceEntry]],
    runner: Callable[[Method, ops.Size], SequenceRunner] = SequenceRunner,
) -> Validated:
    """Step `method` through all `entries` with a `runner`."""
    rows, images = [], []
    counts = np.zeros((2, len(CLASS_NAMES)))
    for dataset, entry in entries:
        display = ops.Size(*dataset.description.display_size)
        scores, image = _sequence(method, dataset.frames(entry), runner(method, display), counts)
        rows.append(scores)
        images.append(image)
    psnr, tpsnr, shaded, unshaded = (_mean([row[i] for row in rows]) for i in range(4))
    kinds = {} if np.isnan(shaded + unshaded) else {"psnr_shaded": shaded, "psnr_unshaded": unshaded}
    overlap = {n: float(a / b) for n, a, b in zip(CLASS_NAMES, *counts, strict=True) if b}
    return Validated(psnr, tpsnr, overlap, kinds, images[0])


def _sequence(
    method: Method, frames: Iterable[TrainingFrame], runner: SequenceRunner, counts: "np.ndarray"
) -> tuple[tuple[float, ...], Float32]:
    squared: tuple[list[float], list[float]] = [], []  # of shaded and of unshaded frames
    changed, before, error_before = [], -1, None
    image = np.zeros((1, 1, 3), np.float32)
    for index, frame in enumerate(frames):
        stepped = runner.step(frame)
        if stepped is None:
            continue
        linear = runner.truth(frame).astype(np.float32)
        shown = display_transform(stepped[0].permute(1, 2, 0).numpy(), frame.exposure)
        truth = display_transform(linear, frame.exposure)
        error = np.where(np.isnan(linear), np.float32(np.nan), shown - truth)[BORDER:-BORDER, BORDER:-BORDER]
        if np.isnan(error).all():  # the frame has no reference
            continue
        if index >= WARM_UP:
            squared[runner.unshaded].append(_psnr(error))
            if error_before is not None and before == index - 1 and not frame.reset:
                changed.append(_psnr(error - error_before))
            if "classes" in method.history and not frame.reset:  # first frames are all visibility ghosting
                _count(runner.history[list(method.history).index("classes")], frame, counts)
        before, error_before, image = index, error, np.concatenate([shown, truth])
    of = ([*squared[0], *squared[1]], changed, *squared)
    return tuple(_mean(values) for values in of), image


def _count(classes: Tensor, frame: TrainingFrame, counts: "np.ndarray") -> None:
    """Count the intersections and unions of each class, on every second pixel within the border."""
    inner = slice(BORDER // 2, -BORDER // 2)
    for group, truth in enumerate((frame.ghost, frame.alias)):
        true = truth[::2, ::2]
        own = ops.resize_nearest(classes[:, 3 * group : 3 * group + 3], ops.Size(*true.shape[::-1]))
        inferred, true = own[0].argmax(dim=0).numpy()[inner, inner], true[inner, inner]
        for c in range(3):
            a, b = (inferred == c) & (true != UNKNOWN), true == c
            counts[:, 3 * group + c] += (a & b).sum(), (a | b).sum()


def _mean(values: list[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else float("nan")


def _psnr(error: Float32) -> float:
    """Return the PSNR of the known values; NaN if none is known."""
    known = error[~np.isnan(error)]
    return decibels(float(np.square(known, dtype=np.float64).mean())) if known.size else float("nan")
