"""`supersampler import`."""

import json
from collections.abc import Callable
from enum import StrEnum
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from supersampler.cli.arguments import size_text
from supersampler.errors import ArgumentError, ShotError

if TYPE_CHECKING:
    from supersampler.conventions import Conventions
    from supersampler.io.shot import Shot

_PRESETS = ("fsr", "xess", "streamline", "unreal", "unity", "blender", "arm_gym")
_OBJECT = 'an object, {"name": value, ...}'


class Layout(StrEnum):
    """Layouts that can be imported."""

    auto = "auto"
    blender = "blender"
    channels = "channels"
    arm = "arm"


def import_shot(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Folder of EXR frames, or a .safetensors.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="SHOT", help="Folder to write.")],
    layout: Annotated[Layout, typer.Option(help="What SOURCE is; auto looks.")] = Layout.auto,
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
        str | None, typer.Option(metavar="PATTERN", help="Blender: reference files, reference/*.exr say.")
    ] = None,
) -> None:
    """Copy other people's frames into a shot of this package's format.

    Pixels are not converted: the shot says in which conventions they are. `supersampler check` finds out
    whether it is right. A run that was stopped continues when it is given again.

    \b
    Examples:
      supersampler import renders/kitchen -o shots/kitchen --jitter jitter.json
      supersampler import unreal_out -o shots/city --channels map.json --conventions unreal
      supersampler import 0001.safetensors -o shots/arm
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from rich.console import Console

    from supersampler.io.shot import copy_shot

    options: dict[str, Any] = {
        "jitter": jitter,
        "channel_map": None if channels is None else _read_json(channels, "--channels"),
        "conventions": None if conventions is None else _conventions(conventions),
        "frame_rate": frame_rate,
        "cuts": None if cuts is None else _indices(cuts),
        "reference": reference,
    }
    shot = _open(source, layout, {name: value for name, value in options.items() if value is not None})
    with Console(stderr=True).status(f"copying {len(shot)} frames"):
        written = copy_shot(shot, output, resume=True)
    typer.echo(f"{len(written)} frames of {size_text(written.render_size)} in {output}")
    typer.echo(f"Next: supersampler check {output}")


def _open(source: Path, layout: Layout, options: dict[str, Any]) -> "Shot":
    """Open with the layout's importer, once it is sure that the importer takes these options."""
    from supersampler.io import shot
    from supersampler.io.shot.sources import guess_layout

    found: str = "channels" if "channel_map" in options else layout.value
    if found == Layout.auto:
        found = guess_layout(source)
    described = shot.import_channels if "channel_map" in options else shot.import_described_channels
    importers: dict[str, Callable[..., Shot]] = {
        "shot": shot.Shot.open, "blender": shot.import_blender, "channels": described, "arm": shot.import_arm,
    }  # fmt: skip
    takes = signature(importers[found]).parameters
    for name in options:
        if name not in takes:
            option = "--" + {"channel_map": "channels"}.get(name, name).replace("_", "-")
            want = f"left out: the layout of SOURCE, {found}, has no use for it"
            raise ArgumentError(option, got="given", want=want)
    if "channel_map" in options and "conventions" not in options:
        raise ArgumentError("--conventions", got="left out", want="given, as --channels is")
    return importers[found](source, **options)


def _conventions(text: str) -> "Conventions":
    from supersampler.conventions import Conventions

    if text in _PRESETS:
        preset: Conventions = getattr(Conventions, text)()
        return preset
    if text.lstrip().startswith("{"):
        content = _parsed_json(text, "--conventions")
    elif Path(text).is_file():
        content = _read_json(Path(text), "--conventions")
    else:
        want = f"one of {', '.join(_PRESETS)}, JSON, or a JSON file"
        raise ArgumentError("--conventions", got=repr(text), want=want)
    return Conventions.from_json(content)


def _read_json(path: Path, option: str) -> dict[str, Any]:
    from supersampler.io.json_fields import read_json

    try:
        content = read_json(path)
    except ShotError as error:
        raise ArgumentError(
            option, got=f"{path} ({error.problem})", want="a JSON file of an object"
        ) from error
    return _object(content, option)


def _parsed_json(text: str, option: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ArgumentError(option, got=f"not JSON ({error})", want=_OBJECT) from error
    return _object(content, option)


def _object(content: object, option: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ArgumentError(option, got=type(content).__name__, want=_OBJECT)
    return content


def _indices(text: str) -> list[int]:
    try:
        return [int(item) for item in text.split(",")]
    except ValueError:
        raise ArgumentError("--cuts", got=repr(text), want="frame indices with commas, 48,120 say") from None
