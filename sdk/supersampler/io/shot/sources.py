"""Open a shot whatever its layout is."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from supersampler.arguments import checked_choice
from supersampler.errors import ShotError
from supersampler.io.images import read_exr_channels
from supersampler.io.shot.arm import import_arm
from supersampler.io.shot.blender import import_blender, is_blender
from supersampler.io.shot.channels import MAP_FILE_NAME, import_channels, import_described_channels
from supersampler.io.shot.format import FILE_NAME
from supersampler.io.shot.shipped import path_or_shipped
from supersampler.io.shot.shot import Shot

Layout: TypeAlias = Literal["auto", "shot", "blender", "channels", "arm"]
_KNOWN = (
    f"Known are a folder with {FILE_NAME}, Blender's EXR frames, EXR frames with {MAP_FILE_NAME}, and Arm's "
    ".safetensors."
)


def open_source(path: Path | str, *, layout: Layout = "auto", **options: object) -> Shot:
    """Open a shot of this package, a folder of Blender's or anybody's EXR frames, or an Arm sequence.

    Args:
        path: the folder, its shot.json or another JSON file of that format, or the .safetensors file; or the
            name of a shot that ships, as of `Shot.open`.
        layout: "auto" looks at what is there; else "shot", "blender", "channels" or "arm".
        options: for `import_blender`, `import_channels` or `import_arm`, as the layout asks. Without a
            channel_map the layout "channels" reads the channels.json in the folder.

    Raises:
        ShotError: nothing that is known lies there; the message says what was found.
        ArgumentError: the layout is unknown.
    """
    path = path_or_shipped(path)
    if path.name == FILE_NAME:
        path = path.parent
    checked_choice("layout", layout, get_args(Layout))
    openers: Mapping[str, Callable[..., Shot]] = {
        "shot": Shot.open,
        "blender": import_blender,
        "channels": import_channels if "channel_map" in options else import_described_channels,
        "arm": import_arm,
    }
    return openers[guess_layout(path) if layout == "auto" else layout](path, **options)


def guess_layout(path: Path) -> Literal["shot", "blender", "channels", "arm"]:
    """Tell the layout from the names in a folder and the channels of its first frame.

    Raises:
        ShotError: it is none that is known; the message says what was found.
    """
    try:
        if path.is_file() and path.suffix in (".safetensors", ".json"):
            return "arm" if path.suffix == ".safetensors" else "shot"
        if not path.exists():
            raise ShotError(path, "there is no such file or folder", _KNOWN)
        if not path.is_dir():
            raise ShotError(path, "is neither a folder nor a .json or .safetensors file", _KNOWN)
        if (path / FILE_NAME).exists():
            return "shot"
        if (path / MAP_FILE_NAME).exists():
            return "channels"
        names = sorted(item.name for item in path.iterdir())
    except OSError as error:
        if isinstance(error, ShotError):
            raise
        raise ShotError(path, f"cannot be read ({error})", _KNOWN) from error
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
    """At most eight names, and how many more there are."""
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return ", ".join(names[:8]) + more
