"""Bytes and multiply-adds of the passes of the GPU backend, from the accesses that its shaders declare.

A pass reads and writes each of its resources once: workgroups share what their threads read, and
neighbouring workgroups find their common border in the cache. A declaration that ends in `// N a thread` is
of a texture rgba32float larger than what the pass reads of it: N pixels for each thread that has a pixel.
docs/explanation/gpu-backend.md compares the counts with those of instrumented shaders.
"""

import re
from typing import NamedTuple

from supersampler.backends.gpu.executor import GpuExecutor
from supersampler.backends.gpu.memory import TEXELS
from supersampler.backends.gpu.program import TEXTURES
from supersampler.backends.gpu.shader import Binding, Constants, Shader
from supersampler.frame import Size
from supersampler.methods.classifier.gpu_network import CHUNK, CORNERS, INPUTS

PIXEL_BYTES = {"frame_color": 8, "frame_depth": 4, "frame_motion": 4, "image": 8}
"""Bytes of a pixel of an engine's textures: rgba16float, r32float, rg16float, rgba16float."""
UNTOUCHED = ("aux", "params", "frame_reactive")
"""Resources of an ordinary step that are not, or hardly, touched."""
_PART = re.compile(r"// (\d+) a thread$", re.MULTILINE)


class PassCost(NamedTuple):
    """Cost of one pass of a step, as it declares its resources.

    Attributes:
        name: name of its shader; with its level, where a method has it several times.
        moved: bytes, read and written.
        multiply_adds: multiply-adds of the network, with the channels that fill up chunks.
    """

    name: str
    moved: int
    multiply_adds: int


def pass_costs(executor: GpuExecutor, render: Size, display: Size) -> list[PassCost]:
    """Return the cost of each pass of a step, on a frame and an image in textures."""
    pixels = {"frame": render[0] * render[1], "image": display[0] * display[1]}
    sizes = {name: spec.bytes for name, spec in executor.program.specs(render, display).items()}
    sizes |= {name: memory.resource.size for name, memory in executor.weights.items()}
    sizes |= {name: size * pixels[name.partition("_")[0]] for name, size in PIXEL_BYTES.items()}
    costs = []
    for spec, one in zip(executor.program.passes, executor.passes(TEXTURES), strict=True):
        width, height = spec.extent.size(render, display)
        moved = 0
        for binding in one.shader.bindings:
            if binding.name not in UNTOUCHED:
                whole = sizes[spec.names.get(binding.name, binding.name)]
                part = part_of(one.shader, binding, width * height)
                moved += whole if part is None else min(whole, part)
        level = f" {spec.constants['level']}" if "level" in spec.constants else ""
        products = round(products_of(spec.constants) * width * height)
        costs.append(PassCost(spec.shader + level, moved, products))
    return costs


def part_of(shader: Shader, binding: Binding, threads: int) -> int | None:
    """Return the bytes of the elements that threads read; None where the declaration names no number."""
    line = re.search(rf"^@group\(.*\b{binding.name}: .*$", shader.code, re.MULTILINE)
    found = _PART.search(line[0]) if line else None
    return int(found[1]) * TEXELS["rgba32float"] * threads if found else None


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
