"""Errors of invalid scenes name the field that is wrong."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gl_scenes import Yard, bending_tube, box, moved, sky
from supersampler_model.data.errors import SceneError
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


def test_what_stood_still_need_not_say_so() -> None:
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
