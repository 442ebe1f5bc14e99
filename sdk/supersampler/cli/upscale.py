"""`supersampler upscale`: upscales shots into folders of images."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from supersampler.arguments import AtRest, Precision, PresetName, Validate
from supersampler.cli import arguments
from supersampler.cli.arguments import open_with, source_notes, with_option_groups
from supersampler.cli.terminal import Terminal, echo
from supersampler.errors import ArgumentError

_RUN_OPTIONS = (
    "output", "preroll", "scale", "maps", "threads", "precision", "at_rest", "preset", "passes", "scratch",
    "validate", "record", "overwrite", "json",
)  # fmt: skip
"""Parameters that are passed to `UpscaleRun` unchanged."""


@with_option_groups
def upscale(
    *,
    shot: Annotated[
        str,
        typer.Argument(
            metavar="SHOT", help="A shot, a folder of frames, a pattern such as beauty.####.exr, or plaza."
        ),
    ],
    output: arguments.OutputOption,
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
    frames: arguments.FramesOption = None,
    preroll: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Frames before --frames that build the history. Without --frames: compute the images as if "
            "in chunks.",
            show_default="with --frames: one jitter period, at least 32",
        ),
    ] = None,
    files: arguments.FileOptions,
    maps: Annotated[
        bool,
        typer.Option(
            "--maps", help="With --compare: also class map, history weight, sample count, frozen pixels."
        ),
    ] = False,
    source: arguments.SourceOptions,
    providers: Annotated[
        str,
        typer.Option(
            help="ONNX Runtime providers in order of preference: cuda,cpu. auto uses a GPU if there is one."
        ),
    ] = "auto",
    threads: arguments.ThreadsOption = 0,
    precision: Annotated[
        Precision,
        typer.Option(help="Precision of the network. int8: fast on a CPU. fp32, fp16: a shipped graph."),
    ] = "auto",
    at_rest: Annotated[
        AtRest | None,
        typer.Option(
            help="Static pixels. converge: to the mean of their samples. accumulate: also where only noise "
            "changes, for path tracers. off: depend on recent frames only.",
            show_default="converge; off with --frames or --preroll",
        ),
    ] = None,
    no_skip: Annotated[
        bool, typer.Option("--no-skip", help="Also compute frozen tiles; the images are the same.")
    ] = False,
    preset: Annotated[
        PresetName | None, typer.Option(help="Set method and precision: Pareto-optimal in time and error.")
    ] = None,
    passes: Annotated[
        int,
        typer.Option(min=1, max=2, help="2: also step backward, and merge; better images in twice the time."),
    ] = 1,
    scratch: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            parser=arguments.folder_path,
            help="With --passes 2: folder for frames that wait for the second pass; its files are removed.",
            show_default="the system's temporary folder",
        ),
    ] = None,
    extrapolate: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL",
            help="Extrapolate unshaded frames of SHOT: guided-warp, guided-flow, or a model folder. All "
            "frames need G-buffers.",
        ),
    ] = None,
    validate: Annotated[
        Validate,
        typer.Option(
            help="off: check shapes. warn: also pixels after cuts. strict: pixels of every frame, and stop."
        ),
    ] = "warn",
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            parser=arguments.folder_path,
            help="Record all frames, for `supersampler replay`.",
        ),
    ] = None,
    overwrite: arguments.OverwriteOption = False,
    json: arguments.JsonOption = False,
) -> None:
    """Upscale SHOT, frame by frame, into a folder of images.

    The same command resumes a stopped run: complete frames are kept, and the history is rebuilt from the
    frames since the last cut. Exit codes: 0 done, 1 an error, 2 wrong arguments, 130 stopped.

    \b
    Examples:
      supersampler upscale plaza -o out --compare
      supersampler upscale "renders/beauty.####.exr" -o out --conventions blender --frames 100-199
      supersampler upscale shots/city -o out --format png --view "ACES 2.0 - SDR 100 nits (Rec.709)"
    """  # noqa: D301  # \b: click keeps the line breaks
    from supersampler.cli.results import ImageOptions
    from supersampler.cli.upscale_run import UpscaleRun, open_for
    from supersampler.io.shot.numbered import FrameRange

    given = dict(locals())
    if method is not None and model is not None:
        raise ArgumentError("--method", got="given with --model", want="one of the two")
    if display_size is not None and scale is not None:
        raise ArgumentError("--scale", got="given with --display-size", want="one of the two")
    if record is not None and passes > 1:
        raise ArgumentError("--record", got="given with --passes 2", want="one pass, in order")
    numbers = None if frames is None else FrameRange.parse(frames, "--frames")
    size = None if display_size is None else arguments.parse_size(display_size, "--display-size")
    console, note = Terminal(stderr=True), ""
    if numbers is None:
        opened = open_with(shot, source)
    else:
        opened, note = open_for(numbers, preroll, partial(open_with, shot, source), passes)
    written = ImageOptions.of(files, opened)
    unused = files.unused(written.formats, passes=passes, maps=maps, scratch=scratch)
    for line in (*filter(None, [note]), *source_notes(opened), *unused):
        console.print(line, soft_wrap=True)
    run = UpscaleRun(
        shot=opened,
        source=source.to_json(),
        images=written,
        numbers=numbers,
        compare=files.compare,
        model=model or method,
        display_size=size,
        providers=arguments.parse_providers(providers),
        skip=not no_skip,
        extrapolation=extrapolate,
        console=console,
        **{key: given[key] for key in _RUN_OPTIONS},
    )
    results = run.write()
    if json:
        return
    if record is not None:
        echo(f"Replay: supersampler replay {record}")
    if written.video:
        echo(f"Video: {output / results.record.video}")
    if files.compare:
        echo(f"Open in a browser: {output / results.record.page}")
