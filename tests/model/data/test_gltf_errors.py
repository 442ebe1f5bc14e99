"""Errors of broken or unsupported glTF files name the file, the place in it and the reason."""

import json
import os
import random
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gltf_files import GltfFile, cube, glb, png, strip
from supersampler_model.data.errors import DataError
from supersampler_model.data.scenes.gltf import GltfError, GltfScene
from supersampler_model.data.scenes.gltf.compose import read_panorama

Break = Callable[[GltfFile], Any]
CUBE = r"mesh 0 'Cube', primitive 0"
PAINT = rf"{CUBE}, material 0 'Paint'"


def primitive(file: GltfFile) -> dict[str, Any]:
    found: dict[str, Any] = file.json["meshes"][0]["primitives"][0]
    return found


def message_of(file: GltfFile, folder: Path) -> str:
    path = file.save(folder / "broken.glb")
    with pytest.raises(GltfError) as caught:
        GltfScene(path)
    assert caught.value.path == path
    assert caught.value.place in str(caught.value)
    assert isinstance(caught.value, DataError)
    return str(caught.value).removeprefix(str(path))


PRIMITIVES: dict[str, tuple[Break, str]] = {
    "no positions": (lambda f: primitive(f)["attributes"].clear(), f"{CUBE}: 'POSITION' is missing"),
    "lines": (lambda f: primitive(f).update(mode=1), f"{CUBE}: it is made of lines; only triangles"),
    "morph targets": (lambda f: primitive(f).update(targets=[{}]), f"{CUBE}: it has morph targets"),
    "no such accessor": (
        lambda f: primitive(f)["attributes"].update(NORMAL=99),
        f"{CUBE}, accessor 99: accessors 99 is referred to, and there are 4",
    ),
    "another kind": (
        lambda f: primitive(f)["attributes"].update(NORMAL=primitive(f)["attributes"]["TEXCOORD_0"]),
        f"{CUBE}, accessor 1: it holds VEC2; want VEC3",
    ),
    "another length": (
        lambda f: primitive(f)["attributes"].update(NORMAL=f.array(np.ones((5, 3)))),
        f"{CUBE}: it has 24 positions and 5 of normal",
    ),
    "NaN": (
        lambda f: primitive(f)["attributes"].update(POSITION=f.array(np.full((24, 3), np.nan))),
        f"{CUBE}, accessor 4: it holds NaN or infinite numbers",
    ),
    "an index too far": (
        lambda f: primitive(f).update(indices=f.array([0, 1, 24], "uint8")),
        f"{CUBE}: its indices refer to vertex 24 of 24",
    ),
    "half a triangle": (
        lambda f: primitive(f).update(indices=f.array([0, 1, 2, 3], "uint8")),
        f"{CUBE}: it has 4 corners, which are no whole triangles",
    ),
    "textures nowhere": (
        lambda f: primitive(f)["attributes"].pop("TEXCOORD_0"),
        f"{CUBE}: its material has textures, and it has no TEXCOORD_0",
    ),
    "beyond the view": (
        lambda f: f.json["accessors"][0].update(count=25),
        f"{CUBE}, accessor 0: it ends at byte 300 of the 288 of its buffer view",
    ),
    "beyond the buffer": (
        lambda f: f.json["bufferViews"][0].update(byteLength=10**6),
        f"{CUBE}, accessor 0: bufferView 0 ends at byte 1000000 of ",
    ),
    "an absurd count": (
        lambda f: f.json["accessors"][0].update(count=10**15),
        f"{CUBE}, accessor 0: its count is 1000000000000000; want",
    ),
    "no such material": (
        lambda f: primitive(f).update(material=3),
        f"{CUBE}: materials 3 is referred to, and there are 1",
    ),
    "a damaged image": (
        lambda f: f.json["bufferViews"][4].update(byteLength=70),
        f"{PAINT}, image 0: it is damaged",
    ),
    "another image format": (
        lambda f: f.json["images"][0].update(bufferView=0),
        f"{PAINT}, image 0: it is neither PNG nor JPEG",
    ),
    "an image elsewhere": (
        lambda f: f.json["images"].__setitem__(0, {"uri": "https://example.org/a.png"}),
        f"{PAINT}, image 0: 'https://example.org/a.png' is elsewhere",
    ),
    "a missing image": (
        lambda f: f.json["images"].__setitem__(0, {"uri": "paint.png"}),
        f"{PAINT}, image 0: 'paint.png' cannot be read (No such file",
    ),
    "only WebP": (
        lambda f: f.json["textures"].__setitem__(0, {"extensions": {"EXT_texture_webp": {"source": 0}}}),
        f"{PAINT}: texture 0 has no PNG or JPEG image (EXT_texture_webp)",
    ),
    "two sets of coordinates": (
        lambda f: f.json["materials"][0].update(normalTexture={"index": 0, "texCoord": 1}),
        f"{PAINT}: its textures are placed in different ways",
    ),
    "a value out of range": (
        lambda f: f.json["materials"][0]["pbrMetallicRoughness"].update(roughnessFactor=2.0),
        f"{PAINT}: material.roughness is 2.0; want",
    ),
    "a value that is none": (
        lambda f: f.json["materials"][0].update(normalTexture={"index": 0, "scale": float("nan")}),
        f"{PAINT}: its scale is nan; want a finite number",
    ),
    "another alphaMode": (
        lambda f: f.json["materials"][0].update(alphaMode="GLOW"),
        f"{PAINT}: its alphaMode is 'GLOW'; want OPAQUE, MASK or BLEND",
    ),
}


