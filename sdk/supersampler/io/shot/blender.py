"""Import Blender's multilayer EXR frames: the passes Combined, Depth, Vector, Normal and diffuse colour."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from supersampler.conventions import Conventions
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Size
from supersampler.io.image_reading import read_exr_channels, read_types
from supersampler.io.shot.channel_names import blended_and_ignored
from supersampler.io.shot.channels import import_channels
from supersampler.io.shot.numbered import Jitter, Range, numbered_files, of_range
from supersampler.io.shot.shot import Shot

_DEPTH = ("Depth.Z", "Z.Z", "Z")
_NEEDED = "Turn on the passes Combined, Z and Vector, and save as OpenEXR MultiLayer."


def import_blender(
    folder: Path | str,
    *,
    layer: str | None = None,
    files: str = "*.exr",
    frames: Range | None = None,
    display_size: Size | None = None,
    frame_rate: float | None = None,
    jitter: Jitter | None = None,
    cuts: Sequence[int] = (),
    reference: str | None = None,
    conventions: Conventions | None = None,
    name: str | None = None,
    color_space: str | None = None,
) -> Shot:
    """Open a folder of Blender's OpenEXR MultiLayer frames as a Shot.

    Colour is the Combined pass; its alpha and the layer's other passes that can be blended (DiffDir, Emit,
    Mist) are AOVs, and the rest is in `Shot.ignored_channels`. Depth is
    Depth or Z, motion is Vector X and Y, and to the next frame Z and W; Normal and DiffCol are G-buffers,
    where they exist. Jitter the camera by `shift_x = x / max(w, h)`, `shift_y = -y / max(w, h)`, and render
    with a Blackman-Harris filter 0.01 pixels wide: one sample at that point.

    Args:
        folder: folder of the frames.
        layer: name of the view layer; required where several have all passes.
        files: see `import_channels`.
        frames: see `import_channels`.
        reference: pattern of the references' files in the folder, such as `reference/*.exr`.
        conventions: by default `Conventions.blender()`; jitter in pixels, y down, pixel centre + jitter.
        display_size: (width, height) of the references; by default the first reference's.
        frame_rate: see `import_channels`.
        jitter: see `import_channels`.
        cuts: see `import_channels`.
        name: name of the shot; by default the folder's.
        color_space: see `import_channels`.

    Raises:
        ShotError: files or passes are missing, or differ in size.
        ArgumentError: several layers have all passes, or `layer` is none of them.
    """
    folder = Path(folder)
    numbered = numbered_files(folder, files)
    first = next(iter(of_range(folder, numbered, frames).values()))
    types = read_types(first)
    channel_map = layer_map(first, types, layer)
    conventions = Conventions.blender() if conventions is None else conventions
    if conventions.motion_jittered:  # of Eevee: the next frame's jitter is in it
        channel_map.pop("motion_next", None)
    if reference is not None:
        image = next(iter(numbered_files(folder, reference).values()))
        channel_map["reference"] = [f"{reference}:{channel}" for channel in _reference_channels(image)]
    layer = channel_map["color"][0].removesuffix(".Combined.R")
    shot = import_channels(
        folder,
        channel_map,
        aov_names=aov_names(channel_map.get("aovs", ()), layer),
        conventions=conventions,
        files=files,
        frames=frames,
        display_size=display_size,
        frame_rate=frame_rate,
        jitter=jitter,
        cuts=cuts,
        name=name,
        color_space=color_space,
    )
    shot.ignored_channels = tuple(_ignored(types, channel_map))
    return shot


def is_blender(channels: Iterable[str]) -> bool:
    """Return whether a file with these channels has a layer with all required passes."""
    return bool(_complete_layers(list(channels)))


def layer_map(
    path: Path, types: Mapping[str, str], layer: str | None, *, motion: bool = True
) -> dict[str, list[str]]:
    """Return the channels of a view layer's passes by our names.

    Args:
        path: the file, for messages.
        types: names of all of its channels, with their types.
        layer: name of the view layer; None where only one is complete.
        motion: whether the pass Vector is needed.

    Raises:
        ShotError: no layer has all passes that are needed.
        ArgumentError: several have, or `layer` has not.
    """
    channels = list(types)
    layers = _complete_layers(channels, motion=motion)
    if not layers:
        raise ShotError(path, f"has no layer with all passes; it has {', '.join(channels)}", _NEEDED)
    if layer is None and len(layers) > 1:
        hint = "Several have all passes."
        raise ArgumentError("layer", got=None, want=f"one of {', '.join(layers)}", hint=hint)
    layer = layers[0] if layer is None else layer
    if layer not in layers:
        raise ArgumentError("layer", got=repr(layer), want=f"one of {', '.join(layers)}", hint=_NEEDED)
    depth = next(name for name in _DEPTH if f"{layer}.{name}" in channels)
    found: dict[str, list[str]] = {
        "color": [f"{layer}.Combined.{axis}" for axis in "RGB"],
        "depth": [f"{layer}.{depth}"],
        "motion": [f"{layer}.Vector.{axis}" for axis in "XY"],
        "motion_next": [f"{layer}.Vector.{axis}" for axis in "ZW"],
        "normal": [f"{layer}.Normal.{axis}" for axis in "XYZ"],
        "base_color": [f"{layer}.DiffCol.{axis}" for axis in "RGB"],
    }
    if f"{layer}.Diffuse Color.R" in channels:  # of Blender 5
        found["base_color"] = [f"{layer}.Diffuse Color.{axis}" for axis in "RGB"]
    found = {name: names for name, names in found.items() if {*names} <= {*channels}}
    alpha = f"{layer}.Combined.A"
    of_layer = {name: kind for name, kind in types.items() if name.startswith(f"{layer}.") and name != alpha}
    aovs = [name for name in (alpha,) if name in channels] + blended_and_ignored(of_layer, found)[0]
    return found | ({"aovs": aovs} if aovs else {})


def aov_names(channels: Iterable[str], layer: str) -> list[str]:
    """Return the names of AOVs in files of results: A is alpha, GlossDir.R a pass."""
    return [name.removeprefix(f"{layer}.").removeprefix("Combined.") for name in channels]


def _ignored(types: Iterable[str], channel_map: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the channels of a file that are not read."""
    read = {name for names in channel_map.values() for name in names}
    return [name for name in types if name not in read]


def _complete_layers(channels: Sequence[str], *, motion: bool = True) -> list[str]:
    """Return the names of the layers that have colour, depth and, if wanted, motion, in the file's order."""
    layers = [name.removesuffix(".Combined.R") for name in channels if name.endswith(".Combined.R")]
    return [
        layer
        for layer in layers
        if (not motion or f"{layer}.Vector.X" in channels)
        and any(f"{layer}.{depth}" in channels for depth in _DEPTH)
    ]


def _reference_channels(path: Path) -> list[str]:
    """Return the colour channels of a reference: a layer's Combined pass, or plain R, G, B."""
    channels = read_exr_channels(path)
    for name in channels:
        if name == "R" or name.endswith(".Combined.R"):
            return [f"{name.removesuffix('R')}{axis}" for axis in "RGB"]
    hint = "A reference has R, G, B or Combined."
    raise ShotError(path, f"has no colour; it has {', '.join(channels)}", hint)
