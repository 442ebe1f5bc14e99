"""`supersampler import`: copies frames of other programs into a shot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from supersampler.cli.arguments import size_text
from supersampler.errors import ArgumentError, ShotError

if TYPE_CHECKING:
    from supersampler.conventions import Conventions

_PRESETS = ("fsr", "xess", "streamline", "unreal", "unity", "blender", "arm_gym")
Layout = Literal["auto", "blender", "channels", "arm"]


def import_shot(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Folder of EXR frames, or a .safetensors.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="SHOT", help="Folder to write.")],
    layout: Annotated[Layout, typer.Option(help="Layout of SOURCE; auto detects it.")] = "auto",
    jitter: Annotated[
        Path | None,
        typer.Option(
            help="JSON file, [[x, y], ...], one pair a frame.", show_default="jitter.json in SOURCE"
        ),
    ] = None,
    channels: Annotated[
        Path | None,
        typer.Option(help="JSON file: our names to EXR channels.", show_default="channels.json in SOURCE"),
    ] = None,
    conventions: Annotated[
        str | None,
        typer.Option(help=f"One of {', '.join(_PRESETS)}; or fields as JSON; or a JSON file of them."),
    ] = None,
    frame_rate: Annotated[float | None, typer.Option(help="Frames a second.", show_default="24")] = None,
    cuts: Annotated[str | None, typer.Option(help="First frames after cuts: 48,120.")] = None,
    reference: Annotated[
        str | None, typer.Option(metavar="PATTERN", help="Blender: reference files, such as reference/*.exr.")
    ] = None,
) -> None:
    """Copy frames of other programs into a shot of this package's format.

    Pixels are not converted: the shot states their conventions, and `supersampler check` tests them. A run
    that was stopped continues when the same command is given again.

    \b
    Examples:
      supersampler import renders/kitchen -o shots/kitchen --jitter jitter.json
      supersampler import unreal_out -o shots/city --channels map.json --conventions unreal
      supersampler import 0001.safetensors -o shots/arm
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from rich.console import Console

    from supersampler.io.shot import copy_shot, open_source

    given = {
        "jitter": jitter,
        "channel_map": None if channels is None else _json_object(str(channels), "--channels"),
        "conventions": None if conventions is None else _conventions(conventions),
        "frame_rate": frame_rate,
        "cuts": None if cuts is None else _indices(cuts),
        "reference": reference,
    }
    options = {name: value for name, value in given.items() if value is not None}
    if channels is not None and conventions is None:
        raise ArgumentError("--conventions", got="left out", want="given, as --channels is")
    try:
        shot = open_source(source, layout=layout if channels is None else "channels", **options)
    except ArgumentError as error:
        if error.name not in options:
            raise
        option = "--" + {"channel_map": "channels"}.get(error.name, error.name).replace("_", "-")
        raise ArgumentError(option, got=error.got, want=error.want, hint=error.hint) from error
    with Console(stderr=True).status(f"copying {len(shot)} frames"):
        written = copy_shot(shot, output, resume=True)
    typer.echo(f"{len(written)} frames of {size_text(written.render_size)} in {output}")
    typer.echo(f"Next: supersampler check {output}")


def _conventions(text: str) -> "Conventions":
    from supersampler.conventions import Conventions
    from supersampler.io.atomic import is_file

    if text in _PRESETS:
        preset: Conventions = getattr(Conventions, text)()
        return preset
    if not (text.lstrip().startswith("{") or is_file(Path(text))):
        want = f"one of {', '.join(_PRESETS)}, JSON, or a JSON file"
        raise ArgumentError("--conventions", got=repr(text), want=want)
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
