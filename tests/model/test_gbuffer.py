"""`gbuffer`: images before it has learned anything, and its parts by numbers worked out by hand."""

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
    GRADIENTS,
    SURFACES,
    Enhancer,
    GatedEncoder,
    GBufferNetwork,
    NetworkInputs,
)
from supersampler_model.methods.gbuffer_surfaces import (
    MIN_REFLECTANCE,
    Surfaces,
    changed_light,
    closest_around,
    gradients,
    motion_of_surface,
    occluded,
    read_bilinear,
    read_nearest,
    reflectance,
    relative_depth,
    samples_of,
    usable_surfaces,
    weighted_mean,
)
from supersampler_model.training.losses import dissimilarity
from torch_inputs import plain_inputs

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
    with torch.no_grad():
        done = method.step(*(inputs[name] for name in method.inputs()), *history)
    return done.image, done.history


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


def test_reflectance_is_the_base_colour_and_1_at_the_sky() -> None:
    base = torch.tensor([0.2, 0.4, 0.6]).reshape(1, 3, 1, 1)
    here = surfaces_of(base)
    torch.testing.assert_close(reflectance(here), base + 0.04 + MIN_REFLECTANCE)
    metal = here._replace(metallic=torch.ones(1, 1, 1, 1))
    torch.testing.assert_close(reflectance(metal), base + MIN_REFLECTANCE)
    sky = here._replace(normal=torch.zeros(1, 3, 1, 1))
    torch.testing.assert_close(reflectance(sky), torch.ones(1, 3, 1, 1))


@pytest.mark.parametrize(("stops", "changed"), [(5.9, 0.0), (6.1, 1.0)])
def test_light_has_changed_where_it_is_six_stops_off_on_average(stops: float, changed: float) -> None:
    previous, known = torch.full((1, 3, 6, 8), 0.2), torch.ones(1, 1, 6, 8)
    now = previous * 2.0**stops
    assert (changed_light(now, previous, known) == changed).all()
    assert (changed_light(previous, now, known * 0.0) == 0.0).all(), "nothing is known to have"


def test_neither_a_spark_nor_darkness_is_a_change_of_light() -> None:
    previous, known = torch.full((1, 3, 6, 8), 0.2), torch.ones(1, 1, 6, 8)
    spark = previous.clone()
    spark[..., 3, 4] = 65504.0
    assert not changed_light(spark, previous, known).any()
    assert not changed_light(previous * 0.0, previous, known).any(), "black is four stops below"


def test_gradients_are_differences_to_the_right_and_below() -> None:
    here = surfaces_of(torch.zeros(1, 3, 3, 4))
    here.base_color[:, :, 1, 2] = 0.5
    found = gradients(here)[0]
    expected = torch.zeros(3, 4)
    expected[1, 1], expected[1, 2], expected[0, 2] = 1.5, 3.0, 1.5
    torch.testing.assert_close(found[0], expected)
    assert not found[1].any()


def test_the_nearest_sample_of_the_history_is_read_with_the_offset_to_it() -> None:
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


def image(value: float, channels: int = 3, side: int = SIDE) -> Tensor:
    return torch.full((1, channels, side, side), value)


def with_block(size: int) -> Tensor:
    """A grey image with a bright square in its middle."""
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


def test_a_frame_and_the_edges_of_its_surfaces_attend_to_each_other() -> None:
    """Figure 3: the frame plus what both attentions bring."""
    torch.manual_seed(0)
    enhancer = Enhancer(2, 4, "both").eval()
    frame, gradients = torch.randn(1, 4, 5, 6), torch.rand(1, GRADIENTS, 10, 12)
    edges = enhancer.embed(torch.nn.functional.pixel_unshuffle(gradients, 2))
    query, key, value, query_2, key_2, value_2 = enhancer.projections
    expected = frame + torch.sigmoid(query(frame) * key(edges)) * value(edges)
    expected = expected + torch.sigmoid(query_2(edges) * key_2(frame)) * value_2(frame)
    torch.testing.assert_close(enhancer(frame, gradients), expected)


def test_the_gate_is_of_the_branch_that_sees_base_colour_and_depth_alone() -> None:
    torch.manual_seed(0)
    encoder = GatedEncoder(replace(SMALL_NETWORK, surfaces=(8, 8), detailed=(8, 8)), 2).eval()
    surfaces = torch.rand(1, SURFACES, 8, 8)
    assert encoder.gate is not None
    with torch.no_grad():
        encoder.gate.fill_(0.0)
        plain = encoder(surfaces)
        encoder.gate.fill_(1.0)
        detailed = encoder(surfaces) - plain
        assert detailed.any()
        for channel in range(SURFACES):
            other = surfaces.clone()
            other[:, channel] += 0.5
            encoder.gate.fill_(0.0)
            base = encoder(other)
            encoder.gate.fill_(1.0)
            moved = not torch.allclose(encoder(other) - base, detailed, atol=1e-5)
            assert moved == (channel in {0, 1, 2, SURFACES - 1}), channel


def seen(size: int = 16) -> NetworkInputs:
    """Noise of the shapes that a network of ratio 2 sees."""
    shapes = SmallGBuffer().subgraph()
    assert shapes is not None
    fields = {}
    for name in NetworkInputs._fields:
        _, channels, *where = shapes.inputs[name]
        side = 2 * size if where[0] == "display_height" else size
        fields[name] = torch.rand(1, int(channels), side, side)
    return NetworkInputs(**fields)


