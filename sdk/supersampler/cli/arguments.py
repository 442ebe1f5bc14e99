"""Command-line options that several commands share, and parsers of their values."""

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from enum import StrEnum
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from supersampler.conventions import PRESETS, Conventions
from supersampler.errors import ArgumentError, ShotError, did_you_mean
from supersampler.frame import Size

if TYPE_CHECKING:
    from supersampler.io.shot import Shot

Layout = Literal["auto", "blender", "channels", "arm"]
Compare = Annotated[bool, typer.Option("--compare", help="Also write compare.html (last 64 frames).")]
ChannelsOption = Annotated[
    Path | None,
    typer.Option(
        help="JSON file that maps our names to channels of EXR, PNG or TIFF files, and to packed bytes.",
        show_default="channels.json beside the frames, or detected by name",
    ),
]
ConventionsOption = Annotated[
    str | None,
    typer.Option(
        help=f"One of {', '.join(PRESETS)}; or fields as JSON, such as "
        '{"preset": "blender", "motion_jittered": true}; or a JSON file with them. supersampler: the '
        "frames use this package's units and signs (docs/conventions.md)."
    ),
]
ViewLayerOption = Annotated[
    str | None,
    typer.Option(
        "--layer", metavar="NAME", help="View layer of Blender's frames, where several are complete."
    ),
]
FollowLinksOption = Annotated[
    bool | None,
    typer.Option(
        "--follow-links", help="Also read frames that are links to files outside of the folder of SHOT."
    ),
]

# Enums, as typer does not support lists of a Literal.
ImageFormat = StrEnum("ImageFormat", ["exr", "png", "tif"])
Format = StrEnum("Format", ["exr", "png", "tif", "mp4"])


def folder_path(text: str) -> Path:
    """Return the path of a folder to write; BadParameter for an empty text, as of an unset shell variable.

    `Path("")` would be the current folder.
    """
    if not text:
        raise typer.BadParameter("'' is no folder.")
    return Path(text)


OutputOption = Annotated[
    Path,
    typer.Option("-o", "--output", metavar="FOLDER", parser=folder_path, help="Folder to write."),
]
FramesOption = Annotated[
    str | None,
    typer.Option(metavar="FIRST-LAST", help="Numbers of the frames to write: 10-50.", show_default="all"),
]
ThreadsOption = Annotated[int, typer.Option(min=0, help="CPU threads; 0 uses every core.")]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace the results of an earlier run.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print a line of JSON per frame to stdout.")]


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """Options that say how to read SHOT; see `open_with`."""

    layout: Annotated[Layout, typer.Option(help="Layout of the files; auto detects it.")] = "auto"
    layer: ViewLayerOption = None
    jitter: Annotated[
        Path | None,
        typer.Option(
            help="JSON file: [[x, y], ...], one pair per frame.",
            show_default="jitter.json beside the frames",
        ),
    ] = None
    channels: ChannelsOption = None
    conventions: ConventionsOption = None
    frame_rate: Annotated[
        float | None, typer.Option(help="Frames per second.", show_default="from the files, or 24")
    ] = None
    cuts: Annotated[
        str | None, typer.Option(help="Indices of the first frames after cuts, from 0: 48,120.")
    ] = None
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="PATTERN", help="Reference images in the folder of the frames: reference/*.exr."
        ),
    ] = None
    color_space: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Colour space of the frames, such as ACEScg; no pixel is converted.",
            show_default="from the files, or lin_rec709",
        ),
    ] = None
    follow_links: FollowLinksOption = None

    def to_json(self) -> dict[str, str]:
        """Return the given options as text, for the settings of a run."""
        return {name: str(value) for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class FileOptions:
    """Options that say which files to write for each frame."""

    format: Annotated[
        list[Format] | None,
        typer.Option(
            help="exr: linear half floats. png, tif, mp4: as displayed. Repeat it for several.",
            show_default="exr; sRGB frames keep theirs",
        ),
    ] = None
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME.####",
            help="Names of the results; #### is the number.",
            show_default="as the frames",
        ),
    ] = None
    compression: Annotated[
        Literal["zip", "dwaa", "piz", "none"], typer.Option(help="EXR compression; dwaa is lossy.")
    ] = "zip"
    ocio: Annotated[
        str | None,
        typer.Option(
            "--ocio",
            metavar="CONFIG",
            help="OpenColorIO configuration for png, tif, mp4: a file, ocio://default, or "
            "ocio://studio-config-latest (ACES 2).",
            show_default="with --display, --view or --look: $OCIO, or the studio config",
        ),
    ] = None
    display: Annotated[
        str | None, typer.Option(help="Display of the configuration.", show_default="its first")
    ] = None
    view: Annotated[
        str | None, typer.Option(help="View of that display.", show_default="the display's first")
    ] = None
    look: Annotated[
        str | None, typer.Option(help="Look of the configuration.", show_default="the view's")
    ] = None
    exposure: Annotated[
        float | None,
        typer.Option(
            metavar="STOPS",
            help="Exposure of png, tif, mp4.",
            show_default="the frame's, or measured; 0 with --ocio",
        ),
    ] = None
    compare: Compare = False

    def unused(self, formats: Collection[str], *, passes: int, **others: object) -> list[str]:
        """Return lines to print about given options that have no effect.

        `formats` are those of the results, `others` the options maps and scratch, if the command has them.
        """
        shows = self.compare or {*formats} != {"exr"}
        display = ("ocio", "display", "view", "look", "exposure")
        needed = {} if shows else dict.fromkeys(display, "another --format")
        needed |= {} if self.compare else {"maps": "--compare"}
        needed |= {} if passes == 2 else {"scratch": "--passes 2"}
        given = {**asdict(self), **others}
        unused = [name for name in needed if given.get(name) not in (None, False)]
        return [f"--{name} has no effect without {needed[name]}." for name in unused]


