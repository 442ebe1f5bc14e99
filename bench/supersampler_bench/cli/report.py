"""`supersampler bench` commands about records: stress, records and tables."""

import time
from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.terminal import echo
from supersampler.errors import ArgumentError
from supersampler_bench.cli import options


def stress(
    methods: Annotated[
        str,
        typer.Option(
            help="Shipped models or model folders, or classifier:fp16, taau:x2 for two passes, "
            "taau+guided-warp; comma-separated."
        ),
    ] = "bilinear,bicubic,taa,taau,classifier,classifier-small",
    executors: options.EXECUTORS = "cpu,onnx",
    only: Annotated[str, typer.Option(help="Scenarios, or families of them, comma-separated.")] = "",
    quick: Annotated[
        bool, typer.Option("--quick", help="Run some scenarios, with few and small frames.")
    ] = False,
    json: options.JSON = None,
) -> None:
    """Run methods for a long time and on hostile input, and compare each figure with its bound.

    After one hostile frame, the difference may be 0.1 steps of an 8-bit image in the mean and 4 at 99.9 % of
    the values, or as large as after a reset at one of five frames around it.

    \b
    Examples:
      supersampler bench stress --quick --methods classifier --executors cpu
      supersampler bench stress --json stress.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.stress import runner
    from supersampler_bench.stress.subjects import subjects

    scenarios = runner.chosen(options.split_list(only) if only else [], quick=quick)
    stressed = subjects(options.split_list(methods), options.executors_of(executors))
    for text in runner.left_out(scenarios, stressed):
        options.warn(text)
    count = len(runner.runs(scenarios, stressed))
    if not count:
        hint = "--quick runs few scenarios." if quick else ""
        raise ArgumentError(
            "--only", got=repr(only), want="scenarios that suit one of the methods", hint=hint
        )
    outcomes = []
    with options.counted("scenarios", count) as advance:
        for outcome in runner.measure(scenarios, stressed, quick=quick):
            outcomes.append(outcome)
            advance()
    record = runner.StressRecord(outcomes, quick=quick)
    options.publish(record, "stress", json, unprinted=["stress exceeded", "stress scenarios"])


def tables(
    root: Annotated[
        Path, typer.Argument(help="The repository: README.md, docs/*.md, bench/results.")
    ] = Path(),
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; fail if a table differs from its record.")
    ] = False,
) -> None:
    """Rewrite every table of README.md and docs/*.md from the records in bench/results.

    A table whose record is missing or of another version is reported and left unchanged.

    \b
    Example:
      supersampler bench tables --check
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.report.doc_tables import find_all

    wrong = 0
    for block in find_all(root):
        what = f"{block.page}: {block.name}"
        if block.recorded is None:
            options.say(f"{what}: left unchanged: {block.problem}")
        if block.is_recorded:
            continue
        wrong += 1
        if check:
            echo(f"{what}: differs from its record")
        elif block.recorded is not None:
            block.write()
            echo(f"{what}: written")
    if check and wrong:
        raise typer.Exit(1)


def records(
    names: Annotated[
        list[str] | None, typer.Argument(help="Records of bench/results; all by default.")
    ] = None,
    root: Annotated[Path, typer.Option(help="The repository.")] = Path(),
    list_only: Annotated[
        bool,
        typer.Option(
            "--list", help="Measure nothing; list the records that are due, and how long they last took."
        ),
    ] = False,
) -> None:
    """Measure again the records of bench/results whose models or command have changed.

    Nothing else should run on the machine. A record is replaced when its command succeeds, so the same
    command continues a stopped run. `supersampler bench tables` then writes the tables.

    \b
    Examples:
      supersampler bench records --list
      supersampler bench records latency quality-plaza
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.report import doc_tables

    due = [recipe for recipe in doc_tables.recipes(root, names or []) if recipe.problem]
    failed = 0
    echo(f"{len(due)} records are due; they took {doc_tables.clock(sum(one.seconds for one in due))}")
    for recipe in due:
        if list_only:
            echo(f"{recipe.name}: {recipe.problem} ({doc_tables.clock(recipe.seconds)})")
            continue
        with options.ERRORS.status(recipe.name):
            began = time.perf_counter()
            ended = doc_tables.measure(root, recipe, options.say)
        seconds = time.perf_counter() - began
        failed += not ended
        echo(f"{recipe.name}: {'measured' if ended else 'failed'}, {doc_tables.clock(seconds)}")
    if failed:
        raise typer.Exit(1)
