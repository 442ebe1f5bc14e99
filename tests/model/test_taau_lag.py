"""`taau` where light changes over ground that does not move: its image follows, on all backends alike."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import torch

from rest_scenes import Light, RestScene, Stepped, flat, stripes, wave
from supersampler import Upscaler
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.taau.spec import MOST_SAMPLES, TaauConfig
from supersampler_model import ops
from supersampler_model.methods.taau import Taau, samples_kept
from supersampler_model.ops import at_rest

START = 40


def fade(factor: Any, frames: int = 64) -> Light:
    return lambda t: 1.0 + (np.asarray(factor) - 1.0) * min(max(0, t - START), frames) / frames


LIGHTS = {
    "fades by half": fade(0.5),
    "rises to twice": fade(2.0),
    "loses its red": fade([0.5, 1.0, 1.0]),
    "jumps": fade(0.3, 1),
}


@cache
def taau() -> Taau:
    return Taau().eval()


def brightness(image: Float32, truth: Float32) -> Float32:
    """Return the logarithm of the mean colour over that of the truth."""
    ratio: Float32 = np.log(image.mean((0, 1)) / truth.mean((0, 1)))
    return ratio


@pytest.mark.parametrize("adds_samples", [0.0, 1.0])
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("pattern", [wave, stripes(5.0, 0.7)], ids=["wave", "stripes"])
def test_the_image_lags_by_at_most_8_percent(pattern: Any, light: Light, adds_samples: float) -> None:
    scene = RestScene(pattern, light)
    run = Stepped(taau(), scene.display, adds_samples)
    ratios = np.stack([brightness(run.step(frame), truth) for frame, truth in scene.frames(START + 70)])
    still = ratios[START - 16 : START].mean(axis=0)  # toned samples have another mean
    assert np.abs(ratios[START:] - still).max() < np.log(1.08)


@pytest.mark.parametrize("pattern", [flat, wave, stripes(5.0, 0.7)], ids=["flat", "wave", "stripes"])
def test_ground_under_steady_light_keeps_all_its_samples(pattern: Any) -> None:
    scene = RestScene(pattern)
    run, without = (Stepped(method, scene.display, 0.0) for method in (taau(), Taau(TaauConfig(lag=1e9))))
    for frame, _ in scene.frames(scene.period):
        np.testing.assert_array_equal(run.step(frame), without.step(frame))


def test_missing_samples_and_blocks_that_move_are_not_compared() -> None:
    size, display = ops.Size(32, 32), ops.Size(64, 64)
    color, history = torch.full((1, 3, 32, 32), 0.5), torch.full((1, 3, 64, 64), 0.5)
    color[..., :16, :], history[..., :32, :] = 0.9, 0.1
    blank = at_rest.RestHistory(
        *(torch.zeros(s) for s in ((1, 4, 64, 64), (1, 4, 8, 8), (38, 4, 8, 8), (38, 4)))
    )

    def kept(usable: torch.Tensor, motion: torch.Tensor) -> float:
        frame = at_rest.RestFrame(
            color, motion, torch.zeros(1, 2), torch.ones(1), torch.zeros(1, 1, 32, 32), torch.ones(1)
        )
        still = at_rest.compare(frame, blank, size, display)
        return float(samples_kept(color, usable, history, still, taau().config).min())

    usable, motion = torch.ones(1, 1, 32, 32), torch.zeros(1, 2, 32, 32)
    upper = torch.zeros(1, 1, 32, 32)
    upper[..., :16, :] = 1.0
    assert kept(usable, motion) < 1.0
    assert kept(usable * (1.0 - upper), motion) == pytest.approx(MOST_SAMPLES)
    assert kept(usable, motion + upper) == pytest.approx(MOST_SAMPLES)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("ratio", [1.5, 2.0])
def test_backends_keep_as_many_samples(executor: Any, ratio: float) -> None:
    scene = RestScene(wave, fade(0.4, 24), place="edge", speed=1.0, render=(75, 47), ratio=ratio)
    run = Stepped(taau(), scene.display, 0.0)
    upscaler = Upscaler("taau", display_size=scene.display, executor=executor, at_rest="off", threads=1)
    for frame, _ in scene.frames(START + 40):
        images = run.step(frame), upscaler.step(frame)
        shown, expected = (display_transform(image, 1.0) for image in images)
        error = np.abs(shown - expected)
        assert error.mean() < 1e-4
        assert np.quantile(error, 0.999) < 1.0 / 255.0
