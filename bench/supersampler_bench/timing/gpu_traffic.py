"""Count what a step of the GPU backend moves, from the accesses that its shaders declare.

A pass reads and writes each of its resources once: workgroups share what their threads read, and
neighbouring workgroups find their common border in the cache. A declaration that ends in `// N a thread` is
of a texture rgba32float larger than what the pass reads of it: N pixels for each thread that has a pixel.
docs/explanation/gpu-backend.md compares the counts with those of instrumented shaders.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from supersampler.backends.gpu.executor import GpuExecutor
from supersampler.backends.gpu.memory import TEXELS
from supersampler.backends.gpu.program import TEXTURES
from supersampler.backends.gpu.shader import Binding, Constants, Shader
from supersampler.frame import Size
from supersampler.methods.classifier.gpu_network import CHUNK, CORNERS, INPUTS
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.model import Model
from supersampler_bench.timing.traffic import Traffic

BACKEND = "gpu"
FORMATS = {
    "frame_color": ("rgba16float", 8),
    "frame_depth": ("r32float", 4),
    "frame_motion": ("rg16float", 4),
    "image": ("rgba16float", 8),
}
"""Formats of an engine's textures, and bytes of a pixel."""
UNTOUCHED = ("aux", "params", "frame_reactive")
"""Resources of an ordinary step that are not, or hardly, touched."""
_PART = re.compile(r"// (\d+) a thread$", re.MULTILINE)


class Access(NamedTuple):
    """Bytes that a pass reads or writes of a resource.

    Attributes:
        number: of the pass.
        shader: its name.
        binding: as it declares the resource.
        resource: its name.
        bytes: that are moved.
    """

    number: int
    shader: str
    binding: Binding
    resource: str
    bytes: int


def count_gpu(method: str, render: Size, display: Size) -> Traffic:
    """Count a step of the shaders on a frame and an image in textures, of the formats FORMATS.

    Args:
        method: a shipped model or a model folder.
        render: (width, height) of the frame.
        display: (width, height) of the image.

    Returns:
        Bytes of the resources of all passes, multiply-adds of the network, and passes.

    Raises:
        ArgumentError: the method has no shaders.
        DeviceError: there is no device.
    """
    executor = Model.load(method, executor="gpu").gpu
    moved = sum(access.bytes for access in accesses(executor, render, display))
    info = read_model_info(find_model(method))
    products = round(info.multiply_adds * display[0] * display[1])
    return Traffic(BACKEND, Path(method).name, moved, products, len(executor.program.passes))


def accesses(
    executor: GpuExecutor, render: Size, display: Size, variants: Mapping[str, str] = TEXTURES
) -> Iterator[Access]:
    """Yield all accesses of a step; `variants`: where frame and image are."""
    sizes = {name: spec.bytes for name, spec in executor.program.specs(render, display).items()}
    sizes |= {name: memory.resource.size for name, memory in executor.weights.items()}
    if variants is TEXTURES:
        pixels = {"frame": render[0] * render[1], "image": display[0] * display[1]}
        sizes |= {name: texel * pixels[name.partition("_")[0]] for name, (_, texel) in FORMATS.items()}
    passes = zip(executor.program.passes, executor.passes(variants), strict=True)
    for number, (spec, one) in enumerate(passes):
        width, height = spec.extent.size(render, display)
        for binding in one.shader.bindings:
            if binding.name not in UNTOUCHED:
                resource = spec.names.get(binding.name, binding.name)
                part = part_of(one.shader, binding, width * height)
                moved = sizes[resource] if part is None else min(sizes[resource], part)
                yield Access(number, spec.shader, binding, resource, moved)


def part_of(shader: Shader, binding: Binding, threads: int) -> int | None:
    """Return the bytes of the elements that threads read; None where the declaration names no number."""
    line = re.search(rf"^@group\(.*\b{binding.name}: .*$", shader.code, re.MULTILINE)
    found = _PART.search(line[0]) if line else None
    return int(found[1]) * TEXELS["rgba32float"] * threads if found else None


class PassCost(NamedTuple):
    """Cost of one pass of a step, as it declares its resources.

    Attributes:
        name: of its shader; with its level, where a method has it several times.
        moved: bytes, read and written.
        multiply_adds: of the network, with the channels that fill up chunks.
    """

    name: str
    moved: int
    multiply_adds: int


def pass_costs(executor: GpuExecutor, render: Size, display: Size) -> list[PassCost]:
    """Return the cost of each pass of a step, on a frame and an image in textures."""
    moved = [0] * len(executor.program.passes)
    for access in accesses(executor, render, display):
        moved[access.number] += access.bytes
    costs = []
    for spec, count in zip(executor.program.passes, moved, strict=True):
        width, height = spec.extent.size(render, display)
        level = f" {spec.constants['level']}" if "level" in spec.constants else ""
        products = round(products_of(spec.constants) * width * height)
        costs.append(PassCost(spec.shader + level, count, products))
    return costs


def products_of(constants: Constants) -> float:
    """Return the multiply-adds of the network in a pass, for each pixel of its extent."""
    if "level" in constants:  # 1x1, depthwise 3x3, 1x1
        names = ("inputs", "channels", "kept", "pooled")
        inputs, channels, kept, pooled = (CHUNK * constants[name] for name in names)
        return channels * (inputs + 9 + kept + pooled)
    if "decoder" in constants:  # of a packed pixel, which is four of the display
        features, hidden = 2 * CHUNK, CORNERS * CHUNK
        layers = features * features + hidden * (features + CORNERS * INPUTS)
        return (layers + CORNERS * 4 * constants["quads"] * hidden) / CORNERS
    return 0.0


def closing(code: str, opening: int) -> int:
    """Return the index of the bracket that closes the one at `opening`."""
    depth = 0
    for i in range(opening, len(code)):
        depth += (code[i] in "([{") - (code[i] in ")]}")
        if depth == 0:
            return i
    raise ValueError(f"no bracket closes {code[opening : opening + 40]!r}")
