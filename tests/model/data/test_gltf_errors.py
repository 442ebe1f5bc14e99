"""Errors of broken or unsupported glTF files name the file, the place in it and the reason."""

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gltf_files import GltfFile, cube, png, strip
from supersampler_model.data.errors import DataError
from supersampler_model.data.scenes.gltf import GltfError, GltfScene, model
from supersampler_model.data.scenes.gltf.compose import read_panorama

CUBE = r"mesh 0 'Cube', primitive 0"
PAINT = rf"{CUBE}, material 0 'Paint'"
MOVE = "animation 0 'move', channel 0"


def primitive(file: GltfFile) -> dict[str, Any]:
    found: dict[str, Any] = file.json["meshes"][0]["primitives"][0]
    return found


def attributes(file: GltfFile, **changes: Any) -> None:
    primitive(file)["attributes"].update(changes)


def first(file: GltfFile, kind: str, **changes: Any) -> None:
    file.json[kind][0].update(changes)


def message_of(file: GltfFile, folder: Path) -> str:
    path = file.save(folder / "broken.glb")
    with pytest.raises(GltfError) as caught:
        GltfScene(path)
    assert caught.value.path == path
    assert caught.value.place in str(caught.value)
    assert isinstance(caught.value, DataError)
    return str(caught.value).removeprefix(str(path))


BROKEN: list[tuple[Callable[[GltfFile], Any], str]] = [
    (lambda f: primitive(f)["attributes"].clear(), f"{CUBE}: 'POSITION' is missing"),
    (lambda f: primitive(f).update(mode=1), f"{CUBE}: it is made of lines; only triangles"),
    (lambda f: primitive(f).update(targets=[{}]), f"{CUBE}: it has morph targets"),
    (lambda f: attributes(f, NORMAL=99), f"{CUBE}, accessor 99: it refers to number 99 of 4 accessors"),
    (lambda f: attributes(f, NORMAL=primitive(f)["attributes"]["TEXCOORD_0"]),
     f"{CUBE}, accessor 1: it holds VEC2; want VEC3"),
    (lambda f: attributes(f, NORMAL=f.array(np.ones((5, 3)))),
     f"{CUBE}: it has 24 positions and 5 of normal"),
    (lambda f: attributes(f, POSITION=f.array(np.full((24, 3), np.nan))),
     f"{CUBE}, accessor 4: it holds NaN or infinite numbers"),
    (lambda f: primitive(f).update(indices=f.array([0, 1, 24], "uint8")),
     f"{CUBE}: its indices refer to vertex 24 of 24"),
    (lambda f: primitive(f).update(indices=f.array([0, 1, 2, 3], "uint8")),
     f"{CUBE}: it has 4 corners, not a multiple of 3"),
    (lambda f: primitive(f)["attributes"].pop("TEXCOORD_0"),
     f"{CUBE}: its material has textures, and it has no TEXCOORD_0"),
    (lambda f: first(f, "accessors", count=25),
     f"{CUBE}, accessor 0: it ends at byte 300 of the 288 of its buffer view"),
    (lambda f: first(f, "bufferViews", byteLength=10**6),
     f"{CUBE}, accessor 0: bufferView 0 ends at byte 1000000 of "),
    (lambda f: first(f, "accessors", count=10**15),
     f"{CUBE}, accessor 0: its count is 1000000000000000; want"),
    (lambda f: primitive(f).update(material=3), f"{CUBE}: it refers to number 3 of 1 materials"),
    (lambda f: f.json["bufferViews"][4].update(byteLength=70), f"{PAINT}, image 0: it is damaged"),
    (lambda f: first(f, "images", bufferView=0), f"{PAINT}, image 0: it is neither PNG nor JPEG"),
    (lambda f: f.json["images"].__setitem__(0, {"uri": "https://example.org/a.png"}),
     f"{PAINT}, image 0: 'https://example.org/a.png' lies outside"),
    (lambda f: f.json["images"].__setitem__(0, {"uri": "paint.png"}),
     f"{PAINT}, image 0: 'paint.png' cannot be read (No such file"),
    (lambda f: f.json["textures"].__setitem__(0, {"extensions": {"EXT_texture_webp": {"source": 0}}}),
     f"{PAINT}: texture 0 has no PNG or JPEG image (EXT_texture_webp)"),
    (lambda f: first(f, "materials", normalTexture={"index": 0, "texCoord": 1}),
     f"{PAINT}: its textures are placed in different ways"),
    (lambda f: f.json["materials"][0]["pbrMetallicRoughness"].update(roughnessFactor=2.0),
     f"{PAINT}: material.roughness is 2.0; want"),
    (lambda f: first(f, "materials", normalTexture={"index": 0, "scale": float("nan")}),
     f"{PAINT}: its scale is nan; want a finite number"),
    (lambda f: first(f, "materials", alphaMode="GLOW"),
     f"{PAINT}: its alphaMode is 'GLOW'; want OPAQUE, MASK or BLEND"),
    (lambda f: f.json.update(extensionsRequired=["KHR_draco_mesh_compression"]),
     ": it requires KHR_draco_mesh_compression, which is not supported; export it without"),
    (lambda f: f.json["asset"].update(version="1.0"), "its version is 1.0; only glTF 2.0"),
    (lambda f: f.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"].update(
        extensions={"KHR_texture_transform": {"scale": [1e300, 1.0]}}), f"{CUBE}: mesh.uv is NaN"),
    (lambda f: f.json["nodes"][0].pop("mesh"), ": it shows no object."),
    (lambda f: first(f, "nodes", children=[0]), "node 0 'Place': it is a child of two nodes, or of itself"),
    (lambda f: first(f, "nodes", translation=[1, 2]),
     "node 0 'Place': its translation is [1, 2]; want 3 finite numbers"),
    (lambda f: first(f, "nodes", rotation=[0, 0, 0, 0]), "node 0 'Place': its rotation is 0"),
    (lambda f: f.channel("scale", [1.0, 0.5], np.ones((2, 3))), f"{MOVE}: its times do not ascend"),
    (lambda f: f.channel("scale", [0.0, 1.0], np.ones((2, 3)), "CUBICSPLINE"),
     f"{MOVE}: it has 2 times and 2 values"),
    (lambda f: f.channel("scale", [0.0], np.ones((1, 3)), "SMOOTH"),
     f"{MOVE}: it is 'SMOOTH' of 'scale'; want one of LINEAR"),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "message"), BROKEN, ids=[message[-50:] for _, message in BROKEN])
