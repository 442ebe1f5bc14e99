"""Sessions whose caller refuses, saves, warms up, shares and overwrites give the images of plain ones."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noise import noise
from random_cases import random_cases
from shared_models import shared_model
from supersampler import Frame, Upscaler
from supersampler.arguments import ExecutorName
from supersampler.errors import SupersamplerError
from supersampler.methods.gbuffers import arrays_by_name, frame_of, values_of
from supersampler_bench.specs import with_default_gbuffers

Rng = np.random.Generator
DISPLAY = (66, 50)
SIZES = ((66, 50), (44, 33), (33, 25))
STEPS = 30
OUTPUTS = ("aovs", "ids", "weight")


def frame_at(step: int, upscaler: Upscaler, rng: Rng) -> Frame:
    """Return a frame that stands still for some steps, with every kind of input."""
    size = SIZES[int(rng.integers(len(SIZES)))] if rng.random() < 0.1 else SIZES[0]
    seed, (width, height) = 1 + step // 8, size
    plain = noise(
        seed, size, exposure=(None, 1.0, 300.0)[int(rng.integers(3))], reset=bool(rng.random() < 0.05)
    )
    assert plain.color is not None
    factor = float(rng.choice([1.0, 1.0, 0.01, 50.0]))
    missing = rng.random((height, width, 1)) < (0.05 if rng.random() < 0.2 else 0.0)
    frame = replace(
        plain,
        color=np.where(missing, np.nan, plain.color * factor).astype(np.float32),
        motion=plain.motion * np.float32(step % 8 == 0),
        pre_exposure=factor,
        reactive=rng.random((height, width), np.float32) if rng.random() < 0.1 else None,
        aovs=plain.color[..., :2] - 1.0,
        ids=(9.0 * plain.color).astype(np.int32)[..., :1],
    )
    return with_default_gbuffers(frame, upscaler.gbuffers, DISPLAY)


def laid_out(array: Any, rng: Rng) -> Any:
    """Return a copy whose values lie elsewhere in memory, between others."""
    other = np.nan if array.dtype.kind == "f" else 77
    match int(rng.integers(5)):
        case 0:
            return np.asfortranarray(array)
        case 1:
            return array[::-1].copy()[::-1]
        case 2:
            rows = np.full((2 * len(array), *array.shape[1:]), other, array.dtype)
            rows[::2] = array
            return rows[::2]
        case 3:
            wide = np.full((array.shape[0], array.shape[1] + 3, *array.shape[2:]), other, array.dtype)
            wide[:, 2:-1] = array
            return wide[:, 2:-1]
    return array.copy()


def target(rng: Rng) -> Any:
    """Return an array for an image, or None."""
    width, height = DISPLAY
    make: list[Callable[[], Any]] = [
        lambda: None,
        lambda: np.full((height, width, 3), np.nan, np.float32),
        lambda: np.full((3, height, width), np.nan, np.float32).transpose(1, 2, 0),
        lambda: np.full((2 * height, width, 5), np.nan, np.float32)[::-2, :, 1:4],
    ]
    return make[int(rng.integers(len(make)))]()


def refused(upscaler: Upscaler, frame: Frame, rng: Rng) -> None:
    """Make a call that is refused."""
    calls: list[Callable[[], object]] = [
        lambda: upscaler.step(replace(frame, color=None)),
        lambda: upscaler.step(noise(1, (300, 300))),
        lambda: upscaler.step(replace(frame, reset=True), outputs=("nonsense",)),
        lambda: upscaler.step(frame, out=np.zeros((3, 3, 3), np.float32)),
        lambda: upscaler.step(replace(frame, aovs=None), outputs=("aovs",)),
        lambda: upscaler.load_state(replace(upscaler.save_state(), method="none")),
    ]
    with pytest.raises(SupersamplerError):
        calls[int(rng.integers(len(calls)))]()


@pytest.mark.parametrize(
    ("method", "executor"), [("taau", "cpu"), ("gbuffer-fast", "cpu"), ("taau", "onnx"), ("taa", "onnx")]
)
@random_cases(3)
@given(seed=st.integers(0, 2**32 - 1))
def test_images_are_those_of_a_plain_session(method: str, executor: ExecutorName, seed: int) -> None:
    model, rng = shared_model(method, executor), np.random.default_rng(seed)
    options: dict[str, Any] = {"display_size": DISPLAY, "validate": "off"}
    ours, other, plain = (Upscaler(model, skip=skip, **options) for skip in (True, True, False))
    for step in range(STEPS):
        frame, stranger = frame_at(step, ours, rng), frame_at(step + 9, ours, rng)
        names: Any = tuple(name for name in OUTPUTS if rng.random() < 0.4)
        found: Any
        if rng.random() < 0.2:
            refused(ours, frame, rng)
        if rng.random() < 0.1:
            ours.warm_up(frame.size)
        if rng.random() < 0.1:
            state = ours.save_state()
            ours = Upscaler(model, **options)
            ours.load_state(state)
        arrays = {name: laid_out(array, rng) for name, array in arrays_by_name(frame).items()}
        given, out = frame_of(arrays, **values_of(frame)), target(rng)
        if rng.random() < 0.2:
            _, found = Upscaler.step_many([other, ours], [stranger, given], out=[None, out], outputs=names)
        else:
            other.step(stranger)
            found = ours.step(given, out=out, outputs=names)
        expected = plain.step(frame, outputs=names)
        for name in ("image", *names):
            mine: Any = getattr(found, name) if names else found
            theirs: Any = getattr(expected, name) if names else expected
            np.testing.assert_array_equal(mine, theirs, f"{name} of step {step}")
            mine[...] = 7  # the caller may write to results and to frames
        for array in arrays.values():
            array[...] = 99
    mine_state, plain_state = ours.save_state().history or {}, plain.save_state().history or {}
    np.testing.assert_equal(mine_state, plain_state)
