"""glTF files are read as they were written, in all encodings that the format allows, and drawn alike."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from gl_scenes import box, moved, sky
from gltf_files import GltfFile, cube, noise, strip
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.gltf import GltfScene
from supersampler_model.data.scenes.procedural.paths import turned_by
from supersampler_model.data.scenes.scene import (
    Camera,
    Instance,
    Material,
    Matrix,
    Scene,
    Texture,
    tangents_of,
)

STILL = np.eye(4)
CAMERA = Camera(position=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0), fov_y=60.0)


def opened(file: GltfFile, folder: Path) -> GltfScene:
    return GltfScene(file.save(folder / "scene.glb"))


def first(file: GltfFile, folder: Path) -> Instance:
    return opened(file, folder).instances(0.0, 0.0, STILL)[0]


def material_of(folder: Path, **content: Any) -> Material:
    """The cube's material with this JSON."""
    return first(cube(**content), folder).material


def pixels_of(texture: Texture | None) -> Any:
    assert texture is not None
    return texture.pixels


# --- files and arrays ---


@pytest.mark.parametrize("buffer", ["inside", "beside", "data"])
def test_a_cube_is_read_as_written(tmp_path: Path, buffer: Literal["inside", "beside", "data"]) -> None:
    shape = box()
    path = cube(doubleSided=True, emissiveFactor=[1, 2, 3]).save(tmp_path / "cube.gltf", buffer)
    (instance,) = GltfScene(str(path)).instances(0.0, 0.0, STILL)
    mesh, material = instance.mesh, instance.material
    for name in ("positions", "normals", "uv", "tangents", "indices"):
        np.testing.assert_array_equal(getattr(mesh, name), getattr(shape, name))
    np.testing.assert_array_equal(pixels_of(material.base_color_texture), noise(0))
    assert (material.metallic, material.roughness, material.emissive) == (0.25, 1.0, (1.0, 2.0, 3.0))
    assert material.double_sided
    assert material.alpha_cutoff is None
    assert GltfScene(path).bounds.tolist() == [[-1, -1, -1], [1, 1, 1]]


def test_integers_strides_and_sparse_rows_are_read(tmp_path: Path) -> None:
    file = cube(parts=())
    shape, attributes = box(), file.json["meshes"][0]["primitives"][0]["attributes"]
    normals = np.concatenate([shape.normals * 127, np.zeros((24, 1))], axis=1).astype(np.int8)
    view = file.view(normals.tobytes(), byteStride=4)
    attributes["NORMAL"] = file.add(
        "accessors", bufferView=view, componentType=5120, count=24, type="VEC3", normalized=True
    )
    attributes["TEXCOORD_0"] = file.array(abs(shape.uv) * 65535, "uint16", normalized=True)
    rows, values = file.view(np.array([3, 9], np.uint16).tobytes()), np.array([[5, 6, 7]] * 2, np.float32)
    file.json["accessors"][attributes["POSITION"]]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": rows, "componentType": 5123},
        "values": {"bufferView": file.view(values.tobytes())},
    }
    mesh = first(file, tmp_path).mesh
    np.testing.assert_array_equal(mesh.normals, shape.normals)
    np.testing.assert_array_equal(mesh.uv, abs(shape.uv))
    np.testing.assert_array_equal(mesh.positions[[3, 9]], values)
    np.testing.assert_array_equal(mesh.positions[4:9], shape.positions[4:9])


@pytest.mark.parametrize(
    ("mode", "triangles"), [(5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]), (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0]])]
)
def test_strips_and_fans_become_triangles(tmp_path: Path, mode: int, triangles: list[list[int]]) -> None:
    file = cube()
    file.json["meshes"][0]["primitives"][0].update(mode=mode, indices=file.array(range(5), "uint8"))
    assert first(file, tmp_path).mesh.indices.tolist() == triangles