def test_a_broken_file_is_named(tmp_path: Path, damage: Callable[[GltfFile], Any], message: str) -> None:
    file = cube()
    damage(file)
    assert message in message_of(file, tmp_path)


def test_too_many_joints_are_refused(tmp_path: Path) -> None:
    file, count = strip(), 160
    spare = [file.add("nodes") for _ in range(200)]
    file.json["scenes"][0]["nodes"] += spare
    file.json["skins"][0] = {"joints": spare}
    primitive(file)["attributes"] = {
        "POSITION": file.array(np.random.default_rng(0).random((count, 3))),
        "JOINTS_0": file.array(np.tile(np.arange(count)[:, None], (1, 4)), "uint8"),
        "NORMAL": file.array(np.tile([0.0, 0.0, 1.0], (count, 1))),
        "WEIGHTS_0": file.array(np.full((count, 4), 0.25)),
    }
    primitive(file)["indices"] = file.array(np.arange(159), "uint16")
    expected = "mesh 0 'Strip', primitive 0: 160 joints move it; at most 128 are supported"
    assert expected in message_of(file, tmp_path)


@pytest.mark.parametrize(
    ("name", "values", "dtype", "message"),
    [
        ("JOINTS_0", np.full((10, 4), 3), "uint8", "its JOINTS_0 refer to joint 3 of 3"),
        ("WEIGHTS_0", np.zeros((10, 4)), "float32", "its WEIGHTS_0 are negative or all 0 at vertex 0"),
    ],
)
def test_a_broken_skin_is_named(tmp_path: Path, name: str, values: Any, dtype: str, message: str) -> None:
    file = strip()
    attributes(file, **{name: file.array(values, dtype)})
    assert f"mesh 0 'Strip', primitive 0: {message}" in message_of(file, tmp_path)


@pytest.mark.parametrize(
    "data", [b"", b"glTF", b"no model at all", b"[1]", b"{}", b"glTF\1\0\0\0\0\0\0\0", None]
)
def test_a_file_that_is_not_gltf_is_refused(tmp_path: Path, data: bytes | None) -> None:
    path = tmp_path / "some.glb"
    if data is not None:
        path.write_bytes(data)
    message = re.escape(str(path)) + (r": it cannot be read \(No such file" if data is None else "")
    with pytest.raises(GltfError, match=message):
        GltfScene(path)


