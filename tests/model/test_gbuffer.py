"""What `gbuffer` promises before it has learned anything, and what its parts compute."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferNetworkConfig
from supersampler_bench.quality import metrics
from supersampler_model import ops
from supersampler_model.methods.base import Method
from supersampler_model.methods.gbuffer import DepthGBuffer, GBuffer, SmallGBuffer, SmallGBuffer4
from supersampler_model.methods.gbuffer_network import GBufferNetwork
from supersampler_model.methods.gbuffer_surfaces import (
    MIN_REFLECTANCE,
    Surfaces,
    changed_light,
    gradients,
    neutral_surfaces,
    occluded,
    read_nearest,
    reflectance,
    relative_depth,
    usable_surfaces,
)
from supersampler_model.training.losses import dissimilarity
from torch_inputs import plain_inputs

BOTH = [SmallGBuffer, SmallGBuffer4]


def surfaces(base: Tensor, depth: float = 0.5) -> Surfaces:
    """Rough dielectrics that face the eye, of any base colour."""
    one = torch.ones_like(base[:, :1])
    normal = torch.cat([0.0 * one, 0.0 * one, one], dim=1)
    return Surfaces(base, normal, 0.8 * one, 0.0 * one, 0.5 * one, depth * one)


def frame(
    render: Surfaces, display: Surfaces, color: Tensor, jitter: tuple[float, float]
) -> dict[str, Tensor]:
    """Inputs by name, standing still."""
    height, width = display.depth.shape[2:]
    of_render = {f"gbuffer_{name}": value for name, value in render._asdict().items() if name != "depth"}
    return {
        **of_render,
        **{f"gbuffer_display_{name}": value for name, value in display._asdict().items()},
        "color": color,
        "depth": render.depth,
        "motion": torch.zeros_like(color[:, :2]),
        "jitter": torch.tensor([jitter]),
        "exposure": torch.ones(1),
        "display_size": torch.tensor([width, height]),
        **plain_inputs((color.shape[3], color.shape[2])),
    }


def step(
    method: Method, inputs: Mapping[str, Tensor], history: list[Tensor] | None = None
) -> tuple[Tensor, list[Tensor]]:
    if history is None:
        display, render = inputs["gbuffer_display_depth"].shape[2:], inputs["depth"].shape[2:]
        history = method.first_history(ops.Size(*display[::-1]), ops.Size(*render[::-1]))
    with torch.no_grad():
        done = method.step(*(inputs[name] for name in method.inputs()), *history)
    return done.image, done.history


def textured(ratio: int, seed: int = 0) -> tuple[Surfaces, Surfaces]:
    """A noisy texture at display size, and what samples at the pixels' centres see of it."""
    random = torch.Generator().manual_seed(seed)
    display = surfaces(torch.rand(1, 3, 8 * ratio, 9 * ratio, generator=random))
    middle = ratio // 2
    render = Surfaces(*(value[:, :, middle::ratio, middle::ratio] for value in display))
    return render, display


@pytest.mark.parametrize("kind", BOTH)
def test_a_texture_is_there_in_the_first_frame(kind: type[GBuffer]) -> None:
    method = kind().eval()
    ratio = method.config.ratio
    render, display = textured(ratio)
    jitter = (0.5 / ratio, 0.5 / ratio)  # on the display pixel right below a pixel's centre
    light = torch.tensor([0.7, 0.9, 1.1]).reshape(1, 3, 1, 1)
    image, _ = step(method, frame(render, display, light * reflectance(render), jitter))
    truth = light * reflectance(display)
    off = (ops.tone(image) - ops.tone(truth)).abs()
    blurred = torch.nn.functional.avg_pool2d(truth, 3, 1, 1, count_include_pad=False)
    assert off.mean() < 0.5 * (ops.tone(blurred) - ops.tone(truth)).abs().mean()


def test_of_depth_alone_no_surface_is_told_from_another() -> None:
    method = DepthGBuffer().eval()
    assert [name for name in method.inputs() if "gbuffer" in name] == ["gbuffer_display_depth"]
    render, display = textured(2)
    inputs = frame(render, display, reflectance(render), (0.1, -0.2))
    image, history = step(method, inputs)
    grey = frame(
        neutral_surfaces(render.depth), neutral_surfaces(display.depth), reflectance(render), (0.1, -0.2)
    )
    ours, _ = step(SmallGBuffer().eval(), grey)
    torch.testing.assert_close(image, ours)
    again, _ = step(method, inputs, history)
    assert again.isfinite().all()


