"""Write the folder: a shader for each pass, weights, and upscaler.json last."""

import hashlib
import json
from pathlib import Path
from typing import Any, Literal

from supersampler.errors import ArgumentError, ShotError
from supersampler.io.atomic import check_ours, remove_files, replacing
from supersampler.io.json_fields import read_json
from supersampler.methods.gpu_backends import gpu_program, with_shaders
from supersampler.methods.model_file import read_upscaling_info
from supersampler_export.shaders.description import FORMAT, described, exported_passes

Images = Literal["textures", "buffers"]
DESCRIPTION = "upscaler.json"


def write_shader_folder(model: str | Path, folder: Path, images: Images = "textures") -> None:
    """Write the shaders of a model.

    Args:
        model: a shipped model by name, or a model folder.
        folder: to write to; files of an earlier export in it are replaced.
        images: whether the shaders take frame and image in textures or in buffers.

    Raises:
        ModelError: there is no such model, or it is damaged.
        ArgumentError: the model has no shaders.
        ShotError: files in the way were not written by an export; nothing is written.
    """
    info = read_upscaling_info(model)
    program = gpu_program(info)
    if program is None:
        hint = "`supersampler export METHOD -o FOLDER` writes it for ONNX Runtime."
        raise ArgumentError("METHOD", got=repr(info.method), want=f"one with shaders: {with_shaders()}", hint=hint)
    passes = exported_passes(program, images)
    description = described(info, program, passes, images)
    content = {f"{one.name}.wgsl": one.shader.code.encode() for one in passes}
    for one, entry in zip(passes, description["passes"], strict=True):
        entry["file"] = f"{one.name}.wgsl"
    content |= {f"{name}.bin": words.astype("<u4").tobytes() for name, words in program.weights.items()}
    description["target"] = "wgsl"
    _write(folder, description, content)


def _write(folder: Path, description: dict[str, Any], content: dict[str, bytes]) -> None:
    description["files"] = {name: hashlib.sha256(data).hexdigest() for name, data in content.items()}
    before = _listed(folder)
    for name in (*content, DESCRIPTION):
        check_ours(folder / name, lambda path: path.name in before, f"listed by {DESCRIPTION} beside it")
    remove_files(folder / name for name in before - {*content, DESCRIPTION})
    content[DESCRIPTION] = f"{json.dumps(description, indent=1)}\n".encode()
    for name, data in content.items():
        with replacing(folder / name) as partial:
            partial.write_bytes(data)


def _listed(folder: Path) -> set[str]:
    """Return the names of the files of an earlier export."""
    try:
        found = read_json(folder / DESCRIPTION)
    except ShotError:
        return set()
    if not isinstance(found, dict) or found.get("format") != FORMAT or not isinstance(found.get("files"), dict):
        return set()
    return {DESCRIPTION, *(name for name in found["files"] if Path(name).name == name)}