def with_option_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Decorator: a parameter of a dataclass type, such as SourceOptions, becomes an option for each field."""
    parameters: list[Parameter] = []
    groups: dict[str, Any] = {}
    for parameter in signature(command, eval_str=True).parameters.values():
        kind = parameter.annotation
        if is_dataclass(kind):
            groups[parameter.name] = kind
            parameters += [
                Parameter(each.name, Parameter.KEYWORD_ONLY, default=each.default, annotation=each.type)
                for each in fields(kind)
            ]
        else:
            parameters.append(parameter.replace(kind=Parameter.KEYWORD_ONLY))

    @wraps(command)
    def run(**given: Any) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{each.name: given.pop(each.name) for each in fields(kind)})
        command(**given)

    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run


def open_with(
    source: str,
    options: SourceOptions,
    frames: tuple[int, int] | None = None,
    *,
    guides: Literal["surface", "denoising"] = "surface",
) -> "Shot":
    """Open a shot, a folder, a pattern or a file; for `frames` and `guides` see `open_source`.

    Raises:
        ArgumentError: an option is wrong, or the layout does not use it.
        ShotError: see `open_source`.
    """
    from supersampler.io.shot.sources import open_source

    given = asdict(options)
    layout, channels = given.pop("layout"), given.pop("channels")
    if channels is not None:
        layout, given["channel_map"] = "channels", _json_object(str(channels), "--channels")
    for name, parse in (("conventions", _conventions), ("cuts", _indices)):
        given[name] = None if given[name] is None else parse(given[name])
    arguments = {name: value for name, value in given.items() if value is not None}
    return open_source(source, layout=layout, frames=frames, guides=guides, **arguments)


def source_notes(shot: "Shot", copied: Collection[str] = ()) -> list[str]:
    """Return lines to print about an opened shot: what is not read, and what is unknown.

    `copied` are channels that the results keep unchanged.
    """
    notes = []
    if copied:
        notes.append(f"Copied, because they cannot be blended: {', '.join(copied)}")
    if unread := [name for name in shot.ignored_channels if name not in copied]:
        notes.append(f"Not read, because they cannot be blended: {', '.join(unread)}")
    if not any(map(shot.is_shaded, range(len(shot)))):
        notes.append("The frames have no colour: no R, G and B, nor another name that docs/shots.md lists.")
    if shot.late_channels:
        names = ", ".join(shot.late_channels)
        notes.append(f"Not read, because frame {shot.first_number} lacks them: {names}")
    if shot.info.known_color_space is None:
        notes.append("The files' headers have unknown primaries. State the colour space: --color-space NAME.")
    return notes


def parse_size(text: str, option: str = "size") -> Size:
    """Parse "1920x1080" as (1920, 1080); ArgumentError, with the option's name, for anything else."""
    found = re.fullmatch(r"\s*([1-9]\d*)\s*[xX×]\s*([1-9]\d*)\s*", text)
    if found is None:
        raise ArgumentError(option, got=repr(text), want="WIDTHxHEIGHT in pixels, such as 1920x1080")
    return int(found[1]), int(found[2])


def parse_providers(text: str) -> str | list[str]:
    """Parse "cuda,cpu" as a list of names; a single name stays text, because a list cannot hold "auto"."""
    names = [name.strip() for name in text.split(",")]
    return names[0] if len(names) == 1 else names


def size_text(size: Sequence[int] | None) -> str:
    """Format (1920, 1080) as "1920x1080", and None as "none"."""
    return "none" if size is None else f"{size[0]}x{size[1]}"


def _conventions(text: str) -> Conventions:
    from supersampler.io.files import is_file

    if text in PRESETS:
        return PRESETS[text]()
    if not (text.lstrip().startswith("{") or is_file(Path(text))):
        want = f"one of {', '.join(PRESETS)}, JSON, or a JSON file"
        raise ArgumentError("--conventions", got=repr(text), want=want, hint=did_you_mean(text, PRESETS))
    return Conventions.from_json(_json_object(text, "--conventions"))


def _json_object(text: str, option: str) -> dict[str, Any]:
    """Parse a JSON object: the text itself if it begins with {, otherwise the file of this name."""
    from supersampler.io.json_files import decoded, read_typed

    is_text = text.lstrip().startswith("{")
    try:
        kind = dict[str, Any]
        return decoded(Path("JSON"), text, kind) if is_text else read_typed(Path(text), kind)
    except ShotError as error:
        got = error.problem.removeprefix("is ") if is_text else f"{text} ({error.problem})"
        raise ArgumentError(option, got=got, want='an object, {"name": value, ...}') from error


def _indices(text: str) -> list[int]:
    try:
        return [int(item) for item in text.split(",")]
    except ValueError:
        want = "frame indices with commas, such as 48,120"
        raise ArgumentError("--cuts", got=repr(text), want=want) from None
