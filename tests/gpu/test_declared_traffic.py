"""Declared accesses of GPU passes, which `bench traffic` counts, match the accesses of the shaders.

Each access by index, `buffer[i]` or `textureLoad(texture, p, 0)`, also sets a bit in a buffer that is bound
in addition. Values of a whole frame (`State`), parameters and weights are not recorded.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pytest

from gbuffer_method import lit
from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.backends.gpu.device import default_device, requested_limits
from supersampler.backends.gpu.executor import GpuExecutor
from supersampler.backends.gpu.memory import PixelBuffer, PixelMemory, allocate, read_back, write_to
from supersampler.backends.gpu.passes import Pass
from supersampler.backends.gpu.program import ARRAYS
from supersampler.backends.gpu.shader import Binding, Shader
from supersampler.frame import Size
from supersampler.methods.at_rest import phase_count
from supersampler.methods.executors import with_shaders
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_bench.specs import with_default_gbuffers
from supersampler_bench.timing.traffic import UNTOUCHED, touched_fraction

RENDER, DISPLAY = (64, 32), (128, 64)
PERIOD, MAX_PERIODS = 32, 4
SPARE = 0.01
"""How much more of a resource than declared a pass may access."""


RECORD = """
@group(0) @binding(99) var<storage, read_write> touched: array<atomic<u32>>;

fn touch(first: u32, count: u32, i: u32) -> u32 {
    if (i < count) { atomicOr(&touched[first + (i >> 5u)], 1u << (i & 31u)); }
    return i;
}

