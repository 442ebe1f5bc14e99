"""Command-line options that several commands share, and parsers of their values."""

import re
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from supersampler.conventions import PRESETS, Conventions
from supersampler.errors import ArgumentError, ShotError, did_you_mean
from supersampler.frame import Size

if TYPE_CHECKING:
    from supersampler.io.display_transforms import DisplayTransform
    from supersampler.io.shot import Shot

# The same words as in the SDK's modules, whose import would slow down `--help`.
Validate = Literal["off", "warn", "strict"]
Precision = Literal["auto", "fp32", "fp16", "int8"]
Executor = Literal["auto", "onnx", "cpu", "gpu"]
Preset = Literal["fast", "balanced", "high"]
AtRest = Literal["converge", "accumulate", "off"]
Layout = Literal["auto", "blender", "channels", "arm"]

Compare = Annotated[bool, typer.Option("--compare", help="Also write compare.html (last 64 frames).")]
ShotArgument = Annotated[str, typer.Argument(metavar="SHOT", help="A shot, or the name of a shipped one.")]

LayoutOption: TypeAlias = Annotated[Layout, typer.Option(help="Layout of the files; auto detects it.")]
JitterOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="JSON file: [[x, y], ...], one pair per frame.", show_default="jitter.json beside the frames"
    ),
]
ChannelsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="JSON file that maps our names to channels of EXR, PNG or TIFF files, and to packed bytes.",
        show_default="channels.json beside the frames, or detected by name",
    ),
]
ConventionsOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help=f"One of {', '.join(PRESETS)}; or fields as JSON; or a JSON file with them. supersampler: the "
        "frames use this package's units and signs (docs/conventions.md)."
    ),
]
FrameRateOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Frames per second.", show_default="from the files, or 24")
]
CutsOption: TypeAlias = Annotated[
    str | None, typer.Option(help="Indices of the first frames after cuts, from 0: 48,120.")
]
ReferenceOption: TypeAlias = Annotated[
    str | None, typer.Option(metavar="PATTERN", help="Reference images, such as reference/*.exr.")
]
ColorSpaceOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Colour space of the frames, such as ACEScg; no pixel is converted.",
        show_default="from the files, or lin_rec709",
    ),
]
SOURCE_OPTIONS = (
    "layout", "jitter", "channels", "conventions", "frame_rate", "cuts", "reference", "color_space",
)  # fmt: skip
"""Parameters of the commands that have the options above: see `open_with`."""

Ocio = Annotated[
    str | None,
    typer.Option(
        "--ocio",
        metavar="CONFIG",
        help="OpenColorIO configuration for png, tif, mp4: a file, ocio://default, or "
        "ocio://studio-config-latest (ACES 2).",
        show_default="with --display, --view or --look: $OCIO, or the studio config",
    ),
]
Display = Annotated[str | None, typer.Option(help="Display of the configuration.", show_default="its first")]
View = Annotated[str | None, typer.Option(help="View of that display.", show_default="the display's first")]
Look = Annotated[str | None, typer.Option(help="Look of the configuration.", show_default="the view's")]
Exposure = Annotated[
    float | None,
    typer.Option(
        metavar="STOPS",
        help="Exposure of png, tif, mp4.",
        show_default="the frame's, or measured; 0 with --ocio",
    ),
]
DISPLAY_OPTIONS = ("ocio", "display", "view", "look", "exposure")
"""Parameters of the commands that have the options above: see `display_transform_of`."""


class ImageFormat(StrEnum):  # a Literal cannot be given several times
    """Formats of image files."""

    exr = "exr"
    png = "png"
    tif = "tif"


class Format(StrEnum):
    """Formats of results."""

    exr = "exr"
    png = "png"
    tif = "tif"
    mp4 = "mp4"


OutputOption: TypeAlias = Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")]
FramesOption: TypeAlias = Annotated[
    str | None,
    typer.Option(metavar="FIRST-LAST", help="Numbers of the frames to write: 10-50.", show_default="all"),
]
FormatOption: TypeAlias = Annotated[
    list[Format] | None,
    typer.Option(
        help="exr: linear half floats. png, tif, mp4: as displayed. Repeat it for several.",
        show_default="exr; sRGB frames keep theirs",
    ),
]
NameOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="NAME.####",
        help="Names of the results; #### is the number.",
        show_default="as the frames",
    ),
]
CompressionOption: TypeAlias = Annotated[
    Literal["zip", "dwaa", "piz", "none"], typer.Option(help="EXR compression; dwaa is lossy.")
]
ThreadsOption: TypeAlias = Annotated[int, typer.Option(min=0, help="CPU threads; 0 uses every core.")]
OverwriteOption: TypeAlias = Annotated[
    bool, typer.Option("--overwrite", help="Replace the results of an earlier run.")
]
JsonOption: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print a line of JSON per frame to stdout.")
]


