"""`supersampler bench extrapolation`: unshaded frames, extrapolated and upscaled, against references."""

from typing import Annotated

import typer
from rich.progress import Progress

from supersampler_bench.cli.options import ERRORS, JSON, UPDATE, check_page, listed, publish, warn
from supersampler_bench.cli.shots import CACHE, RATIO, SHOT, opened_shots


def extrapolation(
    shot: SHOT,
    methods: Annotated[
        str, typer.Option(help="Upscalers: shipped models or model folders, with commas between.")
    ] = "classifier,taau",
    models: Annotated[
        str, typer.Option(help="That extrapolate: shipped models or model folders, likewise.")
    ] = "guided-warp",
    alternation: Annotated[
        str, typer.Option(help="Unshaded frames to a shaded one, with commas between.")
    ] = "1:1,2:1",
    ratio: RATIO = "2",
    cache: CACHE = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Leave out the colour of every second frame, or of two of three, and score their images.

    Compared are: extrapolation by each model, upscaled by each method; the last image warped by motion; the
    same with disoccluded pixels filled from the background; and, as the limit, all frames shaded.
    Scores are of the unshaded frames; tPSNR is of all. Frames need the G-buffers that the models read.

    \b
    Examples:
      supersampler bench extrapolation test-shots --update docs/results/methods.md
      supersampler bench extrapolation my_shot --methods taau --alternation 2:1 --json mine.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.quality.extrapolation import (
        extrapolation_record,
        markdown_table,
        measure_extrapolation,
    )

    name, opened = opened_shots(shot, cache, ratio)
    tables = {f"extrapolation {name}": markdown_table}
    check_page(update, tables)
    upscalers, extrapolators, alternations = listed(methods), listed(models), listed(alternation)
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        total = len(alternations) * sum(len(one) for one, _ in opened)
        task = progress.add_task("frames", total=total)
        measured = [
            measure_extrapolation(
                one,
                upscalers,
                extrapolators,
                alternations,
                origin=origin,
                on_left_out=warn,
                on_frame=lambda _: progress.advance(task),
            )
            for one, origin in opened
        ]
    publish(extrapolation_record(measured, extrapolators), tables, json, update)
