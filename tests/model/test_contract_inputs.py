"""The inputs `reactive`, `pre_exposure` and `adds_samples` keep their promises in every torch method."""

from collections.abc import Mapping, Sequence

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from supersampler.methods.registry import methods
from supersampler_export.parity import noise
from supersampler_model import ops
from supersampler_model.methods import method_class
from supersampler_model.methods.base import Method, Outputs
from torch_inputs import step_by_name

RENDER = ops.Size(17, 11)
ALL = {name: method_class(name) for name in methods()}
CONVERGING = [name for name, kind in ALL.items() if "adds_samples" in kind.inputs()]


def made(name: str) -> tuple[Method, ops.Size]:
    """An untrained method, the same each time, and a display size that it takes."""
    torch.manual_seed(0)
    method = ALL[name]().eval()
    ratio = 1 if method.extrapolates() else max(2, round(method.ratios[0]))
    return method, ops.Size(ratio * RENDER.width, ratio * RENDER.height)


def run(name: str, changes: Sequence[Mapping[str, Tensor]]) -> list[Outputs]:
    """Steps on frames of noise without a mask and pre-exposure, but for these inputs."""
    method, display = made(name)
    history, done = method.first_history(display, RENDER), []
    for index, (frame, change) in enumerate(zip(noise(RENDER, display, len(changes)), changes, strict=True)):
        plain = {**frame, "color": frame["color"] / frame["pre_exposure"], "pre_exposure": torch.ones(1)}
        plain |= {"reactive": torch.zeros_like(frame["depth"]), "adds_samples": torch.ones(1)}
        given = {**plain, **change}
        given["color"] = given["color"] * given["pre_exposure"]
        if method.extrapolates() and index % 2 == 0:
            history = method.after_shaded(given, history if index else None)
            continue
        done.append(step_by_name(method, given, history))
        history = done[-1].history
    return done


@pytest.mark.long  # every method in torch
@pytest.mark.parametrize("name", ALL)
def test_bad_pixels_of_one_frame_reach_neither_images_nor_histories(name: str) -> None:
    method, display = made(name)
    frames = list(noise(RENDER, display, 3))
    for key in {"color", *method.inputs()}:
        for spoilt in (0, 1) if method.extrapolates() else (1,):
            if frames[spoilt][key].ndim != 4:
                continue
            pixels = frames[spoilt][key].clone()
            for row, value in enumerate((float("nan"), float("inf"), -float("inf"), -1.0, 131008.0)):
                pixels[:, :, 2 * row, 4:9] = value
            for done in run(name, [{key: pixels} if index == spoilt else {} for index in range(3)]):
                assert done.image.min() >= 0.0, key
                history = dict(zip(method.history, done.history, strict=True))
                if method.extrapolates():  # it holds the last shaded frame as it is
                    history = {name: value for name, value in history.items() if not name.endswith("color")}
                assert all(value.isfinite().all() for value in (done.image, *history.values())), key


@pytest.mark.parametrize("name", CONVERGING)
def test_a_frame_without_new_samples_leaves_the_mean_unchanged(name: str) -> None:
    still = {"motion": torch.zeros(1, 2, RENDER.height, RENDER.width)}
    nothing = {**still, "adds_samples": torch.zeros(1)}
    steps = run(name, [still, still, nothing, still])
    at = list(ALL[name].history).index("static_mean")
    before, without, after = (step.history[at] for step in steps[1:])
    assert before[:, 3].max() > 0.1
    assert torch.equal(without[:, :3], before[:, :3])
    assert torch.equal(without[:, 3:].abs(), before[:, 3:].abs())
    assert not torch.equal(after[:, :3], before[:, :3])


def test_bad_values_of_a_mask_count_as_the_nearest_ones_and_missing_samples_as_0() -> None:
    mask = torch.tensor([[[[-1.0, float("nan"), 0.25, 3.0, float("inf"), 1.0]]]])
    usable = torch.tensor([[[[1.0, 1.0, 1.0, 1.0, 1.0, 0.0]]]])
    grid = ops.grid_of(ops.Size(6, 1), ops.Size(6, 1), torch.zeros(1, 2))
    assert ops.reactive_at(mask, usable, grid).flatten().tolist() == [0.0, 0.0, 0.25, 1.0, 1.0, 0.0]


@settings(max_examples=30, deadline=None)
@given(value=st.floats(0.0, 1.0, width=32), seed=st.integers(0, 99))
def test_the_compositor_moves_the_image_towards_the_colours_of_this_frame(value: float, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    colors = torch.rand(4, 1, 3, 2, 2, generator=generator)
    weights = torch.rand(4, 1, 1, 2, 2, generator=generator) + 0.01
    factors = torch.randn(1, 4, 2, 2, generator=generator)
    pairs = list(zip(colors, weights, strict=True))

    def blended(mask: float) -> tuple[Tensor, Tensor]:
        result = ops.composite(pairs[:2], pairs[2:], factors, torch.tensor(mask), colors[2])
        return result.color, result.weight

    (plain, weight), (alone, none) = blended(0.0), blended(1.0)
    color, left = blended(value)
    assert none.max() == 0.0
    torch.testing.assert_close(left, (1.0 - value) * weight, rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(color, plain + value * (alone - plain), rtol=1e-4, atol=1e-5)
