"""`supersampler denoise`: denoises path-traced animations into folders of images."""

import re
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from supersampler.cli import arguments
from supersampler.cli.arguments import SOURCE_OPTIONS, Format, open_with, source_notes
from supersampler.cli.terminal import Terminal, echo


def denoise(
    shot: Annotated[
        str,
        typer.Argument(
            metavar="SHOT", help="A shot, a folder of frames, or a pattern such as beauty.####.exr."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")],
    per_frame: Annotated[
        Literal["auto", "oidn", "none"],
        typer.Option(
            help="What denoises each frame first. oidn: Open Image Denoise. none: the frames are denoised. "
            "auto: none where the files say so (Blender's Noisy Image)."
        ),
    ] = "auto",
    passes: Annotated[
        int, typer.Option(min=1, max=2, help="2: look at the frames before and after. 1: at those before.")
    ] = 2,
    lookahead: Annotated[
        int | None,
        typer.Option(
            min=1, max=8, help="With --passes 2: frames after a frame to look at.", show_default="8"
        ),
    ] = None,
    frames: Annotated[
        str | None,
        typer.Option(metavar="FIRST-LAST", help="Numbers of the frames to write: 10-50.", show_default="all"),
    ] = None,
    format: Annotated[  # noqa: A002  # the option's name
        list[Format] | None,
        typer.Option(
            help="exr: linear half floats. png, tif, mp4: as displayed. Repeat it for several.",
            show_default="exr; sRGB frames keep theirs",
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME.####",
            help="Names of the results; #### is the number.",
            show_default="as the frames",
        ),
    ] = None,
    compression: Annotated[
        Literal["zip", "dwaa", "piz", "none"], typer.Option(help="EXR compression; dwaa is lossy.")
    ] = "zip",
    ocio: arguments.Ocio = None,
    display: arguments.Display = None,
    view: arguments.View = None,
    look: arguments.Look = None,
    exposure: arguments.Exposure = None,
    compare: arguments.Compare = False,
    layout: arguments.LayoutOption = "auto",
    jitter: arguments.JitterOption = None,
    channels: arguments.ChannelsOption = None,
    conventions: arguments.ConventionsOption = None,
    frame_rate: arguments.FrameRateOption = None,
    cuts: arguments.CutsOption = None,
    reference: arguments.ReferenceOption = None,
    color_space: arguments.ColorSpaceOption = None,
    threads: Annotated[int, typer.Option(min=0, help="CPU threads; 0 uses every core.")] = 0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the results of an earlier run.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print a line of JSON per frame to stdout.")] = False,
) -> None:
    """Denoise SHOT, the frames of a path tracer, into a folder of images of the same size.

    Each frame is denoised by itself; then up to eight frames before and after it are gathered along the
    motion, and averaged where they agree. Frames need colour, depth and motion; albedo and normal make edges
    sharp. Alpha and AOVs are averaged alike; a missing frame is a cut. The same command resumes a stopped
    run.

    \b
    Examples:
      supersampler denoise renders -o out
      supersampler denoise "renders/beauty.####.exr" -o out --conventions blender --frames 100-199
      supersampler denoise renders -o out --per-frame none --compare
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.cli.denoise_run import DenoiseJob, parts_of, run_denoise
    from supersampler.cli.results import checked_name
    from supersampler.cli.upscale import image_options
    from supersampler.io.shot.numbered import FrameRange

    given = dict(locals())
    numbers = None if frames is None else FrameRange.parse(frames, "--frames")
    if name is not None:
        name = checked_name(re.sub(r"%0?(\d{0,2})d", lambda field: "#" * int(field[1] or 1), name))
    console = Terminal(stderr=True)
    open_frames = partial(open_with, shot, given, guides="denoising")
    for part, opened, note in parts_of(numbers, open_frames, passes):
        for line in (*filter(None, [note]), *source_notes(opened)):
            console.print(line, soft_wrap=True)
        job = DenoiseJob(
            shot=opened,
            output=output,
            source={key: str(given[key]) for key in SOURCE_OPTIONS if given[key] is not None},
            images=image_options(opened, given, name),
            numbers=part,
            compare=compare,
            per_frame=per_frame,
            passes=passes,
            lookahead=lookahead,
            threads=threads,
            overwrite=overwrite,
            json=json,
            console=console,
        )
        results = run_denoise(job)
        if job.images.video and not json:
            echo(f"Video: {output / results.video}")
        if compare and not json:
            echo(f"Open in a browser: {output / results.page}")
