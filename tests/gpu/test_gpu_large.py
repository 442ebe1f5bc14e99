"""`classifier-large` on the GPU backend: the passes of `classifier` on the larger display, and the filter."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpu_steps import DISPLAY, device_or_skip, distance, make, moving
from noise import Size, noise
from supersampler import Frame, StepResult

METHOD, MOST = "classifier-large", 3e-3
"""Mean difference of display values from the CPU backend, at most, as for `classifier`."""


@pytest.fixture(scope="module", autouse=True)
def device() -> Any:
    return device_or_skip()


def assert_alike(frames: list[Frame], display: Size = DISPLAY) -> None:
    ours, theirs = (make(METHOD, executor, display) for executor in ("gpu", "cpu"))
    for index, frame in enumerate(frames):
        image = ours.step(frame)
        assert image.min() >= 0.0, f"frame {index}"
        assert distance(image, theirs.step(frame), frame.exposure) <= MOST, f"frame {index}"


@pytest.mark.parametrize(
    ("render", "display"),
    [((1, 1), (1, 1)), ((1, 1), (2, 2)), ((2, 3), (4, 5)), ((17, 9), (17, 9)), ((17, 9), (34, 17))],
)
def test_odd_sizes_have_the_images_of_the_cpu(render: Size, display: Size) -> None:
    assert_alike([noise(seed, render) for seed in range(4)], display)


def test_render_sizes_that_change_keep_the_history_as_on_the_cpu() -> None:
    sizes = [(20, 12), (20, 12), (31, 19), (40, 24), (20, 12), (33, 13)]
    assert_alike([moving(index, size) for index, size in enumerate(sizes)])


def test_jumps_of_exposure_are_followed_as_on_the_cpu() -> None:
    exposures = (None, 1.0, 300.0, 0.001, None, 1e30, 1.0)
    assert_alike([replace(moving(index), exposure=value) for index, value in enumerate(exposures)])


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 65504.0])
def test_after_a_bad_frame_the_images_return_to_those_of_the_cpu(value: float) -> None:
    ours, theirs = make(METHOD), make(METHOD, "cpu")
    for index in range(9):
        frame = moving(index)
        if index == 3:
            frame = replace(frame, color=np.full_like(np.asarray(frame.color), value))
        image, wanted = ours.step(frame), theirs.step(frame)
        assert np.isfinite(image).all()
    assert distance(image, wanted) <= MOST


def test_maps_have_the_size_and_values_of_the_cpu() -> None:
    names = ("weight", "converged", "count", "class_map")
    ours, theirs = make(METHOD), make(METHOD, "cpu")
    for index in range(4):
        found, wanted = (u.step(moving(index), outputs=names) for u in (ours, theirs))
    assert isinstance(found, StepResult)
    assert isinstance(wanted, StepResult)
    for name in names:
        mine, cpu = getattr(found, name), getattr(wanted, name)
        assert mine.shape == cpu.shape
        assert np.abs(mine - cpu).mean() <= 0.02 * max(1.0, np.abs(cpu).max()), name


def test_a_still_scene_converges_as_on_the_cpu() -> None:
    ours, theirs = make(METHOD), make(METHOD, "cpu")
    for index in range(144):  # a pixel of the larger history has half as many samples of a jitter period
        frame = replace(moving(index), color=moving(0).color, depth=moving(0).depth, reset=False)
        still = replace(frame, motion=np.zeros_like(moving(0).motion), exposure=1.0)
        one, other = (u.step(still, outputs=("converged",)) for u in (ours, theirs))
    assert distance(one.image, other.image) <= 1e-3
    assert one.converged is not None
    assert other.converged is not None
    np.testing.assert_allclose(one.converged, other.converged, atol=0.02)
    assert ours.stats.converged is not None
    assert ours.stats.converged > 0.99


@pytest.mark.parametrize(("first", "second"), [("cpu", "gpu"), ("gpu", "cpu")])
def test_a_state_passes_from_one_backend_to_another(first: str, second: str) -> None:
    before, after, whole = make(METHOD, first), make(METHOD, second), make(METHOD, second)
    for index in range(4):
        before.step(moving(index))
        whole.step(moving(index))
    after.load_state(before.save_state())
    for index in range(4, 7):
        assert distance(after.step(moving(index)), whole.step(moving(index))) <= 2.0 * MOST


def test_a_cut_forgets_all_before_it() -> None:
    upscaler = make(METHOD)
    first = upscaler.step(moving(0))
    upscaler.step(moving(1))
    np.testing.assert_array_equal(upscaler.step(moving(0)), first)
