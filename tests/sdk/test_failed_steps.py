"""A step of the CPU backend that fails between any two of its stages leaves the history as it was."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import CFUNCTYPE, c_int, c_void_p, cast
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any

import numpy as np
import pytest

from cpu_models import cpu_model
from rest_scenes import RestScene, wave
from supersampler import Frame, State, Upscaler
from supersampler.backends.cpu.library import CpuLibrary, Outputs

CHANGES, FRAMES = 20, 28
STAGES = 8
"""At least the stages of a step."""
SCENE = RestScene(wave, lambda index: 1.0 if index < CHANGES else 2.0, "spot", ratio=1.0)
"""Blocks are compared, averaged and frozen; then a spot is brighter."""


class StageError(Exception):
    """A stage that this test makes fail."""


@dataclass
class Failure:
    """The stage of the next step that fails; -1: none."""

    numbers: Iterator[int] = field(default_factory=count)
    stage: int = -1
    runs: bool = True
    cancels: bool = False


TASK = CFUNCTYPE(None, c_void_p, c_int)
FAILURE = Failure()


def run_or_fail(_: int | None, task: Any, context: int, parts: int) -> None:
    """Run the parts of a stage; the one that fails is done or left out, then the step is cancelled."""
    fails = next(FAILURE.numbers) == FAILURE.stage
    for part in range(parts if FAILURE.runs or not fails else 0):
        task(context, part)
    if fails:
        FAILURE.cancels = True
        time.sleep(0.03)  # after which the library asks


def is_cancelled(_: int | None) -> int:
    return FAILURE.cancels


RUN_OR_FAIL = CFUNCTYPE(None, c_void_p, TASK, c_void_p, c_int)(run_or_fail)
IS_CANCELLED = CFUNCTYPE(c_int, c_void_p)(is_cancelled)


@contextmanager
def cancelled(_: CpuLibrary, outputs: Outputs) -> Iterator[None]:
    """Context of a step that fails: at a stage, or else when it has ended."""
    outputs.cancelled = cast(IS_CANCELLED, c_void_p)
    yield
    raise StageError


def session(method: str) -> Upscaler:
    model = cpu_model(method, threads=2, parallel_for=cast(RUN_OR_FAIL, c_void_p))
    return Upscaler(model, display_size=SCENE.display, validate="off")


def fail_at(stage: int, runs: bool, upscaler: Upscaler, frame: Frame, patch: pytest.MonkeyPatch) -> None:
    """Step with a frame of which one stage fails, or else the end of the step."""
    FAILURE.numbers, FAILURE.stage, FAILURE.runs, FAILURE.cancels = count(), stage, runs, False
    patch.setattr(CpuLibrary, "interruptible", cancelled)
    try:
        with pytest.raises(StageError):
            upscaler.step(frame)
    finally:
        FAILURE.stage = -1


def changed(first: State, second: State) -> list[str]:
    """Return the names of history tensors that differ."""
    assert first.history is not None
    assert second.history is not None
    return [name for name in first.history if not np.array_equal(first.history[name], second.history[name])]


@pytest.mark.parametrize("runs", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("light", [1.0, 3.0], ids=["same frame", "other frame"])
@pytest.mark.parametrize("method", ["taau", "classifier"])
def test_after_a_failed_step_the_next_frame_works(
    method: str, light: float, runs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for first in (0, STAGES // 2):
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
