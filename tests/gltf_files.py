"""Writes tiny glTF files for tests: a textured cube, a skinned strip, an animated node."""

import base64
import json
import struct
import tempfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from OpenImageIO import ImageSpec

from exr_parts import write_parts
from gl_scenes import box

Array = NDArray[Any]
CODES = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class GltfFile:
    """JSON and one buffer that grow as arrays, images and items are added."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        self.binary = b""

    def add(self, kind: str, **item: Any) -> int:
        """Append to "meshes" and so on; return the index."""
        self.json.setdefault(kind, []).append(item)
        return len(self.json[kind]) - 1

    def view(self, data: bytes, **more: Any) -> int:
        self.binary += b"\0" * (-len(self.binary) % 4)
        start = len(self.binary)
        self.binary += data
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(data), **more)

    def array(self, values: Any, dtype: str = "float32", **more: Any) -> int:
        rows = np.asarray(values).astype(dtype)
        rows = rows.reshape(len(rows), -1)
        return self.add(
            "accessors", bufferView=self.view(rows.tobytes()), componentType=CODES[dtype],
            count=len(rows), type=KINDS[rows.shape[1]], **more,
        )  # fmt: skip

    def texture(self, pixels: Array) -> int:
        image = self.add("images", bufferView=self.view(png(pixels)), mimeType="image/png")
        return self.add("textures", source=image)

    def primitive(self, positions: Any, indices: Any, **attributes: Any) -> dict[str, Any]:
        """Return a primitive's JSON; attributes are accessors."""
        given = {"POSITION": self.array(positions), **attributes}
        return {"attributes": given, "indices": self.array(np.ravel(indices), "uint16")}

    def channel(self, path: str, times: Any, values: Any, interpolation: str = "LINEAR") -> None:
        """Move node 0 in animation 0."""
        animation = self.json.setdefault("animations", [{"name": "move", "channels": [], "samplers": []}])[0]
        animation["samplers"].append(
            {"input": self.array(times), "output": self.array(values), "interpolation": interpolation}
        )
        sampler = len(animation["samplers"]) - 1
        animation["channels"].append({"sampler": sampler, "target": {"node": 0, "path": path}})

    def save(self, path: Path, buffer: Literal["inside", "beside", "data"] = "inside") -> Path:
        """Write a .glb, or a .gltf with the buffer in a file beside it or in its JSON."""
        content = json.loads(json.dumps(self.json))
        length = len(self.binary)
        content["buffers"] = [{"byteLength": length}]
        if buffer == "inside":
            path.write_bytes(glb(json.dumps(content).encode(), self.binary))
            return path
        if buffer == "beside":
            content["buffers"][0]["uri"] = "the%20buffer.bin"
            (path.parent / "the buffer.bin").write_bytes(self.binary)
        else:
            text = base64.b64encode(self.binary).decode()
            content["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{text}"
        path.write_text(json.dumps(content))
        return path


def glb(text: bytes, binary: bytes) -> bytes:
    text, binary = text + b" " * (-len(text) % 4), binary + b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def png(pixels: Array) -> bytes:
    height, width, channels = pixels.shape
    spec = ImageSpec(width, height, channels, pixels.dtype.name)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    with tempfile.TemporaryDirectory() as folder:
        return write_parts(Path(folder) / "image.png", (spec, pixels)).read_bytes()


def noise(seed: int, height: int = 4, width: int = 8, channels: int = 3) -> Array:
    return np.random.default_rng(seed).integers(0, 256, (height, width, channels), np.uint8)


def cube(*, parts: tuple[str, ...] = ("NORMAL", "TEXCOORD_0"), **material: Any) -> GltfFile:
    """A cube with a texture, as mesh 0 'Cube' of material 0 'Paint' on node 0 'Place'."""
    file, shape = GltfFile(), box()
    values = {"NORMAL": shape.normals, "TEXCOORD_0": shape.uv, "TANGENT": shape.tangents}
    attributes = {name: file.array(values[name]) for name in parts}
    primitive = {**file.primitive(shape.positions, shape.indices, **attributes), "material": 0}
    file.add("meshes", name="Cube", primitives=[primitive])
    pbr = {"baseColorTexture": {"index": file.texture(noise(0))}, "metallicFactor": 0.25}
    file.add("materials", name="Paint", **{"pbrMetallicRoughness": pbr, **material})
    file.add("nodes", name="Place", mesh=0)
    return file


def strip() -> GltfFile:
    """A flat strip, two joints high; the upper one, node 2, turns and shifts in a clip of a second.

    The joints hang on node 1, which is away from the mesh's node 0; both are bound where they are.
    """
    file = GltfFile()
    y = np.repeat(np.linspace(0.0, 2.0, 5), 2)
    positions = np.stack([np.tile([-0.5, 0.5], 5), y, np.zeros(10)], axis=1)
    faces = [(i + a, i + b, i + c) for i in range(0, 8, 2) for a, b, c in ((0, 1, 2), (1, 3, 2))]
    upper = np.clip(y - 0.5, 0.0, 1.0)
    weights = np.stack([1.0 - upper, upper, 0 * y, 0 * y], axis=1)
    attributes = {
        "NORMAL": file.array(np.tile([0.0, 0.0, 1.0], (10, 1))),
        "JOINTS_0": file.array(np.tile([0, 2, 0, 0], (10, 1)), "uint8"),
        "WEIGHTS_0": file.array(weights),
    }
    file.add("meshes", name="Strip", primitives=[file.primitive(positions, faces, **attributes)])
    binds = np.tile(np.eye(4), (3, 1, 1))
    binds[2, 1, 3] = -1.0
    matrices = file.array(binds.transpose(0, 2, 1).reshape(3, 16))
    file.add("skins", joints=[1, 3, 2], inverseBindMatrices=matrices)
    file.add("nodes", mesh=0, skin=0, translation=[5.0, 5.0, 5.0])  # glTF: of no effect
    file.add("nodes", children=[2, 3])
    file.add("nodes", translation=[0.0, 1.0, 0.0])
    file.add("nodes")
    file.json["scenes"][0]["nodes"] = [0, 1]
    half = np.sqrt(0.5)
    file.channel("rotation", [0.0, 1.0], [[0, 0, 0, 1], [0, 0, half, half]])
    file.channel("translation", [0.0, 1.0], [[0, 1, 0], [1, 1, 0]])
    for channel in file.json["animations"][0]["channels"]:
        channel["target"]["node"] = 2
    return file
