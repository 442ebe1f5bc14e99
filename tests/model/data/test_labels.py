"""Labels of analytic scenes equal their closed form."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from label_samples import label_inputs
from more_scenes import Floor, ShadingStep, dots, near, ripples, thin_lines
from supersampler.io.shot import ClassMaps
from supersampler_model.data.labels import Alias, Ghost, LabelThresholds, label
from supersampler_model.data.scenes.analytic import (
    EXTENT,
    FAR,
    AnalyticScene,
    DiscOverPlane,
    Plane,
    WiresOverPlane,
    checker,
    from_spokes,
    places,
    plain,
    zone_plate,
)

SIZE = (128, 72)
PAPER = LabelThresholds(slope_aware=False)


def labelled(
    scene: AnalyticScene, index: int = 3, size: tuple[int, int] = SIZE, **thresholds: Any
) -> ClassMaps:
    now, before = label_inputs(scene, index, size), label_inputs(scene, index - 1, size)
    return label(now, before, LabelThresholds(**thresholds))


@pytest.mark.parametrize("size", [(64, 36), (128, 72), (101, 57)])
@pytest.mark.parametrize("velocities", [((4.0, 1.0), (0.0, 0.0)), ((-3.0, 0.4), (0.7, -0.5))])
def test_only_disoccluded_pixels_are_visibility_ghosting(velocities: Any, size: Any) -> None:
    scene = DiscOverPlane(velocities[0], velocities[1], start=(30.0, 16.0))
    hidden = labelled(scene, size=size).ghost == Ghost.VISIBILITY
    revealed = scene.disoccluded(3, size)
    inner = ~near(~revealed)
    assert inner.any()
    assert not (inner & ~hidden).any()
    assert not (hidden & ~near(revealed)).any()
    assert (hidden != revealed).sum() < 0.2 * revealed.sum()


def test_a_step_of_light_is_shading_ghosting_outside_aliased_pixels() -> None:
    for gain in (0.25, 0.7, 2.5):  # darker or brighter
        step = ShadingStep(Plane(plain), 3, gain)
        assert (labelled(step).ghost == Ghost.SHADING).all()
        assert not labelled(step, 4).ghost.any()  # only as it happens
    labels = labelled(ShadingStep(DiscOverPlane((0.0, 0.0), (0.0, 0.0)), 3, 0.25))
    relit, smooth = labels.ghost == Ghost.SHADING, labels.alias == Alias.NONE
    assert not (relit & ~smooth).any()
    assert (relit & smooth).sum() > 0.97 * smooth.sum()  # the opening takes what is narrow between edges
    assert not (labels.ghost == Ghost.VISIBILITY).any()


@pytest.mark.parametrize(
    "scene",
    [Plane(zone_plate), Plane(thin_lines), Plane(dots, bumps=ripples), Plane(checker), Floor(checker),
     WiresOverPlane(), DiscOverPlane((0.0, 0.0), (0.0, 0.0)), Plane(checker, (0.37, -0.21)),
     Plane(dots, (1.4, 0.6)), Floor(checker, 2.0)],
)  # fmt: skip
def test_surfaces_in_still_light_and_in_view_of_any_camera_have_no_ghosting(scene: AnalyticScene) -> None:
    assert not (labelled(scene).ghost > 0)[~near(scene.disoccluded(3, SIZE))].any()


@pytest.mark.parametrize("size", [(64, 36), (320, 180)])
def test_a_plane_at_a_grazing_angle_is_geometry_aliasing_by_the_papers_test_alone(size: Any) -> None:
    now = label_inputs(Floor(plain), 0, size)
    y = np.array([[0.5], [-0.5]]) * (1 - 1 / 8)  # the lowest and the highest sample
    nearest, farthest = FAR + Floor.SLOPE * (np.arange(size[1]) + 0.5 + y) * EXTENT[1] / size[1]
    grazing = (nearest - farthest) / nearest > 0.01
    assert grazing.any()
    paper = label(now, None, PAPER).alias == Alias.GEOMETRY
    np.testing.assert_array_equal(paper, np.broadcast_to(grazing[:, None], paper.shape))
    assert not label(now, None).alias.any()


@pytest.mark.parametrize("thresholds", [LabelThresholds(), PAPER])
def test_a_silhouette_is_geometry_aliasing(thresholds: LabelThresholds) -> None:
    scene = DiscOverPlane()
    corners = [scene.distance(0, *places(SIZE, (dx, dy))) for dx in (-0.5, 0.5) for dy in (-0.5, 0.5)]
    inner = [scene.distance(0, *places(SIZE, (dx, dy))) for dx in (-0.4, 0.4) for dy in (-0.4, 0.4)]
    edge = label(label_inputs(scene, 0, SIZE), None, thresholds).alias == Alias.GEOMETRY
    bulge = 0.01  # units by which the circle leaves the line between a pixel's corners
    may = (np.min(corners, axis=0) < scene.radius + bulge) & (np.max(corners, axis=0) > scene.radius - bulge)
    must = (np.min(inner, axis=0) < scene.radius) & (np.max(inner, axis=0) > scene.radius)
    assert must.any()
    assert not (edge & ~may).any()
    assert not (must & ~edge).any()


def test_thin_wires_are_geometry_aliasing_and_the_same_lines_painted_are_texture_aliasing() -> None:
    x, y = places(SIZE)
    away = np.hypot(x - EXTENT[0] / 2, y - EXTENT[1] / 2) > 5.0  # where each wire is alone
    pixel = EXTENT[0] / SIZE[0]
    off = np.abs(from_spokes(x, y) - 0.2) / pixel  # from a wire's edge, pixels
    for scene, name in ((WiresOverPlane(), Alias.GEOMETRY), (Plane(thin_lines), Alias.TEXTURE)):
        alias = label(label_inputs(scene, 0, SIZE), None).alias
        assert (alias[away & (off < 0.4)] == name).all()
        assert not alias[away & (off > 0.5 * np.sqrt(2.0))].any()
        assert set(np.unique(alias)) == {Alias.NONE, name}


def test_approaching_and_receding_surfaces_are_compared_at_their_previous_depth() -> None:
    scene = Floor(plain, speed=-2.0)
    now, before = label_inputs(scene, 3, SIZE), label_inputs(scene, 2, SIZE)
    anything_moves = LabelThresholds(velocity=-1.0)  # the depth test alone
    on_screen = ~near(scene.disoccluded(3, SIZE))
    assert not label(now, before, anything_moves).ghost[on_screen].any()
    naive = replace(now, depth_before=now.pixels.depth_max)
    assert label(naive, before, anything_moves).ghost[on_screen].any()
