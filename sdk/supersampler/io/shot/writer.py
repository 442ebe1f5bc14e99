"""`ShotWriter`: writes a shot frame by frame; a killed run can be resumed. `copy_shot` uses it."""

import json
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import as_number, checked_names, checked_path, checked_size
from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.conventions import checked_conventions
from supersampler.errors import ArgumentError, FrameError, ShotError, shown
from supersampler.frame import Array, Frame, Size
from supersampler.io import files
from supersampler.io.display_transforms import REC709
from supersampler.io.images import Metadata
from supersampler.io.json_files import read_json
from supersampler.io.shot.format import (
    FILE_NAME,
    ClassMaps,
    FrameEntry,
    ShotInfo,
    check_info,
    files_of,
    load_shot_json,
    shot_json,
    write_frame,
    write_reference,
)
from supersampler.io.shot.shot import Shot, converter_at, path_hint

_DISPLAY, _REFERENCE = "display", "reference"
_STATED = ("reset", "jitter", "exposure", "pre_exposure", "aov_names")
"""Values of a frame that are not arrays."""
_NAMING = ("first_number", "file_names", "color_space")
_FOREIGN = "Move it away, or write the shot to another folder."


class ShotWriter:
    """Writes frames into a shot's folder, in order.

    >>> with ShotWriter("shots/mine", name="mine", display_size=(1920, 1080), frame_rate=30) as writer:
    ...     for frame in render():
    ...         writer.write(frame)

    Files are written atomically, and shot.json lists a frame only after its files are written, so that the
    folder is a valid shot of the finished frames at any time. With `resume=True` the next run continues after
    these frames: `len(writer)` is the index of the next frame. A file that was not written by `ShotWriter` is
    never replaced: it is an error.

    Args:
        path: the folder; created if it is missing.
        name, display_size, frame_rate, conventions, license, attribution: see `ShotInfo`.
        first_number, file_names, color_space: see `ShotInfo`.
        resume: whether to continue after existing frames.
        variant: name of one of several shots in the folder that share their display-size files, such as "2x":
            2x.json describes it, and its frames are 2x/0000.exr and so on.
        compression: lossless compression of the frames: "zip", or "zip:9", slower and slightly smaller.
        reference_compression: compression of the references; "dwab:45" is lossy and much smaller.

    Raises:
        ShotError: the folder already holds a shot; with `resume`, a shot with other properties.
        ArgumentError: the frame rate is not a positive number, or an argument is of another type.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        name: str,
        display_size: Size | None,
        frame_rate: float | None,
        conventions: Conventions | None = None,
        license: str = "",  # noqa: A002  # the word that shot.json and every reader use
        attribution: tuple[str, ...] | list[str] = (),
        first_number: int = 0,
        file_names: str = "####",
        color_space: str = REC709,
        resume: bool = False,
        variant: str | None = None,
        compression: str = "zip",
        reference_compression: str = "zip",
    ) -> None:
        rate = None if frame_rate is None else as_number(frame_rate)
        if frame_rate is not None and (rate is None or not 0.0 < rate < math.inf):
            raise ArgumentError("frame_rate", got=shown(frame_rate), want="a finite number > 0, or None")
        self.path = Path(checked_path("path", path))
        self._description = self.path / (FILE_NAME if variant is None else f"{variant}.json")
        self._frames_below = "" if variant is None else f"{variant}/"
        self._compression, self._reference_compression = compression, reference_compression
        self._info = ShotInfo(
            name=name,
            render_size=(0, 0),  # set by the first frame
            display_size=None if display_size is None else checked_size("display_size", display_size),
            frame_rate=rate,
            conventions=Conventions() if conventions is None else checked_conventions(conventions),
            license=license,
            attribution=checked_names("attribution", attribution),
            first_number=first_number,
            file_names=file_names,
            color_space=color_space,
        )
        check_info(self._description, self._info)
        self._entries: list[FrameEntry] = []
        self._note = self.path / f".{self._description.name}.writing"
        if files.is_there(self._description):
            self._continue(resume)
        self._begun = self._read_note()
        names = re.compile(rf"\d{{4,}}\.exr|{re.escape(self._description.name)}|{re.escape(self._note.name)}")
        files.remove_partial_files(
            self.path, names.fullmatch, (self._frames_below.rstrip("/"), _DISPLAY, _REFERENCE)
        )

    def __len__(self) -> int:
        """Return the number of complete frames."""
        return len(self._entries)

    def __enter__(self) -> "ShotWriter":
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: `write` completes each frame."""

    def write(
        self,
        frame: RawFrame | Frame,
        *,
        reference: Array | None = None,
        classes: ClassMaps | None = None,
        truth: Mapping[str, Array] | None = None,
        shared: bool = False,
        metadata: Metadata | None = None,
    ) -> None:
        """Write the next frame.

        Args:
            frame: a RawFrame in the shot's conventions, or a Frame, which is converted to them. All frames
                take the AOV names of the first. It has no `ids`, for which shots have no channels.
            reference: (H, W, 3) display size, linear RGB: the ideal output.
            classes: class maps of the reference.
            truth: planes (H, W) of the reference by name, see `Shot.read_truth`.
            shared: whether another variant has written the display-size file and the reference.
            metadata: header entries of the frame's file.

        Raises:
            ShotError: the disk refused, or an array is float64. After any error the shot is unchanged.
            FrameError: the frame breaks the contract, has ids, or has other AOVs than the first frame names.
            ArgumentError: a display-size array does not have the shot's display size, or `classes` or `truth`
                is given without a reference.
        """
        converter = converter_at(self._info, self._entries, len(self._entries))
        raw = converter.from_frame(frame) if isinstance(frame, Frame) else frame
        if raw is frame:
            converter.to_frame(raw)  # raises if the frame could not be read again
        height, width = raw.depth.shape
        info = self._info
        if not self._entries:
            info = msgspec.structs.replace(
                info, render_size=(width, height), aov_names=tuple(raw.aov_names or ())
            )
            check_info(self._description, info)
        _check_channels(raw, info.aov_names)
        self._check_display(raw, reference, classes, truth or {})
        has_display_file = raw.gbuffer_display or raw.motion.shape[:2] != raw.depth.shape
        number = f"{len(self._entries):04d}.exr"
        entry = FrameEntry(
            file=f"{self._frames_below}{number}",
            jitter=(0.0, 0.0) if raw.jitter is None else (float(raw.jitter[0]), float(raw.jitter[1])),
            reset=bool(raw.reset),
            exposure=None if raw.exposure is None else float(raw.exposure),
            pre_exposure=float(raw.pre_exposure),
            display_file=f"{_DISPLAY}/{number}" if has_display_file else None,
            reference=None if reference is None else f"{_REFERENCE}/{number}",
            render_size=None if (width, height) == info.render_size else (width, height),
            shaded=raw.color is not None,
        )
        with self._writing([entry.file] if shared else files_of(entry)):
            write_frame(self.path, entry, raw, self._compression, display=not shared, metadata=metadata)
            if reference is not None and not shared:
                path = self.path / str(entry.reference)
                write_reference(path, reference, classes, truth or {}, self._reference_compression)
            entries = [*self._entries, entry]
            files.write_text(self._description, shot_json(info, entries))  # the frame is now complete
            self._info, self._entries = info, entries

    @contextmanager
    def _writing(self, names: list[str]) -> Iterator[None]:
        """Keep the names of unfinished files in a note file until shot.json lists them.

        The note tells the run after a kill that these files are the writer's own.

        Raises:
            ShotError: a file of another program has one of these names.
        """
        paths = [self.path / name for name in names]
        files.check_inside(self.path, paths)
        for name, path in zip(names, paths, strict=True):
            is_own = files.is_regular(path) and (name in self._begun or self._is_listed(name))
            if files.is_there(path) and not is_own:
                problem = f"already exists, and {self._description.name} does not list it"
                raise ShotError(path, problem, _FOREIGN)
        with files.os_errors_as_shot_error(self._note, "written", files.NO_ROOM):
            self.path.mkdir(parents=True, exist_ok=True)
            files.write_text(self._note, json.dumps(names))
        self._begun, before = frozenset(names), len(self._entries)
        try:
            yield
        finally:
            if before < len(self._entries) or not any(map(files.is_there, paths)):  # listed, or none written
                files.remove_files([self._note])

    def _read_note(self) -> frozenset[str]:
        """Return the names of the files that a killed run was writing."""
        if not files.is_there(self._note):
            return frozenset()
        if not files.is_regular(self._note):
            raise ShotError(self._note, "is not a regular file", _FOREIGN)
        try:
            names = read_json(self._note)
        except ShotError:  # the run was killed while it wrote the note, before the files
            return frozenset()
        listed = names if isinstance(names, list) else []
        return frozenset(name for name in listed if isinstance(name, str))

    def _is_listed(self, name: str) -> bool:
        """Return whether any shot.json or variant in the folder lists a file."""
        for path in self.path.glob("[!.]*.json"):
            with suppress(ShotError):
                if any(name in files_of(entry) for entry in load_shot_json(path)[1]):
                    return True
        return False

    def _continue(self, resume: bool) -> None:
        """Continue after the existing frames."""
        path = self._description
        info, entries = load_shot_json(path)
        if not resume:
            hint = "Resume it (resume=True), delete the folder, or choose another."
            raise ShotError(path, f"a shot of {len(entries)} frames already exists", hint)
        for field in ("name", "display_size", "frame_rate", "conventions", *_NAMING):
            existing, requested = getattr(info, field), getattr(self._info, field)
            if existing != requested:
                hint = "Resume with the shot's own settings, or write to another folder."
                raise ShotError(path, f"its {field} is {existing}; this run's is {requested}", hint)
        self._info, self._entries = info, entries

    def _check_display(
        self, frame: RawFrame, reference: Array | None, classes: ClassMaps | None, truth: Mapping[str, Array]
    ) -> None:
        arrays: dict[str, NDArray[Any] | None] = {"reference": reference, **(frame.gbuffer_display or {})}
        for name, given in (("classes", classes is not None), ("truth", bool(truth))):
            if given and reference is None:
                raise ArgumentError(name, got="without a reference", want="both: they are in one file")
        if classes is not None:
            arrays |= {f"classes.{name}": array for name, array in classes.known().items()}
        arrays |= {f"truth.{name}": array for name, array in truth.items()}
        if frame.motion.shape[:2] != frame.depth.shape:
            arrays["motion"] = frame.motion
        if frame.motion_next is not None and frame.motion_next.shape[:2] != frame.depth.shape:
            arrays["motion_next"] = frame.motion_next
        want = self._info.display_size
        for name, array in arrays.items():
            if array is not None and (want is None or array.shape[:2] != want[::-1]):
                size = f"{array.shape[1]}x{array.shape[0]}" if array.ndim >= 2 else str(array.shape)
                hint = "" if want else "Give the ShotWriter a display_size."
                raise ArgumentError(name, got=size, want=f"the shot's display size, {want}", hint=hint)