def test_without_normals_triangles_are_flat_and_without_tangents_these_are_derived(tmp_path: Path) -> None:
    mesh = first(cube(parts=("TEXCOORD_0",)), tmp_path).mesh
    a, b, c = (mesh.positions[corner] for corner in mesh.indices.T)
    facing = np.cross(b - a, c - a)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    for corner in mesh.indices.T:
        np.testing.assert_allclose(mesh.normals[corner], facing, atol=1e-6)
    derived = tangents_of(mesh.positions, mesh.normals, mesh.uv, mesh.indices)
    np.testing.assert_array_equal(mesh.tangents, derived)


def test_tangents_of_the_file_are_kept_where_they_are_any(tmp_path: Path) -> None:
    file = cube(parts=("NORMAL", "TEXCOORD_0"))
    tangents = box().tangents * (1, 1, 1, -1)
    tangents[5] = 0.0
    file.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = file.array(tangents)
    mesh = first(file, tmp_path).mesh
    np.testing.assert_array_equal(mesh.tangents[5], box().tangents[5])
    np.testing.assert_array_equal(mesh.tangents[6:], tangents[6:].astype(np.float32))


# --- materials ---


def test_metallic_roughness_and_occlusion_become_one_texture(tmp_path: Path) -> None:
    file = cube(occlusionTexture={"index": 2, "strength": 0.5})
    file.json["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": 1}
    file.texture(noise(1))
    file.texture(noise(2, height=2, width=4, channels=1))
    orm = pixels_of(first(file, tmp_path).material.orm_texture)
    np.testing.assert_array_equal(orm[..., 1:], noise(1)[..., 1:])
    red = np.repeat(np.repeat(noise(2, 2, 4, 1)[..., 0], 2, axis=0), 2, axis=1)
    np.testing.assert_allclose(orm[..., 0], 255 - 0.5 * (255.0 - red), atol=0.51)


def test_without_occlusion_or_with_one_that_is_black_all_over_nothing_is_occluded(tmp_path: Path) -> None:
    pbr = {"metallicRoughnessTexture": {"index": 0}}
    assert pixels_of(material_of(tmp_path, pbrMetallicRoughness=pbr).orm_texture)[..., 0].min() == 255
    file = cube(occlusionTexture={"index": 1})
    file.texture(np.full((4, 4, 3), 3, np.uint8))
    assert (pixels_of(first(file, tmp_path).material.orm_texture)[..., 0] == 255).all()


def test_occlusion_with_coordinates_of_its_own_is_left_out(tmp_path: Path) -> None:
    assert material_of(tmp_path, occlusionTexture={"index": 0, "texCoord": 1}).orm_texture is None


def test_a_normal_map_is_scaled(tmp_path: Path) -> None:
    plain, scaled = (
        pixels_of(material_of(tmp_path, normalTexture={"index": 0, **scale}).normal_texture)
        for scale in ({}, {"scale": 0.5})
    )
    np.testing.assert_array_equal(plain, noise(0))
    expected = (plain / 127.5 - 1.0) * (0.5, 0.5, 1.0)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    np.testing.assert_allclose(scaled / 127.5 - 1.0, expected, atol=0.005)


@pytest.mark.parametrize(
    ("mode", "opacity", "cutoff"),
    [
        ({"alphaMode": "OPAQUE"}, 0.1, None),
        ({"alphaMode": "MASK"}, 1.0, 0.5),
        ({"alphaMode": "MASK", "alphaCutoff": 0.3}, 0.5, 0.6),  # the renderer tests the texture alone
        ({"alphaMode": "BLEND"}, 0.8, 0.625),
    ],
)
def test_holes_are_where_opacity_is_below_the_cutoff(
    tmp_path: Path, mode: dict[str, Any], opacity: float, cutoff: float | None
) -> None:
    file = cube(**mode)
    pixels = noise(1, channels=4)
    pixels[0, 0, 3] = 255
    pbr = {"baseColorFactor": [1, 1, 1, opacity], "baseColorTexture": {"index": file.texture(pixels)}}
    file.json["materials"][0]["pbrMetallicRoughness"] = pbr
    material = first(file, tmp_path).material
    assert material.alpha_cutoff == (None if cutoff is None else pytest.approx(cutoff))
    np.testing.assert_array_equal(pixels_of(material.base_color_texture), pixels)  # not times opacity


