"""`gbuffer`: images before it has learned anything, and the equations of its paper by hand."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from gbuffer_sets import surfaces, surfaces_of
from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferNetworkConfig
from supersampler_bench.quality import metrics
from supersampler_model import ops
from supersampler_model.methods.base import Method
from supersampler_model.methods.gbuffer import GBuffer, SmallGBuffer, SmallGBuffer4
from supersampler_model.methods.gbuffer_network import (
    GBufferNetwork,
)
from supersampler_model.methods.gbuffer_surfaces import (
    Surfaces,
    changed_light,
    occluded,
    reflectance,
    samples_of,
    weighted_mean,
)
from supersampler_model.training.losses import dissimilarity
from torch_inputs import plain_inputs, step_by_name

BOTH = [SmallGBuffer, SmallGBuffer4]
GREY, SIDE = 0.2, 15
MARKS: list[Callable[[Tensor], dict[str, Tensor]]] = [
    lambda right: {"base_color": 0.1 + 0.8 * right.expand(-1, 3, -1, -1)},
    lambda right: {"normal": torch.cat([right, 0.0 * right, 1.0 - right], dim=1)},
    lambda right: {"roughness": right},
    lambda right: {"metallic": right},
    lambda right: {"depth": 0.5 + 0.3 * right},
]


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
    image, history, _ = step_by_name(method, inputs, history)
    return image, history


def textured(ratio: int, seed: int = 0) -> tuple[Surfaces, Surfaces]:
    """A noisy texture at display size, and what samples at the pixels' centres see of it."""
    random = torch.Generator().manual_seed(seed)
    display = surfaces_of(torch.rand(1, 3, 8 * ratio, 9 * ratio, generator=random))
    middle = ratio // 2
    render = Surfaces(*(value[:, :, middle::ratio, middle::ratio] for value in display))
    return render, display


@pytest.mark.parametrize("kind", BOTH)
def test_texture_is_visible_in_the_first_frame(kind: type[GBuffer]) -> None:
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


def test_without_blending_the_previous_image_has_no_effect() -> None:
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
    display = surfaces_of(torch.full((1, 3, 5 * ratio, 7 * ratio), 0.5))
    render = Surfaces(*(value[:, :, ::ratio, ::ratio] for value in display))
    color, history = torch.full((1, 3, 5, 7), 0.37), None
    for jitter in ((0.1, -0.3), (-0.4, 0.2), (0.0, 0.0)):
        image, history = step(method, frame(render, display, color, jitter), history)
        torch.testing.assert_close(image, torch.full_like(image, 0.37), rtol=1e-4, atol=1e-5)
    assert history is not None
    counted = float(history[2].sum()) / color[:, :1].numel()
    assert counted == pytest.approx(3.0 * 2.0 * np.pi * 0.47**2, rel=0.05)  # of each sample, its Gaussian


@pytest.mark.parametrize(("stops", "changed"), [(5.9, 0.0), (6.1, 1.0)])
def test_light_has_changed_where_it_is_six_stops_off_on_average(stops: float, changed: float) -> None:
    """Neither a spark nor darkness, four stops below, is a change of light."""
    previous, known = torch.full((1, 3, 6, 8), 0.2), torch.ones(1, 1, 6, 8)
    now, spark = previous * 2.0**stops, previous.clone()
    spark[..., 3, 4] = 65504.0
    assert (changed_light(now, previous, known) == changed).all()
    for light, are_known in ((now, 0.0 * known), (spark, known), (0.0 * previous, known)):
        assert not changed_light(light, previous, are_known).any()


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


def image(value: float, channels: int = 3) -> Tensor:
    return torch.full((1, channels, SIDE, SIDE), value)


def with_block(size: int) -> Tensor:
    block, reach = image(GREY), size // 2
    block[..., SIDE // 2 - reach : SIDE // 2 + reach + 1, SIDE // 2 - reach : SIDE // 2 + reach + 1] = 0.9
    return block


@pytest.mark.parametrize(("size", "by_base", "by_color"), [(1, 0, 0), (3, 1, 0), (5, 1, 1)])
def test_base_colours_are_compared_in_3x3_pixels_and_colours_in_5x5(
    size: int, by_base: int, by_color: int
) -> None:
    """Equation 2: unusable where more than half of the pixels around differ from the warped one."""
    previous, depth = (image(GREY), image(GREY), image(0.5, 1)), image(0.5, 1)
    middle = (0, 0, SIDE // 2, SIDE // 2)
    assert int(occluded((image(GREY), with_block(size), depth), previous)[middle]) == by_base
    assert int(occluded((with_block(size), image(GREY), depth), previous)[middle]) == by_color


@pytest.mark.parametrize(
    ("now", "previous", "found"),
    [
        (0.5, 0.5 / 1.09, 0),
        (0.5, 0.5 / 1.11, 1),
        (0.5, 0.5 / 0.91, 0),
        (0.5, 0.5 / 0.89, 1),
        (0.0, 0.5, 1),
        (0.5, 0.0, 1),
        (0.0, 0.0, 0),
    ],
)
def test_distances_that_differ_by_a_tenth_occlude(now: float, previous: float, found: int) -> None:
    """Equation 1, on distances, the reciprocals of reversed depths; the sky has a depth of 0."""
    colors = (image(GREY), image(GREY))
    assert (occluded((*colors, image(now, 1)), (*colors, image(previous, 1))) == found).all()


@pytest.mark.parametrize("mark", MARKS, ids=["base colour", "normal", "roughness", "metallic", "depth"])
def test_light_is_taken_from_surfaces_like_that_of_the_pixel(
    mark: Callable[[Tensor], dict[str, Tensor]],
) -> None:
    """Light changes with the surface between two columns: on each side of the edge it is that side's."""
    right = (torch.arange(12) >= 6).float().expand(1, 1, 12, 12)
    render, display = surfaces(6, **mark(right[..., ::2, ::2])), surfaces(12, **mark(right))
    light = 0.2 + 0.5 * right[..., ::2, ::2].expand(-1, 3, -1, -1)
    grid = ops.grid_of(ops.Size(12, 12), ops.Size(6, 6), torch.zeros(1, 2))
    samples = samples_of(light, torch.ones(1, 1, 6, 6), render, display, grid)
    torch.testing.assert_close(
        weighted_mean(samples), 0.2 + 0.5 * right.expand(-1, 3, -1, -1), rtol=0.0, atol=0.03
    )
    assert samples.similarity[..., 5:7].min() > 0.5
    lost = samples_of(light, torch.ones(1, 1, 6, 6), render, surfaces(12, **mark(1.0 - right)), grid)
    assert lost.similarity[..., :4].max() < 0.05
