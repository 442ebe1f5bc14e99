"""`supersampler bench speed --against PYTHON`: this version's times over those of another one."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import typer
from rich.progress import Progress

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import ERRORS, check_page, listed, publish, warn


def check_not_given(context: typer.Context, names: Iterable[str], why: str) -> None:
    """Refuse options that would have no effect.

    Args:
        context: of the command.
        names: of its parameters.
        why: they have none.

    Raises:
        ArgumentError: one of them is on the command line.
    """
    for name in names:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            raise ArgumentError(f"--{name}", got="given", want=f"left out: {why}")


def compare_speed(
    python: str,
    methods: list[str],
    sizes: str | None,
    threads: str | None,
    ratio: float,
    taken: Mapping[str, int],
    json: Path | None,
    update: Path | None,
) -> None:
    """Measure, print and write; arguments are those of the command, `taken` the fields of `Rounds`.

    Raises:
        ArgumentError: see `measure_against`.
    """
    from supersampler_bench.timing.against import Rounds, against_record, markdown_table, measure_against

    tables = {"against": markdown_table}
    check_page(update, tables)
    displays = [parse_size(text) for text in listed(sizes or "960x540")]
    counts = [int(text) for text in listed(threads or str(os.cpu_count() or 1))]
    rounds = Rounds(**taken)
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        settings = len(displays) * len(counts)
        task = progress.add_task("rounds", total=len(methods) * rounds.total(settings))
        sides, results = measure_against(
            python,
            methods,
            displays,
            counts,
            ratio=ratio,
            rounds=rounds,
            on_round=lambda: progress.advance(task),
            on_left_out=warn,
        )
    publish(against_record(sides, results, ratio, rounds), tables, json, update)