def _check_channels(frame: RawFrame, names: tuple[str, ...]) -> None:
    """Raise FrameError if a shot whose AOVs have these names cannot hold the ids or AOVs of a frame."""
    if frame.ids is not None:
        hint = "Shots have none: dataclasses.replace(frame, ids=None)."
        raise FrameError("ids", got=shown(frame.ids), want="None", hint=hint)
    given = tuple(frame.aov_names or names)
    if names and given != names:
        raise FrameError("aov_names", got=given, want=f"{names}, as in the first frame")
    if names and frame.aovs is not None and frame.aovs.shape[2] != len(names):
        raise FrameError("aovs", got=f"{frame.aovs.shape[2]} channels", want=f"{len(names)}, named {names}")


def copy_shot(shot: Shot, path: Path | str, *, resume: bool = False) -> Shot:
    """Copy any shot into this package's format, one frame at a time.

    >>> copy_shot(import_blender("renders/kitchen"), "shots/kitchen")

    Args:
        shot: the source; its conventions, pixels and EXR metadata are kept.
        path: the folder to write.
        resume: whether to continue after the frames of an earlier run, which must equal those of the source.

    Returns:
        The written shot.

    Raises:
        ShotError: the folder is, contains or lies in the source; or it holds other frames than the source;
            see also `ShotWriter` and `Shot.read`.
    """
    if not isinstance(shot, Shot):
        raise ArgumentError("shot", got=shown(shot), want="a Shot", hint=path_hint(shot))
    files.check_apart(Path(checked_path("path", path)), shot.source)
    of_frames = ("render_size", "aov_names")  # the first frame has them
    info = {name: getattr(shot.info, name) for name in ShotInfo.__struct_fields__ if name not in of_frames}
    writer = ShotWriter(path, **info, resume=resume)
    if len(writer):
        _check_copied(shot, Shot.open(path))
    for index in range(len(writer), len(shot)):
        writer.write(
            shot.read_raw(index),
            reference=shot.read_reference(index),
            classes=shot.read_classes(index),
            truth=shot.read_truth(index),
            metadata=shot.read_metadata(index),
        )
    return Shot.open(path)


