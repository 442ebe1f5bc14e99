"""Differences between the targets: file names, entry points, and where resources are bound."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from supersampler.backends.gpu.shader import Binding
from supersampler_export.shaders.translation import OPTIONS

SUFFIXES: Mapping[str, str] = {"wgsl": "wgsl", "spirv": "spv", "hlsl": "hlsl", "msl": "metal"}
"""Ends of file names, by target."""
_REGISTER = re.compile(r"register\(([btu])(\d+)(?:, space(\d+))?\)")
_ZERO = re.compile(r"(dot4add_i8packed\([^()]*, )0\)")
_KERNEL = re.compile(r"kernel void (\w+)\((.*?)\n\)", re.DOTALL)
_FAKE = "[[user(fake0)]]"
_SIZES = re.compile(r"struct _mslBufferSizes \{(.*?)\}", re.DOTALL)


_SPIRV_HEADER, _EXTENSION, _CAPABILITY = 5, 10, 17  # words; opcodes
CAPABILITIES: Mapping[int, str] = {
    1: "Shader",
    39: "Int8",
    49: "StorageImageExtendedFormats",
    50: "ImageQuery",
    6018: "DotProductInput4x8BitPacked",
    6019: "DotProduct",
}
"""Names of SPIR-V's capabilities."""


class Placed(NamedTuple):
    """A shader of a target.

    Attributes:
        code: of its file.
        entry_point: name of its function.
        slots: where its bindings are, beyond group and binding.
        buffer_sizes: in Metal, the buffer that takes sizes of others in bytes, and the variables of these.
    """

    code: bytes
    entry_point: str
    slots: Sequence[Mapping[str, Any]]
    buffer_sizes: tuple[int, list[str]] | None = None


def _same(code: bytes, bindings: Sequence[Binding]) -> Placed:
    """Sets and bindings of SPIR-V are groups and bindings of WGSL."""
    return Placed(code, "main", [{} for _ in bindings])


def _hlsl(code: bytes, bindings: Sequence[Binding]) -> Placed:
    """Bindings are registers. DXC refuses a plain 0 as the third argument of dot4add_i8packed."""
    text = _ZERO.sub(r"\1int(0))", code.decode())
    registers = {
        (int(space or 0), int(number)): {"register": kind + number, "space": int(space or 0)}
        for kind, number, space in _REGISTER.findall(text)
    }
    return Placed(text.encode(), "main", [registers[b.group, b.index] for b in bindings])


def _msl(code: bytes, bindings: Sequence[Binding]) -> Placed:
    """Number buffers and textures in the order of the kernel's arguments; the sizes of buffers come last."""
    text = code.decode()
    kernel = _KERNEL.search(text)
    if kernel is None:
        raise ValueError("naga wrote no kernel")
    slots: dict[str, dict[str, Any]] = {}
    variables: list[str] = []  # of the module, which naga numbers
    arguments: list[str] = []
    for argument in kernel[2].split("\n, "):
        if _FAKE in argument:
            kind = "texture" if "texture2d<" in argument else "buffer"
            name = _without_number(argument.partition(_FAKE)[0].split()[-1])
            slots[name] = {kind: sum(kind in slot for slot in slots.values())}
            argument = argument.replace(_FAKE, f"[[{kind}({slots[name][kind]})]]")
            variables.append(name)
        elif "threadgroup " in argument:
            variables.append("")
        arguments.append(argument)
    text = text[: kernel.start(2)] + "\n, ".join(arguments) + text[kernel.end(2) :]
    sizes, taken = _SIZES.search(text), None
    if sizes is not None:
        of = [variables[int(number)] for number in re.findall(r"uint size(\d+);", sizes[1])]
        taken = slots["_buffer_sizes"]["buffer"], of
    return Placed(text.encode(), kernel[1], [slots[b.name] for b in bindings], taken)


def _without_number(name: str) -> str:
    """Return the name of a variable without what naga appends to make it unique."""
    return name if name.startswith("_") else re.sub(r"_\d*$", "", name)


PLACE: Mapping[str, Callable[[bytes, Sequence[Binding]], Placed]] = {
    "wgsl": _same,
    "spirv": _same,
    "hlsl": _hlsl,
    "msl": _msl,
}
"""Functions that take the code and the bindings in WGSL, by target."""


def needs(target: str, shaders: Sequence[Placed]) -> dict[str, Any]:
    """Return what shaders of a target need: its version, and capabilities and extensions of SPIR-V."""
    if target == "hlsl":
        return {"shader_model": OPTIONS["hlsl"]["shaderModel"].replace("_", ".")}
    if target == "msl":
        return {"metal": ".".join(map(str, OPTIONS["msl"]["langVersion"]))}
    if target != "spirv":
        return {}
    found: dict[str, set[str]] = {"capabilities": set(), "extensions": set()}
    for shader in shaders:
        for kind, name in _declared(shader.code):
            found[kind].add(name)
    return {f"spirv_{kind}": sorted(names) for kind, names in found.items()}


def _declared(code: bytes) -> Iterator[tuple[str, str]]:
    """Yield the capabilities and extensions that a SPIR-V module declares, at its beginning."""
    words = memoryview(code).cast("I")
    at = _SPIRV_HEADER
    while (opcode := words[at] & 0xFFFF) in (_CAPABILITY, _EXTENSION):
        count = words[at] >> 16
        if opcode == _CAPABILITY:
            yield "capabilities", CAPABILITIES.get(words[at + 1], str(words[at + 1]))
        else:
            yield "extensions", bytes(words[at + 1 : at + count]).rstrip(b"\0").decode()
        at += count
