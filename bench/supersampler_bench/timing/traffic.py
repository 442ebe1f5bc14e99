"""Cost of networks, and of the passes of the GPU backend by the resources that its shaders declare.

A pass counts as reading or writing each of its resources once: workgroups share what their threads read, and
neighbouring workgroups find their common border in the cache. Two steps are counted: one in which all pixels
move, and one in which all are frozen, as in the frame before. `PassSpec.static` and `PassSpec.at_rest` name
what a pass accesses only where blocks are static, and where all is frozen; shaders mark signatures of which
a step accesses one or two phases of the jitter with `// of 1 phase` and `// of 2 phases`. A test compares
this with the elements that shaders access.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from supersampler.backends.gpu.memory import MAX_PHASES
from supersampler.backends.gpu.program import TEXTURES, GpuProgram, PassSpec
from supersampler.backends.gpu.shader import Binding, Constants, Shader
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.methods.at_rest import phase_count
from supersampler.methods.classifier.gpu_network import CHUNK, CORNERS
from supersampler.methods.classifier.network_file import INPUT_PLANES
from supersampler.methods.executors import gpu_program
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.record import BenchRecord, sizes_text, table
from supersampler_bench.specs import compatible
from supersampler_model.data.rendered import render_size

PIXEL_BYTES = {"frame_color": 8, "frame_depth": 4, "frame_motion": 4, "image": 8}
"""Bytes per pixel of an engine's textures: rgba16float, r32float, rg16float, rgba16float."""
UNTOUCHED = ("aux", "params", "frame_reactive")
"""Resources that do not count: a step accesses few of their bytes, or none."""
_NOTE = re.compile(r"// of (\d) phases?")


class PassCost(NamedTuple):
    """Cost of one pass of a step."""

    name: str  # of the shader, with its level if a method has several
    moved: int  # declared bytes, read and written
    multiply_adds: int  # of the network, with the channels that pad chunks


def pass_costs(program: GpuProgram, render: Size, display: Size, *, frozen: bool = False) -> list[PassCost]:
    """Return the cost of each pass of a step with frame and image in textures; `frozen`: at rest."""
    pixels = {"frame": render[0] * render[1], "image": display[0] * display[1]}
    sizes = {name: memory.total_bytes(render, display) for name, memory in program.memory().items()}
    sizes |= {name: words.nbytes for name, words in program.weights.items()}
    sizes |= {name: size * pixels[name.partition("_")[0]] for name, size in PIXEL_BYTES.items()}
    costs, phases = [], phase_count(display, render)
    for spec in program.passes:
        shader, (width, height) = program.shader(spec, TEXTURES), spec.extent.size(render, display)
        moved = sum(
            touched_fraction(spec, shader, binding, phases, frozen=frozen)
            * sizes[spec.names.get(binding.name, binding.name)]
            for binding in shader.bindings
            if binding.name not in UNTOUCHED
        )
        products = 0 if frozen else round(products_of(spec.constants) * width * height)
        costs.append(PassCost(spec.title, round(moved), products))
    return costs


def touched_fraction(
    spec: PassSpec, shader: Shader, binding: Binding, phases: int, *, frozen: bool = False
) -> float:
    """Return the fraction of a resource that a pass accesses where all pixels move, or all are `frozen`."""
    if not frozen and binding.name in spec.static:
        return 0.0
    if frozen and spec.at_rest is not None and binding.name not in spec.at_rest:
        return 0.0
    if binding.name in (
        "history_phases",
        "next_phases",
    ):  # tables as long as the largest ratio needs
        return phases / MAX_PHASES
    line = re.search(rf"^@group\(.*\b{binding.name}: .*$", shader.code, re.MULTILINE)
    note = _NOTE.search(line[0]) if line else None
    return int(note[1]) / phases if note else 1.0