def _check_copied(shot: Shot, copy: Shot) -> None:
    """Raise ShotError unless the frames of a copy are the first ones of a shot, bit for bit."""
    hint = "Write to another folder, or remove this one to copy all frames again."
    if len(copy) > len(shot):
        raise ShotError(copy.path, f"has {len(copy)} frames; {shot.path} has {len(shot)}", hint)
    for index in range(len(copy)):
        copied = _content(copy, index)
        for name, value in _content(shot, index).items():
            if not _is_same(copied[name], value):
                values = f": {copied[name]}, there {value}" if name in _STATED else ""
                problem = f"frame {index} has another {name} than in {shot.path}{values}"
                raise ShotError(copy.path, problem, hint)


def _content(shot: Shot, index: int) -> dict[str, Any]:
    """Return all that `copy_shot` writes of a frame, by name, except its metadata."""
    raw = shot.read_raw(index)
    names = [field.name for field in fields(raw) if field.name not in ("aov_names", "ids")]
    classes = shot.read_classes(index)
    return {
        **{name: getattr(raw, name) for name in names},
        "aov_names": tuple(raw.aov_names or ()) if index == 0 else (),  # all frames have those of the first
        "reference": shot.read_reference(index),
        "classes": None if classes is None else classes.known(),
        "truth": shot.read_truth(index),
    }


def _is_same(one: Any, other: Any) -> bool:
    """Return whether two arrays, dictionaries of arrays, or other values are equal; NaN equals NaN."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_is_same(one[name], other[name]) for name in one)
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    return type(one) is type(other) and bool(one == other)