def saved(file: GltfFile, folder: Path, uri: str) -> Path:
    """A .gltf in `folder` whose buffer is what the URI stands for."""
    folder.mkdir(exist_ok=True)
    content = {**file.json, "buffers": [{"byteLength": len(file.binary), "uri": uri}]}
    path = folder / "file.gltf"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    "uri",
    [
        "../buffer.bin", "%2e%2e/buffer.bin", "%2E%2E%2Fbuffer.bin", "sub/../../buffer.bin", "{absolute}",
        "%2F{absolute}", "file://{absolute}", "file:{absolute}", "//host/buffer.bin", "..\\buffer.bin",
        "C:buffer.bin", "https://example.org/buffer.bin", "", ".", "..", "buffer%00.bin",
    ],
)  # fmt: skip
def test_a_name_that_leaves_the_folder_is_refused(tmp_path: Path, uri: str) -> None:
    file = cube()
    (tmp_path / "buffer.bin").write_bytes(file.binary)
    path = saved(file, tmp_path / "models", uri.format(absolute=tmp_path / "buffer.bin"))
    with pytest.raises(GltfError, match="lies outside the folder of this file; only"):
        GltfScene(path)


@pytest.mark.parametrize("linked", ["buffer.bin", "sub"])
def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path, linked: str) -> None:
    file, away = cube(), tmp_path / "away"
    away.mkdir()
    (away / "buffer.bin").write_bytes(file.binary)
    path = saved(file, tmp_path / "models", "buffer.bin" if linked == "buffer.bin" else "sub/buffer.bin")
    (tmp_path / "models" / linked).symlink_to(away / "buffer.bin" if linked == "buffer.bin" else away)
    with pytest.raises(GltfError, match="lies outside the folder through a link"):
        GltfScene(path)


def test_names_in_subfolders_and_a_linked_folder_are_read(tmp_path: Path) -> None:
    file = cube()
    path = saved(file, tmp_path / "models", "./sub/the%20buffer.bin")
    (tmp_path / "models" / "sub").mkdir()
    (tmp_path / "models" / "sub" / "the buffer.bin").write_bytes(file.binary)
    (tmp_path / "link").symlink_to("models")
    assert GltfScene(tmp_path / "link" / path.name).digest == GltfScene(path).digest


def test_a_buffer_that_is_not_a_regular_file_is_refused(tmp_path: Path) -> None:
    path = saved(cube(), tmp_path / "models", "pipe")
    os.mkfifo(tmp_path / "models" / "pipe")
    with pytest.raises(GltfError, match="is not a regular file"):
        GltfScene(path)


def test_a_small_file_that_claims_a_large_size_is_refused_before_allocation(tmp_path: Path) -> None:
    file = cube()
    attributes(file, POSITION=file.add("accessors", componentType=5126, count=1 << 26, type="VEC3"))
    assert "accessor 4: all arrays together have more than" in message_of(file, tmp_path)
    file = cube()
    sampler = {"input": file.array(np.arange(5000.0)), "output": file.array(np.ones((5000, 3)))}
    channels = [{"sampler": 0, "target": {"node": 0, "path": "scale"}}] * 2000
    file.add("animations", samplers=[sampler], channels=channels)
    assert "all arrays together have more than" in message_of(file, tmp_path)


LIMITS = {
    "MAX_NODES": "its scene has more than 2 nodes",
    "MAX_PARTS": "its nodes show more than 2 primitives",
    "MAX_VERTICES": "its nodes show 72 vertices; want at most 2",
}


@pytest.mark.parametrize("limit", LIMITS)
def test_nodes_that_share_a_mesh_are_limited_in_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str
) -> None:
    file = cube()
    for _ in range(2):
        file.json["scenes"][0]["nodes"].append(file.add("nodes", mesh=0))
    monkeypatch.setattr(model, limit, 2)
    assert LIMITS[limit] in message_of(file, tmp_path)


def test_a_skin_that_nodes_share_is_read_once(tmp_path: Path) -> None:
    file = strip()
    bind = file.array(np.tile(np.eye(4).ravel(), (5000, 1)))
    file.json["skins"][0].update(joints=[1, 2] * 2500, inverseBindMatrices=bind)
    file.json["scenes"][0]["nodes"] += [file.add("nodes", mesh=0, skin=0) for _ in range(2000)]
    GltfScene(file.save(tmp_path / "crowd.glb"))  # if read for each node, the arrays exceed the limit


def test_a_panorama_of_another_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sky.hdr").write_bytes(png(np.zeros((4, 8, 3), np.uint8)))
    with pytest.raises(GltfError, match=r"sky\.hdr: the panorama is no \.hdr file"):
        read_panorama(tmp_path / "sky.hdr")
