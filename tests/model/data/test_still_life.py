"""The scene of `bench still`: what samples of one jitter period hold of it, and that it stands still."""

import numpy as np

from supersampler import halton_jitter
from supersampler_model.data.scenes.analytic import still_scene, still_scene_with_mover


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
