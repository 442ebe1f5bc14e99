"""Plans state the memory and multiply-adds that a session has."""

import tracemalloc

import numpy as np
import pytest

from method_lists import WITH_KERNELS
from noise import Size, noise
from shared_models import shared_model
from supersampler import Frame, FrameError, Upscaler, halton_jitter
from supersampler.conventions import jitter_phase_count

RENDER: Size = (320, 180)
DISPLAY: Size = (640, 360)


@pytest.mark.parametrize("method", WITH_KERNELS)
def test_the_bytes_of_a_plan_are_those_that_an_upscaler_takes(method: str) -> None:
    model = shared_model(method, executor="cpu", threads=2)
    plan = model.plan(RENDER, DISPLAY)
    assert plan.working_bytes is not None
    still, image = noise(3, RENDER), np.empty((*DISPLAY[::-1], 3), np.float32)
    frames = [
        Frame(
            color=still.color,
            depth=still.depth,
            motion=np.zeros_like(still.motion),
            jitter=halton_jitter(index, 2.0),
            exposure=1.0,
        )
        for index in range(jitter_phase_count(2.0) + 3)
    ]
    tracemalloc.start()
    try:
        upscaler = Upscaler(model, display_size=DISPLAY, validate="off")
        for frame in frames:
            upscaler.step(frame, out=image)
        taken, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert taken == pytest.approx(plan.history_bytes + plan.working_bytes, rel=0.1)


@pytest.mark.parametrize("method", ["bilinear", "taau", "classifier", "classifier-large"])
def test_a_graphs_history_is_planned_by_its_shapes(method: str) -> None:
    model = shared_model(method, executor="onnx")
    plan = model.plan(RENDER, DISPLAY)
    assert (plan.executor, plan.precision, plan.working_bytes) == ("onnx", "fp32", None)
    saved = model.save_history(model.first_history(DISPLAY, RENDER))
    assert plan.history_bytes == 2 * sum(array.nbytes for array in saved.values())


def test_multiply_adds_are_those_of_the_network() -> None:
    plan, small = (Upscaler.plan(RENDER, DISPLAY, m) for m in ("classifier", "classifier-small"))
    assert plan.multiply_adds > 1.9 * small.multiply_adds > 1e8
    assert Upscaler.plan(RENDER, DISPLAY, "taau").multiply_adds == 0


def test_a_ratio_that_the_method_lacks_is_refused() -> None:
    with pytest.raises(FrameError, match="ratio"):
        Upscaler.plan((64, 36), (640, 360))