fn touch_at(first: u32, size: vec2i, p: vec2i) -> vec2i {
    if (all(p >= vec2i(0)) && all(p < size)) { touch(first, u32(size.x * size.y), u32(p.y * size.x + p.x)); }
    return p;
}
"""
ELEMENT_BYTES = {"f32": 4, "u32": 4, "atomic<u32>": 4, "vec2f": 8, "vec2u": 8, "vec4f": 16, "vec4u": 16}
ELEMENT_BYTES |= {"Sums": 64}
_PARAMETER = re.compile(r"\bfn (\w+)\((\w+): texture_2d<\w+>")


class Extent(NamedTuple):
    """The place of a resource in the recording buffer: its first word, and its size in elements."""

    first: int
    size: Size

    @property
    def elements(self) -> int:
        return self.size[0] * self.size[1]


class Recorder:
    """A model whose steps at one render size and one display size record what each pass accesses.

    Attributes:
        model: the model, on a device of its own: passes have more storage buffers than WebGPU's default.
    """

    def __init__(self, method: str, render: Size, display: Size) -> None:
        adapter = default_device().adapter
        limits = requested_limits(adapter) | {"max-storage-buffers-per-shader-stage": 16}
        device = adapter.request_device_sync(required_limits=limits)
        self.model = Model.load(method, executor="gpu", device=device)
        self._gpu: GpuExecutor = self.model.gpu
        sizes = self._gpu.program.memory()
        self._extents: list[dict[str, Extent]] = []
        self._memory = self._gpu._buffers_for(render, display).memory
        passes = []
        for number, (spec, one) in enumerate(
            zip(self._gpu.program.passes, self._gpu.passes(ARRAYS), strict=True)
        ):
            extents, first = {}, 0
            for binding in one.shader.bindings:
                memory = sizes.get(spec.names.get(binding.name, binding.name))
                size = None if memory is None else _elements(one.shader, binding, memory, render, display)
                if size is not None:
                    extents[binding.name] = Extent(first, size)
                    first += -(-extents[binding.name].elements // 32)
            shader = recording(one.shader, extents)
            names = {**spec.names, "touched": f"touched{number}"}
            passes.append(Pass(device, shader, spec.tile, names))
            self._memory[f"touched{number}"] = allocate(device, PixelBuffer(max(4 * first, 16)))
            self._extents.append(extents)
        self._gpu._compiled[tuple(ARRAYS.values())] = passes

    def clear(self) -> None:
        """Forget what was accessed so far."""
        for number in range(len(self._extents)):
            memory = self._memory[f"touched{number}"]
            write_to(self._gpu.device, memory, np.zeros(memory.resource.size // 4, np.uint32))

    def fractions(self) -> list[dict[str, float]]:
        """Return the fraction of the elements of each variable that each pass has accessed."""
        found = []
        for number, extents in enumerate(self._extents):
            words = read_back(self._gpu.device, self._memory[f"touched{number}"])
            bits = np.unpackbits(words.view(np.uint8), bitorder="little")
            found.append(
                {
                    n: float(bits[32 * e.first :][: e.elements].mean())
                    for n, e in extents.items()
                    if e.elements
                }
            )
        return found


def _elements(shader: Shader, binding: Binding, memory: Any, render: Size, display: Size) -> Size | None:
    """Return the size of a resource in elements; None for one that is not an array."""
    if not isinstance(memory, PixelBuffer):
        size: Size = memory.extent.size(render, display)
        return size
    element = re.search(rf"var<[^>]+> {binding.name}: array<(.+?)>;", shader.code)
    return (memory.total_bytes(render, display) // ELEMENT_BYTES[element[1]], 1) if element else None


def recording(shader: Shader, extents: Mapping[str, Extent]) -> Shader:
    """Return a shader that also records accesses to the variables in `extents`."""
    named = {**{name: name for name in extents}, **_parameters(shader.code, extents)}
    code = RECORD + _recording(shader.code, extents, named)
    added = Binding(0, 99, "touched", "storage")
    first = [b for b in shader.bindings if b.group == 0]
    return Shader(f"recording {shader.name}", code, (*first, added, *shader.bindings[len(first) :]))


def _parameters(code: str, extents: Mapping[str, Extent]) -> dict[str, str]:
    """Return the texture that stands behind each texture parameter of a function."""
    functions, behind = dict(_PARAMETER.findall(code)), dict[str, str]()
    for _ in functions:  # through functions that pass a parameter on
        for function, parameter in functions.items():
            names = re.findall(rf"(?<!fn )\b{function}\((\w+)", code)
            given = {behind.get(name, name) for name in names} & extents.keys()
            if given:
                [behind[parameter]] = given
    return behind


def _recording(code: str, extents: Mapping[str, Extent], named: Mapping[str, str]) -> str:
    """Return code in which each index and each position is recorded."""
    if not named:
        return code
    names = "|".join(named)
    access = re.compile(rf"\b({names})\[|\btexture(?:Load|Store)\(({names}), ")
    found, at = "", 0
    while match := access.search(code, at):
        end = _end(code, match.end())
        extent = extents[named[match[1] or match[2]]]
        inner = _recording(code[match.end() : end], extents, named)
        call = f"touch({extent.first}u, {extent.elements}u, u32({inner}))"
        if match[2]:
            call = f"touch_at({extent.first}u, vec2i{extent.size}, vec2i({inner}))"
        found += code[at : match.end()] + call
        at = end
    return found + code[at:]


def _end(code: str, begin: int) -> int:
    """Return the end of the expression that begins at `begin`."""
    depth = 0
    for at in range(begin, len(code)):
        if depth == 0 and code[at] in ",])":
            return at
        depth += (code[at] in "([") - (code[at] in ")]")
    raise ValueError(f"an expression without an end: {code[begin : begin + 60]!r}")


def still(index: int) -> Frame:
    shape = RENDER[::-1]
    frame = Frame(
        color=np.full((*shape, 3), 0.5, np.float32),
        depth=np.full(shape, 0.5, np.float32),
        motion=np.zeros((*shape, 2), np.float32),
        jitter=halton_jitter(index % PERIOD, 2.0),
    )
    return with_default_gbuffers(frame, GBUFFERS, DISPLAY)


class Access(NamedTuple):
    """A resource of a pass: its bytes, and the fractions that are declared and accessed."""

    name: str
    bytes: int
    declared: float
    accessed: float


def accesses(recorder: Recorder, *, frozen: bool) -> Iterator[Access]:
    program, phases = recorder.model.gpu.program, phase_count(DISPLAY, RENDER)
    memory: dict[str, PixelMemory] = program.memory()
    for spec, fractions in zip(program.passes, recorder.fractions(), strict=True):
        shader = program.shader(spec, ARRAYS)
        for binding in shader.bindings:
            if binding.name in fractions and binding.name not in UNTOUCHED:
                resource = memory[spec.names.get(binding.name, binding.name)]
                declared = touched_fraction(spec, shader, binding, phases, frozen=frozen)
                size, name = resource.total_bytes(RENDER, DISPLAY), f"{spec.title}: {binding.name}"
                yield Access(name, size, declared, fractions[binding.name])


def check(found: list[Access]) -> None:
    """Nothing is accessed that is not declared, and little is declared that is not accessed."""
    assert [one for one in found if one.accessed > one.declared + SPARE] == []
    declared = sum(one.bytes * one.declared for one in found)
    accessed = sum(one.bytes * one.accessed for one in found)
    assert 0.95 * declared <= accessed <= 1.001 * declared


@pytest.mark.parametrize("method", with_shaders())
def test_passes_access_what_they_declare_where_all_pixels_move_and_where_all_are_frozen(method: str) -> None:
    recorder = Recorder(method, RENDER, DISPLAY)
    upscaler = Upscaler(recorder.model, display_size=DISPLAY, validate="off")
    for index in range(4):
        recorder.clear()
        upscaler.step(lit(index, RENDER))
    check(list(accesses(recorder, frozen=False)))
    if not upscaler.model.info.converges:
        return
    upscaler.reset()
    for index in range(MAX_PERIODS * PERIOD):
        upscaler.step(still(index))
    assert upscaler.stats.converged == 1.0
    recorder.clear()
    upscaler.step(still(0))
    check(list(accesses(recorder, frozen=True)))
