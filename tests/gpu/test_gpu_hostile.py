"""Hostile frames and histories on the GPU backend: images stay finite, and nothing enters the history."""

from dataclasses import replace

import numpy as np
import pytest

from gpu_steps import DISPLAY, METHODS, RENDER, TOLERANCES, distance, make, moving
from shared_models import shared_model
from supersampler import Frame
from supersampler.backends.base import StepRequest

VALUES = [np.nan, np.inf, -np.inf, -1.0, -0.0, 65504.0, 1e38, 1e-42]


def with_pixel(frame: Frame, name: str, value: float) -> Frame:
    image = np.array(getattr(frame, name), np.float32)
    image[5, 7] = value
    return replace(frame, **{name: image})  # type: ignore[arg-type]  # one of three images


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize("name", ["color", "depth", "motion"])
def test_a_bad_pixel_is_handled_as_on_the_cpu(method: str, name: str, value: float) -> None:
    ours, theirs = make(method), make(method, "cpu")
    for index in range(6):
        frame = moving(index)
        if index == 3:
            frame = with_pixel(frame, name, value)
        image, other = ours.step(frame), theirs.step(frame)
        assert np.isfinite(image).all()
        assert image.min() >= 0.0
        assert distance(image, other) <= TOLERANCES[method], f"frame {index}"


@pytest.mark.parametrize("method", METHODS)
def test_a_history_of_huge_values_gives_finite_images(method: str) -> None:
    gpu = shared_model(method, "gpu").gpu
    history, next_history = (gpu.zeros(DISPLAY, RENDER) for _ in range(2))
    tensors = {name: gpu.tensor(history, name) for name in gpu.program.layout.spec.history}
    huge = {
        name: tensor if "jitter" in name else np.where(np.indices(tensor.shape).sum(axis=0) % 2, 3e38, -3e38)
        for name, tensor in tensors.items()
    }
    gpu.load(history, {name: tensor.astype(np.float32) for name, tensor in huge.items()})
    image = np.empty((*DISPLAY[::-1], 3), np.float32)
    for index in range(1, 4):
        gpu.step_many([StepRequest(moving(index), DISPLAY, history, next_history, image, adds_samples=1.0)])
        history, next_history = next_history, history
        assert np.isfinite(image).all()
        assert image.min() >= 0.0
