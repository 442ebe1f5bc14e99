"""`supersampler bench stress`: what methods make of long runs and bad treatment."""

from pathlib import Path
from typing import Annotated, cast

import typer
from rich.console import Console
from rich.progress import Progress

from supersampler.errors import ArgumentError
from supersampler.model import ExecutorName
from supersampler_bench.record import setting, write_json
from supersampler_bench.table import find_block, update_block

_ERRORS = Console(stderr=True, highlight=False)


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
    json: Annotated[Path | None, typer.Option(help="Write all values and their setting here.")] = None,
    update: Annotated[
        Path | None, typer.Option(help="Rewrite the tables between this Markdown file's bench marks.")
    ] = None,
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
            find_block(update, name)  # fails now, not after minutes
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
    record = {**stress_record(outcomes, quick=quick), **setting()}
    table = markdown_table(record)
    Console().print(table, markup=False, soft_wrap=True)
    if json is not None:
        write_json(record, json)
    if update is not None:
        update_block(update, "stress", table)
        update_block(update, "stress scenarios", scenario_list())


def _executors(text: str) -> list[ExecutorName]:
    kinds = _listed(text)
    if not set(kinds) <= {"host", "graph"}:
        raise ArgumentError("--executors", got=repr(text), want="host, graph or host,graph")
    return [cast("ExecutorName", kind) for kind in kinds]


def _listed(text: str) -> list[str]:
    return [part.strip() for part in text.split(",")]
