"""A step depends on its frame and its history alone, not on what the buffers that it writes to held."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from random_cases import random_cases
from rest_scenes import RestScene, wave
from shared_models import shared_model
from supersampler import Frame, Model
from supersampler.history import History
from supersampler_bench.specs import with_default_gbuffers

SCENE = RestScene(wave, render=(72, 70), ratio=1.0)
"""3x3 tiles; at ratio 1 the jitter repeats soon, so tiles are frozen soon."""
PERIOD = SCENE.period
STEPS, HISTORIES = 60, 4
FRAMES = [frame for frame, _ in SCENE.frames(3 * PERIOD + STEPS)]
CHANGES = ("light", "mask", "motion", "surface")


@dataclass
class Branch:
    """A history, and the number of steps that led to it."""

    history: History
    steps: int


@pytest.mark.parametrize("method", ["taau", "classifier", "gbuffer-fast"])
@random_cases(3)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_step_depends_on_its_frame_and_its_history_alone(method: str, seed: int) -> None:
    model, rng = shared_model(method, "cpu"), np.random.default_rng(seed)
    branches = [frozen(model)]
    for step in range(STEPS):
        at = int(rng.integers(len(branches)))
        before = branches[at]
        frame = frame_of(model, before.steps, [each for each in CHANGES if rng.random() < 0.1])
        other = int(rng.integers(HISTORIES))  # an old history, or none
        reused = branches[other].history if other < len(branches) and other != at else None
        arrays = model.save_history(before.history)
        copy = model.load_history(SCENE.display, SCENE.render, arrays)
        expected, expected_history = model.run_outputs(frame, copy, (), skip=False)
        found, history = model.run_outputs(frame, before.history, (), history_out=reused)
        np.testing.assert_array_equal(found.image, expected.image, f"step {step}")
        assert_same(model.save_history(history), model.save_history(expected_history), step)
        assert_same(model.save_history(before.history), arrays, step)
        after = Branch(history, before.steps + 1)
        if reused is not None:
            branches[other] = after
        elif len(branches) < HISTORIES:
            branches.append(after)
        else:
            branches[at] = after


def frame_of(model: Model, index: int, changes: Collection[str] = ()) -> Frame:
    """Return a frame of the still scene, with changes in a part of its first tiles."""
    frame = with_default_gbuffers(replace(FRAMES[index], reset=False), model.info.gbuffers, SCENE.display)
    part = np.zeros((*SCENE.render[::-1], 1), np.float32)
    part[8:20, 8:36] = 1.0
    assert frame.color is not None
    if "light" in changes:
        frame = replace(frame, color=frame.color * (1.0 + 0.5 * part))
    if "mask" in changes:
        frame = replace(frame, reactive=0.5 * part[..., 0])
    if "motion" in changes:
        frame = replace(frame, motion=frame.motion + 0.5 * part)
    if "surface" in changes and frame.gbuffer_display is not None:
        surfaces = dict(frame.gbuffer_display)
        surfaces["base_color"] = surfaces["base_color"] * np.float32(0.5)
        frame = replace(frame, gbuffer_display=surfaces)
    return frame


def frozen(model: Model) -> Branch:
    history = model.first_history(SCENE.display, SCENE.render)
    for index in range(2 * PERIOD + 1):
        _, history = model.run(frame_of(model, index), history)
    assert model.converged(history) == 1.0
    return Branch(history, 2 * PERIOD + 1)


def assert_same(found: dict[str, Any], expected: dict[str, Any], step: int) -> None:
    assert found.keys() == expected.keys()
    for name, array in found.items():
        np.testing.assert_array_equal(array, expected[name], f"{name} of step {step}")
