"""Samples missing in every frame show their neighbourhood, on every method and backend: never black."""

from typing import Any

import numpy as np
import pytest
import torch

from gpu_steps import device_or_skip
from method_backends import BACKENDS, make
from supersampler import Frame, Upscaler, halton_jitter
from supersampler_bench.specs import with_default_gbuffers
from supersampler_model.ops.color import filled

RENDER = (17, 13)
SHADED = [(name, kind) for name, kind in BACKENDS if not name.startswith(("guided", "extrapolate"))]
ON_GPU = [
    pytest.param(name, "gpu", marks=pytest.mark.long)  # software Vulkan
    for name in ("taa", "taau", "classifier", "classifier-large")
]


def plate(index: int, upscaler: Upscaler, lost: Any, channels: Any = slice(None)) -> Frame:
    """A grey plate, of which `channels` of samples are missing where `lost`, (h, w), is True."""
    width, height = RENDER
    color = np.full((height, width, 3), 0.4, np.float32)
    color[..., channels][lost] = np.nan
    frame = Frame(
        color=color,
        depth=np.full((height, width), 0.5, np.float32),
        motion=np.zeros((height, width, 2), np.float32),
        jitter=halton_jitter(index, 2.0),
        exposure=1.0,
        reset=index == 0,
    )
    return with_default_gbuffers(frame, upscaler.gbuffers, upscaler.display_size or RENDER)


def upscaler_or_skip(method: str, executor: str, **options: Any) -> Upscaler:
    if executor == "gpu":
        device_or_skip()
    return make(method, executor, **options)


@pytest.mark.parametrize(("method", "executor"), [*SHADED, *ON_GPU])
def test_a_hole_in_every_frame_is_filled_from_its_surroundings(method: str, executor: str) -> None:
    upscaler = upscaler_or_skip(method, executor)
    y, x = np.mgrid[: RENDER[1], : RENDER[0]]
    lost = np.hypot(x - 8, y - 6) < 4.5
    for index in range(12):
        image = upscaler.step(plate(index, upscaler, lost))
        assert image.min() > 0.3, f"frame {index}"
        assert image.max() < 0.5, f"frame {index}"


@pytest.mark.parametrize(("method", "executor"), SHADED)
def test_a_sample_that_lacks_one_channel_is_missing_as_a_whole(method: str, executor: str) -> None:
    y, x = np.mgrid[: RENDER[1], : RENDER[0]]
    one, all_of_them = (make(method, executor) for _ in range(2))
    for index in range(3):
        lost = np.hypot(x - 8 - index, y - 6) < 3.5
        image = one.step(plate(index, one, lost, slice(0, 1)))
        np.testing.assert_array_equal(image, all_of_them.step(plate(index, all_of_them, lost)))


@pytest.mark.parametrize(
    ("method", "executor"),
    [
        *(pair for pair in SHADED if pair[0] in ("taau", "gbuffer-fast") or pair[0].startswith("classifier")),
        *ON_GPU[1:],
    ],
)
def test_a_hole_of_some_frames_shows_and_keeps_the_history(method: str, executor: str) -> None:
    upscaler = upscaler_or_skip(method, executor, at_rest="off")
    nothing, all_of_it = np.zeros(RENDER[::-1], bool), np.ones(RENDER[::-1], bool)
    weights = []
    for index in range(14):
        lost = all_of_it if 8 <= index < 12 else nothing
        done: Any = upscaler.step(plate(index, upscaler, lost), outputs=("weight",))
        np.testing.assert_allclose(done.image, 0.4, atol=0.02, err_msg=f"frame {index}")
        weights.append(float(done.weight.mean()))
    assert weights[12] > 0.8 * weights[7]


def test_fills_are_never_brighter_than_the_brightest_sample_nor_not_a_number() -> None:
    color, usable = torch.full((1, 3, 5, 7), 65504.0), torch.zeros(1, 1, 5, 7)
    usable[..., 2:] = 1.0
    done = filled(color, usable, torch.tensor([1.0]))
    assert torch.isfinite(done).all()
    assert done.max() <= 65504.0
