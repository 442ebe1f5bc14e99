"""The `supersampler bench` commands, one module for each group: parse options, measure, print.

Measurements and statistics are in the other packages. The main command loads `app` from here.
"""

import typer

from supersampler_bench.cli import quality, report, timing

app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None)


@app.callback()
def bench() -> None:
    """Measure methods on shots with references; every published number comes from here."""


for command in (
    quality.quality,
    quality.extrapolation,
    quality.denoise,
    timing.cost,
    timing.traffic,
    timing.latency,
    timing.startup,
    timing.device,
    timing.skip,
    timing.views,
    quality.still,
    timing.pareto,
    report.stress,
    quality.parity,
    quality.hashes,
    quality.shots,
    quality.product_shot,
    report.records,
    report.tables,
):
    app.command(command.__name__.replace("_", "-"))(command)
