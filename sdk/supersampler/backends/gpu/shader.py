"""WGSL sources: imports, constants, and the declarations and bindings that an entry point needs.

Loops marked with `/* unroll */` are unrolled here: wgpu adds a counter to every loop, drivers then unroll
none, and the arrays that a loop indexes stay in memory. Mark only small loops that index arrays; unrolling
others only costs compile time.
"""

import re
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.resources import files
from typing import Any, NamedTuple

SHARED = "supersampler.backends.gpu"
SHARED_CONSTANTS = (
    "supersampler.io.display",
    "supersampler.methods.constants",
    "supersampler.methods.at_rest",
)
"""Modules whose constants shaders and the CPU library can use."""
GPU_CONSTANTS = "supersampler.backends.gpu.history"
"""Module whose constants only shaders can use."""
MAX_ROUNDS = 16
"""Largest number of iterations that are unrolled; longer loops would take long to compile."""
Number = float | int | bool
Constants = Mapping[str, Number]
Vector = tuple[float, float, float]

_IMPORT = re.compile(r"^// import (\w+)\n", re.MULTILINE)
_BINDING = re.compile(r"@group\((\d+)\) @binding\((\d+)\) var(?:<([^>]*)>)? (\w+): ([^;]+);")
_STORAGE_TEXTURE = re.compile(r"texture_storage_2d<(\w+), write>")
_NAME = re.compile(r"(?:@\w+(?:\([^)]*\))?\s*)*(?:fn|struct|alias|const|override|var(?:<[^>]*>)?)\s+(\w+)")
_COMMENT = re.compile(r"//[^\n]*")
_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")
_LOCAL = re.compile(r"\b(?:let|var|const)\s+(\w+)")
_PARAMETER = re.compile(r"(\w+)\s*:")
_MARK = "/* unroll */"
_LOOP = re.compile(r"/\* unroll \*/ for \(var (\w+) = (-?\d+)(u?); \1 (<=?) (\w+); \1\+\+\) \{")
_CONSTANT = re.compile(r"^const (\w+) = (\d+)u?;", re.MULTILINE)
_JUMP = re.compile(r"\b(?:break|continue)\b")


class Declaration(NamedTuple):
    """A function, structure, constant or variable of a module.

    Attributes:
        name: its name.
        text: its code, with the comments before it and at the end of its line.
        words: identifiers in it that may name other declarations.
    """

    name: str
    text: str
    words: frozenset[str]


class Part(NamedTuple):
    """A file: its first comment, and its declarations."""

    header: str
    declarations: list[Declaration]


@dataclass(frozen=True)
class Binding:
    """A resource that a pass declares.

    Attributes:
        group: index of the bind group.
        index: binding in the group.
        name: name of the variable.
        kind: "uniform", "storage", "read-only-storage", "texture", "uint-texture" or "storage-texture".
        format: format of a storage texture, else "".
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
        """Whether the resource is a texture rather than a buffer."""
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
        name: name of the file, without its suffix.
        code: `main` and all declarations that it needs, in WGSL.
        bindings: the resources that it uses.
    """

    name: str
    code: str
    bindings: tuple[Binding, ...]


def load_shader(
    name: str, folders: Sequence[str], constants: Constants, variants: Mapping[str, str] | None = None
) -> Shader:
    """Return a shader with the declarations that it needs of imported files (`// import NAME`).

    Args:
        name: name of its file, without the suffix.
        folders: packages of methods, with a folder `shaders` and a module `spec`. Shaders of `backends.gpu`
            are always found.
        constants: declared as `const NAME = value;`. They override constants of the same name in
            SHARED_CONSTANTS, GPU_CONSTANTS and the specs.
        variants: file to import in place of each name.
    """
    modules = *SHARED_CONSTANTS, GPU_CONSTANTS, *(f"{folder}.spec" for folder in reversed(folders))
    known = {key: value for module in modules for key, value in numbers_of(module).items()}
    known |= {key.upper(): value for key, value in constants.items()}
    parts = {"": Part("", [one for key, value in known.items() for one in _declarations(key, value)])}
    _collect(name, (*folders, SHARED), variants or {}, parts)
    code = unroll(reachable_code(parts.values()))
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
    """Return the imports of a file, and its declarations."""
    for folder in folders:
        file = files(folder) / "shaders" / f"{name}.wgsl"
        if file.is_file():
            text = file.read_text(encoding="utf-8")
            return _IMPORT.findall(text), parse(_IMPORT.sub("", text))
    raise FileNotFoundError(f"{name}.wgsl in {', '.join(folders)}")


@cache
def numbers_of(module: str) -> Mapping[str, Number | Vector]:
    """Return the public constants of a module that are numbers or triples of numbers, by name."""
    return {
        name: value
        for name, value in vars(import_module(module)).items()
        if name[0].isalpha() and name.isupper() and (_is_number(value) or _is_vector(value))
    }


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float))


def _is_vector(value: object) -> bool:
    return isinstance(value, tuple) and len(value) == 3 and all(map(_is_number, value))


