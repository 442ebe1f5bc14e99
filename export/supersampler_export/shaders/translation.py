"""Translate WGSL to SPIR-V, HLSL and MSL with naga, which npm installs in a cache folder; it runs in Node."""

import base64
import hashlib
import json
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from supersampler.errors import SupersamplerError, printable
from supersampler.io.child_process import run
from supersampler.io.files import move_new_folder, user_cache, write_bytes, write_text

Target = Literal["wgsl", "spirv", "hlsl", "msl"]
OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "spirv": {"flags": {"adjustCoordinateSpace": False}},
    "hlsl": {"shaderModel": "6_4"},  # the first with dot4add_i8packed
    "msl": {"langVersion": [2, 4]},
}
"""Options of naga, by target."""
PACKAGE = ("package.json", "package-lock.json", "translate.mjs")
SECONDS = 300
"""Longest time that npm or a translation may take."""


class TranslationError(SupersamplerError, RuntimeError):
    """Shaders cannot be translated; the message says what is missing or what was refused."""


def translate(target: Target, sources: Mapping[str, str]) -> dict[str, bytes]:
    """Return shaders in another language, by the same names.

    Raises:
        TranslationError: Node or npm is missing, npm cannot install naga, or naga refuses a shader.
    """
    request = {"to": target, "options": OPTIONS[target], "sources": dict(sources)}
    folder = _installed()
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "request.json"
        write_text(file, json.dumps(request))
        done = _run([_program("node"), str(folder / "translate.mjs"), str(file)], folder)
    try:
        answer = {str(name): str(code) for name, code in json.loads(done).items()}
        if "error" in answer:
            raise TranslationError(f"naga refused a shader. {printable(answer['error'])}")
        return {name: base64.b64decode(answer[name], validate=True) for name in sources}
    except (ValueError, LookupError, AttributeError, RecursionError) as error:
        raise TranslationError(f"naga gave no answer ({error}). Remove {folder}.") from error


def _installed() -> Path:
    """Return the folder with naga, where npm installs it the first time and checks its hash."""
    source = files("supersampler_export.shaders") / "naga"
    content = {name: (source / name).read_bytes() for name in PACKAGE}
    key = hashlib.sha256(b"".join(content.values())).hexdigest()[:16]
    root = user_cache() / "naga"
    folder = root / key
    if folder.is_dir():
        return folder
    npm = _program("npm")
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=root) as made:
            partial = Path(made) / key
            partial.mkdir()
            for name, data in content.items():
                write_bytes(partial / name, data)
            _run([npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"], partial)
            if not folder.is_dir():  # another process may have been faster
                move_new_folder(partial, folder)
    except OSError as error:
        raise TranslationError(
            f"{root}: naga cannot be installed there ({error}). Set XDG_CACHE_HOME."
        ) from error
    return folder


def _program(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        raise TranslationError(
            f"{name} is not installed; it runs naga, which translates WGSL. Install Node.js 20 or newer with "
            "npm, or export --target wgsl, which needs neither."
        )
    return found


def _run(command: list[str], folder: Path) -> str:
    try:
        done = run(command, folder=folder, seconds=SECONDS)
    except subprocess.TimeoutExpired:
        raise TranslationError(f"{Path(command[0]).name} took more than {SECONDS} s. Try again.") from None
    if done.returncode:
        text = printable(" ".join((done.stderr or done.stdout).decode(errors="replace").split())[-400:])
        hint = "The first time npm needs its registry" if command[1] == "ci" else f"Remove {folder}"
        raise TranslationError(f"{Path(command[0]).name} failed: {text}. {hint}.")
    return done.stdout.decode(errors="replace")
