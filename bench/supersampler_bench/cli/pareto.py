"""`supersampler bench pareto`: time against error, and what to use within a budget of time."""

from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.arguments import parse_size
from supersampler_bench.cli.options import ERRORS, JSON, UPDATE, check_page, publish, warn
from supersampler_bench.record import SHIPPED_PARETO, read_record


def pareto(
    quality: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Records of `bench quality test-shots --json`, of any ratios, of `bench extrapolation "
            "test-shots --json`, or of --json here.",
            show_default="the scores of the shipped methods",
        ),
    ] = None,
    display_size: Annotated[str, typer.Option(help="Of the images that are timed.")] = "960x540",
    threads: Annotated[int, typer.Option(min=1, help="Of the processor.")] = 2,
    steps: Annotated[int, typer.Option(min=1, help="That count, of each setting.")] = 20,
    budget_ms: Annotated[
        float | None, typer.Option(min=0.0, help="Name the best setting whose step takes no longer.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for a figure of each metric.")
    ] = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time every setting that was scored, and plot time against error.

    Quiet machines measure well: nothing else should run.

    \b
    Examples:
      supersampler bench pareto --budget-ms 16 --display-size 1920x1080
      supersampler bench pareto bench/results/quality-test-shots*.json -o docs/images --update docs/pareto.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.compatibility import gbuffers_of
    from supersampler_bench.timing.pareto import (
        best_within,
        markdown_table,
        measure_pareto,
        pareto_record,
        preset_table,
        shots_of,
    )
    from supersampler_bench.timing.pareto_extrapolated import (
        BENCH,
        measure_unshaded,
        unshaded_rows,
        unshaded_table,
    )

    tables = {"pareto": markdown_table, "presets": preset_table, "pareto unshaded": unshaded_table}
    check_page(update, tables)
    records, size = [read_record(path) for path in quality or [SHIPPED_PARETO]], parse_size(display_size)
    scored = [record for record in records if record["bench"] != BENCH]
    with ERRORS.status("timing"):
        points = measure_pareto(scored, size, threads=threads, steps=steps, on_left_out=warn)
        unshaded = measure_unshaded(records, size, threads=threads, steps=steps)
    record = pareto_record(points, shots_of(scored[0]), size, threads)
    publish({**record, "unshaded": unshaded_rows(unshaded)}, tables, json, update)
    if output is not None:
        from supersampler_bench.report.pareto_figures import draw_pareto  # needs matplotlib

        draw_pareto(points, f"{display_size}, {threads} threads", output)
    if budget_ms is not None:
        best = best_within(points, budget_ms)
        for point in best:
            reads = " (reads G-buffers)" if gbuffers_of([point.spec.model]) else ""
            ERRORS.print(f"ratio {point.ratio:g}: {point.spec}{reads}, {point.milliseconds:.1f} ms")
        if not best:
            ERRORS.print(f"no setting takes {budget_ms:g} ms or less")
            raise typer.Exit(1)
