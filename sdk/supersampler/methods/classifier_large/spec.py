"""Definition of `classifier-large`: `classifier` on a larger history."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from supersampler.methods.at_rest import AT_REST_HISTORY
from supersampler.methods.classifier.spec import BASE, CLASSIFIER, ClassifierConfig
from supersampler.methods.registry import register
from supersampler.methods.spec import DISPLAY, HALF, LARGE, LARGE_HALF, Flag, Shape

SHARPNESS = 1.15
"""Factor by which the Lanczos filter to the display is narrowed, because its input is already blurred."""
REACH = 3
"""Radius of the filter in history pixels; its support is 2 / SHARPNESS display pixels."""
LANCZOS_SCALE, LANCZOS_SLOPE = 25.0 / 16.0, 0.4
"""Coefficients of the polynomial with which FSR approximates a two-lobe Lanczos filter."""
_LARGER: Mapping[Shape, Shape] = {DISPLAY: LARGE, HALF: LARGE_HALF}
_HISTORY = {name: (*shape[:2], *_LARGER.get(shape[2:], shape[2:])) for name, shape in BASE.history.items()}


@dataclass(frozen=True)
class LargeConfig(ClassifierConfig):
    """`ClassifierConfig` without the clipped history, which gains too little here."""

    rectified: Flag = False


CLASSIFIER_LARGE = register(
    replace(
        CLASSIFIER,
        name="classifier-large",
        config=LargeConfig,
        ratios=(1.0, 2.0),  # the history is up to 2.8 times as large as the frame; with `classifier` up to 3
        history={**_HISTORY, **AT_REST_HISTORY},
        torch="supersampler_model.methods.classifier:LargeClassifier",
        task="supersampler_model.training.classifier_tasks:LargeTask",
        weights="classifier-large.safetensors",
        cpu="classifier-large",
        gpu="supersampler.methods.classifier_large.gpu:large_program",
    )
)
