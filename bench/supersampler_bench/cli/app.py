"""The `bench` command: every measurement, from the module of its group."""

import typer

from supersampler_bench.cli import (
    agreement,
    extrapolation,
    hashes,
    pareto,
    quality,
    render_shots,
    report,
    still,
    stress,
    timing,
)

app = typer.Typer(no_args_is_help=True)


@app.callback()
def bench() -> None:
    """Measure methods on shots with references; every published number comes from here."""


for command in (
    quality.quality,
    extrapolation.extrapolation,
    timing.cost,
    timing.speed,
    timing.startup,
    timing.device,
    timing.skip,
    still.still,
    pareto.pareto,
    stress.stress,
    agreement.parity,
    agreement.precision,
    agreement.compare,
    hashes.hashes,
    render_shots.shots,
    render_shots.product_shot,
    report.tables,
    report.report,
):
    app.command(command.__name__.replace("_", "-"))(command)
