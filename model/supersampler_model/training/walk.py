"""Whole sequences, stepped as an engine steps them: every frame shaded, or some of them drawn."""

from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler_model.data.dataset import TrainingFrame
from supersampler_model.methods.base import Method, Size
from supersampler_model.training.frame_inputs import frame_inputs, gbuffers


class SequenceRunner:
    """Steps a method through frames, in order.

    Args:
        method: to be stepped.
        display: size of its images.

    Attributes:
        history: that the previous frame left, in the order of the method's.
        hidden: whether the previous frame was not shaded.
    """

    def __init__(self, method: Method, display: Size) -> None:
        self._method, self._display = method, display
        self.history: list[Tensor] = []
        self.hidden = False

    @torch.no_grad()
    def step(self, frame: TrainingFrame) -> Tensor | None:
        """Return the image of the next frame, (1, 3, H, W) linear RGB; None where nothing is drawn."""
        if frame.reset or not self.history:
            self.history = self._method.first_history(self._display, Size(*frame.depth.shape[::-1]))
        return self._image(frame)

    def truth(self, frame: TrainingFrame) -> NDArray[Any]:
        """(H, W, 3) what the image should have been, linear RGB."""
        return frame.reference

    def _image(self, frame: TrainingFrame) -> Tensor | None:
        method = self._method
        image, self.history, _ = method.step(*frame_inputs(frame, method.inputs()), *self.history)
        return image


class AlternatingRunner(SequenceRunner):
    """Hides the colour of every second frame after a cut, and has it drawn from the previous frame.

    Args:
        method: steps on shaded frames, and on drawn ones or has what does.
        display: size of its images.
        drawing: draws colours.
    """

    def __init__(self, method: Method, display: Size, drawing: Method) -> None:
        super().__init__(method, display)
        self._on_extrapolated, self._drawing = method.on_extrapolated() or method, drawing
        self._past: list[Tensor] | None = None  # what the next frame is drawn from

    def _image(self, frame: TrainingFrame) -> Tensor | None:
        past = None if frame.reset else self._past
        self.hidden = past is not None and not self.hidden
        names = ["color", "depth", "motion", "jitter", "exposure", "display_size", *gbuffers(frame)]
        given = dict(zip(names, frame_inputs(frame, names), strict=True))
        method = self._method
        if past is not None and self.hidden:
            drawn = self._drawing.step(*(given[name] for name in self._drawing.inputs()), *past)
            given["color"], self._past, method = drawn.image, drawn.history, self._on_extrapolated
        else:
            self._past = self._drawing.after_shaded(given, past)
        image, self.history, _ = method.step(*(given[name] for name in method.inputs()), *self.history)
        return image


class ExtrapolationRunner(SequenceRunner):
    """Has a method that extrapolates draw the colour of every second frame after a cut, and nothing else."""

    @torch.no_grad()
    def step(self, frame: TrainingFrame) -> Tensor | None:
        """See `SequenceRunner`; nothing is drawn of shaded frames."""
        past = self.history if self.history and not frame.reset else None
        self.hidden = past is not None and not self.hidden
        method = self._method
        if self.hidden:
            return self._image(frame)
        names = ["color", *method.inputs()]
        given = dict(zip(names, frame_inputs(frame, names), strict=True))
        self.history = method.after_shaded(given, past)
        return None

    def truth(self, frame: TrainingFrame) -> NDArray[Any]:
        """See `SequenceRunner`; of render size, as it would have been shaded."""
        return frame.color