def test_what_is_not_blended_is_not_of_the_image_before() -> None:
    render, display = textured(2)
    first = frame(render, display, reflectance(render), (0.1, -0.2))
    second = frame(render, display, 0.5 * reflectance(render), (0.1, -0.2))
    alone = SmallGBuffer(replace(SmallGBuffer.spec.config(), blended=False)).eval()
    _, history = step(alone, first)
    torch.testing.assert_close(step(alone, second, history)[0], step(alone, second)[0])
    blended = SmallGBuffer().eval()
    _, history = step(blended, first)
    assert (step(blended, second, history)[0] - step(blended, second)[0]).abs().mean() > 0.01


@pytest.mark.parametrize("kind", BOTH)
def test_one_colour_stays_that_colour_from_frame_to_frame(kind: type[GBuffer]) -> None:
    method = kind().eval()
    ratio = method.config.ratio
    display = surfaces(torch.full((1, 3, 5 * ratio, 7 * ratio), 0.5))
    render = Surfaces(*(value[:, :, ::ratio, ::ratio] for value in display))
    color, history = torch.full((1, 3, 5, 7), 0.37), None
    for jitter in ((0.1, -0.3), (-0.4, 0.2), (0.0, 0.0)):
        image, history = step(method, frame(render, display, color, jitter), history)
        torch.testing.assert_close(image, torch.full_like(image, 0.37), rtol=1e-4, atol=1e-5)
    assert history is not None
    counted = float(history[2].sum()) / color[:, :1].numel()
    assert counted == pytest.approx(3.0 * 2.0 * np.pi * 0.47**2, rel=0.05)  # of each sample, its Gaussian


def test_bad_pixels_in_any_input_never_reach_the_history() -> None:
    method = SmallGBuffer().eval()
    render, display = textured(2)
    good = frame(render, display, reflectance(render), (0.0, 0.0))
    for name in (name for name, value in good.items() if value.ndim == 4):
        inputs = {**good, name: good[name].clone()}
        for place, bad in enumerate((float("nan"), float("inf"), -float("inf"), -1.0, 131008.0)):
            inputs[name][:, :, place, 4] = bad
        image, history = step(method, inputs)
        image, history = step(method, good, history)
        for value in (image, *history):
            assert value.isfinite().all(), name
        assert (image >= 0.0).all()


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("size", [(1, 1), (13, 7)])
def test_any_size_is_rendered(kind: type[GBuffer], size: tuple[int, int]) -> None:
    method = kind().eval()
    ratio, (width, height) = method.config.ratio, size
    display = surfaces(torch.rand(1, 3, height * ratio, width * ratio))
    render = Surfaces(*(value[:, :, ::ratio, ::ratio] for value in display))
    image, _ = step(method, frame(render, display, torch.rand(1, 3, height, width), (0.2, 0.1)))
    assert image.shape == (1, 3, height * ratio, width * ratio)
    assert image.isfinite().all()


def test_a_surface_reflects_its_base_colour_and_the_sky_is_white() -> None:
    base = torch.tensor([0.2, 0.4, 0.6]).reshape(1, 3, 1, 1)
    here = surfaces(base)
    torch.testing.assert_close(reflectance(here), base + 0.04 + MIN_REFLECTANCE)
    metal = here._replace(metallic=torch.ones(1, 1, 1, 1))
    torch.testing.assert_close(reflectance(metal), base + MIN_REFLECTANCE)
    sky = here._replace(normal=torch.zeros(1, 3, 1, 1))
    torch.testing.assert_close(reflectance(sky), torch.ones(1, 3, 1, 1))


def test_surfaces_that_are_no_numbers_become_black_and_far() -> None:
    bad = surfaces(torch.full((1, 3, 1, 1), float("nan")), depth=float("inf"))
    made = usable_surfaces(bad, torch.float32)
    assert float(made.base_color.abs().max()) == 0.0
    assert float(made.depth) == -1.0


