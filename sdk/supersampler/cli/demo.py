"""`supersampler demo`: upscales the shipped shot, or serves a page that upscales in a browser."""

import time
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.arguments import OutputOption, folder_path
from supersampler.cli.terminal import echo


def demo(
    output: OutputOption = Path("out"),
    method: Annotated[str, typer.Option(help="A shipped model: see `supersampler info`.")] = "classifier",
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Also replace the results of another command.")
    ] = False,
    web: Annotated[
        bool, typer.Option("--web", help="Serve a page that upscales in a browser, until Ctrl-C.")
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, help="With --web: port on 127.0.0.1.  [default: a free one]"),
    ] = None,
    write: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            parser=folder_path,
            help="With --web: write the page to this new folder, for a file host; do not serve it.",
        ),
    ] = None,
    node_modules: Annotated[
        Path | None,
        typer.Option(
            help="With --web: npm's folder with three, for the page of three.js.  [default: node_modules, if "
            "it has the tested version]"
        ),
    ] = None,
) -> None:
    """Upscale the shipped shot by 2x, and compare the result with input and reference.

    Writes EXR frames (linear), PNG frames (as displayed) and compare.html, a page that needs no network: drag
    the split, step through the frames, zoom. Replaces an earlier demo in the folder. With --web: serves a
    page that renders a scene live and upscales it with WebGPU.
    """
    if web:
        _serve(port or 0, write, node_modules)
    elif (port, write, node_modules) != (None, None, None):
        raise typer.BadParameter("--port, --write and --node-modules need --web")
    else:
        _upscale(output, method, overwrite=overwrite)


def _upscale(output: Path, method: str, *, overwrite: bool) -> None:
    from supersampler.cli.results import DEMO, ImageOptions
    from supersampler.cli.upscale_run import UpscaleRun
    from supersampler.io.shot import Shot

    run = UpscaleRun(
        shot=Shot.open("plaza"),
        output=output,
        model=method,
        scale=2.0,
        images=ImageOptions(formats=("exr", "png")),
        compare=True,
        maps=True,
        source=DEMO,
        overwrite=overwrite,
    )
    run.write()
    echo(f"EXR frames: {output / 'exr'}")
    echo(f"PNG frames: {output / 'png'}")
    echo(f"Open in a browser: {output / 'compare.html'}")


def _serve(port: int, write: Path | None, node_modules: Path | None) -> None:
    from supersampler.errors import ShotError
    from supersampler.integrations.web import THREE_VERSION, serving, site_files, write_site

    shader_files = import_module("supersampler_export.shaders.folder").shader_files
    try:
        files = site_files(shader_files, node_modules=node_modules or Path("node_modules"))
    except ShotError:  # a project may have another version
        if node_modules is not None:
            raise
        echo(f"Without the page of three.js; to have it: npm install three@{THREE_VERSION}", err=True)
        files = site_files(shader_files)
    if write is not None:
        write_site(write, files)
        echo(f"Page: {write}  (browsers load it from a server only: python -m http.server -d {write})")
        return
    with serving(files, port) as url:
        echo(f"Open in a browser with WebGPU: {url}  (Ctrl-C stops)")
        while True:  # on Windows, Ctrl-C does not interrupt an unlimited wait
            time.sleep(0.5)
