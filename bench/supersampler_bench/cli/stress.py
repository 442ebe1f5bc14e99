"""`supersampler bench stress`: long runs and hostile input, each with a bound."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from supersampler_bench.cli.options import (
    ERRORS,
    JSON,
    UPDATE,
    Tables,
    check_page,
    listed,
    parse_executors,
    publish,
    warn,
)


def stress(
    methods: Annotated[
        str,
        typer.Option(
            help="Shipped models or model folders, or classifier:fp16, taau+guided-warp; with commas between."
        ),
    ] = "bilinear,bicubic,taa,taau,classifier,classifier-small",
    executors: Annotated[str, typer.Option(help="cpu, onnx, or both with a comma between.")] = "cpu,onnx",
    only: Annotated[str, typer.Option(help="Scenarios, or families of them, with commas between.")] = "",
    quick: Annotated[bool, typer.Option("--quick", help="A part of them, few and small frames.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for curves and for outcomes.")
    ] = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Run methods for long and on hostile input, and compare each figure with its bound.

    With a folder, a run that was stopped goes on when the same command is given again.

    \b
    Examples:
      supersampler bench stress --quick --methods classifier --executors cpu
      supersampler bench stress -o stress --json stress.json --update docs/stability.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.stress.report import draw_sheets, markdown_table, scenario_list, stress_record
    from supersampler_bench.stress.runner import chosen, left_out, measure, runs
    from supersampler_bench.stress.subjects import subjects

    scenario_block = "stress scenarios"
    tables: Tables = {"stress": markdown_table, scenario_block: lambda _: scenario_list()}
    check_page(update, tables)
    scenarios = chosen(listed(only) if only else [], quick=quick)
    stressed = subjects(listed(methods), parse_executors(executors))
    for text in left_out(scenarios, stressed):
        warn(text)
    outcomes = []
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task("scenarios", total=len(runs(scenarios, stressed)))
        try:
            for outcome in measure(scenarios, stressed, quick=quick, keep=output):
                outcomes.append(outcome)
                progress.advance(task)
        except KeyboardInterrupt:
            if output is not None:
                ERRORS.print("Stopped. The same command, given again, goes on.")
            raise
    if output is not None:
        for path in draw_sheets(outcomes, output):
            ERRORS.print(str(path))
    publish(stress_record(outcomes, quick=quick), tables, json, update, page_only=[scenario_block])