@pytest.mark.parametrize("name", PRIMITIVES)
def test_a_broken_primitive_is_named(tmp_path: Path, name: str) -> None:
    damage, message = PRIMITIVES[name]
    file = cube()
    damage(file)
    assert message in message_of(file, tmp_path)


FILES: dict[str, tuple[Break, str]] = {
    "an extension": (
        lambda f: f.json.update(extensionsRequired=["KHR_draco_mesh_compression"]),
        ": it requires KHR_draco_mesh_compression, which is not supported; export it without",
    ),
    "version 1": (lambda f: f.json["asset"].update(version="1.0"), "its version is 1.0; only glTF 2.0"),
    "nothing to see": (lambda f: f.json["nodes"][0].pop("mesh"), ": nothing in it is to be seen."),
    "a circle": (
        lambda f: f.json["nodes"][0].update(children=[0]),
        "node 0 'Place': it hangs on two nodes, or on itself",
    ),
    "a bad place": (
        lambda f: f.json["nodes"][0].update(translation=[1, 2]),
        "node 0 'Place': its translation is [1, 2]; want 3 finite numbers",
    ),
    "no rotation": (
        lambda f: f.json["nodes"][0].update(rotation=[0, 0, 0, 0]),
        "node 0 'Place': its rotation is 0",
    ),
    "times that jump back": (
        lambda f: f.channel("scale", [1.0, 0.5], np.ones((2, 3))),
        "animation 0 'move', channel 0: its times do not ascend",
    ),
    "values missing": (
        lambda f: f.channel("scale", [0.0, 1.0], np.ones((2, 3)), "CUBICSPLINE"),
        "animation 0 'move', channel 0: it has 2 times and 2 values",
    ),
    "another interpolation": (
        lambda f: f.channel("scale", [0.0], np.ones((1, 3)), "SMOOTH"),
        "animation 0 'move', channel 0: it is 'SMOOTH' of 'scale'; want one of LINEAR",
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_a_broken_file_is_named(tmp_path: Path, name: str) -> None:
    damage, message = FILES[name]
    file = cube()
    damage(file)
    assert message in message_of(file, tmp_path)


def test_too_many_joints_are_refused(tmp_path: Path) -> None:
    file = strip()
    spare = [file.add("nodes") for _ in range(200)]
    file.json["scenes"][0]["nodes"] += spare
    file.json["skins"][0] = {"joints": spare}
    count = 160
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
    ("name", "values", "message"),
    [
        ("JOINTS_0", np.full((10, 4), 3), "its JOINTS_0 refer to joint 3 of 3"),
        ("WEIGHTS_0", np.zeros((10, 4)), "its WEIGHTS_0 are negative or all 0 at vertex 0"),
    ],
)
def test_a_broken_skin_is_named(tmp_path: Path, name: str, values: Any, message: str) -> None:
    file = strip()
    dtype = "uint8" if name == "JOINTS_0" else "float32"
    primitive(file)["attributes"][name] = file.array(values, dtype)
    assert f"mesh 0 'Strip', primitive 0: {message}" in message_of(file, tmp_path)


@pytest.mark.parametrize("data", [b"", b"glTF", b"no model at all", b"[1]", b"{}", b"glTF\1\0\0\0\0\0\0\0"])
def test_what_is_no_gltf_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "some.glb"
    path.write_bytes(data)
    with pytest.raises(GltfError, match=re.escape(str(path))):
        GltfScene(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(GltfError, match=r"none\.glb: it cannot be read \(No such file"):
        GltfScene(tmp_path / "none.glb")


def test_a_file_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    whole = cube().save(tmp_path / "whole.glb").read_bytes()
    path = tmp_path / "part.glb"
    for length in range(0, len(whole), len(whole) // 40):
        path.write_bytes(whole[:length])
        with pytest.raises(GltfError):
            GltfScene(path)


def spots(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield (object or array, key) of all that is in JSON."""
    keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        yield value, key
        yield from spots(value[key])


def test_damaged_json_is_read_or_refused_and_never_anything_else(tmp_path: Path) -> None:
    generator = random.Random(0)
    junk: list[Any] = [
        None,
        -1,
        0,
        2,
        10**9,
        2**63,
        1.5,
        1e30,
        float("nan"),
        "x",
        "data:,",
        [],
        {},
        [1, 2],
        True,
    ]
    refused = 0
    for number in range(200):
        file = (cube, strip)[number % 2]()
        holder, key = generator.choice(list(spots(file.json)))
        holder[key] = generator.choice(junk)
        path = tmp_path / "damaged.glb"
        content = {**file.json, "buffers": [{"byteLength": len(file.binary)}]}
        path.write_bytes(glb(json.dumps(content).encode(), file.binary))
        try:
            GltfScene(path).instances(0.5, 0.4, np.eye(4))
        except GltfError:
            refused += 1
    assert refused > 100


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
    with pytest.raises(GltfError, match="is elsewhere; only files in the folder of this one are read"):
        GltfScene(path)


@pytest.mark.parametrize("linked", ["buffer.bin", "sub"])
def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path, linked: str) -> None:
    file = cube()
    (tmp_path / "away").mkdir()
    (tmp_path / "away" / "buffer.bin").write_bytes(file.binary)
    path = saved(file, tmp_path / "models", "buffer.bin" if linked == "buffer.bin" else "sub/buffer.bin")
    target = tmp_path / "away" / "buffer.bin" if linked == "buffer.bin" else tmp_path / "away"
    (tmp_path / "models" / linked).symlink_to(target)
    with pytest.raises(GltfError, match="is elsewhere, by a link"):
        GltfScene(path)


def test_names_below_and_a_folder_that_is_a_link_are_read(tmp_path: Path) -> None:
    file = cube()
    path = saved(file, tmp_path / "models", "./sub/the%20buffer.bin")
    (tmp_path / "models" / "sub").mkdir()
    (tmp_path / "models" / "sub" / "the buffer.bin").write_bytes(file.binary)
    (tmp_path / "link").symlink_to("models")
    assert GltfScene(tmp_path / "link" / path.name).digest == GltfScene(path).digest


def test_a_buffer_that_is_no_regular_file_is_refused(tmp_path: Path) -> None:
    path = saved(cube(), tmp_path / "models", "pipe")
    os.mkfifo(tmp_path / "models" / "pipe")
    with pytest.raises(GltfError, match="is no regular file"):
        GltfScene(path)


def test_a_small_file_that_claims_much_is_refused_before_room_is_made(tmp_path: Path) -> None:
    file = cube()
    primitive(file)["attributes"]["POSITION"] = file.add(
        "accessors", componentType=5126, count=1 << 26, type="VEC3"
    )
    assert "accessor 4: all arrays come to more than" in message_of(file, tmp_path)
    file = cube()
    times = file.array(np.arange(5000.0))
    sampler = {"input": times, "output": file.array(np.ones((5000, 3)))}
    channels = [{"sampler": 0, "target": {"node": 0, "path": "scale"}}] * 2000
    file.add("animations", samplers=[sampler], channels=channels)
    assert "all arrays come to more than" in message_of(file, tmp_path)


def test_a_panorama_of_another_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sky.hdr").write_bytes(png(np.zeros((4, 8, 3), np.uint8)))
    with pytest.raises(GltfError, match=r"sky\.hdr: the panorama is no \.hdr file"):
        read_panorama(tmp_path / "sky.hdr")
