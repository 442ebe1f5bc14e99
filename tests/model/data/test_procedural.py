"""Each family draws, is neither black nor blown out, moves, and is lit by lights that change."""

from functools import cache

import numpy as np
import pytest

from supersampler import display_transform
from supersampler_model.data.gl.renderer import Renderer
from supersampler_model.data.mesh import Mesh
from supersampler_model.data.procedural import lighting, paths, shapes, textures
from supersampler_model.data.scene import Instance, Scene
from supersampler_model.data.sequences import (
    TEST_FAMILIES,
    TRAIN_FAMILIES,
    Sequence,
    SequenceSpec,
    make_sequence,
)

FAMILIES = (*TRAIN_FAMILIES, *TEST_FAMILIES)
SIZE = (96, 54)
MOST_TRIANGLES = 60_000


@cache
def sequence_of(family: str, seed: int) -> Sequence:
    return make_sequence(SequenceSpec(family=family, seed=seed, frames=32))


def scene_of(family: str, seed: int = 1, index: int = 4) -> Scene:
    return sequence_of(family, seed).scene(index)


def moves(thing: Instance) -> bool:
    if thing.palette is not None and thing.palette_before is not None:
        return not np.array_equal(thing.palette, thing.palette_before)
    return thing.model_before is not None and not np.array_equal(thing.model, thing.model_before)


@pytest.fixture(scope="session")
def small_renderer() -> Renderer:
    return Renderer(SIZE, samples=4)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_frame_is_neither_black_nor_blown_out(family: str, small_renderer: Renderer) -> None:
    scene = scene_of(family)
    shown = display_transform(small_renderer.reference(scene).color, scene.camera.exposure)
    assert 0.12 < shown.mean() < 0.7
    assert (shown.max(axis=-1) < 0.04).mean() < 0.25
    assert (shown.min(axis=-1) > 0.95).mean() < 0.02
    assert shown.std() > 0.05


@pytest.mark.parametrize("family", FAMILIES)
def test_things_move_and_lights_change(family: str) -> None:
    for seed in (1, 2):
        scene, later = scene_of(family, seed), scene_of(family, seed, 20)
        moving = [thing for thing in scene.instances if moves(thing)]
        assert len(moving) >= 3
        assert (scene.sun, scene.spot, scene.points) != (later.sun, later.spot, later.points)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_scene_is_cheap_to_draw(family: str) -> None:
    for seed in (1, 2):
        scene = scene_of(family, seed)
        assert sum(len(thing.mesh.indices) for thing in scene.instances) < MOST_TRIANGLES


def test_shading_changes_between_frames_where_nothing_moves(small_renderer: Renderer) -> None:
    """Else there would be next to no shading ghosting to learn from."""
    changed = []
    for family in TRAIN_FAMILIES:
        scene, after = scene_of(family), scene_of(family, index=7)
        still = Scene(
            camera=scene.camera, camera_before=scene.camera, environment=scene.environment,
            instances=scene.instances, sun=scene.sun, spot=scene.spot, points=scene.points,
        )  # fmt: skip
        relit = Scene(
            camera=scene.camera, camera_before=scene.camera, environment=scene.environment,
            instances=scene.instances, sun=after.sun, spot=after.spot, points=after.points,
        )  # fmt: skip
        one, other = (display_transform(small_renderer.reference(s).color) for s in (still, relit))
        changed.append(float((np.abs(one - other).max(axis=-1) > 0.03).mean()))
    assert np.mean(changed) > 0.05


@pytest.mark.parametrize(
    "mesh",
    [
        shapes.plane(2.0, 1.0), shapes.wall(2.0, 1.0), shapes.panel(2.0, 1.0), shapes.box(1.0, 2.0, 3.0),
        shapes.cylinder(0.5, 1.0), shapes.ball(1.0), shapes.torus(1.0, 0.3),
        shapes.tube([(0, 0, 0), (0, 1, 0), (1, 2, 0)], 0.1), shapes.rock(np.random.default_rng(0), 1.0),
    ],
)  # fmt: skip
def test_faces_and_normals_of_shapes_agree(mesh: Mesh) -> None:
    a, b, c = mesh.positions[mesh.indices].transpose(1, 0, 2)
    faces = np.cross(b - a, c - a)
    area = np.linalg.norm(faces, axis=1)
    along = (faces * mesh.normals[mesh.indices].mean(axis=1)).sum(axis=1)
    assert (along[area > 1e-6] > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-3)


def test_closed_shapes_point_outwards() -> None:
    for mesh in (shapes.ball(1.0), shapes.cylinder(0.5, 1.0), shapes.box(1.0, 1.0, 1.0)):
        middle = mesh.positions.mean(axis=0)
        assert ((mesh.positions - middle) * mesh.normals).sum(axis=1).min() > -1e-4


def test_textures_repeat_without_a_seam() -> None:
    rng = np.random.default_rng(1)
    for field in (textures.fractal(rng, 2.0), textures.chain_link(8, 0.2), textures.bars(8, 8, 0.3)):
        seam = np.abs(field[0] - field[-1]).max()
        assert seam <= np.abs(np.diff(field, axis=0)).max() + 1e-9


def test_pulses_are_never_negative_and_vary() -> None:
    for kind in lighting.PULSES:
        values = [lighting.pulse(np.random.default_rng(2), kind)(t / 30.0) for t in range(300)]
        assert min(values) >= 0.0
        assert np.ptp(values) > 0.3


def test_wind_holds_the_ground_still_and_bends_the_rest() -> None:
    anchors = np.random.default_rng(3).uniform(-3.0, 3.0, (20, 3))
    palette = paths.wind(np.random.default_rng(4), anchors, 0.2)
    np.testing.assert_array_equal(palette(1.3)[0], np.eye(4))
    assert 0.0 < np.abs(palette(1.3)[1:, :3, 3]).max() < 0.4
    assert not np.array_equal(palette(1.3), palette(1.4))
