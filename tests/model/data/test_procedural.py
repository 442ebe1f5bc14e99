"""Procedural families: exposure is usable, objects move, and lights change."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np
import pytest

from supersampler.io.display import display_transform
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.procedural import fixtures, lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.scene import Camera, Instance, Mesh, Scene
from supersampler_model.data.sequences import (
    APART_FAMILIES,
    TEST_FAMILIES,
    TRAIN_FAMILIES,
    Sequence,
    SequenceSpec,
    make_sequence,
)

FAMILIES = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)
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


def test_every_third_hour_is_dusk_or_night_and_then_the_sun_is_low_or_gone() -> None:
    dark, low = 0, 0
    for seed in range(30):
        weather = lighting.weather(np.random.default_rng(seed), 12.0)
        sun = weather.sun(0.0)
        assert sun.direction[2] < 0.0  # from behind those who look along -z
        assert weather.dark == (max(sun.color) < 8.0 and weather.environment.pixels.mean() < 0.02)
        dark += weather.dark
        low += not weather.dark and -sun.direction[1] < 0.5
    assert 2 <= dark <= 12
    assert low >= 2


def test_a_caster_is_never_seen_but_its_shadow_is(small_renderer: Renderer) -> None:
    for kind in fixtures.CASTERS:
        pictures = []
        for cast in (False, True):
            rng = np.random.default_rng(5)
            weather = lighting.weather(rng, 12.0)
            sun = lighting.sunlight(rng, 6.0, 12.0, azimuth=(4.6, 4.8), elevation=(40.0, 41.0))
            stage = Stage(environment=weather.environment, sun=sun)
            stage.put(shapes.plane(40.0, 40.0), materials.plaster(rng, (0.6, 0.6, 0.6)))
            if cast:
                fixtures.caster(rng, stage, sun, kind)
            camera = Camera(position=(0.0, 3.0, -14.0), target=(0.0, 3.0, 0.0))  # towards caster and sun
            pictures.append(small_renderer.reference(stage.scene(0.2, 0.2, camera, camera)))
        without, shadowed = pictures
        np.testing.assert_array_equal(without.depth_max, shadowed.depth_max)
        darker = (shadowed.color < 0.8 * without.color).all(axis=-1)
        assert 0.005 < darker.mean() < 0.6, kind


def test_brisk_cameras_seldom_stand_still_and_some_turn_fast() -> None:
    vantage = paths.Vantage(position=(0.0, 1.6, 4.0), target=(0.0, 1.0, -3.0), brisk=True)
    still, turns = 0, []
    for seed in range(100):
        camera = paths.camera_path(np.random.default_rng(seed), vantage, lambda _: 1.0)
        one, other = camera(0.5), camera(0.5 + 1.0 / 30.0)
        still += (one.position, one.target) == (other.position, other.target)
        if one.position == other.position:
            away = np.linalg.norm(np.subtract(one.target, one.position))
            turns.append(float(np.linalg.norm(np.subtract(other.target, one.target)) / away))
    assert still <= 10
    assert 0.013 < max(turns) < 0.08  # 5 to 30 pixels a frame, 640 wide


def test_a_pendulum_keeps_its_length() -> None:
    pivot = np.array([1.0, 4.0, -2.0])
    hanging = paths.pendulum(np.random.default_rng(6), pivot.tolist(), 1.5, 0.8)
    places = np.array([hanging(t) for t in np.linspace(0.0, 4.0, 60)])
    np.testing.assert_allclose(np.linalg.norm(places - pivot, axis=1), 1.5)
    assert np.ptp(places, axis=0).max() > 0.5


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
    for field in (materials.fractal(rng, 2.0), materials.chain_link(8, 0.2), materials.bars(8, 8, 0.3)):
        seam = np.abs(field[0] - field[-1]).max()
        assert seam <= np.abs(np.diff(field, axis=0)).max() + 1e-9


def _pulse(kind: str, rng: np.random.Generator) -> lighting.Pulse:
    return lighting.pulse(rng, kind)


def test_pulses_are_never_negative_and_vary() -> None:
    named = [partial(_pulse, kind) for kind in lighting.PULSES]
    makers: list[Callable[[np.random.Generator], lighting.Pulse]]
    makers = [*named, lighting.nervous, lighting.clouds, lighting.lightning]
    for make in makers:
        pulse = make(np.random.default_rng(2))
        values = [pulse(t / 30.0) for t in range(300)]
        assert min(values) >= 0.0
        assert np.ptp(values) > 0.3


def test_wind_holds_the_ground_still_and_bends_the_rest() -> None:
    anchors = np.random.default_rng(3).uniform(-3.0, 3.0, (20, 3))
    palette = paths.wind(np.random.default_rng(4), anchors, 0.2)
    np.testing.assert_array_equal(palette(1.3)[0], np.eye(4))
    assert 0.0 < np.abs(palette(1.3)[1:, :3, 3]).max() < 0.4
    assert not np.array_equal(palette(1.3), palette(1.4))
