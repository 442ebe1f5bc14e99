"""A step of the CPU backend that fails between any two of its stages leaves the history as it was."""

from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest

from rest_scenes import RestScene, wave
from supersampler import Frame, Upscaler
from supersampler.backends.cpu.executor import CpuExecutor
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.history import State

CHANGES, FRAMES = 20, 28
STAGES = 8
"""At least the stages of a step."""
SCENE = RestScene(wave, lambda index: 1.0 if index < CHANGES else 2.0, "spot", ratio=1.0)
"""Blocks are compared, averaged and frozen; then a spot is brighter."""


class StageError(Exception):
    """A stage that this test makes fail."""


def session(method: str) -> Upscaler:
    return Upscaler(method, display_size=SCENE.display, threads=2, validate="off", executor="cpu")


def fail_at(stage: int, runs: bool, upscaler: Upscaler, frame: Frame, patch: pytest.MonkeyPatch) -> None:
    """Step with a frame of which one stage fails, or else the end of the step."""
    run_tasks, step, numbers = ThreadPool.run_tasks, CpuExecutor.step, count()

    def run_tasks_or_fail(pool: ThreadPool, name: str, *tasks: Any) -> None:
        fails = next(numbers) == stage
        if runs or not fails:
            run_tasks(pool, name, *tasks)
        if fails:
            raise StageError

    def step_and_fail(*given: Any, **named: Any) -> None:
        step(*given, **named)
        raise StageError

    patch.setattr(ThreadPool, "run_tasks", run_tasks_or_fail)
    patch.setattr(CpuExecutor, "step", step_and_fail)
    with pytest.raises(StageError):
        upscaler.step(frame)


def changed(first: State, second: State) -> list[str]:
    """Return the names of history tensors that differ."""
    assert first.history is not None
    assert second.history is not None
    return [name for name in first.history if not np.array_equal(first.history[name], second.history[name])]


@pytest.mark.parametrize("runs", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("light", [1.0, 3.0], ids=["same frame", "other frame"])
@pytest.mark.parametrize("method", ["taau", "classifier", "classifier-large"])
def test_after_a_step_that_failed_at_any_stage_the_next_good_frame_works(
    method: str, light: float, runs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for first in range(0, STAGES, 3):
        calm, shaken = session(method), session(method)
        for index, (frame, _) in enumerate(SCENE.frames(FRAMES)):
            before = calm.save_state()
            assert frame.color is not None
            with monkeypatch.context() as patch:
                failing = replace(frame, color=frame.color * np.float32(light))
                fail_at((first + index) % STAGES, runs, shaken, failing, patch)
            if index:
                assert changed(before, shaken.save_state()) == []
            assert np.array_equal(shaken.step(frame), calm.step(frame)), index
            assert changed(calm.save_state(), shaken.save_state()) == []
            assert (calm.stats.converged == 1.0) == (15 <= index < CHANGES)
