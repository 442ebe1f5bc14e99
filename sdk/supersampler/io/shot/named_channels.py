"""Import EXR sequences whose channels have common names."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Unpack

from supersampler.conventions import Conventions
from supersampler.conventions.conventions import checked_conventions
from supersampler.errors import ShotError
from supersampler.io.images import ImageHeader, luminance_chroma_error, read_header
from supersampler.io.shot.channels import SequenceOptions, first_file, import_channels
from supersampler.io.shot.id_channels import base_name, is_id
from supersampler.io.shot.numbered import numbered_files
from supersampler.io.shot.shot import Shot

_XYZ, _RGB = ("xyz", "rgb"), ("rgb", ("red", "green", "blue"))
_VALUE = ("y", "v", "x")
_NAMES: Mapping[str, tuple[tuple[str, ...], tuple[Sequence[str], ...]]] = {
    "color": (("", "rgb", "rgba", "beauty", "combined", "color", "colour"), _RGB),
    "depth": (("depth", "z", "zdepth"), ("z", "v", "r", "y", "x")),
    "motion": (
        ("motion", "motionvector", "motionvectors", "velocity", "vector", "backward"), ("xy", "rg", "uv"),
    ),
    "motion_next": (("forward",), ("xy", "rg", "uv")),
    "normal": (("n", "normal", "normals"), _XYZ),
    "base_color": (("basecolor", "albedo", "diffusealbedo", "diffcol", "diffusecolor"), _RGB),
    "roughness": (("roughness",), (*_VALUE, "r")),
    "metallic": (("metallic", "metalness"), (*_VALUE, "r")),
    "specular": (("specular",), _VALUE),
}  # fmt: skip
"""Our name to the names before a channel's last dot, and the letters or words after it, as in docs/shots.md.

They may be in any case, with spaces, hyphens and underscores. Those in _ALONE may have no letter after them:
`Z`, `roughness`.
"""
_ALPHA = ("a", "alpha")
_LUMINANCE, _CHROMA = "Y", {"RY", "BY"}
"""Channels of EXR files without colours: one for grey images, all for luminance with chroma."""
_ALONE = ("depth", "roughness", "metallic", "specular")
_DATA = re.compile(
    r"""((world|object|local|camera|view|ref|rest|point)[_ ]?(space[_ ]?)?)?pos(ition)?s?
    |p|pref|[pn]world|uv([ ]coordinates)?|st
    |(.*[_ -])(z|depth)|zback|(hit)?pz                        # Arnold: volume_Z; RenderMan, Karma
    |.*normals?|nn|(.*[_ -])motion|motion(back|fore)|dp(camera)?dtime
    |(denoising|noisy|debug)[ ].*""",
    re.VERBOSE,
)
"""Names of other data that cannot be blended, in lower case: positions, depth, normals, other vectors."""


def recognised_map(path: Path, channels: Iterable[str]) -> dict[str, list[str]] | None:
    """Return the channels of a file by our names, for `import_channels`; None without depth or motion.

    Nuke's `forward` leads to the next frame. It is used only together with Nuke's `backward`, as other motion
    may have other units.

    Raises:
        ShotError: several channels have the same meaning; or the only motion leads to the next frame.
    """
    there = list(channels)
    found: dict[str, list[str]] = {}
    for ours in _NAMES:
        candidates = _candidates(ours, there)
        if len(candidates) > 1:
            listed = " and ".join(", ".join(names) for names in candidates)
            hint = "Choose in a channels.json (docs/shots.md), or by `supersampler import --channels FILE`."
            raise ShotError(path, f"has several channels for {ours}: {listed}", hint)
        if candidates:
            found[ours] = candidates[0]
    if "color" not in found and _LUMINANCE in there:
        if not _CHROMA.isdisjoint(there):
            raise luminance_chroma_error(path)
        found["color"] = [_LUMINANCE] * 3
    following = found.get("motion_next", [])
    if following and "motion" not in found:
        problem = f"has motion to the next frame, {', '.join(following)}, and none to the previous frame"
        hint = "Write backward vectors, too; or map these in a channels.json if they are backward vectors."
        raise ShotError(path, problem, hint)
    if following and found["motion"][0].lower().split(".")[-2:-1] != ["backward"]:
        del found["motion_next"]
    return found if {"depth", "motion"} <= found.keys() else None


def of_first_view(header: ImageHeader) -> tuple[dict[str, str], list[str]]:
    """Return the channels of a stereo file's first view with their types, and the names of the others."""
    others = header.other_views
    return {name: kind for name, kind in header.types.items() if name not in others}, [*others]


def blended_and_ignored(
    types: Mapping[str, str], used: Mapping[str, Sequence[str]], cryptomattes: Collection[str] = ()
) -> tuple[list[str], list[str]]:
    """Return the other channels of a file: AOVs, and channels that are not read.

    Ids, positions, integers, and further depth, vectors and normals are not read, because blends of their
    values are meaningless.

    Args:
        types: channel names with their types.
        used: channels by our names.
        cryptomattes: Cryptomatte layers that the header names.
    """
    ours = set(chain.from_iterable(used.values()))
    others = [name for name in types if name not in ours]
    blended = [
        name
        for name in others
        if types[name] in ("half", "float") and not (_is_data(name) or is_id(name, cryptomattes))
    ]
    return blended, [name for name in others if name not in blended]


