"""No glTF file harms its reader: damaged bytes, damaged JSON, damaged images."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fuzzing import damaged, dumped, examples, replaced, run_apart
from gltf_files import GltfFile, cube, glb, strip
from supersampler_model.data.scenes.gltf import GltfScene


def with_damaged_image(file: GltfFile, rng: np.random.Generator) -> bytes:
    """Change bytes of the PNG alone, where there is one."""
    views = [file.json["bufferViews"][image["bufferView"]] for image in file.json.get("images", [])]
    binary = file.binary
    for view in views:
        begin, end = view["byteOffset"], view["byteOffset"] + view["byteLength"]
        image = damaged(binary[begin:end], rng)[: end - begin]
        binary = binary[:begin] + image.ljust(end - begin, b"\0") + binary[end:]
    return glb(json.dumps(content_of(file)).encode(), binary)


def content_of(file: GltfFile) -> dict[str, object]:
    return {**file.json, "buffers": [{"byteLength": len(file.binary)}]}


def with_other_json(file: GltfFile, rng: np.random.Generator) -> bytes:
    content = content_of(file)
    for _ in range(int(rng.integers(1, 4))):
        content = replaced(content, rng)
    return glb(dumped(content), file.binary)


def prepare() -> Callable[[int], object]:
    files = [cube(), strip()]

    def run(case: int) -> None:
        rng, file = np.random.default_rng(case), files[case % 2]
        kind = rng.random()
        if kind < 0.6:
            data = with_other_json(file, rng)
        elif kind < 0.8:
            data = with_damaged_image(file, rng)
        else:
            data = damaged(glb(json.dumps(content_of(file)).encode(), file.binary), rng)
        path = Path("case.glb")
        path.write_bytes(data)
        scene = GltfScene(path)
        for clip in range(min(len(scene.clips), 2)):
            scene.instances(0.5, 0.4, np.eye(4), clip=clip)

    return run


def test_no_gltf_file_harms_its_reader() -> None:
    assert run_apart(prepare, examples(150)) == []
