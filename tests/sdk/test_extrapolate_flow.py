"""A model that looks at two shaded frames, driven by its model.json alone."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from alternating import alternate, extrapolated_by_torch
from flow_method import Shadow
from shared_models import shared_model
from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.backends.onnx.runtime import CPU
from supersampler.extrapolation import Extrapolator
from supersampler.frame import Float32
from supersampler.methods.model_file import find_model
from supersampler_model.methods.base import load_trained, shipped_weights
from supersampler_model.methods.guided_flow import GuidedFlow

SIZE, DISPLAY = (64, 36), (128, 72)
SIZES = (SIZE, (48, 27), (80, 45), SIZE, (33, 19), SIZE)
SCENE = Shadow(2.0, velocity=(1.3, -0.6))


FOLDER = find_model("guided-flow")


@pytest.fixture(scope="module")
def trained() -> GuidedFlow:
    return GuidedFlow.of(load_trained(shipped_weights("guided-flow"))).eval()


@pytest.fixture(scope="module")
def taau() -> Model:
    return shared_model("taau", "onnx")


@pytest.fixture
def make(taau: Model) -> Callable[..., Upscaler]:
    def made(**options: Any) -> Upscaler:
        return Upscaler(taau, display_size=DISPLAY, extrapolation=FOLDER, validate="off", **options)

    return made


def frame(index: int, size: tuple[int, int] = SIZE, **overrides: Any) -> Frame:
    return SCENE.frame(index, size, halton_jitter(index, 2.0), **overrides)


def run(upscaler: Upscaler, pattern: str, start: int = 0) -> list[Float32]:
    return alternate(upscaler, frame, pattern, start)


def assert_alike(
    model: Extrapolator, method: GuidedFlow, pattern: str, sizes: tuple[tuple[int, int], ...]
) -> None:
    """Check each extrapolated image against that of torch."""
    history, images = None, []
    for index, (kind, size) in enumerate(zip(pattern, sizes, strict=True)):
        if kind == "s":
            history = model.after_shaded(frame(index, size), history)
            continue
        image, history = model.extrapolate(frame(index, size, color=None), history)
        images.append(image)
    expected = extrapolated_by_torch(method, lambda index: frame(index, sizes[index]), pattern)
    for image, other in zip(images, [each for each in expected if each is not None], strict=True):
        off = np.abs(image - other)
        assert np.quantile(off, 0.99) < 1e-3
        assert off.mean() < 1e-4


@pytest.mark.parametrize("pattern", ["susuus", "ssuuus", "suusuu"])
@pytest.mark.parametrize("sizes", [(SIZE,) * 6, SIZES])
def test_frames_are_extrapolated_as_by_torch(
    trained: GuidedFlow, pattern: str, sizes: tuple[tuple[int, int], ...]
) -> None:
    assert_alike(Extrapolator("guided-flow", [CPU], 1), trained, pattern, sizes)


def test_light_that_moves_is_extrapolated_better_than_by_guided_warp() -> None:
    flow, plain = (
        run(Upscaler("bilinear", display_size=DISPLAY, extrapolation=name), "susu")[-1]
        for name in ("guided-flow", "guided-warp")
    )
    truth = Upscaler("bilinear", display_size=DISPLAY).step(frame(3))
    assert np.square(flow - truth).mean() < np.square(plain - truth).mean()


def test_an_upscaler_steps_on_colors_extrapolated_from_two_shaded_frames(make: Any) -> None:
    one, other = make(), make()
    a = run(one, "susu")
    other.step(frame(2))  # the same frames, of which the earlier ones are not known
    b = other.extrapolate(frame(3, color=None))
    assert np.abs(a[3] - b).mean() > 1e-3
