"""Import EXR sequences whose channels have names that are in wide use."""

from collections.abc import Sequence
from pathlib import Path

from supersampler.conventions import Conventions
from supersampler.errors import ShotError
from supersampler.frame import Size
from supersampler.io.image_reading import read_types
from supersampler.io.shot.channel_names import blended_and_ignored, of_first_view, recognised_map
from supersampler.io.shot.channels import import_channels
from supersampler.io.shot.numbered import Jitter, Range, numbered_files, of_range
from supersampler.io.shot.shot import Shot


def import_named_channels(
    folder: Path | str,
    *,
    conventions: Conventions,
    files: str = "*.exr",
    frames: Range | None = None,
    reference: str | None = None,
    display_size: Size | None = None,
    frame_rate: float | None = None,
    jitter: Jitter | None = None,
    cuts: Sequence[int] = (),
    name: str | None = None,
    color_space: str | None = None,
) -> Shot:
    """Open a folder of EXR frames as a Shot by the names of their channels, such as R, Z and motion.X.

    docs/shots.md lists the names. Channels that have none of them and can be blended are AOVs; the rest is in
    `Shot.ignored_channels`; so are the views of a stereo file but the first.

    Args:
        folder: folder of the files.
        conventions: conventions of these channels and of the jitter; names do not state them.
        reference: pattern of the references' files, with R, G and B, such as `reference/*.exr`.
        files: see `import_channels`.
        frames: see `import_channels`.
        display_size: see `import_channels`.
        frame_rate: see `import_channels`.
        jitter: see `import_channels`.
        cuts: see `import_channels`.
        name: see `import_channels`.
        color_space: see `import_channels`.

    Raises:
        ShotError: files or channels are missing or differ in size, or several channels have one meaning.
    """
    folder = Path(folder)
    first = next(iter(of_range(folder, numbered_files(folder, files), frames).values()))
    types, other_views = of_first_view(first, read_types(first))
    channel_map = recognised_map(first, types)
    if channel_map is None:
        hint = "docs/shots.md lists the names that are recognised; a channels.json states others."
        raise ShotError(first, f"has no depth or no motion among {', '.join(types)}", hint)
    if conventions.motion_jittered:  # the next frame's jitter is in it
        channel_map.pop("motion_next", None)
    aovs, ignored = blended_and_ignored(types, channel_map)
    if aovs:
        channel_map["aovs"] = aovs
    if reference is not None:
        channel_map["reference"] = [f"{reference}:{axis}" for axis in "RGB"]
    shot = import_channels(
        folder,
        channel_map,
        conventions=conventions,
        files=files,
        frames=frames,
        display_size=display_size,
        frame_rate=frame_rate,
        jitter=jitter,
        cuts=cuts,
        name=name,
        aov_names=_in_results(aovs, channel_map.get("color", ["R"])[0][:-1]),
        color_space=color_space,
    )
    shot.ignored_channels = (*ignored, *other_views)
    return shot


def _in_results(aovs: Sequence[str], layer: str) -> list[str]:
    """Return the names of AOVs in files of results, where colour is R, G, B: beauty.A is A."""
    names = [name.removeprefix(layer) for name in aovs]
    return names if len({*names, *"RGB"}) == len(names) + 3 else list(aovs)
