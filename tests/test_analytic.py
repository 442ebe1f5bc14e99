"""The analytic scenes keep their word: sampling, jitter, motion, depth and truth agree with one another."""

import numpy as np
import pytest
from numpy.typing import NDArray

from analytic import (
    FAR,
    NEAR,
    Cut,
    DiscOverPlane,
    Pattern,
    Plane,
    Scene,
    ShadingStep,
    checker,
    dots,
    thin_lines,
    zone_plate,
)
from supersampler_bench.metrics import psnr

RENDER, DISPLAY = (64, 36), (128, 72)
PATTERNS = pytest.mark.parametrize("pattern", [zone_plate, thin_lines, dots, checker])


def halton(count: int) -> NDArray[np.float64]:
    """(count, 2) of the sequence in bases 2 and 3, moved to [-0.5, 0.5)."""

    def element(index: int, base: int) -> float:
        return 0.0 if index == 0 else (index % base + element(index // base, base)) / base

    return np.array([[element(i, 2) - 0.5, element(i, 3) - 0.5] for i in range(1, count + 1)])


def accumulated(scene: Scene, count: int, sign: float) -> NDArray[np.float32]:
    """Put the samples of `count` jittered frames where they fell at twice the size, and average.

    `sign` -1 reads the jitter the wrong way round.
    """
    total, hits = np.zeros((72, 128, 3)), np.zeros((72, 128, 1))
    for jitter in halton(count):
        frame = scene.frame(0, RENDER, (jitter[0], jitter[1]))
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


def followed(scene: Scene, index: int, sign: float = 1.0) -> tuple[float, NDArray[np.bool_]]:
    """PSNR of the last truth, moved along whole-pixel motion, and where that is fair to ask."""
    motion = sign * scene.frame(index, DISPLAY).motion
    rows, columns = np.indices((72, 128))
    x, y = (np.rint(v).astype(int) for v in (columns + motion[..., 0], rows + motion[..., 1]))
    past = scene.truth(index - 1, DISPLAY)[np.clip(y, 0, 71), np.clip(x, 0, 127)]
    depth = scene.frame(index, DISPLAY).depth
    edge = near(depth == np.float32(NEAR)) & near(depth == np.float32(FAR))
    fair = ~(edge | near(scene.disoccluded(index, DISPLAY)))
    return psnr(past, scene.truth(index, DISPLAY), fair), fair


def near(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask and the pixels that touch it."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    shifted = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.asarray(np.any(shifted, axis=0))


@pytest.mark.parametrize("scene", [Plane(checker, (1.5, -1.0)), Plane(dots, (-0.5, 2.0)), DiscOverPlane()])
def test_the_truth_moves_by_the_motion_away_from_disocclusion(scene: Scene) -> None:
    score, fair = followed(scene, 4)
    assert fair.mean() > 0.7
    assert score > 60
    assert followed(scene, 4, sign=-1)[0] < score - 30


def test_motion_is_in_pixels_of_the_picture_drawn() -> None:
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


def test_a_shading_step_changes_the_light_and_nothing_else() -> None:
    scene = ShadingStep(Plane(dots), at=3, gain=0.25)
    before, after = scene.frame(2, RENDER), scene.frame(3, RENDER)
    np.testing.assert_allclose(np.asarray(after.color), 0.25 * np.asarray(before.color))
    assert not after.motion.any()
    assert not after.reset


def test_a_cut_resets_shows_the_other_scene_and_has_no_past() -> None:
    scene = Cut(Plane(dots), Plane(checker), at=2)
    assert [scene.frame(i, RENDER).reset for i in range(4)] == [True, False, True, False]
    np.testing.assert_array_equal(
        np.asarray(scene.frame(2, RENDER).color), np.asarray(Plane(checker).frame(2, RENDER).color)
    )
    assert scene.disoccluded(2, RENDER).all()
    assert not scene.disoccluded(3, RENDER).any()
