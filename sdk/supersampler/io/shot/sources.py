"""`open_source`: opens a shot of any known file layout."""

from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from supersampler.arguments import checked_choice
from supersampler.errors import ArgumentError, ShotError
from supersampler.io.atomic import os_errors_as_shot_error
from supersampler.io.image_reading import read_exr_channels
from supersampler.io.shot.arm import import_arm
from supersampler.io.shot.blender import import_blender, is_blender
from supersampler.io.shot.blender_render import import_render
from supersampler.io.shot.channels import MAP_FILE_NAME, import_channels, import_described_channels
from supersampler.io.shot.format import FILE_NAME
from supersampler.io.shot.render_record import RENDER_FILE
from supersampler.io.shot.shipped import path_or_shipped
from supersampler.io.shot.shot import Shot

Layout: TypeAlias = Literal["auto", "shot", "render", "blender", "channels", "arm"]
_KNOWN = (
    f"Known are a folder with {FILE_NAME}, Blender's EXR frames, EXR frames with {MAP_FILE_NAME}, and Arm's "
    ".safetensors."
)


def open_source(path: Path | str, *, layout: Layout = "auto", **options: object) -> Shot:
    """Open a shot of this package, a folder of Blender's or other EXR frames, or an Arm sequence.

    Args:
        path: the folder, its shot.json or another JSON file of that format, or the .safetensors file; or the
            name of a shot that ships.
        layout: "auto" detects it from the files; else "shot", "render" (`supersampler blender` rendered it),
            "blender", "channels" or "arm".
        options: arguments of the layout's importer: `import_blender`, `import_channels` or `import_arm`.
            Without a channel_map the layout "channels" reads the channels.json in the folder.

    Raises:
        ShotError: the layout is not known; the message says what was found.
        ArgumentError: there is no such layout, or it does not take an option.
    """
    path = path_or_shipped(path)
    if path.name == FILE_NAME:
        path = path.parent
    if checked_choice("layout", layout, get_args(Layout)) == "auto":
        layout = guess_layout(path)
    openers: Mapping[str, Callable[..., Shot]] = {
        "shot": Shot.open,
        "render": import_render,
        "blender": import_blender,
        "channels": import_channels if "channel_map" in options else import_described_channels,
        "arm": import_arm,
    }
    takes = signature(openers[layout]).parameters
    for name in options:
        if name not in takes:
            raise ArgumentError(name, got="given", want=f"left out: the layout {layout!r} does not use it")
    return openers[layout](path, **options)


def guess_layout(path: Path) -> Literal["shot", "render", "blender", "channels", "arm"]:
    """Return the layout by file and channel names; ShotError, with what was found, where it is unknown."""
    with os_errors_as_shot_error(path, hint=_KNOWN):
        if path.is_file() and path.suffix in (".safetensors", ".json"):
            return "arm" if path.suffix == ".safetensors" else "shot"
        if not path.exists():
            raise ShotError(path, "there is no such file or folder", _KNOWN)
        if not path.is_dir():
            raise ShotError(path, "is neither a folder nor a .json or .safetensors file", _KNOWN)
        if (path / FILE_NAME).exists():
            return "shot"
        if (path / RENDER_FILE).exists():
            return "render"
        if (path / MAP_FILE_NAME).exists():
            return "channels"
        names = sorted(item.name for item in path.iterdir())
    frames = [path / name for name in names if name.endswith(".exr") and not name.startswith(".")]
    if not frames:
        raise ShotError(path, f"holds {_listed(names) or 'nothing'}", _KNOWN)
    channels = read_exr_channels(frames[0])
    if is_blender(channels):
        return "blender"
    hint = (
        f"A {MAP_FILE_NAME} says which is which (docs/shots.md); in Blender, turn on Combined, Z and Vector."
    )
    raise ShotError(path, f"holds EXR frames with the channels {_listed(channels)}", hint)


def _listed(names: Sequence[str]) -> str:
    """Return at most eight names, and the number of the others."""
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return ", ".join(names[:8]) + more
