"""Scenes: what has a default, what is refused, and tangents."""

from dataclasses import replace

import numpy as np
import pytest

from gl_scenes import Yard, bending_tube, moved
from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes.scene import (
    Instance,
    Material,
    PointLight,
    tangents_of,
)

HERE = moved(0, 0, 0)
LAMP = PointLight(position=(0.0, 1.0, 0.0), color=(1.0, 1.0, 1.0))


def test_more_point_lights_than_shaders_have_are_refused() -> None:
    with pytest.raises(SceneError, match=r"scene\.points is 17 lights; .* 16"):
        replace(Yard().scene(0), points=(LAMP,) * 17)


def test_what_stood_still_need_not_say_so() -> None:
    pose = np.stack([HERE, HERE])
    instance = Instance(mesh=bending_tube(), material=Material(), model=HERE, palette=pose)
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
