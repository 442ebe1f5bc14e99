"""`supersampler bench ...` of how methods run, not of what they draw: cost, speed, skip, parity, stress."""

from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.console import Console
from rich.progress import Progress

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError
from supersampler.model import ExecutorName, Precision
from supersampler_bench.record import setting, write_json
from supersampler_bench.table import find_block, update_block

_ERRORS = Console(stderr=True, highlight=False)
_JSON = Annotated[Path | None, typer.Option(help="Write all values and their setting here.")]
_UPDATE = Annotated[
    Path | None, typer.Option(help="Rewrite the table between this Markdown file's bench marks.")
]


def cost(
    methods: Annotated[
        str,
        typer.Option(help="Names of shipped models with a network or model folders, with commas between."),
    ] = "classifier,classifier-small",
    display_size: Annotated[str, typer.Option(help="Of the pictures.")] = "960x540",
    update: _UPDATE = None,
) -> None:
    """Count the multiply-adds and parameters of networks, in their graphs.

    Example:
      supersampler bench cost --methods classifier,my_classifier --update docs/methods.md
    """
    from supersampler_bench.cost import markdown_table, measure_cost

    size = parse_size(display_size)
    table = markdown_table([measure_cost(name.strip(), size) for name in methods.split(",")], size)
    _publish("cost", table, {}, None, update)


def speed(
    methods: Annotated[
        str, typer.Option(help="Names of shipped models or model folders, with commas between.")
    ] = "taa,taau,classifier-small,classifier",
    sizes: Annotated[str, typer.Option(help="Of the pictures, with commas between.")] = "960x540,1920x1080",
    executors: Annotated[str, typer.Option(help="host, graph, or both with a comma between.")] = "host,graph",
    threads: Annotated[str, typer.Option(help="Of the processor, with commas between.")] = "1,2",
    precisions: Annotated[str, typer.Option(help="auto, fp32, int8, with commas between.")] = "auto",
    ratio: Annotated[float, typer.Option(min=1.0, help="Display over render size.")] = 2.0,
    steps: Annotated[int, typer.Option(min=1, help="That count, of each setting.")] = 30,
    json: _JSON = None,
    update: _UPDATE = None,
) -> None:
    """Time a step of methods, on this machine, beside plain variance clipping in the same run.

    Quiet machines measure well: nothing else should run.

    Example:
      supersampler bench speed --sizes 1920x1080 --executors host --json speed.json
    """
    from supersampler_bench.speed import markdown_table, measure_limits, measure_speed, speed_record

    if update is not None:
        find_block(update, "speed")
    names, kinds = _listed(methods), _executors(executors)
    kept = _listed(precisions)
    if not set(kept) <= {"auto", "fp32", "int8"}:
        raise ArgumentError("--precisions", got=repr(precisions), want="auto, fp32, int8")
    counts = [int(text) for text in _listed(threads)]
    displays = [parse_size(text) for text in _listed(sizes)]
    with _ERRORS.status("timing"):
        results = measure_speed(
            names,
            displays,
            kinds,
            counts,
            precisions=[cast("Precision", kind) for kind in kept],
            ratio=ratio,
            steps=steps,
        )
        limits = measure_limits()
    machine = setting()["machine"]
    table = markdown_table(results, limits, ratio, f"{machine['cpu']}, {machine['cores']} cores")
    _publish("speed", table, speed_record(results, limits), json, update)


def skip(
    scenes: Annotated[
        str, typer.Option(help="Families of test shots, with commas between.")
    ] = "court,gallery,market",
    methods: Annotated[str, typer.Option(help="That have kernels, with commas between.")] = "taau,classifier",
    display_size: Annotated[str, typer.Option(help="Of the pictures.")] = "960x540",
    ratio: Annotated[float, typer.Option(min=1.0, help="Display over render size.")] = 2.0,
    samples: Annotated[int, typer.Option(min=1, help="A pixel of the references.")] = 64,
    json: _JSON = None,
    update: _UPDATE = None,
) -> None:
    """Measure what skipping saves and costs, in test shots whose camera stands: rendered here, with OpenGL.

    Quiet machines measure well: nothing else should run.

    Example:
      supersampler bench skip --scenes court --methods classifier --update docs/executors.md
    """
    from supersampler_bench.skip import frame_count, markdown_table, measure_skipping, skip_record

    if update is not None:
        find_block(update, "skip")
    families, names, size = _listed(scenes), _listed(methods), parse_size(display_size)
    with Progress(console=_ERRORS, transient=True, disable=not _ERRORS.is_terminal) as progress:
        task = progress.add_task("frames", total=2 * len(families) * frame_count(ratio))
        results = measure_skipping(
            families, names, size, ratio=ratio, samples=samples, on_frame=lambda: progress.advance(task)
        )
    machine = setting()["machine"]
    table = markdown_table(results, size, ratio, f"{machine['cpu']}, {machine['cores']} cores")
    _publish("skip", table, skip_record(results), json, update)


