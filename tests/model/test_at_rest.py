"""At rest, static pixels are exact; tests/fuzz compares images with the method's own."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest
import torch

from rest_scenes import RestScene, wave
from supersampler import Frame, halton_jitter
from supersampler.frame import Float32
from supersampler.io.display import decibels, display_transform
from supersampler.methods.at_rest import NOISY
from supersampler_model.data.scenes.analytic import still_scene
from supersampler_model.methods.base import Method
from supersampler_model.methods.taau import Taau
from supersampler_model.ops.at_rest import differing, signatures_of
from torch_inputs import Stepped

WAVE = RestScene(wave)
FROZEN = 2 * WAVE.period + 1
"""Frames after which a still scene is frozen."""


@cache
def taau() -> Method:
    return Taau().eval()


def stepped(scene: RestScene, count: int = FROZEN, adds_samples: float = 1.0) -> Stepped:
    run = Stepped(taau(), scene.display, adds_samples)
    for frame, _ in scene.frames(count):
        run.step(frame)
    return run


@pytest.mark.long  # two periods of the jitter
def test_the_analytic_scene_reaches_48_db_after_two_periods() -> None:
    render, display = (160, 90), (320, 180)
    run, scene = Stepped(taau(), display), still_scene()
    for index in range(FROZEN):
        frame = scene.frame(index, render, halton_jitter(index, 2.0))
        image = run.step(replace(frame, reset=index == 0))
    exposure = frame.exposure or 1.0
    shown, truth = (display_transform(i, exposure) for i in (image, scene.truth(index, display)))
    assert decibels(float(np.mean((shown - truth)[8:-8, 8:-8] ** 2))) >= 48.0
    assert run.frozen.mean() > 0.99


CHANGES: dict[str, Callable[[Frame, int], Frame]] = {
    "a jump of 2 %": lambda f, _: times(f, 1.02),
    "a hue of equal luma": lambda f, k: times(f, np.array([1.0 + 0.002 * k, 1.0, 1.0 - 0.002 * k * 2.9])),
    "a slow fade": lambda f, k: times(f, 1.0 - 0.0015 * k),
    "one sample much brighter": lambda f, _: brighter(f),
}


def times(frame: Frame, factor: Any) -> Frame:
    return replace(frame, color=(np.asarray(frame.color) * factor).astype(np.float32))


def brighter(frame: Frame) -> Frame:
    color = np.array(frame.color)
    color[10, 12] *= 3.0
    return replace(frame, color=color)


@pytest.mark.long  # two periods of the jitter
@pytest.mark.parametrize("name", CHANGES)
def test_a_change_unfreezes_pixels(name: str) -> None:
    run = stepped(WAVE)
    assert run.frozen.all()
    for k, (frame, _) in enumerate(WAVE.frames(FROZEN + 12)):
        if k >= FROZEN:
            run.step(CHANGES[name](frame, k - FROZEN + 1))
    assert not run.frozen[20, 24]


@pytest.mark.parametrize("cell", [1, 2])
@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_signatures_tell_where_a_chequered_pattern_lies(light: tuple[float, ...], cell: int) -> None:
    places = []
    for x, y in product(range(4), repeat=2):
        squares = (torch.arange(x, x + 8) // cell + torch.arange(y, y + 8)[:, None] // cell) % 2
        places.append(0.2 + 0.4 * squares * torch.tensor(light)[None, :, None, None])
    for one, other in combinations(places, 2):
        differs = differing(signatures_of(one), signatures_of(other), torch.ones(1))
        assert differs.all() == (one != other).any()


def test_motion_below_the_limit_accumulates_and_unfreezes() -> None:
    scene = RestScene(wave, creep=0.0038)
    assert not stepped(scene, 3 * scene.period).frozen.any()


def test_moving_or_reactive_pixels_unfreeze_only_themselves() -> None:
    *_, (last, _) = WAVE.frames(FROZEN + 1)
    for field, value in (("motion", 0.01), ("reactive", 0.5)):
        run = stepped(WAVE)
        image = np.zeros((32, 48, 2) if field == "motion" else (32, 48), np.float32)
        image[8:12, 8:12] = value
        changed: dict[str, Any] = {field: image}
        run.step(replace(last, **changed))
        assert not run.frozen[16:24, 16:24].any()
        assert run.frozen[40:, 40:].all()


@pytest.mark.long  # several periods of the jitter
@pytest.mark.parametrize("adds_samples", [1.0, 0.0])
def test_a_repeated_jitter_is_no_part_of_the_period(adds_samples: float) -> None:
    """Each jitter comes twice: again, or with another light in a frame that was not sampled."""
    run = Stepped(taau(), WAVE.display)
    for frame, _ in WAVE.frames(FROZEN):
        run.adds_samples = 1.0
        run.step(frame)
        run.adds_samples = adds_samples
        run.step(frame if adds_samples else times(replace(frame, reset=False), 1.3))
    assert run.frozen.all()


def test_jitter_that_never_repeats_freezes_nothing() -> None:
    run = Stepped(taau(), WAVE.display)
    for index, (frame, _) in enumerate(WAVE.frames(80)):
        run.step(replace(frame, jitter=(index / 200.0, 0.1)))
    assert not run.frozen.any()


def test_a_lasting_missing_sample_is_filled_from_neighbours_and_keeps_pixels_frozen() -> None:
    run, plain = (Stepped(taau(), WAVE.display) for _ in range(2))
    for frame, _ in WAVE.frames(FROZEN):
        color = np.array(frame.color)
        color[5, 7] = np.nan
        image = run.step(replace(frame, color=color))
        expected = plain.step(frame)
    assert np.isfinite(image).all()
    off = np.abs(display_transform(image, 1.0) - display_transform(expected, 1.0)).max(-1)
    assert off[10:12, 14:16].max() < 0.2
    assert off[30:, 30:].max() < 1.0 / 255.0
    assert run.frozen[30:, 30:].all()


def noisy(scene: RestScene, count: int, light: Callable[[int], float]) -> Iterator[tuple[Frame, Float32]]:
    rng = np.random.default_rng(1)
    for index, (frame, truth) in enumerate(scene.frames(count)):
        grain = rng.gamma(16.0, 1.0 / 16.0, (*frame.size[::-1], 1)) * light(index)
        yield times(frame, grain), truth * np.float32(light(index))


def test_samples_of_a_path_tracer_average_out_and_a_change_is_right_in_8_frames() -> None:
    ours, own = (Stepped(taau(), WAVE.display, adds) for adds in (NOISY, 0.0))
    errors, bias = [], []
    for frame, truth in noisy(WAVE, 76, lambda t: 1.0 if t < 60 else 0.6):
        images, shown = [run.step(frame) for run in (ours, own)], display_transform(truth, 1.0)
        difference = [display_transform(image, 1.0) - shown for image in images]
        errors.append([float(np.abs(d).mean()) for d in difference])
        bias.append([abs(float(d.mean())) for d in difference])
        assert not ours.frozen.any()
    assert errors[59][0] < 0.8 * errors[59][1]
    assert errors[59][0] < errors[20][0]
    assert all(a <= b + 1.5 / 255.0 for a, b in bias[68:])
    assert all(a <= b + 2.0 / 255.0 for a, b in errors[68:])
