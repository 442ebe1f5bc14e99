"""Time of each stage of `gbuffer` in torch, on a GPU where there is one (Wang et al. 2025, tables IV and V).

python bench/studies/stage_breakdown.py gbuffer-small --sizes 1920x1080
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from statistics import median
from typing import Annotated, Any

import torch
import typer
from torch import Tensor, nn

from supersampler.cli.arguments import parse_size
from supersampler.conventions.ratios import only_ratio, scaled
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler_bench.cli.options import ERRORS, JSON, UPDATE, check_page, listed, publish
from supersampler_bench.record import Record, machine_name
from supersampler_export.graph import example_arguments
from supersampler_model.methods import LEARNED
from supersampler_model.methods.gbuffer.model import GBuffer
from supersampler_model.ops.size import Size as Extent

STAGES = {
    "gather": "samples, warps, masks",
    "surfaces": "G-buffers encoder",
    "attended": "attended encoder",
    "refiner": "refiner",
    "fusion": "fusion network",
    "finish": "reconstruction",
}
"""Headings by name; the paper counts warps and masks to its blender, whose network is the refiner."""
_MODULES = {
    "surfaces": "surfaces",
    "frame": "attended",
    "enhancer": "attended",
    "refiner": "refiner",
    "colors": "fusion",
    "fusion": "fusion",
    "blend": "finish",
}


@dataclass(frozen=True)
class StageTimes:
    """One method at one size.

    Attributes:
        method: its name.
        display: (width, height).
        milliseconds: of each stage, by name, medians.
        multiply_adds: of its convolutions, for the whole image.
    """

    method: str
    display: Size
    milliseconds: dict[str, float]
    multiply_adds: dict[str, int]


def measure_stages(name: str, display: Size, *, threads: int, steps: int) -> StageTimes:
    """Step a method on noise, and time its stages.

    Weights do not change the time: a method without any is measured, too.

    Raises:
        ArgumentError: it is no `gbuffer`, or the size is no multiple of its ratio.
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
    with _hooked(method) as clock, torch.no_grad():
        method(*arguments)  # allocates
        runs = []
        for _ in range(steps):
            clock.seconds.clear()
            clock.multiply_adds.clear()
            method(*arguments)
            runs.append(dict(clock.seconds))
    times = {stage: 1e3 * median(run[stage] for run in runs) for stage in STAGES}
    return StageTimes(name, display, times, {stage: clock.multiply_adds[stage] for stage in STAGES})


class _StageClock:
    """Seconds and multiply-adds of the stages of a step, by name."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.multiply_adds: defaultdict[str, int] = defaultdict(int)
        self._stage, self._began = "", 0.0

    def begin(self, stage: str) -> None:
        self._stage, self._began = stage, _now()

    def end(self) -> None:
        self.seconds[self._stage] += _now() - self._began

    def convolved(self, convolution: nn.Conv2d, output: Tensor) -> None:
        self.multiply_adds[self._stage] += output.numel() * convolution.weight[0].numel()


@contextmanager
def _hooked(method: GBuffer) -> Iterator[_StageClock]:
    """Time a method's stages while this is open."""
    clock, handles = _StageClock(), []
    for name, stage in _MODULES.items():
        module = getattr(method.net, name)
        handles.append(module.register_forward_pre_hook(lambda *_, stage=stage: clock.begin(stage)))
        handles.append(module.register_forward_hook(lambda *_: clock.end()))
    for module in method.net.modules():
        if isinstance(module, nn.Conv2d):
            handles.append(module.register_forward_hook(lambda m, _, out: clock.convolved(m, out)))
    for name in ("gather", "finish"):
        setattr(method, name, _timed(getattr(method, name), name, clock))
    try:
        yield clock
    finally:
        for handle in handles:
            handle.remove()
        del method.gather, method.finish


def _timed(function: Callable[..., Any], stage: str, clock: _StageClock) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        clock.begin(stage)
        result = function(*arguments)
        clock.end()
        return result

    return timed


def _now() -> float:
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter()


def breakdown_record(results: Sequence[StageTimes], threads: int) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    device = torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu"
    return {
        "bench": "stage breakdown",
        "device": device,
        "threads": threads,
        "results": [asdict(result) for result in results],
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    results = [StageTimes(**row) for row in record["results"]]
    rows = [
        f"| method | display | {' | '.join(STAGES.values())} | all, ms | multiply-adds, 1e9 |",
        f"| --- | --- | {' | '.join('---:' for _ in STAGES)} | ---: | ---: |",
    ]
    for r in results:
        times = " | ".join(f"{r.milliseconds[stage]:.0f}" for stage in STAGES)
        total, work = sum(r.milliseconds.values()), sum(r.multiply_adds.values())
        size = f"{r.display[0]}x{r.display[1]}"
        rows.append(f"| {r.method} | {size} | {times} | {total:.0f} | {1e-9 * work:.1f} |")
    where = record["device"] if record["device"] != "cpu" else f"{record['threads']} threads"
    return "\n".join(
        [*rows, "", f"Milliseconds of a step in torch, single precision, {where} ({machine_name(record)})."]
    )


def main(
    methods: Annotated[
        str, typer.Argument(help="Methods of the family of `gbuffer`, with commas between.")
    ] = "gbuffer-small,gbuffer-small-4x,gbuffer-4x",
    sizes: Annotated[
        str, typer.Option(help="Display sizes, with commas between.")
    ] = "1280x720,1920x1080,2560x1440,3840x2160",
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.")] = 2,
    steps: Annotated[int, typer.Option(min=1, help="Timed steps at each size.")] = 3,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time the stages of `gbuffer` in torch, on a GPU where there is one."""
    tables = {"study stage breakdown": markdown_table}
    check_page(update, tables)
    with ERRORS.status("timing"):
        results = [
            measure_stages(name, parse_size(size, "--sizes"), threads=threads, steps=steps)
            for name in listed(methods)
            for size in listed(sizes)
        ]
    publish(breakdown_record(results, threads), tables, json, update)


if __name__ == "__main__":
    typer.run(main)
