"""Runs methods over whole sequences as an engine does: all frames shaded, or some extrapolated."""

from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.methods.at_rest import ADDS_SAMPLES
from supersampler.methods.spec import FRAME_INPUTS
from supersampler_model.data.dataset import TrainingFrame
from supersampler_model.methods.base import Method
from supersampler_model.ops.size import Size
from supersampler_model.training.frame_inputs import frame_inputs, gbuffers


class SequenceRunner:
    """Runs a method over frames, in order.

    Args:
        method: the method.
        display: size of its images.

    Attributes:
        history: the method's history tensors after the previous frame.
        unshaded: whether the previous frame was unshaded.
    """

    def __init__(self, method: Method, display: Size) -> None:
        self._method, self._display = method, display
        self.history: list[Tensor] = []
        self.unshaded = False

    @torch.no_grad()
    def step(self, frame: TrainingFrame) -> Tensor | None:
        """Return the image of the next frame, (1, 3, H, W) linear RGB; None: the method has none."""
        if frame.reset or not self.history:
            self.history = self._method.first_history(self._display, Size(*frame.depth.shape[::-1]))
        return self._image(frame)

    def truth(self, frame: TrainingFrame) -> NDArray[Any]:
        """(H, W, 3) reference of the image, linear RGB."""
        return frame.reference

    def _image(self, frame: TrainingFrame) -> Tensor | None:
        method = self._method
        image, self.history, _ = method.step(*frame_inputs(frame, method.inputs()), *self.history)
        return image


class AlternatingRunner(SequenceRunner):
    """Treats every second frame after a cut as unshaded, and extrapolates its colour.

    Args:
        method: steps on shaded frames, and on extrapolated ones by itself or its `on_extrapolated`.
        display: size of its images.
        extrapolator: computes the colour of unshaded frames.
    """

    def __init__(self, method: Method, display: Size, extrapolator: Method) -> None:
        super().__init__(method, display)
        self._on_unshaded, self._extrapolator = method.on_extrapolated() or method, extrapolator
        self._extrapolator_history: list[Tensor] | None = None

    def _image(self, frame: TrainingFrame) -> Tensor | None:
        history = None if frame.reset else self._extrapolator_history
        self.unshaded = history is not None and not self.unshaded
        names = [*FRAME_INPUTS, ADDS_SAMPLES, *gbuffers(frame)]
        given = dict(zip(names, frame_inputs(frame, names), strict=True))
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
        """See `SequenceRunner`; None for shaded frames."""
        history = self.history if self.history and not frame.reset else None
        self.unshaded = history is not None and not self.unshaded
        method = self._method
        if self.unshaded:
            return self._image(frame)
        names = ["color", *method.inputs()]
        given = dict(zip(names, frame_inputs(frame, names), strict=True))
        self.history = method.after_shaded(given, history)
        return None

    def truth(self, frame: TrainingFrame) -> NDArray[Any]:
        """See `SequenceRunner`; the shaded colour, at render size."""
        return frame.color
