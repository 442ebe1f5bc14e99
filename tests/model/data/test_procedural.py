"""Procedural families: pure functions of their spec; exposure is usable, things move, lights change."""

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from gl_scenes import bending_tube
from more_scenes import Floor, ShadingStep, dots, ripples, thin_lines
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
    Pattern,
    Plane,
    WiresOverPlane,
    checker,
    places,
    zone_plate,
)
from supersampler_model.data.scenes.procedural import lighting, shapes
from supersampler_model.data.scenes.scene import Mesh, Scene, tangents_of
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


@pytest.mark.long  # builds every family twice
@pytest.mark.parametrize("family", FAMILIES[::3])
def test_the_same_spec_gives_the_same_scene_in_any_order(family: str) -> None:
    one = sequence_of(family)
    other = make_sequence(SequenceSpec(**json.loads(json.dumps(asdict(one.spec)))))
    one.scene(17)
    for a, b in zip(content(one.scene(5)), content(other.scene(5)), strict=True):
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b  # type: ignore[arg-type]
    assert [one.cut(i) for i in range(FRAMES)] == [other.cut(i) for i in range(FRAMES)]


@pytest.mark.long  # builds every family
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


SUMMARIES: dict[str, tuple[float, ...]] = {
    "plaza": (18446, 3.7476, 107.02, 65.062, 1.3102, 0.37037),
    "fences": (9362, 4.6305, 91.893, 56.551, -0.51764, 0.077339),
    "floors": (8004, 4.9894, 119.22, 17.578, -8.1886, 0.28389),
    "metals": (9910, 1.6484, 97.901, 11.026, 1.762, 0.24792),
    "movers": (11568, 4.5814, 94.454, 66.775, -12.733, 0.30624),
    "foliage": (30828, 2.9119, 106.5, 8.3553, -0.94957, 0.20251),
    "flicker": (1396, 2.5847, 111.06, 3.3978, -4.7224, 0.032128),
    "station": (2094, 4.0767, 109.86, 5.1642, -3.4997, 0.40165),
    "machine_hall": (12650, 3.401, 102.87, 23.166, 4.2698, 0.1621),
    "market": (31922, 3.2298, 102.13, 9.8496, -0.51654, 0.32749),
    "night_garden": (34680, 2.9839, 68.382, 6.4614, -2.005, 0.020836),
    "gallery": (11810, 3.0539, 129.47, 22.483, 1.4526, 0.47964),
    "court": (12576, 4.0461, 130.16, 19.103, 4.1229, 0.4314),
    "rigging": (58117, 8.0903, 107.27, 7.5114, 2.4708, 0.47312),
    "thin_movers": (19028, 3.6646, 61.627, 5.28, 1.9583, 0.63624),
    "moving_shadows": (15450, 4.5619, 132.96, 11.58, -0.61016, 0.35645),
}
"""Frame 5 of seed 3: triangles, then means of positions, textures and lights, the camera and the sky."""


def summary(scene: Scene) -> tuple[float, ...]:
    materials = [instance.material for instance in scene.instances]
    textures = [t for m in materials for t in (m.base_color_texture, m.emissive_texture) if t is not None]
    lights = [*scene.points, *(light for light in (scene.sun, scene.spot) if light is not None)]
    extents = [
        np.abs(instance.mesh.positions @ instance.model[:3, :3].T + instance.model[:3, 3]).mean()
        for instance in scene.instances
    ]
    return (
        sum(len(instance.mesh.indices) for instance in scene.instances),
        float(np.mean(extents)),
        float(np.mean([texture.pixels.mean() for texture in textures])),
        float(np.mean([light.color for light in lights])),
        float(np.sum([scene.camera.position, scene.camera.target]) * scene.camera.exposure),
        float(scene.environment.pixels.mean()),
    )


@pytest.mark.parametrize("name", SUMMARIES)
def test_a_seed_keeps_its_scene(name: str) -> None:
    sequence = Plaza() if name == "plaza" else sequence_of(name)
    assert summary(sequence.scene(5)) == pytest.approx(SUMMARIES[name], rel=1e-3)


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"family": "moon"}, r"spec\.family is 'moon'; want one of fences, "),
        ({"seed": -1}, r"spec\.seed is -1; want"),
        ({"frames": 0}, r"spec\.frames is 0; want"),
        ({"frames": 10**20}, r"spec\.frames is 1000.*; want a finite number >= 1 and <= 1\.04858e\+06"),
        ({"frame_rate": float("inf")}, r"spec\.frame_rate is inf; want a finite number > 0\."),
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


@pytest.mark.long  # renders every family
@pytest.mark.parametrize("family", FAMILIES)
def test_a_frame_is_neither_black_nor_blown_out(family: str, small_renderer: Renderer) -> None:
    scene = sequence_of(family).scene(4)
    shown = display_transform(small_renderer.reference(scene).color, scene.camera.exposure)
    assert 0.12 < shown.mean() < 0.7
    assert (shown.max(axis=-1) < 0.04).mean() < 0.25
    assert (shown.min(axis=-1) > 0.95).mean() < 0.02
    assert shown.std() > 0.05


@pytest.mark.parametrize("family", FAMILIES)
def test_scenes_are_small_objects_move_and_lights_change(family: str) -> None:
    scene, later = (sequence_of(family).scene(index) for index in (4, 20))
    assert sum(len(thing.mesh.indices) for thing in scene.instances) < MAX_TRIANGLES
    assert sum(thing.moves() for thing in scene.instances) >= 3
    assert (scene.sun, scene.spot, scene.points) != (later.sun, later.spot, later.points)


@pytest.fixture(scope="session")
def display_renderer() -> Renderer:
    return Renderer((320, 180))


@pytest.mark.long  # renders every family
@pytest.mark.parametrize("family", ["plaza", *FAMILIES[::2]])
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


def test_pulses_are_never_negative_and_vary() -> None:
    kinds = [lambda rng, kind=kind: lighting.pulse(rng, kind) for kind in lighting.PULSES]
    for make in (*kinds, lighting.nervous, lighting.clouds, lighting.lightning):
        pulse = make(np.random.default_rng(2))
        values = [pulse(t / 30.0) for t in range(300)]
        assert min(values) >= 0.0
        assert np.ptp(values) > 0.3


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
