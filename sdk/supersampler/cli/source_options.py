"""The options of the commands that open frames of other programs: `import`, `check` and `upscale`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from supersampler.conventions import PRESETS, Conventions
from supersampler.errors import ArgumentError, ShotError, did_you_mean

if TYPE_CHECKING:
    from supersampler.io.shot import Shot

_OPTIONS = {"channel_map": "--channels"}  # where an option has another name than the importers' argument

Layout = Literal["auto", "blender", "channels", "arm"]
LayoutOption: TypeAlias = Annotated[Layout, typer.Option(help="Layout of the files; auto detects it.")]
JitterOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="JSON file, [[x, y], ...], one pair a frame.", show_default="jitter.json with the frames"
    ),
]
ChannelsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="JSON file: our names to channels of EXR, PNG or TIFF files, and packed bytes.",
        show_default="channels.json with the frames, or by their names",
    ),
]
ConventionsOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help=f"One of {', '.join(PRESETS)}; or fields as JSON; or a JSON file of them. supersampler: the "
        "frames have our own units and signs (docs/conventions.md)."
    ),
]
FrameRateOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Frames a second.", show_default="what the files state, or 24")
]
CutsOption: TypeAlias = Annotated[
    str | None, typer.Option(help="First frames after cuts, counted from 0: 48,120.")
]
ReferenceOption: TypeAlias = Annotated[
    str | None, typer.Option(metavar="PATTERN", help="Reference files, such as reference/*.exr.")
]
ColorSpaceOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Colour space of the frames, such as ACEScg; no pixel is converted.",
        show_default="what the files state, or lin_rec709",
    ),
]


def open_with(
    source: str,
    *,
    layout: Layout = "auto",
    jitter: Path | None = None,
    channels: Path | None = None,
    conventions: str | None = None,
    frame_rate: float | None = None,
    cuts: str | None = None,
    reference: str | None = None,
    color_space: str | None = None,
    frames: tuple[int, int] | None = None,
) -> "Shot":
    """Open a shot, a folder, a pattern or a file with the values of the options above.

    Args:
        source: see `open_source`.
        layout: value of --layout; so the next ones, None where the option is left out.
        jitter: of --jitter.
        channels: of --channels.
        conventions: of --conventions.
        frame_rate: of --frame-rate.
        cuts: of --cuts.
        reference: of --reference.
        color_space: of --color-space.
        frames: see `open_source`.

    Raises:
        ArgumentError: an option is wrong, or the layout does not use it; it is named as on the command line.
        ShotError: see `open_source`.
    """
    from supersampler.io.shot import open_source

    given = {
        "jitter": jitter,
        "channel_map": None if channels is None else _json_object(str(channels), "--channels"),
        "conventions": None if conventions is None else _conventions(conventions),
        "frame_rate": frame_rate,
        "cuts": None if cuts is None else _indices(cuts),
        "reference": reference,
        "color_space": color_space,
    }
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    try:
        return open_source(
            source, layout=layout if channels is None else "channels", frames=frames, **options
        )
    except ArgumentError as error:
        if error.name not in given:
            raise
        option = _OPTIONS.get(error.name, f"--{error.name.replace('_', '-')}")
        raise ArgumentError(option, got=error.got, want=error.want, hint=error.hint) from error


def source_notes(shot: "Shot") -> list[str]:
    """Return lines to print of an opened shot: what is not read, not known, or lost in its files."""
    from supersampler.io.images import UNKNOWN_COLOR_SPACE

    notes = []
    if shot.ignored_channels:
        notes.append(f"Not read, as they cannot be blended: {', '.join(shot.ignored_channels)}")
    if shot.info.color_space == UNKNOWN_COLOR_SPACE:
        notes.append("Unknown primaries in the files' headers. State the colour space: --color-space NAME.")
    return [*notes, *(f"Lost in these files: {loss}" for loss in shot.losses)]


def _conventions(text: str) -> Conventions:
    from supersampler.io.files import is_file

    if text in PRESETS:
        return PRESETS[text]()
    if not (text.lstrip().startswith("{") or is_file(Path(text))):
        want = f"one of {', '.join(PRESETS)}, JSON, or a JSON file"
        raise ArgumentError("--conventions", got=repr(text), want=want, hint=did_you_mean(text, PRESETS))
    return Conventions.from_json(_json_object(text, "--conventions"))


def _json_object(text: str, option: str) -> dict[str, Any]:
    """Return a JSON object, of the text itself where it begins with {, else of the file of this name."""
    from supersampler.io.json_fields import parse_json, read_json

    want = 'an object, {"name": value, ...}'
    try:
        content = parse_json(text.encode()) if text.lstrip().startswith("{") else read_json(Path(text))
    except (ShotError, ValueError, RecursionError) as error:
        got = f"{text} ({error.problem})" if isinstance(error, ShotError) else f"not JSON ({error})"
        raise ArgumentError(option, got=got, want=want) from error
    if not isinstance(content, dict):
        raise ArgumentError(option, got=type(content).__name__, want=want)
    return content


def _indices(text: str) -> list[int]:
    try:
        return [int(item) for item in text.split(",")]
    except ValueError:
        raise ArgumentError(
            "--cuts", got=repr(text), want="frame indices with commas, such as 48,120"
        ) from None