def _declarations(name: str, value: Number | Vector) -> list[Declaration]:
    """Return `const NAME`, and for a float >= 0 `const NAME_BITS`, its bits in single precision."""
    found = [Declaration(name, f"const {name} = {_literal(value)};", frozenset())]
    if isinstance(value, float) and value >= 0.0:
        (bits,) = struct.unpack("<I", struct.pack("<f", value))
        found.append(Declaration(f"{name}_BITS", f"const {name}_BITS = {bits:#010x}u;", frozenset()))
    return found


def _literal(value: Number | Vector) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"vec3f({', '.join(map(_literal, value))})"
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


def parse(source: str) -> Part:
    """Return the declarations of a file, each with the comments before it.

    A first comment that an empty line follows belongs to the file.
    """
    header, blank, rest = source.partition("\n\n")
    if not blank or _COMMENT.sub("", header).strip():
        header, rest = "", source
    found = []
    while rest.strip():
        end = _end(rest)
        found.append(_declaration(rest[:end].strip()))
        rest = rest[end:]
    return Part(header.strip(), found)


def reachable_code(parts: Collection[Part]) -> str:
    """Return `main` and the declarations that it needs, in order, with the headers of the files."""
    known = {one.name: one for part in parts for one in part.declarations}
    reached, waiting = set[str](), ["main"]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += known[name].words & known.keys()
    kept = [Part(p.header, [one for one in p.declarations if one.name in reached]) for p in parts]
    return "\n".join(_text(part) for part in kept if part.declarations)


def _text(part: Part) -> str:
    """Return the code of a file, with an empty line around declarations of several lines."""
    text = f"{part.header}\n\n" if part.header else ""
    for index, one in enumerate(part.declarations):
        before = part.declarations[index - 1].text if index else one.text
        text += ("\n" if "\n" in before + one.text and index else "") + one.text + "\n"
    return text


def _end(source: str) -> int:
    """Return the end of the first declaration of a source, including a comment on its last line."""
    code, depth = _blanked(source), 0
    for at, letter in enumerate(code):
        depth += (letter in "([{") - (letter in ")]}")
        if depth == 0 and letter in ";}":
            line = source.find("\n", at)
            end = len(source) if line < 0 else line
            return end if not code[at + 1 : end].strip() else at + 1
    raise ValueError(f"no declaration: {source[:60]!r}")


def _declaration(text: str) -> Declaration:
    code = _COMMENT.sub("", text).strip()
    name = _NAME.match(code)
    if name is None:
        raise ValueError(f"no declaration: {text[:60]!r}")
    words = set(_WORD.findall(code)) - {name[1]}
    if "{" in code:
        head, _, body = code.partition("{")
        own = _LOCAL.findall(body) + _PARAMETER.findall(head if "fn " in head else body)
        words -= set(own)
    return Declaration(name[1], text, frozenset(words))


def unroll(code: str) -> str:
    """Replace each marked loop by its iterations: blocks in which the index is a constant.

    A marked loop is `/* unroll */ for (var i = FIRST; i < END; i++) {`, or with `<=`. FIRST is a number; END
    is a number or a numeric constant of the module. The loop neither breaks nor continues.

    Raises:
        ValueError: a marked loop has another form.
    """
    return _unroll(code, {name: int(value) for name, value in _CONSTANT.findall(code)})


def _unroll(code: str, constants: Mapping[str, int]) -> str:
    before, mark, _ = code.partition(_MARK)
    if not mark:
        return code
    loop = _LOOP.match(code, len(before))
    if loop is None:
        raise ValueError(f"no loop that can be unrolled: {_line(code, len(before))}")
    name, first, unsigned, sign, last = loop.groups()
    end = _closing(code, loop.end())
    if last not in constants and not last.removesuffix("u").isdigit():
        raise ValueError(f"{last} is not a constant number: {_line(code, len(before))}")
    stop = (constants[last] if last in constants else int(last.removesuffix("u"))) + (sign == "<=")
    body, after = _unroll(code[loop.end() : end], constants), _unroll(code[end + 1 :], constants)
    if _JUMP.search(_COMMENT.sub("", body)):
        raise ValueError(f"a loop that is unrolled has no break or continue: {_line(code, len(before))}")
    if stop - int(first) > MAX_ROUNDS:
        return f"{before}{loop[0].removeprefix(_MARK + ' ')}{body}}}{after}"
    kind = "u32" if unsigned else "i32"
    rounds = [f"{{ const {name}: {kind} = {i}{unsigned};{body}}}" for i in range(int(first), stop)]
    return before + "\n".join(rounds) + after


def _closing(code: str, begin: int) -> int:
    """Return the end of the block that begins at `begin`."""
    depth = 1
    for at, letter in enumerate(_blanked(code[begin:])):
        depth += (letter == "{") - (letter == "}")
        if depth == 0:
            return begin + at
    raise ValueError(f"a block without an end: {_line(code, begin)}")


def _line(code: str, at: int) -> str:
    return code[at:].partition("\n")[0].strip()


def _blanked(code: str) -> str:
    """Return code with spaces in place of comments."""
    return _COMMENT.sub(lambda comment: " " * len(comment[0]), code)
