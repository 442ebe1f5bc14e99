"""`supersampler bench quality` and `extrapolation`: methods against the references of a shot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from supersampler.cli.terminal import Terminal
from supersampler.io.shot import Shot
from supersampler_bench.cli.options import (
    CACHE,
    JSON,
    METHODS,
    RATIO,
    SHOT,
    UPDATE,
    check_page,
    counted,
    listed,
    opened_shots,
    publish,
    warn,
)
from supersampler_bench.markdown_blocks import find_blocks, update_blocks
from supersampler_bench.record import write_json

if TYPE_CHECKING:
    from supersampler_bench.record import Record


def quality(
    shot: SHOT,
    methods: Annotated[
        str,
        typer.Option(
            help="Shipped models or model folders, with commas between; NAME:fp32, NAME:fp16 for a graph, "
            "NAME:gpu for shaders, NAME:x2 for two passes, NAME:native for frames of display size; fsr2-like."
        ),
    ] = "bilinear,bicubic,taa,taau,classifier-small,classifier,classifier-large",
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
    docs/quality.md describes each metric. Methods that cannot upscale a shot, at its ratio or with its
    G-buffers, are left out.

    \b
    Examples:
      supersampler bench quality plaza --methods bilinear,taau --update README.md
      supersampler bench quality my_shot -o errors
      supersampler bench quality test-shots --ratio 1.5,2,3,4 --json results.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.quality import score_table
    from supersampler_bench.quality.confusion import rich_class_table
    from supersampler_bench.quality.score_record import quality_record

    name, opened = opened_shots(shot, cache, ratio)
    for page in update or []:
        find_blocks(page, score_table.block_names(f"quality {name}"))
    record = quality_record([_measured(one, origin, listed(methods), output) for one, origin in opened])
    if output is not None:
        from supersampler_bench.quality.figures import draw_means  # needs matplotlib

        draw_means(record, output)
    console = Terminal()
    for title, rows in [*score_table.shot_tables(record), *score_table.mean_tables(record).values()]:
        console.print(score_table.rich_table(title, rows))
        if (classes := rich_class_table(title, rows)) is not None:
            console.print(classes)
    if json is not None:
        write_json(record, json)
    for page in update or []:
        update_blocks(page, score_table.blocks(record, f"quality {name}"))


def _measured(shot: Shot, origin: dict[str, Any], methods: list[str], output: Path | None) -> "Record":
    from supersampler_bench.quality.error_maps import ErrorMaps
    from supersampler_bench.quality.measure import measure_quality, runnable
    from supersampler_bench.quality.score_record import shot_scores

    methods = runnable(shot, methods, warn)
    maps = ErrorMaps(methods)
    with counted(shot.name, len(shot)) as advance:
        watch = maps if output is not None else (lambda _: None)
        results = measure_quality(shot, methods, watch=watch, on_frame=advance)
    measured = shot_scores(shot, results, origin)
    if output is not None:
        from supersampler_bench.quality.figures import draw_shot  # needs matplotlib

        draw_shot(measured, maps, output)
    return measured


def extrapolation(
    shot: SHOT,
    methods: METHODS = "classifier,taau",
    models: Annotated[
        str, typer.Option(help="That extrapolate: shipped models or model folders, likewise.")
    ] = "guided-warp",
    alternation: Annotated[
        str, typer.Option(help="Unshaded frames to a shaded one, with commas between.")
    ] = "1:1,2:1",
    every_frame: Annotated[
        bool,
        typer.Option(
            "--every-frame",
            help="Run once from each frame of the alternation: each frame is scored unshaded and shaded.",
        ),
    ] = False,
    ratio: RATIO = "2",
    cache: CACHE = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Remove the colour of every second frame, or of two of three, and score their images.

    Compared are: extrapolation by each model, upscaled by each method; the last image warped by motion; the
    same with disoccluded pixels filled from the background; and, as the limit, all frames shaded.
    Scores are of the unshaded frames; tPSNR is of all. Frames need the G-buffers that the models read.

    \b
    Examples:
      supersampler bench extrapolation test-shots --update docs/results/methods.md
      supersampler bench extrapolation my_shot --methods taau --alternation 2:1 --json mine.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.quality import extrapolation as bench

    name, opened = opened_shots(shot, cache, ratio)
    tables = {f"extrapolation {name}": bench.markdown_table}
    check_page(update, tables)
    upscalers, extrapolators, alternations = listed(methods), listed(models), listed(alternation)
    runs = sum(len(bench.runs_of(text, every_frame=every_frame)) for text in alternations)
    measured = []
    with counted("frames", runs * sum(len(one) for one, _ in opened)) as advance:
        for one, origin in opened:
            scores = bench.measure_extrapolation(
                one,
                upscalers,
                extrapolators,
                alternations,
                every_frame=every_frame,
                on_left_out=warn,
                on_frame=advance,
            )
            measured.append(bench.shot_scores(one, scores, origin))
    record = bench.extrapolation_record(measured, extrapolators, every_frame=every_frame)
    publish(record, tables, json, update)
