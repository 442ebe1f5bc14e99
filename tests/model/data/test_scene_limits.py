"""Scenes that would render a wrong image silently are refused."""

from dataclasses import replace

import numpy as np
import pytest

from gl_scenes import bending_tube, box
from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes import scene

CAMERA = scene.Camera(position=(0.0, 1.0, 4.0), target=(0.0, 0.0, 0.0))
LIGHT = scene.PointLight(position=(0.0, 1.0, 0.0), color=(1.0, 1.0, 1.0), reach=2.0)
SKY = scene.Environment(pixels=np.ones((32, 64, 3), np.float32))
SCENE = scene.Scene(camera=CAMERA, camera_before=CAMERA, environment=SKY, instances=())


def test_lights_beyond_the_limit_are_refused() -> None:
    assert len(replace(SCENE, points=(LIGHT,) * scene.MAX_POINTS).points) == scene.MAX_POINTS
    with pytest.raises(
        SceneError, match=rf"points is {scene.MAX_POINTS + 1} lights; want at most {scene.MAX_POINTS}"
    ):
        replace(SCENE, points=(LIGHT,) * (scene.MAX_POINTS + 1))


@pytest.mark.parametrize("joints", [0, 1, scene.MAX_JOINTS + 1])
def test_a_pose_without_a_matrix_for_each_joint_is_refused(joints: int) -> None:
    palette = np.tile(np.eye(4), (joints, 1, 1)) if joints else None
    with pytest.raises(SceneError, match=rf"palette is {joints} joints; want 2 to {scene.MAX_JOINTS}"):
        scene.Instance(mesh=bending_tube(), material=scene.Material(), model=np.eye(4), palette=palette)


def test_a_pose_of_a_rigid_mesh_is_refused() -> None:
    with pytest.raises(SceneError, match="palette is 2 joints; want 0 to 0"):
        scene.Instance(
            mesh=box(), material=scene.Material(), model=np.eye(4), palette=np.tile(np.eye(4), (2, 1, 1))
        )
