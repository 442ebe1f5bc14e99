"""Procedural families: pure functions of their spec; exposure is usable, things move, lights change."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from gl_scenes import Yard, bending_tube, box, moved, sky
from label_samples import label_inputs, samples
from more_scenes import Cut, Floor, ShadingStep, dots, near, ripples, thin_lines
from supersampler import Frame, halton_jitter
from supersampler.conventions import camera_motion
from supersampler.io.display import display_transform
from supersampler.validation import FrameChecker
from supersampler_bench.quality.metrics import psnr
from supersampler_model.data.errors import SceneError
from supersampler_model.data.product_shot import Plaza
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.analytic import (
    FAR,
    NEAR,
    AnalyticScene,
    DiscOverPlane,
    Mask,
    Pattern,
    Plane,
    WiresOverPlane,
    checker,
    places,
    plain,
    still_scene,
    still_scene_with_mover,
    zone_plate,
)
from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.stage import CASTERS, Stage, caster
from supersampler_model.data.scenes.scene import (
    Camera,
    Environment,
    Instance,
    Material,
    Mesh,
    Particles,
    PointLight,
    Scene,
    Skin,
    Spot,
    Sun,
    Texture,
    tangents_of,
)
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


def test_test_and_training_families_are_disjoint() -> None:
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
def test_a_frame_index_out_of_range_is_refused(index: int) -> None:
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
    """Training needs frames with shading ghosting."""
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


# --- errors of invalid scenes name the field that is wrong ---


WHITE = np.full((2, 2, 3), 255, np.uint8)
PAINT = Texture(pixels=WHITE)
ROWS = np.ones((2, 4), np.float32)
HERE = moved(0, 0, 0)
LAMP = PointLight(position=(0.0, 1.0, 0.0), color=(1.0, 1.0, 1.0))
WIDER = Camera(position=(0.0, 0.0, 1.0), target=(0.0, 0.0, 0.0), near=0.2)


def scene(**changes: object) -> Scene:
    return replace(Yard().scene(0), **changes)  # type: ignore[arg-type]


def tube(**changes: object) -> Instance:
    pose = np.stack([HERE, HERE])
    fields = {"mesh": bending_tube(), "material": Material(), "model": HERE, "palette": pose, **changes}
    return Instance(**fields)  # type: ignore[arg-type]


def mesh(**changes: object) -> Mesh:
    return replace(box(), **changes)  # type: ignore[arg-type]


BAD: list[tuple[Callable[[], object], str]] = [
    (lambda: mesh(indices=np.zeros((0, 3), np.uint32)), r"mesh\.indices is \(0, 3\) uint32; want \(n, 3\)"),
    (lambda: mesh(positions=np.zeros((0, 3), np.float32)), r"mesh\.positions is \(0, 3\)"),
    (lambda: mesh(indices=np.full((1, 3), 99, np.uint32)), r"mesh\.indices is 99; want vertices below 24"),
    (lambda: mesh(normals=np.full((24, 3), np.nan, np.float32)), r"mesh\.normals is NaN"),
    (lambda: mesh(skin=bending_tube().skin), r"mesh\.skin is \d+ vertices; want 24"),
    (lambda: Skin(joints=np.zeros((3, 4), np.uint16), weights=np.ones((3, 4), np.float32)), r"skin\.weights"),
    (lambda: Texture(pixels=WHITE.astype(np.float32)), r"texture\.pixels is .* float32; want .* uint8"),
    (lambda: Texture(pixels=np.zeros((0, 4, 3), np.uint8)), r"texture\.pixels is \(0, 4, 3\)"),
    (lambda: Material(alpha_cutoff=0.5), r"material\.base_color_texture is missing; want an RGBA"),
    (lambda: Material(alpha_cutoff=0.5, base_color_texture=PAINT), r"base_color_texture is without opacity"),
    (lambda: Material(normal_texture=PAINT), r"material\.normal_texture\.srgb is True; want False"),
    (lambda: Material(base_color_texture="paint.png"), r"base_color_texture is str; want a Texture"),  # type: ignore[arg-type]
    (lambda: Material(base_color=(2.0, 0.0, 0.0)), r"material\.base_color is 2\.0; want .* <= 1"),
    (lambda: Material(roughness=float("nan")), r"material\.roughness is nan"),
    (lambda: tube(palette=None), r"instance\.palette is None; want a pose"),
    (lambda: tube(mesh=box()), r"instance\.palette is given; want None"),
    (lambda: tube(palette=np.eye(4)[None]), r"instance\.palette is 1 joints; want 2 to 128"),
    (lambda: tube(palette=np.tile(np.eye(4), (200, 1, 1))), r"instance\.palette is 200 joints"),
    (lambda: tube(model=moved(1, 2, 3).T), r"instance\.model.* Matrices act on column vectors"),
    (lambda: tube(emission=-1.0), r"instance\.emission is -1\.0"),
    (lambda: Environment(pixels=np.ones((32, 32, 3), np.float32)), r"environment\.pixels is \(32, 32, 3\)"),
    (lambda: Environment(pixels=-sky().pixels), r"environment\.pixels is negative"),
    (lambda: Camera(position=(0, 0, 0), target=(0, 0, 0)), r"camera\.target .* some distance"),
    (lambda: Camera(position=(0, 0, 0), target=(0, 0, 1), near=0.0), r"camera\.near is 0\.0; want .* > 0"),
    (lambda: Sun(direction=(0, 0, 0), color=(1, 1, 1)), r"sun\.direction is \(0, 0, 0\); want a direction"),
    (lambda: Spot(position=(0, 0, 0), target=(1, 0, 0), color=(1, 1, 1), outer=95.0), r"spot\.outer is 95"),
    (lambda: PointLight(position=(0, 0, 0), color=(1, -1, 1)), r"point\.color is -1"),
    (lambda: scene(points=(LAMP,) * 17), r"scene\.points is 17 lights; .* 16"),
    (lambda: scene(camera_before=WIDER), r"camera_before\.near"),
    (
        lambda: Particles(centers=ROWS[:, :3], radii=ROWS[0, :3], colors=ROWS),
        r"radii is \(3,\) float32; want \(2\)",
    ),
]


@pytest.mark.parametrize(("make", "message"), BAD, ids=[message[:40] for _, message in BAD])
def test_a_bad_scene_is_named(make: Callable[[], object], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make()


def test_an_instance_without_a_previous_state_is_at_rest() -> None:
    instance = tube()
    assert instance.model_before is instance.model
    assert instance.palette_before is instance.palette


def test_tangents_follow_u_and_stand_on_the_normal() -> None:
    shape = bending_tube()
    derived = tangents_of(shape.positions, shape.normals, shape.uv, shape.indices)
    around = np.cross((0.0, 1.0, 0.0), shape.normals)  # u runs around the tube
    np.testing.assert_allclose((derived[:, :3] * around).sum(axis=1), 1.0, atol=0.02)
    np.testing.assert_allclose((derived[:, :3] * shape.normals).sum(axis=1), 0.0, atol=1e-5)
    flat = np.zeros_like(shape.uv)  # no u at all: any direction along the surface
    derived = tangents_of(shape.positions, shape.normals, flat, shape.indices)
    np.testing.assert_allclose(np.linalg.norm(derived[:, :3], axis=1), 1.0, atol=1e-5)


# --- analytic scenes: sampling, jitter, motion, depth and reference are consistent ---


RENDER, DISPLAY = (64, 36), (128, 72)
PATTERNS = pytest.mark.parametrize("pattern", [zone_plate, thin_lines, dots, checker])


def accumulated(scene: AnalyticScene, count: int, sign: float) -> NDArray[np.float32]:
    """Put the samples of `count` jittered frames where they fell at twice the size, and average.

    `sign` -1 reads the jitter the wrong way round.
    """
    total, hits = np.zeros((72, 128, 3)), np.zeros((72, 128, 1))
    for jitter in (halton_jitter(index, 16.0) for index in range(count)):
        frame = scene.frame(0, RENDER, jitter)
        right, down = (int(sign * offset >= 0) for offset in jitter)  # which half of the pixel was hit
        total[down::2, right::2] += np.asarray(frame.color)
        hits[down::2, right::2] += 1
    return (total / hits).astype(np.float32)


@PATTERNS
def test_many_jittered_frames_average_to_the_truth_and_only_with_the_right_sign(pattern: Pattern) -> None:
    scene = Plane(pattern)
    truth = scene.truth(0, DISPLAY)
    right = psnr(accumulated(scene, 1024, sign=1), truth)
    assert right > 40
    assert psnr(accumulated(scene, 1024, sign=-1), truth) < right - 10


@PATTERNS
def test_one_frame_alone_is_aliased(pattern: Pattern) -> None:
    scene = Plane(pattern)
    assert psnr(np.asarray(scene.frame(0, RENDER).color), scene.truth(0, RENDER)) < 25


def test_the_truth_is_the_same_scene_at_every_size() -> None:
    scene = DiscOverPlane()
    large, small = scene.truth(3, (256, 144), samples=8), scene.truth(3, (128, 72), samples=16)
    np.testing.assert_allclose(large.reshape(72, 2, 128, 2, 3).mean(axis=(1, 3)), small, atol=1e-6)


def followed(scene: AnalyticScene, index: int, sign: float = 1.0) -> tuple[float, Mask]:
    """PSNR of the last truth, moved along whole-pixel motion, and where that is fair to ask."""
    motion = sign * scene.frame(index, DISPLAY).motion
    rows, columns = np.indices((72, 128))
    x, y = (np.rint(v).astype(int) for v in (columns + motion[..., 0], rows + motion[..., 1]))
    past = scene.truth(index - 1, DISPLAY)[np.clip(y, 0, 71), np.clip(x, 0, 127)]
    depth = scene.frame(index, DISPLAY).depth
    edge = near(depth == np.float32(NEAR)) & near(depth == np.float32(FAR))
    fair = ~(edge | near(scene.disoccluded(index, DISPLAY)))
    return psnr(past, scene.truth(index, DISPLAY), fair), fair


@pytest.mark.parametrize("scene", [Plane(checker, (1.5, -1.0)), Plane(dots, (-0.5, 2.0)), DiscOverPlane()])
def test_the_truth_moves_by_the_motion_away_from_disocclusion(scene: AnalyticScene) -> None:
    score, fair = followed(scene, 4)
    assert fair.mean() > 0.7
    assert score > 60
    assert followed(scene, 4, sign=-1)[0] < score - 30


def test_motion_is_in_pixels_of_the_image_rendered() -> None:
    scene = Plane(checker, (1.5, -1.0))
    np.testing.assert_allclose(scene.frame(2, (64, 36)).motion[0, 0], (-1.5, 1.0))
    np.testing.assert_allclose(scene.frame(2, (128, 18)).motion[0, 0], (-3.0, 0.5))


def test_the_disc_is_near_and_reveals_the_background_behind_it_only() -> None:
    scene = DiscOverPlane(velocity=(3.0, 0.0), background_velocity=(0.0, 0.0))
    frame, revealed = scene.frame(5, DISPLAY), scene.disoccluded(5, DISPLAY)
    assert set(np.unique(frame.depth)) == {np.float32(FAR), np.float32(NEAR)}
    assert revealed.any()
    assert (frame.depth[revealed] == np.float32(FAR)).all()
    assert np.nonzero(revealed)[1].max() < 2 * (20 + 5 * 3)  # left of its middle, as it moves right
    crescent = 2 * 3 * 2 * 8 * 2  # about velocity times diameter, in display pixels
    assert 0.85 * crescent < revealed.sum() < 1.05 * crescent


def test_pixels_panning_in_from_off_screen_are_disoccluded() -> None:
    revealed = Plane(checker, (2.0, 0.0)).disoccluded(1, DISPLAY)
    assert revealed[:, :4].all()
    assert not revealed[:, 4:].any()


@pytest.mark.parametrize(
    "scene",
    [
        Plane(zone_plate, (0.7, -0.3), bumps=ripples),
        Floor(checker, 3.0),
        Floor(checker, -2.0),
        WiresOverPlane(),
        DiscOverPlane(),
        ShadingStep(Floor(checker, 3.0), at=9),
        Cut(Plane(dots), Floor(checker, 3.0), at=4),
    ],
)
def test_motion_and_depth_agree_with_the_previous_frame(scene: AnalyticScene) -> None:
    x, y = places(DISPLAY)
    now, seen = scene.surface(5, x, y), scene.visible_before(5, x, y)
    assert seen.mean() > 0.5
    before = scene.surface(4, x + now.motion[..., 0], y + now.motion[..., 1])
    np.testing.assert_allclose(before.depth[seen], now.depth_before[seen], rtol=1e-9)
    for a, b in ((before.color, now.color), (before.normal, now.normal)):
        assert (np.abs(a - b).max(axis=-1) < 1e-6)[seen].mean() > 0.999  # rounding decides on edges
    np.testing.assert_allclose(before.normal_mapped[seen], now.normal_mapped[seen], atol=1e-6)


def test_evidence_holds_the_ranges_and_the_mean_of_the_samples() -> None:
    scene = DiscOverPlane()
    drawn = label_inputs(scene, 3, RENDER, count=4)
    np.testing.assert_array_equal(drawn.pixels.color, scene.truth(3, RENDER, samples=4))
    np.testing.assert_array_equal(drawn.motion, scene.frame(3, RENDER).motion)
    np.testing.assert_array_equal(drawn.depth_before, scene.frame(3, RENDER).depth)  # nothing comes closer
    depths = np.array([sample.depth for sample in samples(scene, 3, RENDER, 4)], np.float32)
    np.testing.assert_array_equal(drawn.pixels.depth_min, depths.min(axis=0))
    np.testing.assert_array_equal(drawn.pixels.depth_max, depths.max(axis=0))
    assert [label_inputs(scene, i, RENDER, count=1).cut for i in (0, 1)] == [True, False]


def test_a_normal_map_changes_nothing_but_the_mapped_normals() -> None:
    flat, bumpy = (
        label_inputs(Plane(plain, bumps=bumps), 0, RENDER) for bumps in (Plane(plain).bumps, ripples)
    )
    assert bumpy.pixels.normal_mapped_spread.min() > 0.3
    assert not flat.pixels.normal_mapped_spread.any()
    assert not bumpy.pixels.normal_spread.any()
    normals = Plane(plain, bumps=ripples).surface(0, *places(RENDER)).normal_mapped
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0)


def test_camera_motion_is_that_of_a_plane_that_an_analytic_camera_passes() -> None:
    """A camera that moves along a plane sees it pan; depth is 1 / distance."""
    velocity, jitter, (width, height) = (0.75, -0.5), (0.25, -0.375), RENDER
    frame = Plane(zone_plate, velocity).frame(4, RENDER, jitter)
    projection = np.diag([2.0, 2.0 * width / height, 0.0, 0.0])
    projection[2, 3], projection[3, 2] = 1.0, -1.0  # reversed, infinite far
    pan = np.array([-2.0 / width, 2.0 / height]) * frame.motion[0, 0]  # of one frame, in clip space
    cameras = [np.eye(4), np.eye(4)]
    for index, camera in enumerate(cameras):
        camera[:2, 3] = (3 + index) * pan / FAR / np.diag(projection)[:2]
    motion = camera_motion(frame.depth, projection @ cameras[1], projection @ cameras[0], jitter=jitter)
    np.testing.assert_allclose(motion, frame.motion, atol=1e-3)
    assert np.abs(frame.motion).min() > 0.1


# --- the static scene of `bench still` ---


def test_nothing_moves_but_the_disc() -> None:
    size = (64, 36)
    frame = still_scene().frame(5, size)
    assert not np.asarray(frame.motion).any()
    with_mover = still_scene_with_mover()
    near = np.asarray(with_mover.frame(40, size).depth) > 0.05
    moves = np.asarray(with_mover.frame(40, size).motion)[..., 0] != 0
    assert near.any()
    np.testing.assert_array_equal(near, moves)


def test_a_frame_depends_on_its_jitter_alone() -> None:
    scene, jitter = still_scene(), halton_jitter(3, 2.0)
    one, later = (scene.frame(index, (80, 45), jitter) for index in (3, 35))
    np.testing.assert_array_equal(one.color, later.color)


def test_colors_are_in_range_and_the_disc_leaves_the_lower_half_alone() -> None:
    still, moving = (scene.truth(40, (64, 36), 4) for scene in (still_scene(), still_scene_with_mover()))
    assert still.min() >= 0.0
    assert still.max() <= 1.0
    np.testing.assert_array_equal(still[18:], moving[18:])
    assert np.abs(still[:18] - moving[:18]).max() > 0.1