def late_channels(shot: Shot, first: ImageHeader) -> tuple[str, ...]:
    """Return the channels of the last frame that the first lacks; none if the last one is incomplete."""
    try:
        last = shot.read_header(len(shot) - 1)
    except ShotError:
        return ()
    return tuple(name for name in last.types if name not in first.types)


def _is_data(channel: str) -> bool:
    """Return whether a channel's name is a name of positions, depth, motion or normals."""
    base = base_name(channel).lower().lstrip("_")  # RenderMan: __Pworld
    vectors = {name for ours in ("depth", "motion", "motion_next", "normal") for name in _NAMES[ours][0]}
    return _joined(base) in vectors or _DATA.fullmatch(base) is not None


def _joined(name: str) -> str:
    """Return a name in lower case without spaces, hyphens and underscores."""
    return re.sub("[ _-]", "", name.lower())


def _candidates(ours: str, channels: Sequence[str]) -> list[list[str]]:
    """Return the groups of channels that have the names of one of our arrays.

    Names in one case, as R, G and B, are a group whatever else differs from them only in its case.
    """
    bases, endings = _NAMES[ours]
    by_lower = {name.lower(): name for name in channels}
    groups, of_mixed_case = [], []
    for name in channels:
        *before, last = name.lower().split(".")
        base = _joined(before[-1]) if before else ""
        is_known = _joined(last) in bases and base not in bases
        is_alone = is_known and (not before or len(last) > 1)  # N.Z: of a normal
        if ours in _ALONE and is_alone:
            groups.append([name])
        layer, own = name[: len(name) - len(last)], name[len(name) - len(last) :]
        for ending in endings:
            if base not in bases or last != ending[0]:
                continue
            group = [layer + (part.upper() if own.isupper() else part) for part in ending]
            if all(member in channels for member in group):
                groups.append(group)
            elif all(member.lower() in by_lower for member in group):
                of_mixed_case.append([by_lower[member.lower()] for member in group])
    known = [[member.lower() for member in group] for group in groups]
    return groups + [g for g in of_mixed_case if [member.lower() for member in g] not in known]


def _parts_of_color(channels: Iterable[str]) -> list[str]:
    """Return the channels with a name of red, green or blue of the colour."""
    bases, endings = _NAMES["color"]
    letters = {*chain.from_iterable(endings)}
    split = {name: ["", *name.lower().split(".")] for name in channels}
    return [name for name, parts in split.items() if parts[-2] in bases and parts[-1] in letters]


def _likely_color(blended: Sequence[str]) -> list[str]:
    """Return three channels of one layer that may be colour by an unknown name; [] if there are none."""
    layers: dict[str, list[str]] = {}
    for name in blended:
        layers.setdefault(name.rpartition(".")[0], []).append(name)
    return next((names[:3] for names in layers.values() if len(names) >= 3), [])


def _output_name(name: str, color: str) -> str:
    """Return an AOV's name beside the output's R, G and B: beauty.A and beauty.alpha become A."""
    layer = color.rpartition(".")[0]
    own = name.removeprefix(f"{layer}.") if layer else name
    return "A" if own.lower() in _ALPHA else own


def import_named_channels(
    folder: Path | str,
    *,
    conventions: Conventions,
    reference: str | None = None,
    **options: Unpack[SequenceOptions],
) -> Shot:
    """Open a folder of EXR frames as a Shot by the names of their channels, such as R, Z and motion.X.

    docs/shots.md lists the names. Other channels that can be blended are AOVs. `Shot.ignored_channels` lists
    the rest, and the channels of a stereo file's other views.

    Args:
        folder: folder of the files.
        conventions: conventions of these channels and of the jitter.
        reference: pattern of the references' files, with R, G and B, such as `reference/*.exr`.
        options: see `import_channels`.

    Raises:
        ShotError: files or channels are missing or differ in size, or several channels have one meaning.
    """
    folder = Path(folder)
    first = first_file(folder, options)
    header = read_header(first)
    types, other_views = of_first_view(header)
    channel_map = recognised_map(first, types)
    if channel_map is None:
        hint = "docs/shots.md lists the names that are recognised; a channels.json states others."
        raise ShotError(first, f"has no depth or no motion among {', '.join(types)}", hint)
    if checked_conventions(conventions).motion_jittered:  # it contains the next frame's jitter
        channel_map.pop("motion_next", None)
    aovs, ignored = blended_and_ignored(types, channel_map, header.cryptomattes)
    if "color" not in channel_map and (parts := _parts_of_color(types)):
        problem = f"has {', '.join(parts)} of the colour; want red, green and blue"
        raise ShotError(first, problem, "Write all three, or map them in a channels.json (docs/shots.md).")
    if "color" not in channel_map and (likely := _likely_color(aovs)):
        hint = "Rename it, or map it in a channels.json (docs/shots.md)."
        problem = f"has no colour by a known name; {', '.join(likely)} may be it"
        raise ShotError(first, problem, hint)
    if aovs:
        channel_map["aovs"] = aovs
    if reference is not None:
        numbered_files(folder, reference, follow_links=options.get("follow_links", False))  # raises for none
        channel_map["reference"] = [f"{reference}:{axis}" for axis in "RGB"]
    names = [_output_name(name, channel_map.get("color", ["R"])[0]) for name in aovs]
    if len({*names, *"RGB"}) != len(names) + 3:
        names = aovs
    shot = import_channels(folder, channel_map, conventions=conventions, aov_names=names, **options)
    shot.ignored_channels[:] = [*ignored, *other_views]
    shot.late_channels = late_channels(shot, header)
    return shot
