"""The files of the page, and the page as a folder: all links in it are relative, so any file host will do."""

import json
import re
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from supersampler.errors import ShotError
from supersampler.io.files import (
    check_inside,
    is_own_folder,
    is_regular,
    is_there,
    os_errors_as_shot_error,
    remove_empty_folders,
    remove_files,
    write_bytes,
    write_text,
)
from supersampler.io.images import encode_exr
from supersampler.io.json_fields import Field, read_json
from supersampler.io.shot import Shot
from supersampler.methods.executors import with_shaders
from supersampler.methods.model_file import shipped_model

SHOT = "plaza"
RECORD = "site.json"
PACKAGES: Mapping[str, str] = {"three": "0.187.0", "onnxruntime-web": "1.30.0"}
"""Packages of npm and their versions, for three.html and for the fallback without WebGPU."""
SiteFiles: TypeAlias = Mapping[str, Callable[[], bytes]]
"""Functions that return the content of a file, by the file's path relative to the page's folder, with "/"."""
_FILES: Mapping[str, tuple[str, ...]] = {
    "three": ("build/three.core.js", "build/three.webgpu.js", "build/three.tsl.js", "LICENSE"),
    "onnxruntime-web": (
        "dist/ort.wasm.min.mjs",
        "dist/ort-wasm-simd-threaded.mjs",
        "dist/ort-wasm-simd-threaded.wasm",
        "dist/ort.webgpu.min.mjs",
        "dist/ort-wasm-simd-threaded.asyncify.mjs",
        "dist/ort-wasm-simd-threaded.asyncify.wasm",
    ),
}
_WRITTEN_BY = "supersampler demo --web"
_MOST_FILES = 10_000
_STALE = re.compile(
    r"(models|onnx|shot|vendor|page|scene|three)(/[\w-]+)*/[\w.-]+\.(wgsl|bin|json|onnx|exr|m?js|wasm)",
    re.ASCII,
)
"""Names that another version may have written: of those that a record lists, no others are removed."""
_FOREIGN = "Move it away, or choose another folder."


def site_files(
    shader_files: Callable[[str], Mapping[str, bytes]], *, node_modules: Path | None = None
) -> dict[str, Callable[[], bytes]]:
    """Return the files of the page: its own, shaders, graphs and the shipped shot.

    Args:
        shader_files: returns the shaders of a method by name: `supersampler_export.shaders.folder`.
        node_modules: npm's folder with PACKAGES; None, or a package that it lacks: the parts of the page that
            need it say so.

    Raises:
        ShotError: a package is damaged, or has another version.
    """
    page = page_files()
    found = {path.relative_to(page).as_posix(): path for path in page.rglob("*") if path.is_file()}
    for method in with_shaders():
        for name in ("model.json", "step.onnx"):
            found[f"onnx/{method}/{name}"] = shipped_model(method) / name
    for name, package in _packages(node_modules).items():
        found |= {f"vendor/{name}/{Path(file).name}": package / file for file in _FILES[name]}
    shot = Shot.open(SHOT)
    found |= {f"shot/{path.name}": path for path in sorted(shot.source.glob("*.*"))}
    files: dict[str, Callable[[], bytes]] = {name: partial(_content, path) for name, path in found.items()}
    for index in shot.reference_indices:
        files[f"shot/reference/{index:04d}.exr"] = cache(partial(_reference, shot, index))
    for method in with_shaders():
        for name, data in shader_files(method).items():
            files[f"models/{method}/{name}"] = partial(bytes, data)
    return files


def write_site(folder: Path, files: SiteFiles) -> None:
    """Write the page as a folder. Files of an earlier call are replaced or removed, and no others.

    Args:
        folder: to write to; it may hold other files, under other names.
        files: as `site_files` returns them.

    Raises:
        ShotError: the folder holds a file of another program under the name of one of these; or links that
            lead out of it; or the disk refuses.
    """
    listed = [name for name in _listed(folder) if name in files or _STALE.fullmatch(name)]
    check_inside(folder, [folder / name for name in (RECORD, *listed, *files)])
    for name in (*files, *listed):
        path = folder / name
        if is_there(path) and not (name in listed and is_regular(path)):
            raise ShotError(path, f"is there already, and {RECORD} does not list it", _FOREIGN)
    _record(folder, {*listed, *files})
    stale = [folder / name for name in listed if name not in files]
    remove_files(stale)
    below = {parent for path in stale for parent in path.parents if folder in parent.parents}
    remove_empty_folders(sorted(filter(is_own_folder, below), key=lambda path: len(path.parts), reverse=True))
    for name, content in files.items():
        write_bytes(folder / name, content())
    _record(folder, set(files))


def page_files() -> Path:
    """Return the folder of the page's own files: beside this module, or in a checkout's examples/."""
    shipped = Path(__file__).parent / "page"
    return shipped if shipped.is_dir() else Path(__file__).parents[4] / "examples" / "web"


def _record(folder: Path, names: set[str]) -> None:
    """Write the list of the files that are this page's."""
    content = {"written_by": _WRITTEN_BY, "files": sorted(names)}
    write_text(folder / RECORD, json.dumps(content, indent=1) + "\n")


def _listed(folder: Path) -> list[str]:
    """Return the names that the record of an earlier call lists; ShotError where it is none."""
    path = folder / RECORD
    if not is_there(path):
        return []
    record = Field(path, "the file", read_json(path) if is_regular(path) else None)
    if not isinstance(record.value, dict) or record.value.get("written_by") != _WRITTEN_BY:
        raise ShotError(path, f"was not written by `{_WRITTEN_BY}`", _FOREIGN)
    return [item.text() for item in record["files"].items(_MOST_FILES)]


def _content(path: Path) -> bytes:
    with os_errors_as_shot_error(path):
        return path.read_bytes()


def _reference(shot: Shot, index: int) -> bytes:
    """Return a reference as half floats, packed in a way that the page can read."""
    return encode_exr(np.asarray(shot.read_reference(index), np.float16))


def _packages(node_modules: Path | None) -> dict[str, Path]:
    """Return the folders of the packages that are installed."""
    found = {}
    for name, tested_version in PACKAGES.items():
        if node_modules is None:
            continue
        package = node_modules / name
        file = package / "package.json"
        if not is_there(file):
            continue
        version = Field(file, "the file", read_json(file))["version"].text()
        if version != tested_version:
            hint = f"Install it: npm install {name}@{tested_version}"
            raise ShotError(package, f"is version {version}; the page is tested with {tested_version}", hint)
        found[name] = package
    return found
