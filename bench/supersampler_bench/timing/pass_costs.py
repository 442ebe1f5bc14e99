"""Bytes and multiply-adds of the passes of the GPU backend, from the accesses that its shaders declare.

A pass reads and writes each of its resources once: workgroups share what their threads read, and
neighbouring workgroups find their common border in the cache. In the step that is counted, all pixels move:
resources that only static blocks touch are declared with `// of static blocks`, and signatures of which a
step touches those of one or two phases of the jitter with `// of 1 phase` and `// of 2 phases`.
"""

import re
from typing import NamedTuple

from supersampler.backends.gpu.executor import GpuExecutor
from supersampler.backends.gpu.program import TEXTURES
from supersampler.backends.gpu.shader import Binding, Constants, Shader
from supersampler.frame import Size
from supersampler.methods.at_rest import phase_count
from supersampler.methods.classifier.gpu_network import CHUNK, CORNERS, INPUTS

PIXEL_BYTES = {"frame_color": 8, "frame_depth": 4, "frame_motion": 4, "image": 8}
"""Bytes of a pixel of an engine's textures: rgba16float, r32float, rg16float, rgba16float."""
UNTOUCHED = ("aux", "params", "frame_reactive")
"""Resources that an ordinary step does not touch, or hardly."""
_NOTE = re.compile(r"// of (?:static blocks|(\d) phases?)")


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
    costs, phases = [], phase_count(display, render)
    for spec, one in zip(executor.program.passes, executor.passes(TEXTURES), strict=True):
        width, height = spec.extent.size(render, display)
        moved = sum(
            touched_fraction(one.shader, binding, phases) * sizes[spec.names.get(binding.name, binding.name)]
            for binding in one.shader.bindings
            if binding.name not in UNTOUCHED
        )
        products = round(products_of(spec.constants) * width * height)
        costs.append(PassCost(spec.title, round(moved), products))
    return costs


def touched_fraction(shader: Shader, binding: Binding, phases: int) -> float:
    """Return the fraction of a resource that a step touches, by the note of its declaration."""
    line = re.search(rf"^@group\(.*\b{binding.name}: .*$", shader.code, re.MULTILINE)
    note = _NOTE.search(line[0]) if line else None
    if note is None:
        return 1.0
    return 0.0 if note[1] is None else int(note[1]) / phases


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
