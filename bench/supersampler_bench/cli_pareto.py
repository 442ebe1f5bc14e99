"""`supersampler bench pareto` and `suggest`: time against error, and what to use."""

from importlib import resources
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from supersampler.cli.arguments import open_shot, parse_size
from supersampler_bench.cli_shared import ERRORS, JSON, UPDATE, check_page, publish, warn
from supersampler_bench.record import read_record


def pareto(
    quality: Annotated[
        list[Path],
        typer.Argument(
            help="Files of `bench quality test-shots --json`, of any ratios, of `bench extrapolation` "
            "likewise, or of --json here."
        ),
    ],
    display_size: Annotated[str, typer.Option(help="Of the pictures that are timed.")] = "960x540",
    threads: Annotated[int, typer.Option(min=1, help="Of the processor.")] = 2,
    steps: Annotated[int, typer.Option(min=1, help="That count, of each setting.")] = 20,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for a figure of each metric.")
    ] = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time every setting that was scored, and draw time against error: what leads, and what is beaten.

    Quiet machines measure well: nothing else should run.

    Example:
      supersampler bench pareto bench/results/quality-test-shots*.json -o docs/images --update docs/pareto.md
    """
    from supersampler_bench.pareto import (
        markdown_table,
        measure_pareto,
        pareto_record,
        preset_table,
        shots_of,
    )
    from supersampler_bench.pareto_hidden import BENCH, hidden_rows, hidden_table, measure_hidden

    tables = {"pareto": markdown_table, "presets": preset_table, "pareto hidden": hidden_table}
    check_page(update, tables)
    records, size = [read_record(path) for path in quality], parse_size(display_size)
    scored = [record for record in records if record["bench"] != BENCH]
    with ERRORS.status("timing"):
        points = measure_pareto(scored, size, threads=threads, steps=steps, on_left_out=warn)
        hidden = measure_hidden(records, size, threads=threads, steps=steps)
    record = pareto_record(points, shots_of(scored[0]), size, threads)
    publish({**record, "hidden": hidden_rows(hidden)}, tables, json, update)
    if output is not None:
        from supersampler_bench.pareto_figures import draw_pareto  # needs matplotlib

        draw_pareto(points, f"{display_size}, {threads} threads", output)


def suggest(
    shot: Annotated[str, typer.Argument(metavar="SHOT", help="A shot, or the name of a shipped one.")],
    budget_ms: Annotated[float, typer.Option(min=0.0, help="Milliseconds that a step may take.")],
    display_size: Annotated[str, typer.Option(metavar="WxH", help="Of the pictures.")],
    threads: Annotated[int, typer.Option(min=0, help="CPU threads; 0 takes every core.")] = 0,
) -> None:
    """Time all methods on a shot's frames, on this machine, and say which draws best within a budget.

    How well they draw is known from the test shots; the budget holds in 95 of 100 frames.

    Example:
      supersampler bench suggest plaza --budget-ms 16 --display-size 640x360
    """
    from supersampler_bench.pareto import points_of
    from supersampler_bench.suggest import measure_candidates, upscale_command

    known = resources.files("supersampler_bench") / "pareto.json"
    with resources.as_file(known) as path:
        points = points_of(read_record(path))
    opened, size = open_shot(shot), parse_size(display_size)
    with ERRORS.status("timing"):
        candidates = measure_candidates(opened, size, budget_ms, points, threads=threads, on_left_out=warn)
    lines = [
        "| setting | ms | p95 | PSNR dB of the test shots | |",
        "| --- | ---: | ---: | ---: | --- |",
        *(
            f"| {c.spec} | {c.median:.1f} | {c.p95:.1f} | {c.psnr:.2f} | {'' if c.fits else 'too slow'} |"
            for c in candidates
        ),
    ]
    console = Console()
    console.print("\n".join(lines), markup=False, soft_wrap=True)
    best = candidates[0]
    if not best.fits:
        ERRORS.print(f"nothing fits {budget_ms:g} ms; {best.spec} comes nearest: {best.p95:.1f} ms")
        raise typer.Exit(1)
    console.print(f"\n{upscale_command(shot, size, best.spec, threads)}", markup=False, soft_wrap=True)