def test_objects_more_than_half_transparent_are_left_out(tmp_path: Path) -> None:
    file = cube()
    primitive = file.json["meshes"][0]["primitives"][0]
    glass = {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.3]}}
    file.json["meshes"][0]["primitives"].append({**primitive, "material": file.add("materials", **glass)})
    assert len(opened(file, tmp_path).instances(0.0, 0.0, STILL)) == 1


def test_emission_may_exceed_one_and_textures_may_be_shifted(tmp_path: Path) -> None:
    place = {"KHR_texture_transform": {"offset": [0.5, 0.25], "scale": [2.0, 3.0]}}
    file = cube(
        emissiveFactor=[1.0, 0.5, 0.0],
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}},
        pbrMetallicRoughness={"baseColorTexture": {"index": 0, "extensions": place}},
    )
    instance = first(file, tmp_path)
    assert instance.material.emissive == (4.0, 2.0, 0.0)
    np.testing.assert_allclose(instance.mesh.uv, box().uv * (2, 3) + (0.5, 0.25))


# --- nodes and clips ---


def placed(file: GltfFile, folder: Path, time: float = 0.0) -> Matrix:
    return opened(file, folder).instances(time, 0.0, STILL)[0].model


def test_nodes_hang_on_nodes(tmp_path: Path) -> None:
    file, half = cube(), float(np.sqrt(0.5))
    file.json["nodes"] = [
        {"mesh": 0, "matrix": moved(1, 2, 3, (2, 1, -1)).T.ravel().tolist()},
        {"children": [0], "translation": [7, 0, 0], "rotation": [0, half, 0, half], "scale": [1, 3, 1]},
    ]
    file.json["scenes"][0]["nodes"] = [1]
    parent = moved(7, 0, 0) @ turned_by(1, np.pi / 2) @ moved(0, 0, 0, (1, 3, 1))
    expected = parent @ moved(1, 2, 3, (2, 1, -1))
    world, before = moved(-1, 0, 0) @ turned_by(0, 0.3), moved(-2, 0, 0)
    (instance,) = opened(file, tmp_path).instances(0.0, 0.0, world, before)
    np.testing.assert_allclose(instance.model, world @ expected, atol=1e-12)
    assert instance.model_before is not None
    np.testing.assert_allclose(instance.model_before, before @ expected, atol=1e-12)


def test_a_rotation_turns_evenly_the_short_way(tmp_path: Path) -> None:
    file, angle = cube(), 1.2
    end = -np.array([0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)])  # the same turn as without the sign
    file.channel("rotation", [1.0, 3.0], [[0, 0, 0, 1], end])
    for time, fraction in ((0.0, 0.0), (1.5, 0.25), (2.0, 0.5), (9.0, 1.0)):  # still before and after
        np.testing.assert_allclose(placed(file, tmp_path, time), turned_by(2, fraction * angle), atol=1e-6)


def test_keyframes_are_interpolated_as_the_clip_states(tmp_path: Path) -> None:
    times, (a, b, c) = [0.0, 2.0, 3.0], np.array([[0.0, 0, 0], [4, 0, 0], [4, 2, 0]])
    slope, nothing = np.array([3.0, 0, 0]), np.zeros(3)
    cubic = [nothing, a, slope, nothing, b, nothing, nothing, c, nothing]
    # At a quarter of two seconds: value 0.84375 a + 0.15625 b, tangent 2 * 0.140625.
    cases = {"LINEAR": ([a, b, c], 1.0), "STEP": ([a, b, c], 0.0), "CUBICSPLINE": (cubic, 0.625 + 0.84375)}
    for interpolation, (values, expected) in cases.items():
        file = cube()
        file.channel("translation", times, values, interpolation)
        np.testing.assert_allclose(placed(file, tmp_path, 0.5), moved(expected, 0, 0), atol=1e-6)
        np.testing.assert_allclose(placed(file, tmp_path, 3.5), moved(4, 2, 0), atol=1e-6)


