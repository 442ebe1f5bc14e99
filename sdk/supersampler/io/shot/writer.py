"""Write a shot frame by frame. A run that is killed leaves whole frames only, and can be resumed."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Array, Frame, Size
from supersampler.io.atomic import (
    NO_ROOM,
    check_apart,
    check_inside,
    is_regular,
    is_there,
    remove_files,
    remove_partial_files,
    replacing,
)
from supersampler.io.json_fields import read_json
from supersampler.io.shot.format import FILE_NAME, FrameEntry, ShotInfo, files_of, load_shot_json, shot_json
from supersampler.io.shot.frame_files import ClassMaps, has_display_file, write_frame, write_reference
from supersampler.io.shot.shot import Shot, converter_at

_DISPLAY, _REFERENCE = "display", "reference"
_FOREIGN = "Move it away, or write the shot to another folder."


class ShotWriter:
    """Write frames into a shot's folder, in order.

    >>> with ShotWriter("shots/mine", name="mine", display_size=(1920, 1080), frame_rate=30) as writer:
    ...     for frame in render():
    ...         writer.write(frame)

    Each file appears under its name only when it is complete, a frame's files before shot.json lists it. So
    the folder is a whole shot at any moment, of as many frames as were finished; with `resume=True` the next
    run goes on after them: `len(writer)` is the index of the frame to write next. Files that no run wrote are
    never replaced: one in the way is an error.

    Args:
        path: the folder; made where it is missing.
        name: for people.
        display_size: (width, height) of references and display-size buffers; None where there are none.
        frame_rate: frames a second; None where it is not known.
        conventions: of the RawFrames that are written.
        license: of the images.
        attribution: whom to name where the images are shown.
        resume: go on after the frames that are there already.
        variant: name of one of several shots in the folder that share their display-size files, "2x" say: it
            is described by 2x.json, and its frames are 2x/0000.exr and so on.
        compression: of the frames, lossless: "zip", or "zip:9", which is slower and a little smaller.
        reference_compression: of the references; "dwab:45" is lossy and much smaller.

    Raises:
        ShotError: the folder holds a shot already; with `resume`, one of other properties.
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
        resume: bool = False,
        variant: str | None = None,
        compression: str = "zip",
        reference_compression: str = "zip",
    ) -> None:
        self.path = Path(path)
        self._description = self.path / (FILE_NAME if variant is None else f"{variant}.json")
        self._frames_below = "" if variant is None else f"{variant}/"
        self._compression, self._reference_compression = compression, reference_compression
        self._info = ShotInfo(
            name=name,
            render_size=(0, 0),  # of the first frame
            display_size=None if display_size is None else (display_size[0], display_size[1]),
            frame_rate=None if frame_rate is None else float(frame_rate),
            conventions=Conventions() if conventions is None else conventions,
            license=license,
            attribution=tuple(attribution),
        )
        self._entries: list[FrameEntry] = []
        self._note = self.path / f".{self._description.name}.writing"
        if is_there(self._description):
            self._continue(resume)
        self._begun = self._read_note()
        names = re.compile(rf"\d{{4,}}\.exr|{re.escape(self._description.name)}")
        remove_partial_files(self.path, names, (self._frames_below.rstrip("/"), _DISPLAY, _REFERENCE))

    def __len__(self) -> int:
        """Return how many frames are complete."""
        return len(self._entries)

    def __enter__(self) -> "ShotWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is left to do: each frame was finished by `write`."""

    def write(
        self,
        frame: RawFrame | Frame,
        *,
        reference: Array | None = None,
        classes: ClassMaps | None = None,
        shared: bool = False,
    ) -> None:
        """Write the next frame.

        Args:
            frame: a RawFrame in the shot's conventions, or a Frame, which is converted to them.
            reference: (H, W, 3) display size, linear RGB: what a perfect upscaler would return.
            classes: of the reference's pixels.
            shared: the display-size file and the reference are there, written by another variant.

        Raises:
            ShotError: the disk refused, or an array is float64. After any error the shot is as it was.
            FrameError: the frame breaks the contract.
            ArgumentError: a display-size array is not of the shot's display size, or `classes` come without
                a reference.
        """
        raw = self._checked(frame)
        height, width = raw.depth.shape
        info = self._info if self._entries else replace(self._info, render_size=(width, height))
        self._check_display(raw, reference, classes)
        number = f"{len(self._entries):04d}.exr"
        entry = FrameEntry(
            file=f"{self._frames_below}{number}",
            jitter=(0.0, 0.0) if raw.jitter is None else (float(raw.jitter[0]), float(raw.jitter[1])),
            reset=bool(raw.reset),
            exposure=None if raw.exposure is None else float(raw.exposure),
            display_file=f"{_DISPLAY}/{number}" if has_display_file(raw) else None,
            reference=None if reference is None else f"{_REFERENCE}/{number}",
            render_size=None if (width, height) == info.render_size else (width, height),
            shaded=raw.color is not None,
        )
        with self._writing([entry.file] if shared else files_of(entry)):
            write_frame(self.path, entry, raw, self._compression, display=not shared)
            if reference is not None and not shared:
                path = self.path / str(entry.reference)
                write_reference(path, reference, classes, self._reference_compression)
            self._publish(info, [*self._entries, entry])

    def _publish(self, info: ShotInfo, entries: list[FrameEntry]) -> None:
        """List the frames in shot.json: from here on they count as written."""
        with replacing(self._description) as partial:
            partial.write_text(shot_json(info, entries), encoding="utf-8", newline="\n")
        self._info, self._entries = info, entries

    @contextmanager
    def _writing(self, names: list[str]) -> Iterator[None]:
        """Note in a file which files are about to be written; refuse names that other programs have written.

        A run that is killed before shot.json lists them leaves that note, by which the next one knows them.

        Raises:
            ShotError: a file that no run wrote has one of these names.
        """
        paths = [self.path / name for name in names]
        check_inside(self.path, paths)
        for name, path in zip(names, paths, strict=True):
            if is_there(path) and not (is_regular(path) and (name in self._begun or self._is_listed(name))):
                problem = f"is there already, and {self._description.name} does not list it"
                raise ShotError(path, problem, _FOREIGN)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._note.write_text(json.dumps(names), encoding="utf-8")
        except OSError as error:
            raise ShotError(self._note, f"cannot be written ({error})", NO_ROOM) from error
        self._begun, before = frozenset(names), len(self._entries)
        try:
            yield
        finally:
            if before < len(self._entries) or not any(map(is_there, paths)):  # listed, or not begun
                remove_files([self._note])

    def _read_note(self) -> frozenset[str]:
        """Names of the files that a killed run was about to write."""
        if not is_there(self._note):
            return frozenset()
        if not is_regular(self._note):
            raise ShotError(self._note, "is no regular file", _FOREIGN)
        try:
            names = read_json(self._note)
        except ShotError:  # killed while it was written, before any of the files
            return frozenset()
        return frozenset(filter(lambda name: isinstance(name, str), names if isinstance(names, list) else ()))

    def _is_listed(self, name: str) -> bool:
        """Tell whether another shot in the folder, which shares files with this one, lists a file."""
        for path in self.path.glob("[!.]*.json"):
            try:
                _, entries = load_shot_json(path)
            except ShotError:
                continue
            if any(name in files_of(entry) for entry in entries):
                return True
        return False

    def _checked(self, frame: RawFrame | Frame) -> RawFrame:
        """Return the frame in the shot's conventions, once it is known that it can be read again."""
        converter = converter_at(self._info, self._entries, len(self._entries))
        if isinstance(frame, Frame):
            return converter.from_frame(frame)
        converter.to_frame(frame)
        return frame

    def _continue(self, resume: bool) -> None:
        """Take over the frames that are there."""
        path = self._description
        info, entries = load_shot_json(path)
        if not resume:
            hint = "Resume it (resume=True), delete the folder, or choose another."
            raise ShotError(path, f"a shot of {len(entries)} frames is there already", hint)
        for field in ("name", "display_size", "frame_rate", "conventions"):
            there, wanted = getattr(info, field), getattr(self._info, field)
            if there != wanted:
                hint = "Resume with what the shot was begun with, or write to another folder."
                raise ShotError(path, f"its {field} is {there}; this run's is {wanted}", hint)
        self._info, self._entries = info, entries

    def _check_display(self, frame: RawFrame, reference: Array | None, classes: ClassMaps | None) -> None:
        arrays: dict[str, NDArray[Any] | None] = {"reference": reference, **(frame.gbuffer_display or {})}
        if classes is not None:
            if reference is None:
                raise ArgumentError("classes", got="without a reference", want="both: they lie in one file")
            arrays |= {"classes.ghost": classes.ghost, "classes.alias": classes.alias}
        if frame.motion.shape[:2] != frame.depth.shape:
            arrays["motion"] = frame.motion
        want = self._info.display_size
        for name, array in arrays.items():
            if array is not None and (want is None or array.shape[:2] != want[::-1]):
                size = f"{array.shape[1]}x{array.shape[0]}" if array.ndim >= 2 else str(array.shape)
                hint = "" if want else "Give the ShotWriter a display_size."
                raise ArgumentError(name, got=size, want=f"the shot's display size, {want}", hint=hint)


def copy_shot(shot: Shot, path: Path | str, *, resume: bool = False) -> Shot:
    """Copy a shot of any origin into the package's own format, one frame at a time.

    >>> copy_shot(import_blender("renders/kitchen"), "shots/kitchen")

    Args:
        shot: what to copy; its conventions are kept, pixels are not converted.
        path: the folder to write.
        resume: go on after the frames that an earlier run wrote.

    Returns:
        The shot that was written.

    Raises:
        ShotError: the folder is, holds or lies in the source, or a file of others is in the way; see also
            `ShotWriter` and `Shot.read`.
    """
    check_apart(Path(path), shot.source)
    info = shot.info
    writer = ShotWriter(
        path,
        name=info.name,
        display_size=info.display_size,
        frame_rate=info.frame_rate,
        conventions=info.conventions,
        license=info.license,
        attribution=info.attribution,
        resume=resume,
    )
    for index in range(len(writer), len(shot)):
        reference, classes = shot.read_reference(index), shot.read_classes(index)
        writer.write(shot.read_raw(index), reference=reference, classes=classes)
    return Shot.open(path)