def test_masks_find_what_was_hidden_and_what_has_another_colour() -> None:
    def image(value: float, channels: int = 3) -> Tensor:
        return torch.full((1, channels, 7, 7), value)

    now = (image(0.2), image(0.3), image(0.1, 1))
    assert not occluded(now, now).any()
    assert occluded(now, (now[0], now[1], image(0.08, 1))).all()  # equation 1: 25 % farther
    assert not occluded(now, (now[0], now[1], image(0.095, 1))).any()
    assert occluded(now, (now[0], image(0.9), now[2])).all()
    assert occluded(now, (image(0.8), now[1], now[2])).all()
    one = image(0.2)
    one[..., 3, 3] = 0.8  # in the previous frame: unlike all of its neighbours now
    assert occluded(now, (one, now[1], now[2])).nonzero()[:, 2:].tolist() == [[3, 3]]


@pytest.mark.parametrize(("stops", "changed"), [(5.9, 0.0), (6.1, 1.0)])
def test_light_has_changed_where_it_is_six_stops_off_on_average(stops: float, changed: float) -> None:
    previous, known = torch.full((1, 3, 6, 8), 0.2), torch.ones(1, 1, 6, 8)
    now = previous * 2.0**stops
    assert (changed_light(now, previous, known) == changed).all()
    assert (changed_light(previous, now, known * 0.0) == 0.0).all(), "nothing is known to have"


def test_a_spark_is_no_change_of_light_and_neither_is_the_dark() -> None:
    previous, known = torch.full((1, 3, 6, 8), 0.2), torch.ones(1, 1, 6, 8)
    spark = previous.clone()
    spark[..., 3, 4] = 65504.0
    assert not changed_light(spark, previous, known).any()
    assert not changed_light(previous * 0.0, previous, known).any(), "black is four stops below"


def test_gradients_are_differences_to_the_right_and_below() -> None:
    here = surfaces(torch.zeros(1, 3, 3, 4))
    here.base_color[:, :, 1, 2] = 0.5
    found = gradients(here)[0]
    expected = torch.zeros(3, 4)
    expected[1, 1], expected[1, 2], expected[0, 2] = 1.5, 3.0, 1.5
    torch.testing.assert_close(found[0], expected)
    assert not found[1].any()


def test_depth_is_seen_without_its_unit() -> None:
    depth, closest = torch.rand(1, 1, 5, 5) + 0.1, torch.full((1, 1, 5, 5), 1.2)
    torch.testing.assert_close(relative_depth(depth, closest), relative_depth(1e-3 * depth, 1e-3 * closest))


def test_the_history_is_read_at_its_nearest_sample_and_says_how_far_that_is() -> None:
    image = torch.arange(12.0).reshape(1, 1, 3, 4)
    motion = torch.full((1, 2, 3, 4), 0.8)
    found, off, on_screen = read_nearest(image, motion, torch.tensor([[0.1, -0.2]]))
    assert float(found[0, 0, 0, 0]) == 5.0  # (0.9, 0.6) rounds to (1, 1)
    torch.testing.assert_close(off[0, :, 0, 0], torch.tensor([0.1, 0.4]))
    assert on_screen[0, 0].tolist() == [[1.0, 1.0, 1.0, 0.0]] * 2 + [[0.0] * 4]


@pytest.mark.parametrize(
    "config",
    [
        GBufferNetworkConfig(),
        replace(SMALL_NETWORK, gated=False, attention="none", refined=False),
        replace(SMALL_NETWORK, attention="one"),
    ],
)
def test_a_network_without_some_of_its_parts_still_begins_as_the_mean(config: GBufferNetworkConfig) -> None:
    method = SmallGBuffer()
    method.net = GBufferNetwork(config, ratio=2, blend_parameters=sum(method.config.parts))
    render, display = textured(2)
    image, _ = step(method.eval(), frame(render, display, reflectance(render), (0.0, 0.0)))
    ours, _ = step(SmallGBuffer().eval(), frame(render, display, reflectance(render), (0.0, 0.0)))
    torch.testing.assert_close(image, ours)


def test_dissimilarity_is_one_less_the_similarity_that_the_bench_measures() -> None:
    random = np.random.default_rng(0)
    truth = random.random((40, 50, 3)).astype(np.float32)
    image = np.clip(truth + 0.1 * random.standard_normal(truth.shape), 0.0, 1.0).astype(np.float32)
    planes = [torch.from_numpy(i.transpose(2, 0, 1).copy())[None] for i in (image, truth)]
    ours = 1.0 - float(dissimilarity(*planes)[..., 5:-5, 5:-5].mean())
    assert ours == pytest.approx(metrics.ssim(image, truth), abs=0.01)
    assert float(dissimilarity(planes[0], planes[0]).abs().max()) < 1e-5
