"""Read and write shot.json, the description of a shot's frames. docs/shots.md explains each key."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath

from supersampler.conventions import Conventions
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Size
from supersampler.io.display_transforms import REC709
from supersampler.io.json_fields import Field, read_json
from supersampler.io.limits import IMAGE_CHANNELS, SHOT_FRAMES

FORMAT_VERSION = 1
FILE_NAME = "shot.json"
LARGEST_NUMBER = 10**9
"""Largest number of a frame in the name of its image; the smallest is its negative."""
_LONGEST = 255  # bytes of a name; no file system takes more
_FORBIDDEN = re.compile(r"[\\:\x00-\x1f\ud800-\udfff]")


@dataclass(frozen=True, slots=True, kw_only=True)
class ShotInfo:
    """Properties of all frames of a shot.

    Attributes:
        name: name of the shot.
        render_size: (width, height) of the frames that have no size of their own.
        display_size: (width, height) of the references and display-size buffers; None where there are none.
        frame_rate: frames a second, > 0; None where it is unknown.
        conventions: conventions of the stored colour, depth, motion and jitter.
        license: licence of the images; "" is unknown.
        attribution: names to credit where the images are shown, one line each.
        first_number: number of the first frame in the program that rendered it, at most LARGEST_NUMBER from
            0; images of the shot's frames are named by it and the numbers after it.
        file_names: stem of the names of the source's files, #### for the number, such as `beauty.####`.
        aov_names: names of the AOVs' channels in files of results; empty: they are numbered.
        color_space: of the colour, linear (decoded, where the conventions say sRGB): its name in an
            OpenColorIO config, such as "lin_rec709" and "ACEScg"; or "unknown".
    """

    name: str
    render_size: Size
    display_size: Size | None
    frame_rate: float | None
    conventions: Conventions
    license: str = ""
    attribution: tuple[str, ...] = ()
    first_number: int = 0
    file_names: str = "####"
    aov_names: tuple[str, ...] = ()
    color_space: str = REC709


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameEntry:
    """One frame in shot.json.

    Attributes:
        file: EXR file of the render-size channels, relative to the folder, with forward slashes.
        jitter: (x, y) in the shot's conventions.
        reset: True on the first frame after a cut.
        exposure: > 0, multiplies colour before the tone curve; None: it is measured.
        pre_exposure: what the renderer has multiplied the colour by.
        display_file: EXR file of the display-size channels, or None.
        reference: EXR file of the ideal output, or None.
        render_size: (width, height) where it differs from the shot's.
        shaded: False where the frame has no colour (extrapolation).
    """

    file: str
    jitter: tuple[float, float]
    reset: bool = False
    exposure: float | None = None
    pre_exposure: float = 1.0
    display_file: str | None = None
    reference: str | None = None
    render_size: Size | None = None
    shaded: bool = True


def is_frame_range(first: int, last: int) -> bool:
    """Return whether images can be named by the numbers from a first to a last."""
    return -LARGEST_NUMBER <= first <= last <= LARGEST_NUMBER


def files_of(entry: FrameEntry) -> list[str]:
    """Return the files of a frame, relative to the shot's folder."""
    return [name for name in (entry.file, entry.display_file, entry.reference) if name]


def load_shot_json(path: Path) -> tuple[ShotInfo, list[FrameEntry]]:
    """Read and check a shot.json.

    Raises:
        ShotError: it is missing, not JSON, of another version, or an entry is missing, wrong or repeated.
    """
    header = Field(path, "the file", read_json(path))
    version = header["version"].of(int)
    if version != FORMAT_VERSION:
        hint = "Write it again, or update supersampler."
        raise ShotError(path, f"is of version {version}; this package reads {FORMAT_VERSION}", hint)
    header.check_names({"version", "frames", *(field.name for field in fields(ShotInfo))})
    try:
        conventions = Conventions.from_json(header["conventions"].of(dict))
    except ArgumentError as error:
        raise ShotError(path, f'"conventions" is not valid: {error}') from error
    info = ShotInfo(
        name=header["name"].of(str),
        render_size=header["render_size"].size(),
        display_size=header.read("display_size", Field.size, None),
        frame_rate=header.read("frame_rate", Field.rate, None),
        conventions=conventions,
        license=header.read("license", lambda text: text.of(str), ""),
        attribution=header.read("attribution", Field.texts, ()),
        first_number=header.read("first_number", lambda n: n.whole(-LARGEST_NUMBER, LARGEST_NUMBER), 0),
        file_names=header.read("file_names", _file_names, "####"),
        aov_names=header.read("aov_names", _aov_names, ()),
        color_space=header.read("color_space", Field.text, REC709),
    )
    entries = [frame_entry(item) for item in header["frames"].items(SHOT_FRAMES)]
    if not entries:
        raise ShotError(path, f"lists no frames; want 1 to {SHOT_FRAMES}")
    _check_listed_once(path, entries)
    return info, entries


