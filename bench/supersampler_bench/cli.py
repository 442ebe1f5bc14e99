"""`supersampler bench ...`; the main command finds `app` by this module's name."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from supersampler.cli.arguments import ShotArgument, open_shot
from supersampler_bench.quality import measure_quality
from supersampler_bench.record import quality_record, write_json
from supersampler_bench.table import find_block, markdown_table, rich_table, update_block

app = typer.Typer(no_args_is_help=True)


@app.callback()
def bench() -> None:
    """Measure methods on shots with references; every published number comes from here."""


@app.command()
def quality(
    shot: ShotArgument,
    methods: Annotated[
        str, typer.Option(help="Names of shipped models or model folders, with commas between.")
    ] = "bilinear,bicubic,taa,taau",
    json: Annotated[Path | None, typer.Option(help="Write all values and their setting here.")] = None,
    update: Annotated[
        Path | None, typer.Option(help="Rewrite the table between this Markdown file's bench marks.")
    ] = None,
) -> None:
    """Compare the pictures of methods with a shot's references.

    PSNR, SSIM and FLIP of frames; tPSNR and warped error of changes from frame to frame; PSNR where something
    was hidden a frame ago and where the picture moves. All on pictures as a screen shows them: exposed, tone
    mapped, sRGB.

    Example: supersampler bench quality courtyard --methods bilinear,taau --update README.md
    """
    opened = open_shot(shot)
    if update is not None:
        find_block(update, opened.name)  # fails now, not after minutes of measuring
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(opened.name, total=len(opened))
        names = [method.strip() for method in methods.split(",")]
        results = measure_quality(opened, names, on_frame=lambda n: progress.update(task, completed=n))
    Console().print(rich_table(opened, results))
    if json is not None:
        write_json(quality_record(opened, results), json)
    if update is not None:
        update_block(update, opened.name, markdown_table(opened, results))
