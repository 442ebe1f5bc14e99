"""`supersampler upscale`: upscales shots into folders of images."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from supersampler.cli.arguments import (
    AtRest,
    Compare,
    Format,
    Precision,
    Preset,
    Validate,
    parse_providers,
    parse_size,
)
from supersampler.cli.display_options import Display, Exposure, Look, Ocio, View, display_transform_of
from supersampler.cli.source_options import (
    ChannelsOption,
    ColorSpaceOption,
    ConventionsOption,
    CutsOption,
    FrameRateOption,
    JitterOption,
    LayoutOption,
    ReferenceOption,
    open_with,
    source_notes,
)
from supersampler.cli.terminal import echo
from supersampler.errors import ArgumentError, SupersamplerError

if TYPE_CHECKING:
    from supersampler.cli.image_options import ImageOptions
    from supersampler.cli.job import UpscaleJob
    from supersampler.io.shot import Shot
    from supersampler.io.shot.numbered import FrameNumbers

_SUFFIXES = (".exr", ".png", ".tif", ".tiff", ".json", ".safetensors")  # folders may have dots in their names
Compression = Literal["zip", "dwaa", "piz", "none"]
Shots = Annotated[
    list[str],
    typer.Argument(
        metavar="SHOT", help="A shot, a folder of frames, a pattern such as beauty.####.exr, or plaza."
    ),
]


def upscale(
    shots: Shots,
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
    frames: Annotated[
        str | None,
        typer.Option(metavar="RANGES", help="Numbers of the frames to write: 10-50,60.", show_default="all"),
    ] = None,
    preroll: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Frames before a range that build its history. Also without --frames: images of chunks.",
            show_default="with --frames one period of the jitter, at least 32",
        ),
    ] = None,
    format: Annotated[  # noqa: A002  # the option's name
        list[Format] | None,
        typer.Option(
            help="exr: linear half floats. png, tif, mp4: as a display shows it. Repeat for several.",
            show_default="exr, or that of sRGB frames",
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME.####",
            help="Names of results; #### is the number.",
            show_default="those of the frames",
        ),
    ] = None,
    compression: Annotated[Compression, typer.Option(help="Of EXR; dwaa loses a little.")] = "zip",
    ocio: Ocio = None,
    display: Display = None,
    view: View = None,
    look: Look = None,
    exposure: Exposure = None,
    compare: Compare = False,
    maps: Annotated[
        bool,
        typer.Option(
            "--maps", help="With --compare: also classes, weight of the history, samples, what is frozen."
        ),
    ] = False,
    layout: LayoutOption = "auto",
    jitter: JitterOption = None,
    channels: ChannelsOption = None,
    conventions: ConventionsOption = None,
    frame_rate: FrameRateOption = None,
    cuts: CutsOption = None,
    reference: ReferenceOption = None,
    color_space: ColorSpaceOption = None,
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
    at_rest: Annotated[
        AtRest | None,
        typer.Option(
            help="Where nothing moves. converge: to the mean of the samples. accumulate: also where noise "
            "changes, for path tracers. off: depend on recent frames only.",
            show_default="converge; off with --frames or --preroll",
        ),
    ] = None,
    no_skip: Annotated[
        bool, typer.Option("--no-skip", help="Compute frozen tiles, too; the images are the same.")
    ] = False,
    preset: Annotated[
        Preset | None, typer.Option(help="Sets method and precision for the best error at its speed.")
    ] = None,
    passes: Annotated[
        int,
        typer.Option(min=1, max=2, help="2: also step backward, and merge: better, and twice the time."),
    ] = 1,
    scratch: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="With --passes 2: where frames wait for the second pass; removed at the end.",
            show_default="the system's temporary files",
        ),
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
    profile: Annotated[bool, typer.Option("--profile", help="Print where the time goes.")] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print a line of JSON for each frame on the standard output.")
    ] = False,
) -> None:
    """Upscale SHOT, frame by frame, into a folder of images; several, each into a folder of its name.

    A run that was stopped continues when the same command is given again: complete frames are kept, and the
    history is rebuilt from the frames since the last cut. Exit codes: 0 done, 1 an error, 2 wrong arguments,
    130 stopped.

    \b
    Examples:
      supersampler upscale plaza -o out --compare
      supersampler upscale "renders/beauty.####.exr" -o out --conventions blender --frames 100-199
      supersampler upscale shots/* -o out --format exr --format mp4 --view "ACES 2.0 - SDR 100 nits (Rec.709)"
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.cli.job import UpscaleJob
    from supersampler.io.shot.numbered import FrameNumbers

    if method is not None and model is not None:
        raise ArgumentError("--method and --model", got="both given", want="one of the two")
    if display_size is not None and scale is not None:
        raise ArgumentError("--display-size and --scale", got="both given", want="one of the two")
    numbers = None if frames is None else FrameNumbers.parse(frames, "--frames")
    source: dict[str, Any] = {
        "layout": layout,
        "jitter": jitter,
        "channels": channels,
        "conventions": conventions,
        "frame_rate": frame_rate,
        "cuts": cuts,
        "reference": reference,
        "color_space": color_space,
    }
    shown = {"ocio": ocio, "display": display, "view": view, "look": look, "exposure": exposure}
    settings: dict[str, Any] = {
        "numbers": numbers,
        "preroll": preroll,
        "model": model or method,
        "display_size": None if display_size is None else parse_size(display_size, "--display-size"),
        "scale": scale,
        "compare": compare,
        "maps": maps,
        "providers": parse_providers(providers),
        "threads": threads,
        "precision": precision,
        "at_rest": at_rest,
        "skip": not no_skip,
        "preset": preset,
        "passes": passes,
        "scratch": scratch,
        "extrapolation": extrapolate,
        "validate": validate,
        "overwrite": overwrite,
        "profile": profile,
        "json": json,
        "source": {name: str(value) for name, value in source.items() if value is not None},
    }
    folders = _folders(shots, output)
    if record is not None and passes > 1:
        raise ArgumentError("--record", got="given with --passes 2", want="one pass, in order")
    if record is not None and len(folders) > 1:
        raise ArgumentError("--record", got="given for several shots", want="one shot")
    failed = 0
    for text, folder in folders.items():
        try:
            shot, note = _opened(text, source, numbers, preroll, passes)
            images = _image_options(shot, format, name, compression, shown)
            job = UpscaleJob(shot=shot, output=folder, images=images, **settings, record=record)
            if note:
                job.console.print(note, soft_wrap=True)
            _run(job)
        except (SupersamplerError, OSError) as error:
            if len(folders) == 1:
                raise
            failed += 1
            echo(f"error: {error}", err=True)
    if failed:
        raise typer.Exit(1)


def _opened(
    text: str, source: dict[str, Any], numbers: "FrameNumbers | None", preroll: int | None, passes: int
) -> tuple["Shot", str]:
    """Open a shot, or what the frames of these numbers need of it; return also a note to print, or ""."""
    from supersampler.cli.frame_plan import open_for

    if numbers is None:
        return open_with(text, **source), ""
    return open_for(numbers, preroll, lambda frames: open_with(text, **source, frames=frames), passes)


def _run(job: "UpscaleJob") -> None:
    """Run a job, and print what to open."""
    from supersampler.cli.run import run_job

    for note in source_notes(job.shot):
        job.console.print(note, soft_wrap=True)
    results = run_job(job)
    if job.json:
        return
    if job.record is not None:
        echo(f"Replay: supersampler replay {job.record}")
    if job.images.video:
        echo(f"Video: {job.output / results.video}")
    if job.compare:
        echo(f"Open in a browser: {job.output / results.page}")


def _image_options(
    shot: "Shot",
    formats: list[Format] | None,
    name: str | None,
    compression: str,
    shown: Mapping[str, Any],
) -> "ImageOptions":
    """Return the options of the images of a shot; sRGB-encoded frames come back as they were by default."""
    from supersampler.cli.image_options import checked_name, image_options
    from supersampler.io.display_transforms import REC709
    from supersampler.io.images import UNKNOWN_COLOR_SPACE

    stored, srgb, stated = shot.stored_as, shot.conventions.srgb, shot.info.color_space
    space = None if stated == UNKNOWN_COLOR_SPACE else stated
    same = srgb and stored.format in ("png", "tif")
    return image_options(
        [item.value for item in formats] if formats else [stored.format if same else "exr"],
        name=checked_name(shot.info.file_names if name is None else re.sub(r"%0?(\d{0,2})d", _hashes, name)),
        transform=display_transform_of(color_space=space or REC709, srgb=srgb, **shown),
        compression=compression,
        straight_alpha=stored.format in ("png", "tif"),
        bits=16 if same and stored.type == "uint16" else 8,
        color_space=space,
    )


def _hashes(field: re.Match[str]) -> str:
    return "#" * int(field[1] or 1)


def _folders(shots: list[str], output: Path) -> dict[str, Path]:
    """Return the folder of the results of each shot; with several, a subfolder of its name."""
    from supersampler.io.shot.numbered import is_pattern

    if len(shots) == 1:
        return {shots[0]: output}
    folders: dict[str, Path] = {}
    for text in shots:
        path = Path(text).resolve()
        name = path.stem if path.suffix.lower() in _SUFFIXES else path.name
        if is_pattern(path):
            name = re.sub(r"[._ -]*(#+|%0?\d*d|[*?]+)", "", name)
        folder = output / (path.parent.name if name == "" or path.name == "shot.json" else name)
        if folder in folders.values():
            other = next(shot for shot, given in folders.items() if given == folder)
            raise ArgumentError("SHOT", got=f"{other} and {text}", want="shots of different names")
        folders[text] = folder
    return folders
