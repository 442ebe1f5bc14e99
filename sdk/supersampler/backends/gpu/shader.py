"""WGSL sources: imports, constants and the bindings that a pass declares."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from supersampler.backends.gpu.declarations import Part, needed, parsed
from supersampler.backends.gpu.unrolling import unrolled

SHARED = "supersampler.backends.gpu"
_IMPORT = re.compile(r"^// import (\w+)\n", re.MULTILINE)
_BINDING = re.compile(r"@group\((\d+)\) @binding\((\d+)\) var(?:<([^>]*)>)? (\w+): ([^;]+);")
_STORAGE_TEXTURE = re.compile(r"texture_storage_2d<(\w+), write>")
Constants = Mapping[str, float | int | bool]


@dataclass(frozen=True)
class Binding:
    """A resource that a pass declares.

    Attributes:
        group: bind group.
        index: binding in it.
        name: of the variable, which is that of the resource.
        kind: "uniform", "storage", "read-only-storage", "texture", "uint-texture" or "storage-texture".
        format: of a storage texture, else "".
    """

    group: int
    index: int
    name: str
    kind: str
    format: str = ""

    @property
    def writes(self) -> bool:
        """Whether the pass writes the resource."""
        return self.kind in ("storage", "storage-texture")

    @property
    def is_texture(self) -> bool:
        """Whether it is a texture, and no buffer."""
        return self.kind.endswith("texture")

    def layout(self) -> dict[str, Any]:
        """Return the entry of a bind group layout."""
        entry: dict[str, Any] = {"binding": self.index, "visibility": 4}  # of compute shaders
        if self.kind == "storage-texture":
            entry["storage_texture"] = {"access": "write-only", "format": self.format}
        elif self.is_texture:
            kind = "uint" if self.kind == "uint-texture" else "unfilterable-float"
            entry["texture"] = {"sample_type": kind}
        else:
            entry["buffer"] = {"type": self.kind}
        return entry


@dataclass(frozen=True)
class Shader:
    """The source of one pass.

    Attributes:
        name: of the file, without its suffix.
        code: complete WGSL: what `main` needs.
        bindings: the resources that it uses.
    """

    name: str
    code: str
    bindings: tuple[Binding, ...]


def load_shader(
    name: str, folders: Sequence[str], constants: Constants, variants: Mapping[str, str] | None = None
) -> Shader:
    """Return a shader after what it needs of the files that it imports (`// import NAME`), each once.

    Loops that are marked with `/* unroll */` are written out (`unrolled`).

    Args:
        name: of its file, without the suffix.
        folders: packages with a folder `shaders`; those of `backends.gpu` are found always.
        constants: written first, as `const NAME = value;`.
        variants: files to import in place of a name.
    """
    parts: dict[str, Part] = {"": parsed(_constants_text(constants))}
    _collect(name, (*folders, SHARED), variants or {}, parts)
    code = unrolled(needed(parts.values()))
    return Shader(name, code, tuple(_bindings(code)))


def _collect(name: str, folders: Sequence[str], variants: Mapping[str, str], parts: dict[str, Part]) -> None:
    if name in parts:
        return
    imports, part = _source(variants.get(name, name), tuple(folders))
    for imported in imports:
        _collect(imported, folders, variants, parts)
    parts[name] = part


@cache
def _source(name: str, folders: tuple[str, ...]) -> tuple[list[str], Part]:
    """Return what a file imports, and the rest of it."""
    for folder in folders:
        file = files(folder) / "shaders" / f"{name}.wgsl"
        if file.is_file():
            text = file.read_text(encoding="utf-8")
            return _IMPORT.findall(text), parsed(_IMPORT.sub("", text))
    raise FileNotFoundError(f"{name}.wgsl in {', '.join(folders)}")


def _constants_text(constants: Constants) -> str:
    return "".join(f"const {name.upper()} = {_literal(value)};\n" for name, value in constants.items())


def _literal(value: float | int | bool) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, int) else repr(float(value))


def _bindings(code: str) -> list[Binding]:
    found = []
    for group, index, space, name, kind in _BINDING.findall(code):
        texture = _STORAGE_TEXTURE.match(kind)
        if space:
            of = {"uniform": "uniform", "storage, read": "read-only-storage"}.get(space, "storage")
        elif texture:
            of = "storage-texture"
        else:
            of = "uint-texture" if kind == "texture_2d<u32>" else "texture"
        found.append(Binding(int(group), int(index), name, of, texture[1] if texture else ""))
    return sorted(found, key=lambda b: (b.group, b.index))
