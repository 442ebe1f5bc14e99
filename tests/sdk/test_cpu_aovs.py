"""AOVs of the CPU library are those of the graph, `aovs.onnx`."""

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest

from cpu_models import cpu_executor
from noise import Size, noise
from shared_models import shared_model
from supersampler import Upscaler
from supersampler.backends.base import AovRequest
from supersampler.backends.onnx.executor import AovBlender
from supersampler.errors import SupersamplerError
from supersampler.frame import Float32
from supersampler.io.display import MAX_HALF
from supersampler.methods.model_file import read_upscaling_info

INSTRUCTIONS = ("", "avx2", "portable")
SIZES: list[tuple[Size, Size, int]] = [
    ((1, 1), (2, 2), 1),
    ((2, 3), (3, 5), 2),
    ((17, 9), (33, 18), 3),
    ((21, 13), (21, 13), 4),
    ((9, 21), (18, 41), 5),
    ((40, 11), (130, 44), 9),
]


@cache
def executor(instructions: str) -> Any:
    """Return an executor with two threads, or None where the CPU lacks the instructions."""
    try:
        return cpu_executor("taau", threads=2, instructions=instructions)
    except SupersamplerError:
        return None


@cache
def graph() -> AovBlender:
    return AovBlender(read_upscaling_info("taau"), 1)


def requests(render: Size, display: Size, channels: int, *, spoilt: bool = False) -> Iterator[AovRequest]:
    """Yield frames with the weights of their colour, and the history by the graph."""
    random, upscaler = (
        np.random.default_rng(3),
        Upscaler(shared_model("taau"), display_size=display, validate="off"),
    )
    history: Float32 | None = None
    for index in range(6):
        aovs = random.standard_normal((*render[::-1], channels)).astype(np.float32)
        if spoilt:
            for value in (np.nan, np.inf, -1e30):
                aovs[random.random(aovs.shape) < 0.05] = value
        frame = noise(index, render, aovs=aovs)
        weight = upscaler.step(frame, outputs=("weight",)).weight
        assert weight is not None
        yield AovRequest(frame, display, None if history is None else weight[None, None], history)
        history = graph().blend(AovRequest(frame, display, weight[None, None], history))


@pytest.mark.parametrize("spoilt", [False, True])
@pytest.mark.parametrize(("render", "display", "channels"), SIZES)
@pytest.mark.parametrize("instructions", INSTRUCTIONS)
def test_blended_aovs_are_those_of_the_graph(
    instructions: str, render: Size, display: Size, channels: int, spoilt: bool
) -> None:
    """Mean, 99.9 % quantile and largest difference, relative to the largest value, borders included.

    Off screen, where the weight is 0, only missing samples show the history, and the graph reads zeros there.
    """
    library, apart = executor(instructions), []
    if library is None:
        pytest.skip(f"this CPU has no {instructions}")
    for request in requests(render, display, channels, spoilt=spoilt):
        [ours], theirs = library.blend_aovs([request]), graph().blend(request)
        assert ours.shape == theirs.shape == (1, channels, *display[::-1])
        on_screen = 1.0 if request.weight is None or not spoilt else request.weight > 0.0
        apart.append((np.abs(ours - theirs) * on_screen).ravel() / (MAX_HALF if spoilt else 4.0))
    differences = np.concatenate(apart)
    assert differences.mean() < 1e-6
    assert np.quantile(differences, 0.999) < 1e-5
    assert differences.max() < 1e-4


def test_without_a_weight_the_history_only_fills_in_for_missing_samples() -> None:
    library, display = executor(""), (64, 36)
    aovs = np.full((18, 32, 2), 0.25, np.float32)
    aovs[5:14, 10:20, 1] = np.nan
    history = np.full((1, 2, 36, 64), 0.75, np.float32)
    frame = noise(0, motion=np.zeros((18, 32, 2), np.float32), jitter=(0.0, 0.0), aovs=aovs)
    [blended] = library.blend_aovs([AovRequest(frame, display, None, history)])
    np.testing.assert_allclose(blended[0, 0], 0.25, rtol=1e-6)
    np.testing.assert_allclose(blended[0, 1, 14:24, 24:36], 0.75, rtol=1e-6)
    np.testing.assert_allclose(blended[0, 1, :8], 0.25, rtol=1e-6)
