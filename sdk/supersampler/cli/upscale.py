"""`supersampler upscale`: upscales a shot into a folder of images."""

from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.arguments import (
    Compare,
    Format,
    Precision,
    Preset,
    ShotArgument,
    Validate,
    open_shot,
    parse_providers,
    parse_size,
    parse_skip,
)
from supersampler.errors import ArgumentError


def upscale(
    shot: ShotArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
    method: Annotated[
        str | None, typer.Option(help="A shipped model by name.", show_default="classifier")
    ] = None,
    model: Annotated[Path | None, typer.Option(help="A model folder, instead of --method.")] = None,
    display_size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH", help="Size of the results, such as 1920x1080.", show_default="the shot's, or 2x"
        ),
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="Instead of --display-size: display over render size, 1.0 to 4.0.")
    ] = None,
    format: Annotated[  # noqa: A002  # the option's name
        list[Format] | None,
        typer.Option(
            help="exr: linear half floats. png: exposed, tone mapped, sRGB. Twice for both, in two folders.",
            show_default="exr",
        ),
    ] = None,
    compare: Compare = False,
    maps: Annotated[
        bool,
        typer.Option("--maps", help="With --compare: also classes, weight of the history, samples, work."),
    ] = False,
    providers: Annotated[
        str,
        typer.Option(
            help="ONNX Runtime providers in order, commas between: cuda,cpu. auto takes a GPU if any."
        ),
    ] = "auto",
    threads: Annotated[int, typer.Option(min=0, help="CPU threads; 0 takes every core.")] = 0,
    precision: Annotated[
        Precision, typer.Option(help="Of the network. int8: fast on a CPU. fp32, fp16: a graph that ships.")
    ] = "auto",
    skip: Annotated[
        str,
        typer.Option(
            help="exact: compute every pixel. auto, or the error to settle at: converge where nothing moves. "
            "accumulate: also where noise does."
        ),
    ] = "auto",
    preset: Annotated[
        Preset | None, typer.Option(help="Sets method, precision and skip for the best error at its speed.")
    ] = None,
    extrapolate: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL",
            help="Extrapolates frames of SHOT that were not shaded: guided-warp, or a model folder. "
            "All frames need G-buffers.",
        ),
    ] = None,
    validate: Annotated[
        Validate,
        typer.Option(
            help="off: check shapes. warn: also pixels after cuts. strict: pixels of every frame, and stop."
        ),
    ] = "warn",
    record: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Record all frames, for `supersampler replay`.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the results of an earlier run.")
    ] = False,
) -> None:
    """Upscale SHOT, frame by frame, into a folder of images.

    A run that was stopped continues when the same command is given again: complete frames are kept, and the
    history is rebuilt from the frames since the last cut.

    \b
    Examples:
      supersampler upscale plaza -o out --compare
      supersampler upscale renders/kitchen -o out --display-size 3840x2160
      supersampler upscale shot -o out --model my_model --scale 1.5 --format exr --format png
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.cli.run import UpscaleJob, run_job

    if method is not None and model is not None:
        raise ArgumentError("--method and --model", got="both given", want="one of the two")
    if display_size is not None and scale is not None:
        raise ArgumentError("--display-size and --scale", got="both given", want="one of the two")
    job = UpscaleJob(
        shot=open_shot(shot),
        output=output,
        model=model or method,
        display_size=None if display_size is None else parse_size(display_size),
        scale=scale,
        formats=tuple(sorted({item.value for item in format or [Format.exr]})),
        compare=compare,
        maps=maps,
        providers=parse_providers(providers),
        threads=threads,
        precision=precision,
        skip=parse_skip(skip),
        preset=preset,
        extrapolation=extrapolate,
        validate=validate,
        record=record,
        overwrite=overwrite,
    )
    run_job(job)
    if record is not None:
        typer.echo(f"Replay: supersampler replay {record}")
    if compare:
        typer.echo(f"Open in a browser: {output / 'compare.html'}")
