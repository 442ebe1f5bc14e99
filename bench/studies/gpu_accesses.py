"""Compare the accesses that shaders declare, as `bench traffic` counts them, with those that they make.

    python bench/studies/gpu_accesses.py --json FILE --update docs/explanation/gpu-backend.md

Each access of an instrumented shader marks the element that it touches. Counted are marked elements, in
bytes, of the last of STEPS steps on the shipped shot, whose exposure is measured. Needs a device with more
storage buffers than WebGPU's default.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
import typer

from supersampler import Model, Shot, Upscaler
from supersampler.backends.gpu.device import LIMITS, default_device
from supersampler.backends.gpu.executor import GpuExecutor
from supersampler.backends.gpu.memory import TEXELS, BufferSpec, TextureSpec, allocate, read_back, write_to
from supersampler.backends.gpu.passes import Pass
from supersampler.backends.gpu.program import ARRAYS
from supersampler.backends.gpu.shader import Binding, Shader
from supersampler.frame import Size
from supersampler_bench.cli.options import JSON, METHODS, UPDATE, check_page, listed, publish
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.record import Record
from supersampler_bench.timing.gpu_traffic import Access, accesses, closing

BLOCK, STEPS = "study gpu accesses", 3
ELEMENTS = {"Sums": 64, "vec4f": 16, "vec4u": 16, "vec2u": 8, "vec2f": 8, "f32": 4, "u32": 4}
"""Bytes of the elements of storage buffers; others hold values of a whole frame."""
MARKS = Binding(0, 31, "marks", "storage")
HELPERS = """
@group(0) @binding(31) var<storage, read_write> marks: array<atomic<u32>>;
fn mark(i: u32) { atomicOr(&marks[i / 32u], 1u << (i % 32u)); }
"""
_FUNCTION = re.compile(r"^(?P<head>(?:@[^\n]*\n)*)fn (?P<name>\w+)\(", re.MULTILINE)
_TEXTURE = re.compile(r"(\w+): texture_2d<\w+>,?\s*")


class Region(NamedTuple):
    """The marks of an access: from `first` on, of `elements` of `size` bytes each; `width` of a texture."""

    access: Access
    first: int
    elements: int
    size: int
    width: int = 0


def regions_of(executor: GpuExecutor, render: Size, display: Size) -> list[Region]:
    """Return where each access of a step is marked."""
    specs, passes = executor.program.specs(render, display), executor.passes(ARRAYS)
    first, regions = 0, []
    for access in accesses(executor, render, display, ARRAYS):
        if access.bytes == 0:  # the deepest level pools nothing
            continue
        memory, code = specs.get(access.resource), passes[access.number].shader.code
        kind = re.search(rf"\b{access.binding.name}: array<(?:atomic<)?(\w+)", code)
        if isinstance(memory, TextureSpec):
            element, width = TEXELS[memory.format], memory.size[0]
        elif memory is not None and kind is not None:
            element, width = ELEMENTS[kind[1]], 0
        else:
            continue
        regions.append(Region(access, first, memory.bytes // element, element, width))
        first += regions[-1].elements
    return regions


def arguments(code: str, opening: int) -> list[str]:
    """Return the arguments of the call whose bracket is at `opening`."""
    parts, depth, end = [""], 0, closing(code, opening)
    for letter in code[opening + 1 : end]:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


class Specialiser:
    """Writes a copy of each function for the textures that it is called with.

    Args:
        code: WGSL without comments.
    """

    def __init__(self, code: str) -> None:
        self.functions: dict[str, tuple[str, str, str]] = {}  # attributes, parameters, rest
        self.rest, at = "", 0
        for match in _FUNCTION.finditer(code):
            end = closing(code, match.end() - 1)
            last = closing(code, code.index("{", end))
            self.functions[match["name"]] = match["head"], code[match.end() : end], code[end + 1 : last + 1]
            self.rest += code[at : match.start()]
            at = last + 1
        self.rest += code[at:]
        self.written: dict[str, str] = {}

    def code(self) -> str:
        """Return the code of `main` and of all that it calls."""
        self._write("main", [])
        return self.rest + "\n".join(self.written.values())

    def _write(self, name: str, textures: Sequence[str]) -> str:
        """Write a function for these textures, and return its new name."""
        own = "__".join([name, *textures])
        if own not in self.written:
            head, parameters, body = self.functions[name]
            for parameter, texture in zip(_TEXTURE.findall(parameters), textures, strict=True):
                body = re.sub(rf"(?<!\.)\b{parameter}\b", texture, body)
            self.written[own] = ""  # its place, after those that it is called by
            text = f"{head}fn {own}({_TEXTURE.sub('', parameters)}){self._with_calls(body)}"
            self.written[own] = text
        return own

    def _with_calls(self, body: str) -> str:
        done, at = "", 0
        for match in re.finditer(r"\b(\w+)\(", body):
            if match[1] not in self.functions or match.start() < at:
                continue
            given = arguments(body, match.end() - 1)
            count = len(_TEXTURE.findall(self.functions[match[1]][1]))
            parameters = [part for part in self.functions[match[1]][1].split(",") if ":" in part]
            places = [i for i, part in enumerate(parameters) if "texture_2d<" in part]
            name = self._write(match[1], [given[i] for i in places[:count]])
            others = ", ".join(self._with_calls(g) for i, g in enumerate(given) if i not in places)
            done += f"{body[at : match.start()]}{name}({others})"
            at = closing(body, match.end() - 1) + 1
        return done + body[at:]


def instrumented(shader: Shader, regions: Sequence[Region]) -> Shader:
    """Return a shader that marks what it touches."""
    code = Specialiser(re.sub(r"//.*", "", shader.code)).code()
    helpers = [HELPERS]
    for region in regions:
        name, first = region.access.binding.name, f"{region.first}u"
        if region.access.binding.is_texture:
            pattern, kind, index = (
                rf"\btexture(?:Load|Store)\({name}, ",
                "vec2i",
                f"u32(i.y * {region.width} + i.x)",
            )
        else:
            pattern, kind, index = rf"\b{name}\[", "u32", "i"
        helpers.append(f"fn touched_{name}(i: {kind}) -> {kind} {{ mark({first} + {index}); return i; }}\n")
        for match in reversed(list(re.finditer(pattern, code))):
            inner = code[match.end() :]
            end = match.end() + _first_argument(inner)
            code = f"{code[: match.end()]}touched_{name}({code[match.end() : end]}){code[end:]}"
    bindings = (*_group(shader.bindings, 0), MARKS, *_group(shader.bindings, 1))
    return replace(shader, code=code + "".join(helpers), bindings=bindings)


def _group(bindings: Sequence[Binding], group: int) -> list[Binding]:
    return [binding for binding in bindings if binding.group == group]


def _first_argument(code: str) -> int:
    """Return the length of the argument or index with which `code` begins."""
    depth = 0
    for i, letter in enumerate(code):
        if depth == 0 and letter in ",)]":
            return i
        depth += (letter in "([{") - (letter in ")]}")
    raise ValueError(f"no end of {code[:40]!r}")


def touched(method: str, ratio: float) -> tuple[Size, Size, list[tuple[Region, int]]]:
    """Run a method's instrumented shaders; return the sizes, and the bytes touched in each region."""
    limits = {**LIMITS, "max-storage-buffers-per-shader-stage": 12}
    device = default_device().adapter.request_device_sync(required_limits=limits)
    model = Model.load(method, executor="gpu", device=device)
    shot = zip(Shot.open("plaza"), range(STEPS), strict=False)
    frames = [replace(shot_frame.frame, exposure=None) for shot_frame, _ in shot]
    render = frames[0].size
    display = round(render[0] * ratio), round(render[1] * ratio)
    regions = regions_of(model.gpu, render, display)
    words = -(-(regions[-1].first + regions[-1].elements) // 32)
    model.gpu.weights["marks"] = marks = allocate(device, BufferSpec(4 * words))
    for index, one in enumerate(model.gpu.passes(ARRAYS)):
        own = [region for region in regions if region.access.number == index]
        spec = model.gpu.program.passes[index]
        model.gpu.passes(ARRAYS)[index] = Pass(device, instrumented(one.shader, own), spec.tile, spec.names)
    upscaler = Upscaler(model, display_size=display, validate="off")
    for frame in frames:
        write_to(device, marks, np.zeros(words, np.uint32))
        upscaler.step(frame)
    bits = np.unpackbits(read_back(device, marks).view(np.uint8), bitorder="little")
    return render, display, [(r, int(bits[r.first : r.first + r.elements].sum()) * r.size) for r in regions]


def accesses_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    rows = []
    for row in record["methods"]:
        declared, found = row["declared"], row["touched"]
        sums = f"{declared / 1e6:.1f}", f"{found / 1e6:.1f}", f"{found / declared:.3f}"
        rows.append([row["method"], *sums, f"{row['worst']} {row['least']:.2f}"])
    render, display = (size_text(record[name]) for name in ("render", "display"))
    caption = (
        f"MB of a step, {render} to {display}, frame and image in buffers: as declared, and elements that "
        f"instrumented shaders touch. Last column: the access with the least touched part."
    )
    return table(["method", "declared:", "touched:", "touched / declared:", "least:"], rows, caption)


def main(
    methods: METHODS = "taa,taau,classifier-small,classifier",
    ratio: Annotated[float, typer.Option(help="Display over render size.")] = 2.0,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Compare declared and actual accesses of the GPU backend's shaders."""
    check_page(update, {BLOCK: accesses_table})
    rows = []
    for method in listed(methods):
        render, display, found = touched(method, ratio)
        parts = {f"{r.access.shader}.{r.access.binding.name}": size / r.access.bytes for r, size in found}
        worst = min(parts, key=lambda name: parts[name])
        sums = {"declared": sum(r.access.bytes for r, _ in found), "touched": sum(size for _, size in found)}
        rows.append({"method": method, **sums, "worst": worst, "least": parts[worst], "parts": parts})
    record = {"bench": "gpu_accesses", "render": render, "display": display, "methods": rows}
    publish(record, {BLOCK: accesses_table}, json, update)


if __name__ == "__main__":
    typer.run(main)