def products_of(constants: Constants) -> float:
    """Return the multiply-adds of the network in a pass, per pixel of its extent."""
    if "level" in constants:  # 1x1, depthwise 3x3, 1x1
        names = ("inputs", "channels", "kept", "pooled")
        inputs, channels, kept, pooled = (CHUNK * constants[name] for name in names)
        return channels * (inputs + 9 + kept + pooled)
    if "decoder" in constants:  # per packed pixel, which is four display pixels
        features, hidden = 2 * CHUNK, CORNERS * CHUNK
        layers = features * features + hidden * (features + CORNERS * INPUT_PLANES)
        return (layers + CORNERS * 4 * constants["quads"] * hidden) / CORNERS
    return 0.0


@dataclass(frozen=True)
class Traffic:
    """Cost of a step: the sums of its passes."""

    method: str
    render: Size
    display: Size
    passes: int
    moved: int
    multiply_adds: int
    moved_at_rest: int


def traffic_of(
    methods: Sequence[str],
    display: Size,
    ratios: Sequence[float],
    *,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[Traffic]:
    """Return the cost of a step of each method at each ratio that it supports.

    Raises:
        ArgumentError: a method has no shaders.
    """
    found = []
    for method in methods:
        program = gpu_program(read_model_info(find_model(method)))
        if program is None:
            raise ArgumentError("--methods", got=method, want="methods with shaders")
        for ratio in ratios:
            render = render_size(display, ratio)
            if not compatible([method], render, display, on_left_out):
                continue
            costs = pass_costs(program, render, display)
            moved, products = sum(one.moved for one in costs), sum(one.multiply_adds for one in costs)
            at_rest = sum(one.moved for one in pass_costs(program, render, display, frozen=True))
            found.append(Traffic(method, render, display, len(costs), moved, products, at_rest))
    return found


@dataclass(frozen=True)
class TrafficRecord(BenchRecord):
    """Bytes, multiply-adds and passes of steps of the GPU backend."""

    steps: list[Traffic]
    BENCH = "traffic"

    def table(self) -> str:
        """Return the table of steps."""
        rows = [
            [
                *(s.method, sizes_text(s.render, s.display), s.passes),
                *(f"{s.moved / 1e9:.2f}", f"{s.multiply_adds / 1e9:.1f}", f"{s.moved_at_rest / 1e9:.2f}"),
            ]
            for s in self.steps
        ]
        caption = (
            "A step with frame and image in textures of half floats (depth in single precision), in which "
            "all pixels move and the exposure is measured. Bytes: all resources that passes declare, each "
            "read or written once. Multiply-adds: of the int8 network. At rest: all pixels are frozen, as in "
            "the frame before."
        )
        names = ["method", "size", "passes:", "GB:", "10^9 multiply-adds:", "GB at rest:"]
        return table(names, rows, caption)


@dataclass(frozen=True)
class Cost:
    """Cost of one run of `network.onnx`."""

    method: str
    multiply_adds: float  # of convolutions and matrix products, per display pixel
    parameters: int
    operators: int  # nodes of the graph


def cost_of(name_or_path: str) -> Cost:
    """Return the cost of a model's network.

    Raises:
        ArgumentError: the model has no network.
    """
    import onnx  # a measuring kit lacks it, and counts traffic alone

    info = read_model_info(find_model(name_or_path))
    if "network.onnx" not in info.files:
        raise ArgumentError("--methods", got=name_or_path, want="methods with a network")
    graph = onnx.load(info.folder / "network.onnx").graph
    parameters = sum(math.prod(tensor.dims) for tensor in graph.initializer)
    return Cost(name_or_path, info.multiply_adds, parameters, len(graph.node))


@dataclass(frozen=True)
class CostRecord(BenchRecord):
    """Costs of networks."""

    networks: list[Cost]
    BENCH = "cost"

    def table(self) -> str:
        """Return the table of networks."""
        rows = [
            [c.method, f"{c.multiply_adds:,.0f}", f"{c.parameters:,}", c.operators] for c in self.networks
        ]
        headings = ["method", "multiply-adds a display pixel:", "parameters:", "operators:"]
        return table(headings, rows, "The network alone (`network.onnx`).")