def test_the_previous_state_is_that_of_the_previous_time(tmp_path: Path) -> None:
    file = cube()
    file.channel("scale", [0.0, 1.0], [[1, 1, 1], [3, 1, 1]])
    scene = opened(file, tmp_path)
    (now,), (then,) = scene.instances(0.5, 0.4, STILL), scene.instances(0.4, 0.0, STILL)
    np.testing.assert_array_equal(now.model_before, then.model)
    assert now.model[0, 0] == pytest.approx(2.0)
    assert scene.clips[0].duration == 1.0


# --- skins ---


def skinned(instance: Instance, *, before: bool = False) -> Matrix:
    """Vertices in the world."""
    palette = instance.palette_before if before else instance.palette
    model, skin, mesh = instance.model_before if before else instance.model, instance.mesh.skin, instance.mesh
    assert model is not None
    assert skin is not None
    assert palette is not None
    local = np.concatenate([mesh.positions, np.ones((len(mesh.positions), 1))], axis=1)
    posed = np.einsum("nk,nkij,nj->ni", skin.weights, palette[skin.joints], local)
    return np.asarray((posed @ model.T)[:, :3])


def test_a_skin_follows_its_joints_and_not_its_node(tmp_path: Path) -> None:
    scene = opened(strip(), tmp_path)
    (instance,) = scene.instances(0.5, 0.0, moved(0, 0, -3))
    bound, away = instance.mesh.positions.astype(np.float64), np.array([0, 0, -3])
    np.testing.assert_allclose(skinned(instance, before=True), bound + away, atol=1e-6)
    bend = moved(0.5, 1, 0) @ turned_by(2, np.pi / 4) @ moved(0, -1, 0)
    upper = np.clip(bound[:, 1:2] - 0.5, 0.0, 1.0)
    turned = bound @ bend[:3, :3].T + bend[:3, 3]
    np.testing.assert_allclose(skinned(instance), (1 - upper) * bound + upper * turned + away, atol=1e-6)
    np.testing.assert_allclose(scene.bounds, [[-0.5, 0, 0], [0.5, 2, 0]], atol=1e-6)


def test_a_palette_holds_the_joints_in_use(tmp_path: Path) -> None:
    file = strip()
    spare = [file.add("nodes") for _ in range(300)]
    file.json["skins"][0]["joints"] += spare
    file.json["scenes"][0]["nodes"] += spare
    del file.json["skins"][0]["inverseBindMatrices"]
    (instance,) = opened(file, tmp_path).instances(0.0, 0.0, STILL)
    assert instance.palette is not None
    assert instance.palette.shape == (2, 4, 4)


# --- drawn ---


def scene_of(instances: tuple[Instance, ...]) -> Scene:
    return Scene(camera=CAMERA, camera_before=CAMERA, environment=sky(), instances=instances)


def pixel_of(x: float, y: float) -> tuple[float, float]:
    """Return where `CAMERA` sees a point of z = 0, in an image of 160 x 90."""
    zoom = 45.0 / np.tan(np.radians(30.0)) / 5.0
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
    seen = renderer.display(scene_of((first(file, tmp_path),))).base_color
    for (row, column), color in corners.items():
        x, y = pixel_of(column - 0.5, 0.5 - row)
        np.testing.assert_allclose(seen[int(y), int(x)], np.array(color) / 255.0, atol=0.01)


@pytest.mark.parametrize("clip_moves", [True, False])
def test_motion_is_exact(tmp_path: Path, renderer: Renderer, clip_moves: bool) -> None:
    file = strip()
    if clip_moves:  # the upper joint moves all of it to the right; else its transform does
        del file.json["animations"][0]["channels"][0]
        weights = file.array(np.tile([0.0, 1.0, 0.0, 0.0], (10, 1)))
        file.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = weights
        instances = opened(file, tmp_path).instances(0.3, 0.1, STILL)
    else:
        instances = opened(file, tmp_path).instances(0.0, 0.0, moved(0.3, 0, 0), moved(0.1, 0, 0))
    surfaces = renderer.display(scene_of(instances))
    drawn = surfaces.depth > 0.0
    assert drawn.sum() > 200
    expected = np.subtract(pixel_of(0.1, 0.0), pixel_of(0.3, 0.0))
    np.testing.assert_allclose(surfaces.motion[drawn], np.broadcast_to(expected, (drawn.sum(), 2)), atol=1e-3)