def shot_json(info: ShotInfo, entries: Sequence[FrameEntry]) -> str:
    """Return the text of a shot.json, with one line for each key and for each frame."""
    header = {"version": FORMAT_VERSION, **{field.name: getattr(info, field.name) for field in fields(info)}}
    header["conventions"] = info.conventions.to_json()
    head = "".join(f'  "{key}": {json.dumps(value, ensure_ascii=False)},\n' for key, value in header.items())
    frames = ",\n".join("    " + json.dumps(entry_json(entry)) for entry in entries)
    return f'{{\n{head}  "frames": [\n{frames}\n  ]\n}}\n'


def entry_json(entry: FrameEntry) -> dict[str, object]:
    """Return a frame's entry as JSON values, without most defaults, so that long files stay readable."""
    item: dict[str, object] = {
        "file": entry.file, "jitter": entry.jitter, "reset": entry.reset, "exposure": entry.exposure,
    }  # fmt: skip
    for key in ("display_file", "reference", "render_size"):
        if getattr(entry, key) is not None:
            item[key] = getattr(entry, key)
    if entry.pre_exposure != 1.0:
        item["pre_exposure"] = entry.pre_exposure
    if not entry.shaded:
        item["shaded"] = False
    return item


def frame_entry(data: Field) -> FrameEntry:
    """Read a frame's entry, the inverse of `entry_json`; ShotError for a missing or wrong key."""
    data.check_names([field.name for field in fields(FrameEntry)])
    return FrameEntry(
        file=_file(data["file"]),
        jitter=data["jitter"].pair(),
        reset=data.read("reset", Field.flag, default=False),
        exposure=data.read("exposure", Field.number, None),
        pre_exposure=data.read("pre_exposure", Field.number, 1.0),
        display_file=data.read("display_file", _file, None),
        reference=data.read("reference", _file, None),
        render_size=data.read("render_size", Field.size, None),
        shaded=data.read("shaded", Field.flag, default=True),
    )


def _file_names(data: Field) -> str:
    """Read a name with one field for the number; no path, as results are named by it."""
    name = data.text(_LONGEST)
    if re.fullmatch(r"[^#/]*#{4,}[^#/]*", name) is None or _FORBIDDEN.search(name) or name[0] == ".":
        data.refuse("a name with one ####, such as beauty.####")
    return name


def _aov_names(data: Field) -> tuple[str, ...]:
    names = tuple(item.text(_LONGEST) for item in data.items(IMAGE_CHANNELS))
    if len({*names, *"RGB"}) != len(names) + 3:
        data.refuse("names that differ, and are not R, G or B")
    return names


def _file(data: Field) -> str:
    """Read a file name, which must be inside the shot's folder: a shot must not reach other files."""
    name = data.of(str)
    path = PurePosixPath(name)
    if not path.name or path.is_absolute() or ".." in path.parts or _FORBIDDEN.search(name):
        data.refuse("a file inside the shot's folder, with forward slashes")
    if any(len(part.encode()) > _LONGEST for part in path.parts):
        data.refuse(f"names of at most {_LONGEST} bytes")
    return name


def _check_listed_once(path: Path, entries: Sequence[FrameEntry]) -> None:
    seen: dict[str, int] = {}
    for index, entry in enumerate(entries):
        for name in files_of(entry):
            if name in seen:
                problem = f"{name} is listed twice: in frame {seen[name]} and frame {index}"
                raise ShotError(path, problem, "Each frame has its own files.")
            seen[name] = index
