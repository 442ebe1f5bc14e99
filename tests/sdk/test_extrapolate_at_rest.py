"""Unshaded frames where nothing moves: they add nothing to the mean of the samples."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from alternating import alternate
from lit_scene import LitScene
from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.arguments import ExecutorName
from supersampler.frame import Float32
from supersampler_bench.specs import with_default_gbuffers
from supersampler_bench.stress.scenes import still

SIZE, DISPLAY = (64, 36), (128, 72)
STILL_BUT_A_DISC = LitScene(radius=7.0, disc_velocity=(0.5, 0.0))


def make(method: str, executor: ExecutorName, **options: Any) -> Upscaler:
    model = shared_model(method, executor)
    return Upscaler(model, display_size=DISPLAY, extrapolation="guided-warp", validate="off", **options)


def at_rest(index: int) -> Frame:
    return STILL_BUT_A_DISC.frame(index, SIZE, halton_jitter(index, 2.0))


def mean_of(upscaler: Upscaler) -> Float32:
    history: Any = upscaler.save_state().history
    return np.array(history["history.static_mean"][0])


@pytest.mark.parametrize("executor", ["onnx", "cpu"])
@pytest.mark.parametrize("method", ["taau", "classifier-small"])
def test_unshaded_frames_add_nothing_to_the_mean_at_rest(method: str, executor: ExecutorName) -> None:
    upscaler = make(method, executor)
    alternate(upscaler, at_rest, "s" * 24)
    for index, kind in enumerate("uusu", 24):
        before = mean_of(upscaler)
        alternate(upscaler, at_rest, kind, index)
        after = mean_of(upscaler)
        kept = after[3] > 0.0
        assert kept.mean() > 0.6
        if kind == "u":
            np.testing.assert_array_equal(after[:3, kept], before[:3, kept])
            np.testing.assert_array_equal(after[3, kept], before[3, kept])
            assert (after[3] == 0.0).any(), "where the disc moves, the mean ends"
        else:
            assert (after[3] > before[3] + 0.01).mean() > 0.3


@pytest.mark.parametrize("unshaded", [True, False])
@pytest.mark.parametrize("executor", ["onnx", "cpu"])
def test_where_each_jitter_comes_twice_still_frames_converge(executor: ExecutorName, unshaded: bool) -> None:
    """The second frame of a jitter is extrapolated, or shaded again; it is not part of the period."""
    upscaler = Upscaler(
        shared_model("taau", executor),
        display_size=(48, 32), extrapolation="guided-warp", validate="off",
    )  # fmt: skip
    frames, shares = still((24, 16), 2), []
    for index in range(4 * len(frames)):
        frame = with_default_gbuffers(frames[index % len(frames)], upscaler.gbuffers, (48, 32))
        if unshaded and index % 2:
            upscaler.extrapolate(replace(frame, color=None))
        else:
            upscaler.step(frame)
        shares.append(upscaler.stats.converged)
    assert shares[3 * len(frames) :] == [1.0] * len(frames)
