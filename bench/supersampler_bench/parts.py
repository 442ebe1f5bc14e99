"""What each part of `gbuffer` costs, in torch on this machine (Wang et al. 2025, tables IV and V)."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import torch
from torch import Tensor, nn

from supersampler.conventions.ratios import only_ratio, scaled
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler_bench.record import Record, machine_name
from supersampler_export.graph import example_arguments
from supersampler_model.methods import LEARNED
from supersampler_model.methods.base import Size as Extent
from supersampler_model.methods.gbuffer.model import GBuffer

PARTS = {
    "gather": "samples, warps, masks",
    "surfaces": "G-buffers encoder",
    "attended": "attended encoder",
    "refiner": "refiner",
    "fusion": "fusion network",
    "finish": "reconstruction",
}
"""By name, for people; the paper counts warps and masks to its blender, whose network is the refiner."""
_MODULES = {
    "surfaces": "surfaces",
    "frame": "attended",
    "enhancer": "attended",
    "refiner": "refiner",
    "colors": "fusion",
    "fusion": "fusion",
    "mixing": "finish",
}


@dataclass(frozen=True)
class Parted:
    """One method at one size.

    Attributes:
        method: its name.
        display: (width, height).
        milliseconds: of each part, by name, medians.
        multiply_adds: of its convolutions, for the whole picture.
    """

    method: str
    display: Size
    milliseconds: dict[str, float]
    multiply_adds: dict[str, int]


def measure_parts(name: str, display: Size, *, threads: int, steps: int) -> Parted:
    """Step a method on noise, and time its parts.

    Weights do not matter to it: a method without any is measured, too.

    Raises:
        ArgumentError: it is no `gbuffer`, or cannot draw that size.
    """
    kind = LEARNED.get(name)
    if kind is None or not issubclass(kind, GBuffer):
        kinds = [known for known, kind in LEARNED.items() if issubclass(kind, GBuffer)]
        raise ArgumentError("METHODS", got=name, want=f"some of {', '.join(kinds)}")
    ratio = only_ratio(kind.ratios)
    render = None if ratio is None else scaled(display, 1.0 / ratio)
    if render is None:
        raise ArgumentError("--sizes", got=display, want=f"multiples of {ratio:g} for {name}")
    torch.set_num_threads(threads)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    method = kind().eval().to(device)
    example = example_arguments(method, Extent(*render), Extent(*display), Extent(*render))
    arguments = [tensor.to(device) for tensor in example]
    with _watched(method) as watch, torch.no_grad():
        method(*arguments)  # memory is taken
        runs = []
        for _ in range(steps):
            watch.seconds.clear()
            watch.multiply_adds.clear()
            method(*arguments)
            runs.append(dict(watch.seconds))
    times = {part: 1e3 * median(run[part] for run in runs) for part in PARTS}
    return Parted(name, display, times, {part: watch.multiply_adds[part] for part in PARTS})


class _Watch:
    """Seconds and multiply-adds of the parts of a step, by name."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.multiply_adds: defaultdict[str, int] = defaultdict(int)
        self._part, self._began = "", 0.0

    def begin(self, part: str) -> None:
        self._part, self._began = part, _now()

    def end(self) -> None:
        self.seconds[self._part] += _now() - self._began

    def convolved(self, convolution: nn.Conv2d, output: Tensor) -> None:
        self.multiply_adds[self._part] += output.numel() * convolution.weight[0].numel()


@contextmanager
def _watched(method: GBuffer) -> Iterator[_Watch]:
    """Have a method's parts watched while this is open."""
    watch, handles = _Watch(), []
    for name, part in _MODULES.items():
        module = getattr(method.net, name)
        handles.append(module.register_forward_pre_hook(lambda *_, part=part: watch.begin(part)))
        handles.append(module.register_forward_hook(lambda *_: watch.end()))
    for module in method.net.modules():
        if isinstance(module, nn.Conv2d):
            handles.append(module.register_forward_hook(lambda m, _, out: watch.convolved(m, out)))
    for name in ("gather", "finish"):
        setattr(method, name, _timed(getattr(method, name), name, watch))
    try:
        yield watch
    finally:
        for handle in handles:
            handle.remove()
        del method.gather, method.finish


def _timed(function: Callable[..., Any], part: str, watch: _Watch) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        watch.begin(part)
        result = function(*arguments)
        watch.end()
        return result

    return timed


def _now() -> float:
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter()


def parts_record(results: Sequence[Parted], threads: int) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    device = torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu"
    return {
        "bench": "parts",
        "device": device,
        "threads": threads,
        "results": [asdict(result) for result in results],
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    results = [Parted(**row) for row in record["results"]]
    rows = [
        f"| method | display | {' | '.join(PARTS.values())} | all, ms | multiply-adds, 1e9 |",
        f"| --- | --- | {' | '.join('---:' for _ in PARTS)} | ---: | ---: |",
    ]
    for r in results:
        times = " | ".join(f"{r.milliseconds[part]:.0f}" for part in PARTS)
        total, work = sum(r.milliseconds.values()), sum(r.multiply_adds.values())
        size = f"{r.display[0]}x{r.display[1]}"
        rows.append(f"| {r.method} | {size} | {times} | {total:.0f} | {1e-9 * work:.1f} |")
    where = record["device"] if record["device"] != "cpu" else f"{record['threads']} threads"
    return "\n".join(
        [*rows, "", f"Milliseconds of a step in torch, single precision, {where} ({machine_name(record)})."]
    )