def open_with(
    source: str,
    options: dict[str, Any],
    frames: tuple[int, int] | None = None,
    *,
    guides: Literal["surface", "denoising"] = "surface",
) -> "Shot":
    """Open a shot, a folder, a pattern or a file.

    `options` are values of the parameters SOURCE_OPTIONS, and maybe others; for `frames` see
    `open_source`, for `guides`, of Blender's frames, `import_blender`.

    Raises:
        ArgumentError: an option is wrong, or the layout does not use it; it is named as on the command line.
        ShotError: see `open_source`.
    """
    from supersampler.io.shot.sources import layout_of, open_source

    layout, given = options["layout"], {name: options[name] for name in SOURCE_OPTIONS[1:]}
    if (channels := given.pop("channels")) is not None:
        layout, given["channel_map"] = "channels", _json_object(str(channels), "--channels")
    for name, parse in (("conventions", _conventions), ("cuts", _indices)):
        given[name] = None if given[name] is None else parse(given[name])
    try:
        arguments = {name: value for name, value in given.items() if value is not None}
        if guides != "surface" and layout_of(source, layout, arguments) == "blender":
            arguments["guides"] = guides
        return open_source(source, layout=layout, frames=frames, **arguments)
    except ArgumentError as error:
        raise _with_option(error, {**dict.fromkeys(given, ""), "channel_map": "--channels"}) from error


def source_of(options: dict[str, Any]) -> dict[str, str]:
    """Return the options SOURCE_OPTIONS that were given, as text for the settings of a run."""
    return {key: str(options[key]) for key in SOURCE_OPTIONS if options[key] is not None}


def source_notes(shot: "Shot") -> list[str]:
    """Return lines to print about an opened shot: what is not read, or not known."""
    from supersampler.io.images import UNKNOWN_COLOR_SPACE

    notes = []
    if shot.ignored_channels:
        notes.append(f"Not read, because they cannot be blended: {', '.join(shot.ignored_channels)}")
    if shot.info.color_space == UNKNOWN_COLOR_SPACE:
        notes.append("The files' headers have unknown primaries. State the colour space: --color-space NAME.")
    return notes


def display_transform_of(color_space: str, *, srgb: bool, options: dict[str, Any]) -> "DisplayTransform":
    """Return `display_transform_from` of DISPLAY_OPTIONS; errors name the options as they are typed.

    `options` are values of the parameters DISPLAY_OPTIONS, and maybe others.

    Raises:
        ArgumentError, ShotError: a name is not in the configuration, or it cannot be read.
    """
    from supersampler.io.display_transforms import display_transform_from

    given = {name: options[name] for name in DISPLAY_OPTIONS}
    try:
        return display_transform_from(color_space=color_space, srgb=srgb, **given)
    except ArgumentError as error:
        raise _with_option(error, dict.fromkeys([*given, "color_space"], "")) from error


def parse_size(text: str, option: str = "size") -> Size:
    """Parse "1920x1080" as (1920, 1080); ArgumentError, with the name of the option, for anything else."""
    found = re.fullmatch(r"\s*([1-9]\d*)\s*[xX×]\s*([1-9]\d*)\s*", text)
    if found is None:
        raise ArgumentError(option, got=repr(text), want="WIDTHxHEIGHT in pixels, such as 1920x1080")
    return int(found[1]), int(found[2])


def parse_providers(text: str) -> str | list[str]:
    """Parse "cuda,cpu" as a list of names; one name stays text, as "auto" is not allowed in a list."""
    names = [name.strip() for name in text.split(",")]
    return names[0] if len(names) == 1 else names


def size_text(size: Sequence[int] | None) -> str:
    """Format (1920, 1080) as "1920x1080", and None as "none"."""
    return "none" if size is None else f"{size[0]}x{size[1]}"


def _with_option(error: ArgumentError, names: dict[str, str]) -> ArgumentError:
    """Return the error with the option in place of the argument that it names.

    `names` maps arguments to options; "" stands for the option of the argument's name.
    """
    if error.name not in names:
        return error
    option = names[error.name] or f"--{error.name.replace('_', '-')}"
    return ArgumentError(option, got=error.got, want=error.want, hint=error.hint)


def _conventions(text: str) -> Conventions:
    from supersampler.io.files import is_file

    if text in PRESETS:
        return PRESETS[text]()
    if not (text.lstrip().startswith("{") or is_file(Path(text))):
        want = f"one of {', '.join(PRESETS)}, JSON, or a JSON file"
        raise ArgumentError("--conventions", got=repr(text), want=want, hint=did_you_mean(text, PRESETS))
    return Conventions.from_json(_json_object(text, "--conventions"))


def _json_object(text: str, option: str) -> dict[str, Any]:
    """Return a JSON object: the text itself if it begins with {, else the file of this name."""
    from supersampler.io.json_files import decoded, read_json

    want = 'an object, {"name": value, ...}'
    try:
        is_text = text.lstrip().startswith("{")
        content = decoded(Path("JSON"), text, dict) if is_text else read_json(Path(text))
    except ShotError as error:
        got = f"not JSON ({error.problem})" if is_text else f"{text} ({error.problem})"
        raise ArgumentError(option, got=got, want=want) from error
    if not isinstance(content, dict):
        raise ArgumentError(option, got=type(content).__name__, want=want)
    return content


def _indices(text: str) -> list[int]:
    try:
        return [int(item) for item in text.split(",")]
    except ValueError:
        want = "frame indices with commas, such as 48,120"
        raise ArgumentError("--cuts", got=repr(text), want=want) from None
