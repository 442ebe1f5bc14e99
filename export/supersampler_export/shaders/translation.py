"""Translate WGSL to SPIR-V, HLSL and MSL with naga, which npm installs in a cache folder; it runs in Node."""

import base64
import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from supersampler.errors import SupersamplerError

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
    done = _run([_program("node"), str(folder / "translate.mjs")], folder, json.dumps(request))
    answer = json.loads(done)
    if "error" in answer:
        raise TranslationError(f"naga refused a shader. {answer['error']}")
    return {name: base64.b64decode(code) for name, code in answer.items()}


def _installed() -> Path:
    """Return the folder with naga, where npm installs it the first time and checks its hash."""
    source = files("supersampler_export.shaders") / "naga"
    content = {name: (source / name).read_bytes() for name in PACKAGE}
    key = hashlib.sha256(b"".join(content.values())).hexdigest()[:16]
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "supersampler" / "naga"
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
                (partial / name).write_bytes(data)
            _run([npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"], partial, "")
            if not folder.is_dir():  # another process may have been faster
                partial.rename(folder)
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


def _run(command: list[str], folder: Path, given: str) -> str:
    try:
        done = subprocess.run(  # noqa: S603  # node and npm, as PATH has them
            command, cwd=folder, input=given, capture_output=True, text=True, timeout=SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        raise TranslationError(f"{Path(command[0]).name} took more than {SECONDS} s. Try again.") from None
    if done.returncode:
        text = " ".join((done.stderr or done.stdout).split())[-400:]
        hint = "The first time npm needs its registry" if command[1] == "ci" else f"Remove {folder}"
        raise TranslationError(f"{Path(command[0]).name} failed: {text}. {hint}.")
    return done.stdout