def parity(
    methods: Annotated[
        str, typer.Option(help="Names of shipped models that have kernels, with commas between.")
    ] = "taa,taau,classifier-small,classifier",
    frames: Annotated[int, typer.Option(min=10, help="That follow from one another.")] = 200,
    json: _JSON = None,
    update: _UPDATE = None,
) -> None:
    """Hold the graph and the kernels against torch, over a long sequence that is rendered here, with OpenGL.

    Example:
      supersampler bench parity --methods classifier --frames 300 --update docs/executors.md
    """
    from supersampler_bench.parity import SIZES, markdown_table, measure_parity, parity_record

    if update is not None:
        find_block(update, "parity")
    with Progress(console=_ERRORS, transient=True, disable=not _ERRORS.is_terminal) as progress:
        task = progress.add_task("frames", total=len(SIZES) * frames)
        results = measure_parity(_listed(methods), frames, on_frame=lambda: progress.advance(task))
    table = markdown_table(results)
    _publish("parity", table, parity_record(results), json, update)


def stress(
    methods: Annotated[
        str, typer.Option(help="Shipped models or model folders, with commas between.")
    ] = "bilinear,bicubic,taa,taau,classifier,classifier-small",
    executors: Annotated[str, typer.Option(help="host, graph, or both with a comma between.")] = "host,graph",
    only: Annotated[str, typer.Option(help="Scenarios, or families of them, with commas between.")] = "",
    quick: Annotated[bool, typer.Option("--quick", help="A part of them, few and small frames.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for curves, and for what was measured.")
    ] = None,
    json: _JSON = None,
    update: _UPDATE = None,
) -> None:
    """Run methods for long and treat them badly, and hold what happens against what they promise.

    With a folder, a run that was stopped goes on when the same command is given again.

    \b
    Examples:
      supersampler bench stress --quick --methods classifier --executors host
      supersampler bench stress -o stress --json stress.json --update docs/stability.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.stress.report import draw_sheets, markdown_table, scenario_list, stress_record
    from supersampler_bench.stress.runner import chosen, measure, runs
    from supersampler_bench.stress.subjects import subjects

    if update is not None:
        for name in ("stress", "stress scenarios"):
            find_block(update, name)
    scenarios = chosen(_listed(only) if only else [], quick=quick)
    stressed = subjects(_listed(methods), _executors(executors))
    outcomes = []
    with Progress(console=_ERRORS, transient=True, disable=not _ERRORS.is_terminal) as progress:
        task = progress.add_task("scenarios", total=len(runs(scenarios, stressed)))
        try:
            for outcome in measure(scenarios, stressed, quick=quick, keep=output):
                outcomes.append(outcome)
                progress.advance(task)
        except KeyboardInterrupt:
            if output is not None:
                _ERRORS.print("Stopped. The same command, given again, goes on.")
            raise
    if output is not None:
        for path in draw_sheets(outcomes, output):
            _ERRORS.print(str(path))
    _publish("stress", markdown_table(outcomes), stress_record(outcomes, quick=quick), json, update)
    if update is not None:
        update_block(update, "stress scenarios", scenario_list())


def _publish(name: str, table: str, record: dict[str, Any], json: Path | None, update: Path | None) -> None:
    """Print a table; write its record to `json` and itself to the page `update`, where they are given."""
    Console().print(table, markup=False, soft_wrap=True)
    if json is not None:
        write_json({**record, **setting()}, json)
    if update is not None:
        update_block(update, name, table)


def _listed(text: str) -> list[str]:
    return [part.strip() for part in text.split(",")]


def _executors(text: str) -> list[ExecutorName]:
    kinds = _listed(text)
    if not set(kinds) <= {"host", "graph"}:
        raise ArgumentError("--executors", got=repr(text), want="host, graph or host,graph")
    return [cast("ExecutorName", kind) for kind in kinds]