@pytest.mark.parametrize("name", NetworkInputs._fields)
def test_every_gathered_tensor_changes_the_networks_output(name: str) -> None:
    torch.manual_seed(1)
    network = GBufferNetwork(
        SMALL_NETWORK, ratio=2, blend_parameters=5
    )  # training: what is untrained is normalised as well
    torch.nn.init.normal_(network.blend.weight, std=0.1)
    tensors = seen()
    with torch.no_grad():
        (said,) = network(*tensors)
        (other,) = network(*tensors._replace(**{name: torch.rand_like(getattr(tensors, name))}))
    assert said.shape == (1, 5, 32, 32)
    assert (said - other).abs().max() > 1e-2


def test_both_frames_of_the_history_are_refined_by_what_lies_beside_each() -> None:
    torch.manual_seed(1)
    network = GBufferNetwork(SMALL_NETWORK, ratio=2, blend_parameters=5).eval()
    torch.nn.init.normal_(network.blend.weight, std=0.1)
    tensors = seen()
    same = tensors._replace(earlier=tensors.previous, earlier_refiner_inputs=tensors.refiner_inputs)
    exchanged = tensors._replace(
        refiner_inputs=tensors.earlier_refiner_inputs, earlier_refiner_inputs=tensors.refiner_inputs
    )
    given: list[Tensor] = []
    handle = network.refiner.register_forward_pre_hook(lambda _, x: given.extend(x))
    with torch.no_grad():
        network(*same)
        network(*exchanged)
    handle.remove()
    features, refiner_inputs, _, exchanged_beside = given
    torch.testing.assert_close(features[0], features[1])
    torch.testing.assert_close(refiner_inputs[0], tensors.refiner_inputs[0])
    torch.testing.assert_close(
        exchanged_beside, torch.cat([tensors.earlier_refiner_inputs, tensors.refiner_inputs])
    )


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


def test_motion_is_of_the_sample_whose_depth_is_most_like_the_pixels() -> None:
    depth, motion = torch.full((1, 1, 3, 3), 0.2), torch.zeros(1, 2, 3, 3)
    depth[..., 0, 2], motion[..., 0, 2] = 0.5, 3.0
    grid = ops.grid_of(ops.Size(3, 3), ops.Size(3, 3), torch.zeros(1, 2))
    found = motion_of_surface(depth, motion, torch.full((1, 1, 3, 3), 0.49), grid)
    near = torch.tensor([[0.0, 3.0, 3.0], [0.0, 3.0, 3.0], [0.0, 0.0, 0.0]])
    torch.testing.assert_close(found, near.expand(1, 2, 3, 3))
    assert not motion_of_surface(depth, motion, torch.full((1, 1, 3, 3), 0.21), grid).any()


def test_between_samples_of_the_same_depth_the_nearest_one_leads() -> None:
    motion = torch.arange(9.0).reshape(1, 1, 3, 3).expand(1, 2, 3, 3)
    depth = torch.full((1, 1, 3, 3), 0.2)
    grid = ops.grid_of(ops.Size(3, 3), ops.Size(3, 3), torch.zeros(1, 2))
    torch.testing.assert_close(motion_of_surface(depth, motion, depth, grid), motion)


def test_depth_is_relative_to_the_closest_within_four_pixels() -> None:
    depth = torch.full((1, 1, 11, 11), 0.1)
    depth[..., 5, 5] = 0.4
    relative = relative_depth(depth, closest_around(depth))
    assert float(relative[..., 5, 5]) == 1.0
    assert float(relative[..., 1, 9]) == pytest.approx(0.25)
    assert float(relative[..., 0, 5]) == float(relative[..., 5, 10]) == 1.0
    assert (relative_depth(-depth, closest_around(depth)) == 0.0).all()


def test_the_history_is_read_between_its_pixels_where_motion_and_jitter_lead() -> None:
    ramp = torch.arange(8.0).expand(1, 1, 6, 8) + 10.0 * torch.arange(6.0)[:, None]
    motion = torch.tensor([1.25, -0.5]).reshape(1, 2, 1, 1).expand(1, 2, 6, 8)
    found = read_bilinear(ramp, motion, torch.tensor([[0.25, 0.1]]))
    assert float(found[..., 3, 2]) == pytest.approx(2.0 + 1.5 + 10.0 * (3.0 - 0.4), abs=1e-4)
    assert float(found[..., 0, 7]) == pytest.approx(7.0)  # clamped at the border


def test_motion_just_inside_the_border_is_on_screen_and_just_outside_is_not() -> None:
    frame = torch.zeros(1, 1, 4, 6)
    for axis, size in ((0, 6), (1, 4)):
        for edge, sign in ((-0.5, 1.0), (size - 0.5, -1.0)):
            for inside in (True, False):
                motion = torch.zeros(1, 2, 4, 6)
                motion[0, axis, 2, 2] = edge - 2.0 + (1e-3 if inside else -1e-3) * sign
                seen_there = read_nearest(frame, motion, torch.zeros(1, 2)).on_screen
                assert bool(seen_there[0, 0, 2, 2]) is inside
                assert int(seen_there.sum()) == 24 - (not inside)


@pytest.mark.parametrize("field", ["base_color", "normal", "roughness", "metallic", "specular"])
def test_values_out_of_range_count_as_unknown_and_those_in_range_are_kept(field: str) -> None:
    plain = surfaces(3)
    values = getattr(plain, field).clone()
    values[..., 0, 0], values[..., 0, 1], values[..., 0, 2] = 1.01, torch.nan, 1.0
    made = getattr(usable_surfaces(plain._replace(**{field: values}), torch.float32), field)
    assert not made[..., 0, :2].any()
    assert (made[..., 0, 2] == 1.0).all()
    torch.testing.assert_close(made[..., 1:, :], values[..., 1:, :])
