"""Write the page as a folder of static files: all links in it are relative, so any file host will do."""

import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from supersampler.errors import ShotError
from supersampler.io.files import os_errors_as_shot_error, write_text
from supersampler.io.images import write_exr
from supersampler.io.shot import Shot
from supersampler.methods.model_file import shipped_model

METHODS = ("classifier", "classifier-small", "classifier-large", "taau", "taa")
"""The methods of the page: those that have shaders."""
SHOT = "plaza"
RECORD = "site.json"
PACKAGES: Mapping[str, str] = {"three": "0.187.0", "onnxruntime-web": "1.30.0"}
"""Packages of npm and their versions, for three.html and for the fallback without WebGPU."""
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


def write_site(
    folder: Path, write_shaders: Callable[[str, Path], None], *, node_modules: Path | None = None
) -> None:
    """Write the page, shaders, graphs and the shipped shot.

    A folder that an earlier call wrote is replaced; one that holds anything else is an error.

    Args:
        folder: to write.
        write_shaders: writes the WGSL folder of a method: `supersampler_export.shaders.folder`.
        node_modules: npm's folder with PACKAGES; None, or a package that it lacks: the parts of the page that
            need it say so.

    Raises:
        ShotError: the folder holds other files, a package has another version, or the disk refuses.
    """
    folder = Path(folder)
    found = {name: _package(node_modules, name) for name in PACKAGES} if node_modules else {}
    _clear(folder)
    with os_errors_as_shot_error(folder, "written"):
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / RECORD, json.dumps({"written_by": "supersampler demo --web"}) + "\n")
        shutil.copytree(page_files(), folder, dirs_exist_ok=True)
        for method in METHODS:
            write_shaders(method, folder / "models" / method)
            (folder / "onnx" / method).mkdir(parents=True)
            for name in ("model.json", "step.onnx"):
                shutil.copyfile(shipped_model(method) / name, folder / "onnx" / method / name)
        _write_shot(folder / "shot")
        for name, package in found.items():
            if package is not None:
                _copy_package(package, folder / "vendor" / name, _FILES[name])


def page_files() -> Path:
    """Return the folder of the page's own files: beside this module, or in a checkout's examples/."""
    shipped = Path(__file__).parent / "page"
    return shipped if shipped.is_dir() else Path(__file__).parents[4] / "examples" / "web"


def _clear(folder: Path) -> None:
    """Remove what an earlier call wrote."""
    if not folder.exists():
        return
    if not folder.is_dir() or (any(folder.iterdir()) and not (folder / RECORD).is_file()):
        raise ShotError(folder, "holds files that are not of this page", "Choose another folder.")
    with os_errors_as_shot_error(folder, "removed"):
        shutil.rmtree(folder)


def _write_shot(folder: Path) -> None:
    """Copy the shipped shot; its references as half floats, packed in a way that the page can read."""
    shot = Shot.open(SHOT)
    folder.mkdir(parents=True)
    for path in sorted(shot.source.glob("*.*")):
        shutil.copyfile(path, folder / path.name)
    for index in shot.reference_indices:
        reference = np.asarray(shot.read_reference(index), np.float16)
        write_exr(folder / "reference" / f"{index:04d}.exr", reference)


def _package(node_modules: Path, name: str) -> Path | None:
    """Return the folder of a package; None where it is not installed."""
    package = node_modules / name
    if not (package / "package.json").is_file():
        return None
    version = json.loads((package / "package.json").read_text("utf-8"))["version"]
    if version != PACKAGES[name]:
        hint = f"Install it: npm install {name}@{PACKAGES[name]}"
        raise ShotError(package, f"is version {version}; the page is tested with {PACKAGES[name]}", hint)
    return package


def _copy_package(package: Path, folder: Path, names: tuple[str, ...]) -> None:
    folder.mkdir(parents=True)
    for name in names:
        shutil.copyfile(package / name, folder / Path(name).name)
