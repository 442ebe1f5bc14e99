"""`open_source`: opens a shot of any supported file layout."""

from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from supersampler.arguments import checked_choice, checked_path
from supersampler.errors import ArgumentError, ShotError
from supersampler.io.files import check_inside, os_errors_as_shot_error
from supersampler.io.images import read_header
from supersampler.io.shot.arm import import_arm
from supersampler.io.shot.blender import RENDER_FILE, import_blender, import_render, is_blender
from supersampler.io.shot.channels import (
    MAP_FILE_NAME,
    SequenceOptions,
    import_channels,
    import_described_channels,
)
from supersampler.io.shot.format import FILE_NAME
from supersampler.io.shot.named_channels import import_named_channels, of_first_view, recognised_map
from supersampler.io.shot.numbered import (
    FOLLOW_LINKS,
    FRAME_SUFFIXES,
    Range,
    is_pattern,
    numbered_files,
    suggestion,
)
from supersampler.io.shot.shot import Shot, path_or_shipped

Layout: TypeAlias = Literal["auto", "shot", "render", "blender", "channels", "arm"]
_OPENERS: Mapping[str, Callable[..., Shot]] = {
    "shot": Shot.open, "render": import_render, "blender": import_blender, "arm": import_arm,
}  # fmt: skip
_KNOWN = (
    f"Supported: a folder with {FILE_NAME}, Blender's EXR frames, EXR frames with {MAP_FILE_NAME}, and Arm's "
    ".safetensors."
)


def open_source(
    path: Path | str, *, layout: Layout = "auto", frames: Range | None = None, **options: object
) -> Shot:
    """Open a shot of this package, a folder of Blender's or other EXR frames, or an Arm sequence.

    Args:
        path: the folder, its shot.json or another JSON file of that format, or the .safetensors file; or a
            pattern of EXR frames: `renders/beauty.####.exr`, `renders/beauty.%04d.exr`,
            `renders/beauty_*.exr`; or the name of a shipped shot.
        layout: "auto" detects it from the files; otherwise "shot", "render" (rendered by `supersampler
            blender`), "blender", "channels" or "arm".
        frames: first and last number of the frames to open, both included; by default all. Numbers before the
            first frame and after the last are ignored.
        options: arguments of the layout's importer: `import_blender`, `import_channels`,
            `import_named_channels` or `import_arm`. The layout "channels" without a channel_map reads the
            channels.json in the folder; without that file, `import_named_channels` recognises the channels.
            `guides` is ignored by other layouts than "blender".

    Raises:
        ShotError: the layout is not supported; the message states what was found.
        ArgumentError: there is no such layout, or it does not take an option.
    """
    checked_choice("layout", layout, get_args(Layout))
    if is_pattern(Path(checked_path("path", path))):
        path, options["files"] = Path(path).parent, Path(path).name
    else:
        path = path_or_shipped(path)
        if path.name == FILE_NAME:
            path = path.parent
    pattern: Any = options.get("files")
    files = None if "files" not in options else str(checked_path("files", pattern))
    if layout == "auto":
        layout = guess_layout(path, files, follow_links=options.get("follow_links") is True)
    opener = _opener(layout, path, options)
    parameters = {*signature(opener).parameters}
    if "options" in parameters:
        parameters |= SequenceOptions.__annotations__.keys()
    if "guides" not in parameters:
        options.pop("guides", None)  # only Blender's frames have a choice
    if files is not None and "files" not in parameters:
        raise ArgumentError("path", got="a pattern", want=f"a folder or file, as the layout is {layout!r}")
    for name in options:
        if name not in parameters:
            is_stated = layout == "shot" and name != "follow_links"
            hint = f"Change {FILE_NAME} instead." if is_stated else ""
            want = f"left out: the layout {layout!r} does not use it"
            raise ArgumentError(name, got="given", want=want, hint=hint)
    if "frames" in parameters:
        return opener(path, frames=frames, **options)
    shot = opener(path, **options)
    return shot if frames is None else shot.cropped(*frames)


def _opener(layout: str, path: Path, options: Mapping[str, object]) -> Callable[..., Shot]:
    """Return the importer of a layout; ArgumentError if it needs conventions that are not given."""
    if layout != "channels":
        return _OPENERS[layout]
    if "channel_map" not in options and (path / MAP_FILE_NAME).exists():
        return import_described_channels
    if "conventions" not in options:
        hint = "Channel names do not state them; `supersampler check` tests given ones."
        want = "given: the units and signs of the channels, such as unreal, or supersampler for our own"
        raise ArgumentError("conventions", got="left out", want=want, hint=hint)
    return import_channels if "channel_map" in options else import_named_channels


def guess_layout(
    path: Path, files: str | None = None, *, follow_links: bool = False
) -> Literal["shot", "render", "blender", "channels", "arm"]:
    """Return the layout by file and channel names; ShotError, which states them, if it is not supported.

    `files` is the pattern of the frames' files in the folder; None accepts all EXR files. For `follow_links`
    see `import_channels`.
    """
    with os_errors_as_shot_error(path, hint=_KNOWN):
        if path.is_file() and path.suffix in (".safetensors", ".json"):
            return "arm" if path.suffix == ".safetensors" else "shot"
        if path.is_file() and path.suffix.lower() in FRAME_SUFFIXES:
            raise ShotError(path, "is one image; want a sequence", suggestion(path.parent))
        if not path.exists():
            is_image = path.suffix.lower() in FRAME_SUFFIXES
            hint = suggestion(path.parent) if is_image and path.parent.is_dir() else _KNOWN
            raise ShotError(path, "there is no such file or folder", hint)
        if not path.is_dir():
            raise ShotError(path, "is neither a folder nor a .json or .safetensors file", _KNOWN)
        if files is None and (path / FILE_NAME).exists():
            return "shot"
        if files is None and (path / RENDER_FILE).exists():
            return "render"
        if (path / MAP_FILE_NAME).exists():
            return "channels"
        names = sorted(item.name for item in path.iterdir())
    frames = [path / name for name in names if name.lower().endswith(".exr") and not name.startswith(".")]
    if files is not None:
        frames = list(numbered_files(path, files, follow_links=follow_links).values())
    if not frames:
        raise ShotError(path, f"holds {_listed(names) or 'nothing'}", _KNOWN)
    if not follow_links:
        check_inside(path, frames[:1], FOLLOW_LINKS)
    header = read_header(frames[0])
    types, other_views = of_first_view(header)
    if is_blender(types):
        return "blender"
    if recognised_map(frames[0], types) is not None:
        return "channels"
    if other_views and any(".Combined." in name for name in types):
        hint = "Set Views Format to Individual, render again, and give the files of one view: ####_L.exr."
        raise ShotError(path, "holds several views in each file, as Blender 4 names their channels", hint)
    blender = "in Blender, turn on Combined, Z and Vector, and save as OpenEXR MultiLayer"
    hint = f"Map them in a {MAP_FILE_NAME} (docs/shots.md); {blender}."
    raise ShotError(path, f"holds frames with the channels {_listed(list(header.types))}", hint)


def _listed(names: Sequence[str]) -> str:
    """Return at most eight names as text, and the number of the others."""
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return ", ".join(names[:8]) + more
