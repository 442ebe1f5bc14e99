"""Plans state the memory and multiply-adds that a session has."""

import gc
from collections import Counter
from ctypes import CDLL, CFUNCTYPE, c_size_t, c_void_p, cast
from typing import Any

import numpy as np
import pytest

from cpu_models import cpu_model
from method_lists import WITH_KERNELS
from noise import Size, noise
from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.conventions import jitter_phase_count

RENDER: Size = (160, 90)
DISPLAY: Size = (320, 180)
LIBC = CDLL(None)
LIBC.malloc.restype, LIBC.malloc.argtypes = c_void_p, [c_size_t]
LIBC.free.restype, LIBC.free.argtypes = None, [c_void_p]


@pytest.mark.parametrize("method", WITH_KERNELS)
def test_the_bytes_of_a_plan_are_those_that_an_upscaler_takes(method: str) -> None:
    held = Counter[int]()

    def allocate(_: int | None, size: int) -> int | None:
        address: int | None = LIBC.malloc(size)
        held[address or 0] = size
        return address

    def release(_: int | None, address: int, size: int) -> None:
        assert held.pop(address) == size
        LIBC.free(address)

    callbacks = (
        CFUNCTYPE(c_void_p, c_void_p, c_size_t)(allocate),
        CFUNCTYPE(None, c_void_p, c_void_p, c_size_t)(release),
    )
    functions = dict(zip(("allocate", "release"), (cast(c, c_void_p) for c in callbacks), strict=True))
    model = cpu_model(method, threads=2, **functions)
    weights = held.total()
    plan: Any = model.plan(RENDER, DISPLAY)
    still = noise(3, RENDER)
    upscaler = Upscaler(model, display_size=DISPLAY, validate="off")
    for index in range(jitter_phase_count(2.0) + 3):
        motion = np.zeros_like(still.motion)
        jitter = halton_jitter(index, 2.0)
        frame = Frame(color=still.color, depth=still.depth, motion=motion, jitter=jitter, exposure=1.0)
        upscaler.step(frame)
    taken = held.total() - weights
    assert taken == pytest.approx(plan.history_bytes + plan.working_bytes, rel=0.1)
    del upscaler, model
    gc.collect()
    assert held.total() == 0


@pytest.mark.parametrize("method", ["bilinear", "taau", "classifier", "classifier-large"])
def test_a_graphs_history_is_planned_by_its_shapes(method: str) -> None:
    model = shared_model(method, "onnx")
    plan = model.plan(RENDER, DISPLAY)
    assert (plan.executor, plan.precision, plan.working_bytes) == ("onnx", "fp32", None)
    saved = model.save_history(model.first_history(DISPLAY, RENDER))
    assert plan.history_bytes == 2 * sum(array.nbytes for array in saved.values())


def test_multiply_adds_are_those_of_the_network() -> None:
    plan, small = (Upscaler.plan(RENDER, DISPLAY, m) for m in ("classifier", "classifier-small"))
    assert plan.multiply_adds > 1.9 * small.multiply_adds > 1e8
    assert Upscaler.plan(RENDER, DISPLAY, "taau").multiply_adds == 0
