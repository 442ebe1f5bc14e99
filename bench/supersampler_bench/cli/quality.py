"""`supersampler bench quality`: methods against the references of a shot, or of the five test shots."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import Progress

from supersampler.io.shot import Shot
from supersampler_bench.cli.options import ERRORS, JSON, listed, warn
from supersampler_bench.cli.shots import CACHE, RATIO, SHOT, opened_shots
from supersampler_bench.markdown_blocks import find_blocks, update_blocks
from supersampler_bench.quality.class_table import rich_class_table
from supersampler_bench.quality.error_maps import ErrorMaps
from supersampler_bench.quality.measure import measure_quality, runnable
from supersampler_bench.quality.score_record import Measured, quality_record
from supersampler_bench.quality.score_report import Report, block_names
from supersampler_bench.quality.score_table import rich_table
from supersampler_bench.record import write_json

if TYPE_CHECKING:
    from supersampler_bench.quality.figure_folder import FigureFolder


def quality(
    shot: SHOT,
    methods: Annotated[
        str,
        typer.Option(
            help="Shipped models or model folders, with commas between; NAME:fp32, NAME:fp16 for a graph."
        ),
    ] = "bilinear,bicubic,taa,taau,classifier,classifier-small",
    ratio: RATIO = "2",
    cache: CACHE = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder for curves over the frames, error heat maps, classes."),
    ] = None,
    json: JSON = None,
    update: Annotated[
        list[Path] | None,
        typer.Option(help="Rewrite the tables between this Markdown file's bench marks; any number."),
    ] = None,
) -> None:
    """Compare the images of methods with a shot's references.

    PSNR, SSIM and FLIP of frames; tPSNR, warped error and STRRED of changes from frame to frame; PSNR of
    disoccluded, relit, aliased and moving pixels; and predicted against true classes. All after the display
    transform: exposed, tone mapped, sRGB. For the test shots, a table of each and of their mean.
    docs/quality.md has
    what each metric is. Methods that cannot upscale a shot, at its ratio or with its G-buffers, are left out.

    \b
    Examples:
      supersampler bench quality plaza --methods bilinear,taau --update README.md
      supersampler bench quality my_shot -o errors
      supersampler bench quality test-shots --ratio 1.5,2,3,4 --json results.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    figures = None if output is None else _figure_folder(output)
    name, opened = opened_shots(shot, cache, ratio)
    for page in update or []:
        find_blocks(page, block_names(f"quality {name}"))
    names = listed(methods)
    report = Report(quality_record([_measured(one, origin, names, figures) for one, origin in opened]))
    if figures is not None:
        figures.add_means(report)
    console = Console()
    for title, scores in [*report.shot_tables(), *report.mean_tables()]:
        console.print(rich_table(title, scores))
        if (table := rich_class_table(title, scores)) is not None:
            console.print(table)
    if json is not None:
        write_json(report.record, json)
    for page in update or []:
        update_blocks(page, report.blocks(f"quality {name}"))


def _measured(
    shot: Shot, origin: dict[str, Any], methods: list[str], figures: "FigureFolder | None"
) -> Measured:
    methods = runnable(shot, methods, warn)
    maps = ErrorMaps(methods)
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task(shot.name, total=len(shot))
        results = measure_quality(
            shot,
            methods,
            watch=(lambda _: None) if figures is None else maps,
            on_frame=lambda n: progress.update(task, completed=n),
        )
    measured = Measured(shot, results, origin)
    if figures is not None:
        figures.add(measured, maps)
    return measured


def _figure_folder(folder: Path) -> "FigureFolder":
    from supersampler_bench.quality.figure_folder import FigureFolder  # needs matplotlib

    return FigureFolder(folder)
