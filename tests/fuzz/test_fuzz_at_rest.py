"""No image at rest is worse than the method's own: scenes by chance, on the CPU backend."""

import os
from functools import cache

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzzing import examples
from rest_scenes import SCENES, RestScene, worse_by
from supersampler import Model, Upscaler

MEAN, QUANTILE = 1.0, 4.0
"""What an image may be worse by, 1/255 of the display."""


@cache
def model(method: str) -> Model:
    return Model.load(method, executor="cpu", threads=1)


@settings(
    max_examples=examples(6),
    derandomize="SUPERSAMPLER_FUZZ" not in os.environ,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(scene=SCENES, method=st.sampled_from(["taau", "classifier"]))
def test_no_image_at_rest_is_worse_than_the_methods_own(scene: RestScene, method: str) -> None:
    options = {"display_size": scene.display, "validate": "off"}
    ours = Upscaler(model(method), **options)  # type: ignore[arg-type]
    own = Upscaler(model(method), at_rest="off", **options)  # type: ignore[arg-type]
    for index, (frame, truth) in enumerate(scene.frames(4 * scene.period)):
        mean, quantile = worse_by(ours.step(frame), own.step(frame), truth)
        assert mean <= MEAN, f"frame {index}: {mean:.2f}/255"
        assert quantile <= QUANTILE, f"frame {index}: {quantile:.2f}/255 in the 99.9 % quantile"
