"""Training of `gbuffer`: structural dissimilarity, and larger weights on reflective surfaces."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from torch import Tensor

from gbuffer_sets import surfaces
from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferConfig
from supersampler_model import ops
from supersampler_model.methods.gbuffer import Gathered, SmallGBuffer
from supersampler_model.methods.gbuffer_surfaces import Surfaces
from supersampler_model.training.crops import CropFrame
from supersampler_model.training.gbuffer_task import GBufferTask, GBufferWeights, reflective_of
from supersampler_model.training.losses import display_values, dissimilarity

SIDE = 12  # of the render size


def sample(display: Surfaces) -> CropFrame:
    """A noisy frame at rest, whose truth is other noise."""
    random = torch.Generator().manual_seed(0)
    render = surfaces(SIDE)
    gbuffer = {f"gbuffer_{name}": value for name, value in render._asdict().items() if name != "depth"}
    gbuffer |= {f"gbuffer_display_{name}": value for name, value in display._asdict().items()}
    color = torch.rand(1, 3, SIDE, SIDE, generator=random)
    reference = torch.rand(1, 3, 2 * SIDE, 2 * SIDE, generator=random)
    classes = torch.zeros(1, 2 * SIDE, 2 * SIDE, dtype=torch.int64)
    view = ops.View(ops.Size(2 * SIDE, 2 * SIDE), ops.Size(SIDE, SIDE), torch.zeros(1, 2))
    motion = torch.zeros(1, 2, SIDE, SIDE)
    exposure = torch.ones(1)
    return CropFrame(
        color, render.depth, motion, exposure, view, True, reference, classes, classes, gbuffer
    )  # fmt: skip


@pytest.fixture(scope="module")
def task() -> GBufferTask:
    torch.manual_seed(0)
    network = replace(SMALL_NETWORK, surfaces=(8, 8), detailed=(8, 8), frame=8, levels=(8, 8, 8, 8))
    return GBufferTask(SmallGBuffer(GBufferConfig(network=network)))


def half_metal() -> Surfaces:
    metal = torch.zeros(1, 1, 2 * SIDE, 2 * SIDE)
    metal[..., :SIDE] = 1.0
    return surfaces(2 * SIDE, metallic=metal)


def test_structure_costs_the_dissimilarity_of_shown_images_and_more_where_surfaces_shine(
    task: GBufferTask,
) -> None:
    frame = sample(half_metal())
    frame.reference[..., -2:, -2:] = torch.nan
    with torch.no_grad():
        stepped = task.step([frame], [task.first_state(frame)])
    shown = (display_values(image, frame.exposure) for image in (stepped.images, frame.reference))
    apart = dissimilarity(*shown)
    weight = torch.where(apart.isnan(), 0.0, torch.ones_like(apart))
    weight[..., :SIDE] += task.losses.reflective_structure
    expected = task.losses.structure * float((weight * apart).nansum() / weight.sum())
    even = task.losses.structure * float(apart.nanmean())
    assert float(stepped.terms["structure"]) == pytest.approx(expected, rel=1e-4)
    assert abs(expected - even) > 1e-4 * even > 1e-6, "the scene tells the two apart"


def test_each_weight_changes_its_own_term(task: GBufferTask) -> None:
    frame = sample(half_metal())

    def stepped(**weights: float) -> tuple[float, float]:
        other = GBufferTask(task.method)
        other.losses = GBufferWeights(**weights)
        with torch.no_grad():
            done = other.step([frame], [task.first_state(frame)])
        assert isinstance(done.weight, Tensor)
        return float(done.terms["structure"]), float(done.weight.max())

    term, weight = stepped(structure=0.2, reflective=0.5)
    assert stepped(structure=0.4, reflective=0.5) == pytest.approx((2.0 * term, weight), rel=1e-4)
    assert stepped(structure=0.2, reflective=1.5) == pytest.approx((term, weight + 1.0), rel=1e-4)
    assert weight == pytest.approx(1.5)


def gathered(now: Tensor, before: Tensor) -> Gathered:
    """Gathered tensors of rough surfaces with these normals, (3,) each."""
    normal, previous = (n.reshape(1, 3, 1, 1) for n in (now, before))
    display = surfaces(4, normal=normal.expand(1, 3, 4, 4))
    render = SimpleNamespace(shape=(1, 11, 2, 2))
    current = SimpleNamespace(inputs=SimpleNamespace(display=display))
    made = SimpleNamespace(current=current, previous_normal=previous.expand(1, 3, 2, 2), frame=render)
    return cast(Gathered, cast(Any, made))


def at(degrees: float) -> Tensor:
    turn = torch.deg2rad(torch.tensor(degrees))
    return torch.stack([turn.sin(), torch.zeros(()), turn.cos()])


@pytest.mark.parametrize(("degrees", "found"), [(0, 0), (40, 0), (44, 0), (46, 1), (80, 1), (120, 1)])
def test_a_normal_that_has_turned_by_more_than_45_degrees_counts_as_reflective(
    degrees: float, found: int
) -> None:
    assert (reflective_of(gathered(at(degrees), at(0))) == found).all()
    assert (reflective_of(gathered(at(10), at(10 + degrees))) == found).all()


def test_new_pixels_have_no_turned_normals_and_sky_is_not_reflective() -> None:
    assert not reflective_of(gathered(at(90), torch.zeros(3))).any()
    assert not reflective_of(gathered(torch.zeros(3), at(0))).any()


@pytest.mark.parametrize(
    ("metallic", "roughness", "found"),
    [(0.94, 0.5, 0), (0.96, 0.5, 1), (0.0, 0.03, 0), (0.0, 0.01, 1), (1.0, 0.0, 1)],
)
def test_metal_and_mirrors_are_reflective(metallic: float, roughness: float, found: int) -> None:
    here = gathered(at(0), at(0))
    one = torch.ones(1, 1, 4, 4)
    display = here.current.inputs.display._replace(metallic=metallic * one, roughness=roughness * one)
    here.current.inputs.display = display  # type: ignore[misc]
    assert (reflective_of(here) == found).all()
