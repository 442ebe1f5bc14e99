"""Analytic scenes: sampling, jitter, motion, depth and reference are consistent."""

import numpy as np
import pytest
from numpy.typing import NDArray

from label_samples import label_inputs, samples
from more_scenes import Cut, Floor, ShadingStep, dots, near, ripples, thin_lines
from supersampler import halton_jitter
from supersampler.conventions import camera_motion
from supersampler_bench.quality.metrics import psnr
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


def test_what_pans_in_from_off_screen_is_disoccluded() -> None:
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
def test_what_is_seen_was_where_its_motion_says_at_the_depth_it_says(scene: AnalyticScene) -> None:
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
