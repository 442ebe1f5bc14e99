"""Sequences composed of a folder's files: reproducible, with exact previous states, objects on free floor."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from OpenImageIO import ImageSpec

from exr_parts import write_parts
from gl_scenes import box, plane
from gltf_files import GltfFile, cube, strip
from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes.gltf import Composition, GltfError, GltfScene
from supersampler_model.data.scenes.gltf.compose import read_folder
from supersampler_model.data.scenes.gltf.ground import Ground, triangles_of
from supersampler_model.data.scenes.scene import Scene
from supersampler_model.data.sequences import SequenceSpec, make_sequence

FRAMES = 12
Floats = NDArray[np.float64]


def room(*, table: bool = False) -> GltfFile:
    """12 x 12 m, with a hollow cupboard, 2 m a side, in the middle, or with a table there, 1 m high."""
    file = GltfFile()
    for shape in (plane(1.0), box()):
        normals = file.array(shape.normals)
        file.add("meshes", primitives=[file.primitive(shape.positions, shape.indices, NORMAL=normals)])
    file.add("nodes", mesh=0, scale=[6, 1, 6])
    height = {"translation": [0, 1, 0], "scale": [1, 0.05 if table else 1, 1]}
    file.json["scenes"][0]["nodes"] = [0, file.add("nodes", mesh=1, **height)]
    return file


def files_in(folder: Path) -> Path:
    (folder / "props").mkdir()
    room().save(folder / "room.glb")
    cube().save(folder / "props" / "cube.glb")
    strip().save(folder / "props" / "strip.gltf", "data")
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return files_in(tmp_path)


def compose(folder: Path, seed: int, frames: int = FRAMES) -> Composition:
    return Composition(read_folder(folder).spec(seed, frames))


def ground_of(file: GltfFile, folder: Path) -> Ground:
    return Ground(triangles_of(GltfScene(file.save(folder / "stage.glb")).instances(0.0, 0.0, np.eye(4))))


@pytest.mark.parametrize("table", [True, False])
def test_spots_lie_neither_inside_nor_under_objects(tmp_path: Path, table: bool) -> None:
    ground, rng = ground_of(room(table=table), tmp_path), np.random.default_rng(0)
    spots = np.array([ground.spot(rng) for _ in range(200)])
    assert (np.abs(spots[:, [0, 2]]).max(axis=1) > 1.25).all()
    assert np.abs(spots[:, [0, 2]]).max() < 6.0
    assert np.abs(spots[:, 1]).max() < 1e-6
    assert not ground.clear(np.array([-4.0, 0, 0]), np.array([4.0, 0, 0]))
    assert ground.clear(np.array([-4.0, 0, 4]), np.array([4.0, 0, 4]))


def floor(width: float, depth: float, *, up: bool = True) -> Floats:
    """Two triangles (2, 3, 3) that face up or down."""
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]]) * (width / 2, 0, depth / 2)
    return corners[[[0, 1, 2], [0, 2, 3]] if up else [[0, 2, 1], [0, 3, 2]]]


def test_there_is_no_ground_without_a_floor_or_on_its_underside() -> None:
    wall = floor(4.0, 8.0)[..., [1, 0, 2]] + (8.0, 2.0, 0.0)
    ground, rng = Ground(np.concatenate([floor(8, 8), wall])), np.random.default_rng(0)
    assert max(ground.spot(rng)[0] for _ in range(100)) < 4.0
    assert not Ground(floor(8, 8, up=False)).free.any()


def test_taken_ground_is_not_used_again() -> None:
    ground, rng = Ground(floor(9, 9)), np.random.default_rng(0)
    ground.take(np.zeros(3), 1.5)
    assert min(float(np.hypot(*ground.near(rng, np.zeros(3), 0.0, 2.5)[[0, 2]])) for _ in range(50)) > 1.2
    ground.take(np.zeros(3), 99.0)
    assert np.isfinite(ground.spot(rng)).all()


def test_positions_near_another_are_at_that_distance_and_in_sight(tmp_path: Path) -> None:
    ground, rng = ground_of(room(), tmp_path), np.random.default_rng(1)
    for _ in range(20):
        place = ground.spot(rng)
        other = ground.near(rng, place, 1.0, 3.0)
        assert 1.0 <= np.hypot(*(other - place)[[0, 2]]) <= 3.0
        assert ground.clear(place, other)


def assert_same(one: Scene, other: Scene) -> None:
    assert (one.camera, one.sun, one.spot, one.points) == (other.camera, other.sun, other.spot, other.points)
    for a, b in zip(one.instances, other.instances, strict=True):
        np.testing.assert_array_equal(a.model, b.model)
    np.testing.assert_array_equal(one.environment.pixels, other.environment.pixels)


def test_the_same_seed_or_spec_is_the_same_sequence(folder: Path) -> None:
    sequence = compose(folder, 3)
    again = make_sequence(SequenceSpec(**json.loads(json.dumps(asdict(sequence.spec)))))
    assert again.spec == sequence.spec
    for other in (again, compose(folder, 3)):
        assert_same(sequence.scene(5), other.scene(5))
    assert sequence.scene(5).camera != compose(folder, 4).scene(5).camera


@pytest.fixture(scope="module")
def sequences(tmp_path_factory: pytest.TempPathFactory) -> list[Composition]:
    folder = files_in(tmp_path_factory.mktemp("files"))
    return [compose(folder, seed) for seed in range(8)]


def test_the_previous_state_is_the_previous_frame_except_at_cuts(sequences: list[Composition]) -> None:
    for sequence in sequences:
        scenes = [sequence.scene(index) for index in range(FRAMES)]
        assert sequence.cut(0)
        for index in range(1, FRAMES):
            before, now = scenes[index - 1], scenes[index]
            assert now.camera_before == (now.camera if sequence.cut(index) else before.camera)
            assert now.camera.exposure == sequence.exposure(index)
            for a, b in zip(before.instances, now.instances, strict=True):
                assert a.mesh is b.mesh  # drawn from what has been uploaded
                np.testing.assert_array_equal(a.model, b.model_before)
                np.testing.assert_array_equal(a.palette, b.palette_before)


def test_objects_move_in_every_sequence_and_all_kinds_occur(sequences: list[Composition]) -> None:
    scenes = [sequence.scene(1) for sequence in sequences]
    for scene in scenes:
        assert any((i.model != i.model_before).any() for i in scene.instances)
    assert any(scene.camera != scene.camera_before for scene in scenes)
    assert any(sequence.cut(index) for sequence in sequences for index in range(1, FRAMES))
    assert any(scene.spot for scene in scenes)
    assert any(scene.points for scene in scenes)
    assert 0 < sum(len(scene.particles) for scene in scenes) < 8
    materials = [i.material for scene in scenes for i in scene.instances]
    assert any(material.alpha_cutoff is not None for material in materials)
    assert any(material.metallic == 1.0 and material.orm_texture is not None for material in materials)


def test_props_stand_on_the_stage_and_the_camera_above_it(sequences: list[Composition]) -> None:
    staged = 0
    for sequence in sequences:
        scene = sequence.scene(0)
        assert 0.2 < scene.camera.position[1] < 2.2
        if "room.glb" not in dict(sequence.spec.files):
            continue
        staged += 1
        assert max(abs(scene.camera.position[0]), abs(scene.camera.position[2])) < 6.1
        boxes = [i for i in scene.instances if len(i.mesh.positions) == 24][1:]  # the first is the cupboard
        for instance in boxes:
            low = (instance.model @ np.append(instance.mesh.positions.min(axis=0), 1.0))[1]
            assert -0.01 < low < 1.2  # at most a hop, or two crates, above the floor
    assert staged > 3


def test_without_a_stage_props_stand_on_a_bare_floor(tmp_path: Path) -> None:
    cube().save(tmp_path / "cube.glb")
    sequence = compose(tmp_path, 0)
    assert [name for name, _ in sequence.spec.files] == ["cube.glb"]
    assert len(sequence.scene(0).instances) > 2


def test_panoramas_of_the_folder_are_used_and_bad_ones_named(folder: Path) -> None:
    def write(height: int) -> None:
        pixels = np.full((height, 2 * height, 3), 0.5, np.float32)
        write_parts(folder / "some.hdr", (ImageSpec(2 * height, height, 3, "float"), pixels))

    write(32)
    shapes = {compose(folder, seed).scene(0).environment.pixels.shape for seed in range(8)}
    assert shapes == {(32, 64, 3), (64, 128, 3)}
    write(33)
    with pytest.raises(GltfError, match=r"some\.hdr: environment\.pixels is \(33, 66, 3\); want"):
        compose(folder, 0)


def test_a_file_that_is_neither_prop_nor_stage_is_left_out_with_the_reason(folder: Path) -> None:
    wall = GltfFile()  # as a prop in centimetres
    corners = wall.primitive([[0, 0, 0], [20, 0, 0], [0, 180, 0]], [(0, 1, 2)])
    wall.add("nodes", mesh=wall.add("meshes", primitives=[corners]))
    wall.save(folder / "centimetres.glb")
    reasons = list[str]()
    read = read_folder(folder, reasons.append)
    assert "centimetres.glb" not in {name for name, _ in (*read.stages, *read.props)}
    [reason] = reasons
    assert "centimetres.glb is left out: it is 20 x 180 x 0 m, too large for a prop" in reason


def test_missing_or_broken_input_is_named(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(SceneError, match=r"gltf is .*empty, without any; want at least one \.glb"):
        compose(tmp_path / "empty", 0)
    with pytest.raises(SceneError, match=r"gltf is .*nowhere, which is not a folder; want a folder"):
        compose(tmp_path / "nowhere", 0)
    with pytest.raises(SceneError, match=r"spec\.frames is 0; want"):
        compose(folder, 0, 0)
    with pytest.raises(SceneError, match=r"index is 12; want 0 to 11"):
        compose(folder, 0).scene(FRAMES)
    (folder / "room.glb").write_bytes(b"glTF")
    with pytest.raises(GltfError, match=r"room\.glb: "):
        compose(folder, 0)


def test_a_scene_file_changed_since_rendering_is_named(folder: Path) -> None:
    spec = read_folder(folder).spec(0, FRAMES)
    name = next(name for name, _ in spec.files if name.startswith("props"))
    cube(emissiveFactor=[1.0, 0.0, 0.0]).save(folder / name)
    with pytest.raises(GltfError, match=rf"{name}: is not the file .* was made with; restore"):
        make_sequence(spec)


def test_a_files_digest_covers_those_that_it_refers_to(tmp_path: Path) -> None:
    path = cube().save(tmp_path / "cube.gltf", "beside")
    before = GltfScene(path).digest
    assert GltfScene(path).digest == before
    beside = tmp_path / "the buffer.bin"
    data = bytearray(beside.read_bytes())
    data[8] ^= 1
    beside.write_bytes(data)
    assert GltfScene(path).digest != before


@pytest.mark.parametrize("change", [{"folder": None}, {"files": ()}, {"family": "floors"}])
def test_a_spec_without_its_files_or_with_others_is_refused(change: dict[str, object]) -> None:
    content = {"family": "gltf", "seed": 0, "frames": 1, "folder": "here", "files": (("a.glb", "0"),)}
    with pytest.raises(SceneError, match=r"spec\.folder, files is .*; want both for a gltf sequence"):
        SequenceSpec(**{**content, **change})  # type: ignore[arg-type]
