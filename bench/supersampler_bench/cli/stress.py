"""`supersampler bench stress`: long runs and hostile input, each with a bound."""

from pathlib import Path
from typing import Annotated

import typer

from supersampler_bench.cli.options import (
    EXECUTORS,
    JSON,
    UPDATE,
    Tables,
    check_page,
    counted,
    executors_of,
    listed,
    publish,
    say,
    warn,
)


def stress(
    methods: Annotated[
        str,
        typer.Option(
            help="Shipped models or model folders, or classifier:fp16, taau:x2 for two passes, "
            "taau+guided-warp; with commas between."
        ),
    ] = "bilinear,bicubic,taa,taau,classifier,classifier-small",
    executors: EXECUTORS = "cpu,onnx",
    only: Annotated[str, typer.Option(help="Scenarios, or families of them, with commas between.")] = "",
    quick: Annotated[bool, typer.Option("--quick", help="Some of them, with few and small frames.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for curves and for outcomes.")
    ] = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Run methods for long and on hostile input, and compare each figure with its bound.

    With a folder, the same command continues a stopped run. After one hostile frame, the bound is 0.1 steps
    of an 8-bit image in the mean and 4 at 99.9 % of the values, or the largest difference after a reset at
    one of five frames around it if that is larger.

    \b
    Examples:
      supersampler bench stress --quick --methods classifier --executors cpu
      supersampler bench stress -o stress --json stress.json --update docs/stability.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.stress import report, runner
    from supersampler_bench.stress.subjects import subjects

    scenario_block = "stress scenarios"
    tables: Tables = {"stress": report.markdown_table, scenario_block: lambda _: report.scenario_list()}
    check_page(update, tables)
    scenarios = runner.chosen(listed(only) if only else [], quick=quick)
    stressed = subjects(listed(methods), executors_of(executors))
    for text in runner.left_out(scenarios, stressed):
        warn(text)
    outcomes = []
    total = len(runner.runs(scenarios, stressed))
    with counted("scenarios", total, resumes=output is not None) as advance:
        for outcome in runner.measure(scenarios, stressed, quick=quick, keep=output):
            outcomes.append(outcome)
            advance()
    if output is not None:
        for path in report.draw_sheets(outcomes, output):
            say(str(path))
    publish(report.stress_record(outcomes, quick=quick), tables, json, update, page_only=[scenario_block])
