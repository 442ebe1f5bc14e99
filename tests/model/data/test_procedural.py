"""Procedural families: pure functions of their spec; exposure is usable, things move, lights change."""

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest

from supersampler import Frame, halton_jitter
from supersampler.io.display import display_transform
from supersampler.validation import FrameChecker
from supersampler_model.data.errors import SceneError
from supersampler_model.data.product_shot import Plaza
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.stage import CASTERS, Stage, caster
from supersampler_model.data.scenes.scene import Camera, Mesh, Scene
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES, TRAIN_FAMILIES, make_sequence
from supersampler_model.data.specs import Sequence, SequenceSpec

FAMILIES = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)
FRAMES = 24
SIZE = (96, 54)
MAX_TRIANGLES = 60_000


@cache
def sequence_of(family: str, seed: int = 3) -> Sequence:
    return make_sequence(SequenceSpec(family=family, seed=seed, frames=FRAMES))


@pytest.fixture(scope="session")
def small_renderer() -> Renderer:
    return Renderer(SIZE, samples=4)


# --- sequences ---


def content(scene: Scene) -> Iterator[object]:
    """Everything of a scene that can differ, in order."""
    yield scene.camera, scene.camera_before, scene.sun, scene.spot, scene.points
    yield scene.environment.pixels
    for cloud in scene.particles:
        yield from (cloud.centers, cloud.radii, cloud.colors)
    for thing in scene.instances:
        yield from (thing.model, thing.model_before, thing.palette, thing.palette_before, thing.emission)
        yield from (thing.mesh.positions, thing.mesh.normals, thing.mesh.uv, thing.mesh.indices)
        material = thing.material
        yield material.base_color, material.roughness, material.metallic, material.emissive
        for name in ("base_color", "normal", "orm", "emissive"):
            texture = getattr(material, f"{name}_texture")
            yield None if texture is None else texture.pixels


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_spec_gives_the_same_scene_in_any_order(family: str) -> None:
    one = sequence_of(family)
    other = make_sequence(SequenceSpec(**json.loads(json.dumps(asdict(one.spec)))))
    one.scene(17)
    for a, b in zip(content(one.scene(5)), content(other.scene(5)), strict=True):
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b  # type: ignore[arg-type]
    assert [one.cut(i) for i in range(FRAMES)] == [other.cut(i) for i in range(FRAMES)]


@pytest.mark.parametrize("family", FAMILIES)
def test_the_previous_state_is_that_of_the_previous_frame(family: str) -> None:
    sequence = sequence_of(family)
    before = sequence.scene(0)
    assert before.camera_before == before.camera
    for index in range(1, FRAMES):
        scene = sequence.scene(index)
        assert scene.camera_before == (scene.camera if sequence.cut(index) else before.camera)
        for now, then in zip(scene.instances, before.instances, strict=True):
            assert now.mesh is then.mesh
            assert now.material is then.material
            np.testing.assert_array_equal(now.model_before, then.model)
            np.testing.assert_array_equal(now.palette_before, then.palette)
        before = scene


def test_some_sequences_have_cuts_and_cuts_move_the_camera() -> None:
    seen = 0
    for seed in range(12):
        sequence = sequence_of("floors", seed)
        cuts = [index for index in range(FRAMES) if sequence.cut(index)]
        assert cuts[0] == 0
        for index in cuts[1:]:
            here, there = (np.array(sequence.scene(i).camera.position) for i in (index, index - 1))
            assert np.linalg.norm(here - there) > 0.5
            seen += 1
    assert 0 < seen < 24


def test_some_exposures_change_and_some_are_left_to_be_measured() -> None:
    ranges, measured = [], 0
    for seed in range(12):
        sequence = sequence_of("floors", seed)
        given = [sequence.exposure(index) for index in (0, FRAMES - 1)]
        cameras = [sequence.scene(index).camera.exposure for index in (0, FRAMES - 1)]
        assert given in ([None, None], cameras)
        measured += given[0] is None
        ranges.append(max(cameras) / min(cameras))
    assert 0 < measured < 12
    assert min(ranges) == pytest.approx(1.0)
    assert 1.3 < max(ranges) < 3.0


def test_families_for_tests_are_no_families_to_learn_from() -> None:
    assert len(set(FAMILIES)) == len(FAMILIES)
    assert len(TRAIN_FAMILIES) >= 6
    assert len(TEST_FAMILIES) >= 5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"family": "moon"}, r"spec\.family is 'moon'; want one of fences, "),
        ({"seed": -1}, r"spec\.seed is -1; want"),
        ({"frames": 0}, r"spec\.frames is 0; want"),
        ({"frame_rate": 0.0}, r"spec\.frame_rate is 0\.0; want"),
    ],
)
def test_a_bad_spec_is_named(change: dict[str, object], message: str) -> None:
    fields = {"family": "floors", "seed": 1, "frames": 4, "frame_rate": 30.0} | change
    with pytest.raises(SceneError, match=message):
        make_sequence(SequenceSpec(**fields))  # type: ignore[arg-type]


@pytest.mark.parametrize("index", [-1, FRAMES])
def test_there_is_no_frame_outside(index: int) -> None:
    with pytest.raises(SceneError, match=r"index is .*; want 0 to 23"):
        sequence_of("floors").scene(index)


