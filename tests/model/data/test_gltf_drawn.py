"""Rendered glTF files: orientation of textures, and exact motion."""

from pathlib import Path

import numpy as np
import pytest

from gl_scenes import moved, sky
from gltf_files import GltfFile, strip
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.gltf import GltfScene
from supersampler_model.data.scenes.scene import Camera, Instance, Scene

STILL = np.eye(4)
CAMERA = Camera(position=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0), fov_y=60.0)


def scene_of(instances: tuple[Instance, ...]) -> Scene:
    return Scene(camera=CAMERA, camera_before=CAMERA, environment=sky(), instances=instances)


def pixel_of(x: float, y: float, z: float = 0.0) -> tuple[float, float]:
    """Where `CAMERA` sees a point, in a picture of 160 x 90."""
    zoom = 45.0 / np.tan(np.radians(30.0)) / (5.0 - z)
    return 80.0 + zoom * x, 45.0 - zoom * y


def test_row_0_of_an_image_is_at_v_0(tmp_path: Path, renderer: Renderer) -> None:
    corners = {(0, 0): (255, 0, 0), (0, 1): (0, 255, 0), (1, 0): (0, 0, 255), (1, 1): (255, 255, 255)}
    pixels = np.zeros((64, 64, 3), np.uint8)
    for (row, column), color in corners.items():
        pixels[32 * row : 32 * row + 32, 32 * column : 32 * column + 32] = color
    file = GltfFile()
    attributes = {
        "NORMAL": file.array(np.tile([0.0, 0.0, 1.0], (4, 1))),
        "TEXCOORD_0": file.array([[0, 0], [1, 0], [0, 1], [1, 1]]),
    }
    places = [[-1, 1, 0], [1, 1, 0], [-1, -1, 0], [1, -1, 0]]
    primitive = file.primitive(places, [(0, 2, 1), (1, 2, 3)], **attributes)
    paint = {"baseColorTexture": {"index": file.texture(pixels)}}
    material = file.add("materials", pbrMetallicRoughness=paint)
    file.add("nodes", mesh=file.add("meshes", primitives=[{**primitive, "material": material}]))
    instances = GltfScene(file.save(tmp_path / "quad.glb")).instances(0.0, 0.0, STILL)
    seen = renderer.display(scene_of(instances)).base_color
    for (row, column), color in corners.items():
        x, y = pixel_of(column - 0.5, 0.5 - row)
        np.testing.assert_allclose(seen[int(y), int(x)], np.array(color) / 255.0, atol=0.01)


@pytest.mark.parametrize("clip_moves", [True, False])
def test_motion_is_exact(tmp_path: Path, renderer: Renderer, clip_moves: bool) -> None:
    file = strip()
    if clip_moves:  # the upper joint carries all of it to the right; else what it is placed by does
        del file.json["animations"][0]["channels"][0]
        weights = file.array(np.tile([0.0, 1.0, 0.0, 0.0], (10, 1)))
        file.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = weights
        instances = GltfScene(file.save(tmp_path / "strip.glb")).instances(0.3, 0.1, STILL)
    else:
        scene = GltfScene(file.save(tmp_path / "strip.glb"))
        instances = scene.instances(0.0, 0.0, moved(0.3, 0, 0), moved(0.1, 0, 0))
    surfaces = renderer.display(scene_of(instances))
    drawn = surfaces.depth > 0.0
    assert drawn.sum() > 200
    expected = np.subtract(pixel_of(0.1, 0.0), pixel_of(0.3, 0.0))
    np.testing.assert_allclose(surfaces.motion[drawn], np.broadcast_to(expected, (drawn.sum(), 2)), atol=1e-3)
