"""Writing of a shader folder: a shader for each pass, the weights, and upscaler.json."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any, Literal

from supersampler.errors import ArgumentError, ShotError
from supersampler.io.files import check_ours, remove_files, write_bytes
from supersampler.io.json_files import read_json
from supersampler.methods.executors import gpu_program, with_shaders
from supersampler.methods.model_file import read_upscaling_info
from supersampler_export.shaders.description import FORMAT, ExportedAovs, described, exported_passes

Images = Literal["textures", "buffers"]
DESCRIPTION = "upscaler.json"
_NAMES = re.compile(r"\d+_\w+\.wgsl|network\w*\.bin")
"""Names of files that an export writes. Other files that a description lists are never removed."""
LONGEST_LINE = 140
"""Longest line of upscaler.json with a whole list or object."""


def write_shader_folder(
    model: str | Path, folder: Path, *, images: Images = "textures", aovs: int = 0
) -> None:
    """Write the files of `shader_files` to a folder, in place of those of an earlier export.

    Raises:
        ShotError: existing files were not written by an export; nothing is written.
        ModelError, ArgumentError: see `shader_files`.
    """
    content = shader_files(model, images=images, aovs=aovs)
    before = _listed(folder)
    for name in content:
        check_ours(folder / name, lambda path: path.name in before, f"listed by {DESCRIPTION} next to it")
    remove_files(folder / name for name in before - content.keys())
    for name, data in content.items():
        write_bytes(folder / name, data)


def shader_files(model: str | Path, *, images: Images = "textures", aovs: int = 0) -> dict[str, bytes]:
    """Return the files of a model's shaders, in WGSL, by name, upscaler.json last.

    Args:
        model: a shipped model by name, or a model folder.
        images: kind of the resources that hold frame and image.
        aovs: channels of AOVs to blend; each texture holds four.

    Raises:
        ModelError: the model does not exist or is damaged.
        ArgumentError: the model has no shaders.
    """
    info = read_upscaling_info(model)
    program = gpu_program(info)
    if program is None:
        want = f"one with shaders: {', '.join(with_shaders())}"
        hint = "Without --target, the method is exported for ONNX Runtime."
        raise ArgumentError("METHOD", got=repr(info.method), want=want, hint=hint)
    blended = ExportedAovs.of(aovs, images)
    passes = exported_passes(program, images, blended)
    content = {one.file: one.shader.code.encode() for one in passes}
    content |= {f"{name}.bin": words.astype("<u4").tobytes() for name, words in program.weights.items()}
    description = described(info, program, images, blended, passes)
    description["files"] = {name: hashlib.sha256(data).hexdigest() for name, data in content.items()}
    return {**content, DESCRIPTION: f"{_json(description)}\n".encode()}


def _json(value: Any, indent: str = "") -> str:
    """Return JSON in which each list and object takes one line if it fits."""
    flat = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict | list) or len(indent) + len(flat) <= LONGEST_LINE:
        return flat
    inner = f"{indent} "
    if isinstance(value, list):
        items, (opening, closing) = [_json(item, inner) for item in value], "[]"
    else:
        items = [f"{json.dumps(key)}: {_json(item, inner)}" for key, item in value.items()]
        opening, closing = "{}"
    lines = f",\n{inner}".join(items)
    return f"{opening}\n{inner}{lines}\n{indent}{closing}"


def _listed(folder: Path) -> set[str]:
    """Return the names of an earlier export's files, as far as an export can have written them."""
    try:
        found = read_json(folder / DESCRIPTION)
    except ShotError:
        return set()
    files = found.get("files") if isinstance(found, dict) and found.get("format") == FORMAT else None
    return {DESCRIPTION, *filter(_NAMES.fullmatch, files)} if isinstance(files, dict) else set()
