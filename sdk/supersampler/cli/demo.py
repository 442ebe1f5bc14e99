"""`supersampler demo`: upscales the shot that ships with the package."""

from pathlib import Path
from typing import Annotated

import typer


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")] = Path("out"),
    method: Annotated[str, typer.Option(help="A shipped model: see `supersampler info`.")] = "classifier",
) -> None:
    """Upscale the shot that ships with the package by 2x, and show the result beside input and reference.

    Writes EXR frames (linear), PNG frames (as a screen shows them) and compare.html, one page that needs no
    network: drag the split, step through the frames, zoom.
    """
    from supersampler.cli.image_options import ImageOptions
    from supersampler.cli.job import UpscaleJob
    from supersampler.cli.run import run_job
    from supersampler.io.shot import Shot

    job = UpscaleJob(
        shot=Shot.open("plaza"),
        output=output,
        model=method,
        scale=2.0,
        images=ImageOptions(formats=("exr", "png")),
        compare=True,
        maps=True,
    )
    results = run_job(job)
    typer.echo(f"EXR frames: {results.place('exr')}")
    typer.echo(f"PNG frames: {results.place('png')}")
    typer.echo(f"Open in a browser: {output / 'compare.html'}")
