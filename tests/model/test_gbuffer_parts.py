"""What single parts of `gbuffer` compute, by numbers worked out by hand."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferNetworkConfig
from supersampler.methods.registry import methods
from supersampler_model import ops
from supersampler_model.methods import method_class
from supersampler_model.methods.gbuffer import GBuffer, SmallGBuffer
from supersampler_model.methods.gbuffer_network import (
    GRADIENTS,
    SURFACES,
    Enhancer,
    GatedEncoder,
    GBufferNetwork,
    NetworkInputs,
)
from supersampler_model.methods.gbuffer_surfaces import (
    Surfaces,
    closest_around,
    motion_of_surface,
    neutral_surfaces,
    occluded,
    read_bilinear,
    read_nearest,
    relative_depth,
    samples_of,
    usable_surfaces,
    weighted_mean,
)

GREY, SIDE = 0.2, 15


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
    """Equation 2: of no use where more than half of the pixels around are unlike the warped one."""
    previous, depth = (image(GREY), image(GREY), image(0.5, 1)), image(0.5, 1)
    middle = (0, 0, SIDE // 2, SIDE // 2)
    assert int(occluded((image(GREY), with_block(size), depth), previous)[middle]) == by_base
    assert int(occluded((with_block(size), image(GREY), depth), previous)[middle]) == by_color


@pytest.mark.parametrize(
    ("previous", "found"), [(0.5 / 1.09, 0), (0.5 / 1.11, 1), (0.5 / 0.91, 0), (0.5 / 0.89, 1)]
)
def test_distances_that_differ_by_a_tenth_hide(previous: float, found: int) -> None:
    """Equation 1, by distance, which is one over the reversed depth."""
    colors = (image(GREY), image(GREY))
    assert (occluded((*colors, image(0.5, 1)), (*colors, image(previous, 1))) == found).all()


@pytest.mark.parametrize(("now", "previous", "found"), [(0.0, 0.5, 1), (0.5, 0.0, 1), (0.0, 0.0, 0)])
def test_sky_hides_a_surface_and_a_surface_hides_the_sky(now: float, previous: float, found: int) -> None:
    colors = (image(GREY), image(GREY))
    assert (occluded((*colors, image(now, 1)), (*colors, image(previous, 1))) == found).all()


def test_a_frame_and_the_edges_of_its_surfaces_each_ask_the_other() -> None:
    """Figure 3: the frame plus what both attentions bring."""
    torch.manual_seed(0)
    enhancer = Enhancer(2, 4, "both").eval()
    frame, gradients = torch.randn(1, 4, 5, 6), torch.rand(1, GRADIENTS, 10, 12)
    edges = enhancer.embed(torch.nn.functional.pixel_unshuffle(gradients, 2))
    query, key, value, query_2, key_2, value_2 = enhancer.projections
    expected = frame + torch.sigmoid(query(frame) * key(edges)) * value(edges)
    expected = expected + torch.sigmoid(query_2(edges) * key_2(frame)) * value_2(frame)
    torch.testing.assert_close(enhancer(frame, gradients), expected)


@pytest.mark.parametrize("config", [GBufferNetworkConfig(), SMALL_NETWORK], ids=["gbuffer", "gbuffer-small"])
def test_the_networks_that_are_used_have_all_parts_of_the_paper(config: GBufferNetworkConfig) -> None:
    assert (config.gated, config.attention, config.refined) == (True, "both", True)
    assert len(Enhancer(2, 4, config.attention).projections) == 6


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
def test_every_tensor_that_is_gathered_changes_what_the_network_says(name: str) -> None:
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


def surfaces(side: int, **fields: Tensor) -> Surfaces:
    """Grey, rough dielectrics that face the eye."""
    one = torch.ones(1, 1, side, side)
    plain = Surfaces(
        0.5 * one.expand(-1, 3, -1, -1),
        torch.cat([0 * one, 0 * one, one], 1),
        0.8 * one,
        0 * one,
        0.5 * one,
        0.5 * one,
    )
    return plain._replace(**fields)


MARKS: list[Callable[[Tensor], dict[str, Tensor]]] = [
    lambda right: {"base_color": 0.1 + 0.8 * right.expand(-1, 3, -1, -1)},
    lambda right: {"normal": torch.cat([right, 0.0 * right, 1.0 - right], dim=1)},
    lambda right: {"roughness": right},
    lambda right: {"metallic": right},
    lambda right: {"depth": 0.5 + 0.3 * right},
]


@pytest.mark.parametrize("mark", MARKS, ids=["base colour", "normal", "roughness", "metallic", "depth"])
def test_samples_are_taken_from_surfaces_like_the_pixels(mark: Callable[[Tensor], dict[str, Tensor]]) -> None:
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


@pytest.mark.parametrize("name", [name for name in methods() if issubclass(method_class(name), GBuffer)])
def test_a_method_of_one_ratio_has_a_network_of_that_ratio(name: str) -> None:
    ratio = 4 if name.endswith("4x") else 2
    method = method_class(name)()
    assert isinstance(method, GBuffer)
    assert method.ratios == (method.config.ratio,) * 2 == (ratio, ratio)


def test_surfaces_of_known_depth_alone_are_grey_rough_and_face_one_way() -> None:
    depth = torch.rand(1, 1, 2, 3)
    made = neutral_surfaces(depth)
    assert [float(value.mean()) for value in made[:1]] == [0.5]
    assert made.base_color.shape == made.normal.shape == (1, 3, 2, 3)
    assert made.normal[0, :, 0, 0].tolist() == [0.0, 0.0, 1.0]
    assert [float(value[0, 0, 1, 1]) for value in made[2:5]] == [0.5, 0.0, 0.5]
    assert torch.equal(made.depth, depth)
