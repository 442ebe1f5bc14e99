"""The options of `taa` (Salvi 2016), changed one at a time, on shots with references.

python bench/studies/salvi_options.py test-shots --json bench/results/studies/salvi-options.json \
    --update docs/results/methods.md
"""

import numpy as np
import torch
import typer

from studies.stepper_study import run_study
from supersampler.backends.onnx.session import frame_inputs
from supersampler.frame import Float32, Frame, Size
from supersampler.io.shot import Shot
from supersampler.methods.taa.spec import TaaConfig
from supersampler_bench.cli.options import CACHE, JSON, RATIO, SHOT, UPDATE
from supersampler_bench.quality.measure import StepImage, Stepper, reference_size
from supersampler_model.methods.taa.model import Taa
from supersampler_model.ops.size import Size as Extent

OPTIONS = {
    "taa": TaaConfig(),
    "20 % new": TaaConfig(alpha=0.2),
    "5 % new": TaaConfig(alpha=0.05),
    "gamma 0.75": TaaConfig(gamma=0.75),
    "gamma 1.5": TaaConfig(gamma=1.5),
    "minimum and maximum alone": TaaConfig(gamma=None),
    "no minimum and maximum": TaaConfig(intersect_extent=False),
    "RGB": TaaConfig(space="rgb"),
    "5x5 window": TaaConfig(window=5),
    "7x7 window": TaaConfig(window=7),
    "clipped to the centre (not his)": TaaConfig(clip="center"),
    "clamped (not his)": TaaConfig(clip="clamp"),
}
STUDY = "salvi-options"


class TaaSteps:
    """Steps `taa` with other constants in torch; images of (height, width) `display`."""

    def __init__(self, config: TaaConfig, display: Size) -> None:
        self._method, self._display = Taa(config).eval(), Extent(*display)
        self._history: list[torch.Tensor] = []

    def step(self, frame: Frame) -> Float32:
        """Return the image (H, W, 3) of the next frame, linear RGB."""
        if frame.reset or not self._history:
            self._history = self._method.first_history(self._display, Extent(*frame.size))
        inputs = frame_inputs(frame, self._display, self._method.inputs())
        with torch.no_grad():
            image, self._history, _ = self._method.step(
                *map(torch.from_numpy, inputs.values()), *self._history
            )
        return np.ascontiguousarray(image[0].permute(1, 2, 0).numpy())


def main(
    shot: SHOT, ratio: RATIO = "2", cache: CACHE = None, json: JSON = None, update: UPDATE = None
) -> None:
    """Measure every option; frames need references."""
    run_study(STUDY, steppers, shot, ratio, cache, json, update)


def steppers(shot: Shot) -> list[Stepper]:
    """Return all options."""
    display = reference_size(shot)
    return [stepper_of(title, config, display) for title, config in OPTIONS.items()]


def stepper_of(title: str, config: TaaConfig, display: Size) -> Stepper:
    """Return an option as `measure_steppers` takes it."""
    steps = TaaSteps(config, display)
    return Stepper(title, lambda item: StepImage(steps.step(item.frame)))


if __name__ == "__main__":
    typer.run(main)