# --- what families show ---


@pytest.mark.parametrize("family", FAMILIES)
def test_a_frame_is_neither_black_nor_blown_out(family: str, small_renderer: Renderer) -> None:
    scene = sequence_of(family).scene(4)
    shown = display_transform(small_renderer.reference(scene).color, scene.camera.exposure)
    assert 0.12 < shown.mean() < 0.7
    assert (shown.max(axis=-1) < 0.04).mean() < 0.25
    assert (shown.min(axis=-1) > 0.95).mean() < 0.02
    assert shown.std() > 0.05


@pytest.mark.parametrize("family", FAMILIES)
def test_scenes_are_cheap_things_move_and_lights_change(family: str) -> None:
    scene, later = (sequence_of(family).scene(index) for index in (4, 20))
    assert sum(len(thing.mesh.indices) for thing in scene.instances) < MAX_TRIANGLES
    assert sum(thing.moves() for thing in scene.instances) >= 3
    assert (scene.sun, scene.spot, scene.points) != (later.sun, later.spot, later.points)


def test_seeds_give_other_scenes() -> None:
    one, other = (sequence_of("floors", seed).scene(4) for seed in (3, 4))
    assert one.camera != other.camera
    assert not np.array_equal(one.environment.pixels, other.environment.pixels)
    assert one.points != other.points


@pytest.fixture(scope="session")
def display_renderer() -> Renderer:
    return Renderer((320, 180))


@pytest.mark.parametrize("family", ["plaza", *FAMILIES])
def test_no_check_doubts_a_rendered_scene(family: str, display_renderer: Renderer) -> None:
    """A warning is an error here. The mip bias is the renderer's own."""
    sequence, checker = Plaza() if family == "plaza" else sequence_of(family), FrameChecker()
    for index in range(3):
        jitter, size = halton_jitter(index, 2.0), (160, 90)
        color, surfaces = display_renderer.frame(sequence.scene(index), size, jitter=jitter)
        motion = surfaces.motion.astype(np.float16)
        frame = Frame(color=color, depth=surfaces.depth, motion=motion, jitter=jitter, reset=index == 0)
        checker.check(frame, (320, 180))


def test_shading_changes_between_frames_where_nothing_moves(small_renderer: Renderer) -> None:
    """Else there would be next to no shading ghosting to learn from."""
    changed = []
    for family in TRAIN_FAMILIES:
        scene, after = (sequence_of(family).scene(index) for index in (4, 7))
        relit = replace(scene, sun=after.sun, spot=after.spot, points=after.points)
        one, other = (display_transform(small_renderer.reference(s).color) for s in (scene, relit))
        changed.append(float((np.abs(one - other).max(axis=-1) > 0.03).mean()))
    assert np.mean(changed) > 0.05


# --- the parts of scenes ---


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
    for kind in CASTERS:
        pictures = []
        for cast in (False, True):
            rng = np.random.default_rng(5)
            weather = lighting.weather(rng, 12.0)
            sun = lighting.sunlight(rng, 6.0, 12.0, azimuth=(4.6, 4.8), elevation=(40.0, 41.0))
            stage = Stage(environment=weather.environment, sun=sun)
            stage.put(shapes.plane(40.0, 40.0), materials.plaster(rng, (0.6, 0.6, 0.6)))
            if cast:
                caster(rng, stage, sun, kind)
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


def test_pulses_are_never_negative_and_vary() -> None:
    kinds = [lambda rng, kind=kind: lighting.pulse(rng, kind) for kind in lighting.PULSES]
    for make in (*kinds, lighting.nervous, lighting.clouds, lighting.lightning):
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


@pytest.mark.parametrize("rows", [1, 3, 16])
def test_every_row_has_words_that_end_at_different_columns(rows: int) -> None:
    page = materials.lettering(np.random.default_rng(1), rows, 256)
    assert page.shape == (256, 256)
    assert page.min() == 0.0
    assert page.max() == 1.0
    lines = np.split(page[: 256 // rows * rows], rows)
    ends = [int(np.flatnonzero(line.max(axis=0))[-1]) for line in lines]
    assert len(set(ends)) >= rows // 3
    assert all(0.02 < line[:, :end].mean() < 0.5 for line, end in zip(lines, ends, strict=True))


def test_words_have_gaps_between_them() -> None:
    line = materials.lettering(np.random.default_rng(2), 8, 512)[:64]
    inked = line.max(axis=0) > 0.0
    gaps = np.diff(np.flatnonzero(inked))
    assert gaps.max() > 0.5 * 64 * 0.62  # a space is a glyph wide


def test_signs_reflect_and_screens_shine() -> None:
    rng = np.random.default_rng(3)
    board, lit, page = materials.sign(rng, 4), materials.sign(rng, 4, shine=2.0), materials.screen(rng, 1.5)
    assert board.base_color_texture is not None
    assert max(board.emissive) == 0.0
    assert lit.emissive == (2.0,) * 3
    assert page.emissive_texture is not None
    assert page.emissive_texture.pixels.std() > 20.0  # not one colour
