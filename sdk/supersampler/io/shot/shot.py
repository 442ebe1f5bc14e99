"""`Shot`: a frame sequence on disk, read frame by frame."""

import hashlib
import json
import os
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import msgspec

from supersampler.arguments import checked_path
from supersampler.conventions import Conventions, Converter, RawFrame
from supersampler.errors import INCOMPLETE_PACKAGE, FrameError, ShotError, did_you_mean
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.files import check_inside, is_file, os_errors_as_shot_error
from supersampler.io.images import Channel, ImageHeader, Metadata, read_exr, read_header
from supersampler.io.shot import format as shot_format
from supersampler.io.shot.format import ClassMaps, FrameEntry, ShotInfo

SHIPPED = Path(__file__).parents[2] / "shots"
"""Folder of the shipped shots."""


def path_or_shipped(path: str | Path) -> Path:
    """Return a path; for a bare name that does not exist, the folder of the shipped shot.

    Raises:
        ArgumentError: the argument is neither text nor a path.
        ShotError: no shot of that name exists or ships; or the package's own shots are missing.
    """
    path = Path(checked_path("path", path))
    if path.name != str(path) or os.path.lexists(path):
        return path
    if not SHIPPED.is_dir():
        problem = f"there is no such file or folder, and the package's data files, {SHIPPED}, are missing"
        raise ShotError(path, problem, INCOMPLETE_PACKAGE)
    names = sorted(folder.name for folder in SHIPPED.iterdir())
    if path.name in names:
        return SHIPPED / path.name
    hint = did_you_mean(path.name, names) or f"Shots that ship: {', '.join(names)}."
    raise ShotError(path, "there is no such file or folder, and no shot of that name ships", hint)


_AHEAD = 2  # number of frames that are read ahead
_READERS = 2  # threads; a frame with many channels takes longer to decompress than to step
_Stored: TypeAlias = tuple[RawFrame, Float32 | None]


def path_hint(value: object) -> str:
    """Return a hint for a path that was given in place of a Shot; "" for anything else."""
    return "`supersampler.io.shot.open_source` opens files." if isinstance(value, str | Path) else ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShotFrame:
    """One frame of a shot.

    Attributes:
        index: index in the shot, from 0.
        frame: the frame in this package's conventions, for `Upscaler.step`.
        raw: the stored frame, in the shot's conventions.
        reference: (H, W, 3) float32, display size, linear RGB: the ideal output; or None.
    """

    index: int
    frame: Frame
    raw: RawFrame
    reference: Float32 | None


class StoredAs(NamedTuple):
    """Format and type of the colour in a file.

    Attributes:
        format: "exr", "png", "tif"; "safetensors" for Arm's sequences.
        type: "half", "float", "uint8", "uint16".
    """

    format: str
    type: str


class Shot:
    """A sequence of rendered frames on disk.

    >>> shot = Shot.open("plaza")
    >>> for item in shot:  # read by threads, two frames ahead
    ...     image = upscaler.step(item.frame)

    Memory does not grow with the number of frames. `Shot.open` reads this package's own folders;
    `open_source`, `import_blender`, `import_channels` and `import_arm` open other formats; `copy_shot` writes
    any Shot in this package's format.

    Attributes:
        path: the folder, its JSON file, or the .safetensors file.
        info: properties of all frames.
        ignored_channels: channels of the first frame's file that an importer does not read: ids and other
            data that cannot be blended. For renders of `supersampler blender`, empty until a frame is read.
        late_channels: channels of the last frame's file that the first lacks; importers that recognise
            channels do not read them.
        is_denoised: whether the frames state that their renderer has denoised them; only Blender's can.
        noisy_channels: channels of the colour before the renderer denoised it; empty if there are none.
        samples: samples per pixel of the renderer, None if unknown; only frames of Cycles state it.
        own_format: whether a shot.json describes the frames.
    """

    def __init__(
        self,
        path: Path,
        info: ShotInfo,
        entries: Sequence[FrameEntry],
        read_arrays: Callable[[int, Collection[str] | None], RawFrame],
        read_reference: Callable[[int], Float32] | None = None,
        *,
        wait: Callable[[int], object] = lambda _: None,
        stop_waiting: Callable[[], None] = lambda: None,
        color_channel: str = "R",
        channel_map: Mapping[str, Any] | None = None,
        own_format: bool = False,
        frame_files: Callable[[int], Collection[Path]] | None = None,
    ) -> None:
        self.path, self.info = path, info
        self._offset = 0  # index of the first frame in the uncropped shot, for the callables
        self._wait = wait  # returns when the file of a frame is complete
        self._stop_waiting = stop_waiting  # ends a call that waits for a frame
        self._entries, self._raw = tuple(entries), read_arrays
        self._reference = read_reference
        self.ignored_channels: list[str] = []  # one list of all copies: the first frame may be read later
        self.late_channels: tuple[str, ...] = ()
        self.is_denoised = False
        self.noisy_channels: tuple[str, ...] = ()
        self.samples: int | None = None
        self._color_channel, self.own_format = color_channel, own_format
        self._channel_map = channel_map  # of `import_channels`
        self._frame_files = frame_files  # of frames with a file for each pass

    @classmethod
    def open(cls, path: Path | str) -> "Shot":
        """Open a folder with a shot.json; images are read later.

        Args:
            path: the folder; or one of several JSON files in it that share its images; or the name of a
                shipped shot, such as "plaza".

        Raises:
            ShotError: the path does not exist; shot.json is missing or wrong, or lists a file that is missing
                or lies outside of the folder, links followed. The folder itself may be a link.
        """
        path = path_or_shipped(path)
        description = path if path.suffix == ".json" else path / shot_format.FILE_NAME
        folder = description.parent
        if path.is_dir() and not os.path.lexists(description):
            hint = "`supersampler.io.shot.open_source` opens frames of other programs."
            raise ShotError(path, f"has no {shot_format.FILE_NAME}", hint)
        info, entries = shot_format.load_shot_json(description)
        for index, entry in enumerate(entries):
            for name in shot_format.files_of(entry):
                if not is_file(folder / name):
                    hint = f"{description.name} lists it; copy or render it again."
                    raise ShotError(folder / name, f"the file of frame {index} is missing", hint)
        check_inside(folder, (folder / name for entry in entries for name in shot_format.files_of(entry)))

        def raw_frame(index: int, gbuffers: Collection[str] | None) -> RawFrame:
            return shot_format.read_frame(folder, info, entries[index], gbuffers)

        def reference(index: int) -> Float32:
            return shot_format.read_reference(folder / str(entries[index].reference), info.display_size)

        return cls(path, info, entries, raw_frame, reference, own_format=True)

    @property
    def name(self) -> str:
        """The shot's name."""
        return self.info.name

    @property
    def source(self) -> Path:
        """Folder or file that the frames are read from."""
        return self.path.parent if self.path.suffix == ".json" else self.path

    @property
    def render_size(self) -> Size:
        """(width, height) of the frames without a size of their own."""
        return self.info.render_size

    @property
    def display_size(self) -> Size | None:
        """(width, height) of references and display-size buffers; None if there are none."""
        return self.info.display_size

    @property
    def frame_rate(self) -> float | None:
        """Frames per second; None if unknown."""
        return self.info.frame_rate

    @property
    def conventions(self) -> Conventions:
        """Conventions of the stored frames."""
        return self.info.conventions

    @property
    def first_number(self) -> int:
        """Number of the first frame in the program that rendered it; see `ShotInfo`."""
        return self.info.first_number

    @property
    def stored_as(self) -> StoredAs:
        """Format and type of the colour in the first frame's file, read from its header."""
        path = self.source / self._entries[0].file
        if path.suffix == ".safetensors":
            return StoredAs("safetensors", "half")
        header = read_header(path)
        return StoredAs(header.format, header.types.get(self._color_channel, "half"))

    @property
    def reference_indices(self) -> list[int]:
        """Indices of the frames that have a reference."""
        return [index for index, entry in enumerate(self._entries) if entry.reference is not None]

    def cropped(self, first: int, last: int) -> "Shot":
        """Return a shot of the frames with these numbers, both included; its first frame resets the history.

        Numbers before the first frame and after the last are ignored.

        Raises:
            ShotError: no frame has such a number.
        """
        begin = max(first - self.first_number, 0)
        entries = list(self._entries[begin : max(last + 1 - self.first_number, 0)])
        if not entries:
            numbers = f"{self.first_number} to {self.first_number + len(self) - 1}"
            raise ShotError(self.path, f"has no frame from {first} to {last}", f"Its frames are {numbers}.")
        entries[0] = msgspec.structs.replace(entries[0], reset=True)
        shot = copy(self)
        shot.info = msgspec.structs.replace(self.info, first_number=self.first_number + begin)
        shot._entries, shot._offset = tuple(entries), self._offset + begin
        return shot

    def with_conversion(self, convert: Callable[[Path, RawFrame], RawFrame]) -> "Shot":
        """Return a shot whose frames are the results of `convert` for each frame's file and stored frame."""
        shot, read_raw = copy(self), self._raw
        paths = [self.source / entry.file for entry in self._entries]
        offset = self._offset

        def converted(index: int, gbuffers: Collection[str] | None) -> RawFrame:
            return convert(paths[index - offset], read_raw(index, gbuffers))

        shot._raw = converted
        return shot

    def with_noise(self) -> "Shot":
        """Return a shot with the colour from before the renderer denoised it; itself, if that is unknown."""
        names = self.noisy_channels
        if not names:
            return self

        def noisy(path: Path, raw: RawFrame) -> RawFrame:
            channels = read_exr(path, only=names, outside={})
            return replace(raw, color=shot_format.take(path, channels, names))

        shot = self.with_conversion(noisy)
        shot.is_denoised, shot.noisy_channels = False, ()
        return shot

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[ShotFrame]:
        return self.frames()

    def frames(
        self,
        start: int = 0,
        stop: int | None = None,
        *,
        gbuffers: Collection[str] | None = None,
        references: bool = True,
    ) -> Iterator[ShotFrame]:
        """Iterate over frames in order; two threads read ahead, one converts.

        An error is raised when its frame is reached. The threads end with the iterator.

        Args:
            start: index of the first frame.
            stop: index after the last frame; None is the end.
            gbuffers: G-buffers to read, by their names in `Model.info.gbuffers`, and "motion_next"; None
                reads all.
            references: whether to read the references.
        """
        converter = converter_at(self.info, self._entries, start)
        waiting: deque[Future[ShotFrame]] = deque()
        readers = ThreadPoolExecutor(_READERS, thread_name_prefix="shot-read")
        converting = ThreadPoolExecutor(1, thread_name_prefix="shot-convert")  # the converter needs the order

        def load(index: int, stored: Future[_Stored]) -> ShotFrame:
            return self._converted(index, *stored.result(), converter)

        def read(index: int) -> _Stored:
            reference = self.read_reference(index) if references else None
            return self.read_raw(index, gbuffers=gbuffers), reference

        try:
            for index in range(start, len(self) if stop is None else min(stop, len(self))):
                waiting.append(converting.submit(load, index, readers.submit(read, index)))
                if len(waiting) > _AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            self._stop_waiting()
            converting.shutdown(wait=False, cancel_futures=True)
            readers.shutdown(cancel_futures=True)
            converting.shutdown()

    def last_cut(self, index: int) -> int:
        """Return the index of the last frame up to `index` that resets the history; 0 if none does."""
        while 0 < index < len(self) and not self._entries[index].reset:
            index -= 1
        return index

    def is_shaded(self, index: int) -> bool:
        """Return whether a frame has colour."""
        return self._entries[index].shaded

    def exposure(self, index: int) -> float | None:
        """Return the exposure that the shot states for a frame; None if it does not state it."""
        return self._entries[index].exposure

    def changed_at(self, index: int) -> int:
        """Return the time at which a file of a frame has changed last, in ns; 0 if there is none."""
        if self._frame_files is not None:
            paths = self._frame_files(self._offset + index)
        else:
            folder = self.source if self.source.is_dir() else self.source.parent
            entry = self._entries[index]
            paths = [folder / name for name in (entry.file, entry.display_file) if name is not None]
        return max((path.stat().st_mtime_ns for path in paths if is_file(path)), default=0)

    def hashes(self, count: int) -> dict[str, str]:
        """Return hashes of what is stated about the first `count` frames, by kind; none of their pixels."""
        entries = self._entries[:count]
        facts: dict[str, Any] = {
            "files": [(entry.file, entry.display_file, entry.render_size, entry.shaded) for entry in entries],
            "channels": self._channel_map or list(self.info.aov_names) or None,
            "jitter": [entry.jitter for entry in entries],
            "cuts": [entry.reset for entry in entries],
            "exposure": [(entry.exposure, entry.pre_exposure) for entry in entries],
        }
        texts = {name: json.dumps(facts[name], sort_keys=True, ensure_ascii=False) for name in facts}
        data = {name: text.encode(errors="surrogateescape") for name, text in texts.items()}
        return {name: hashlib.sha256(each).hexdigest() for name, each in data.items()}

    def read(self, index: int) -> ShotFrame:
        """Read one frame by its index.

        Raises:
            IndexError: there is no such frame.
            ShotError: a file is missing, damaged, of another size, or lacks a channel.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        converter = converter_at(self.info, self._entries, index)
        return self._converted(index, self.read_raw(index), self.read_reference(index), converter)

    def read_raw(self, index: int, *, gbuffers: Collection[str] | None = None) -> RawFrame:
        """Read one frame as stored, without its reference; for `gbuffers` see `frames`."""
        raw, entry = self._raw(self._offset + index, gbuffers), self._entries[index]
        return replace(
            raw,
            jitter=entry.jitter,
            reset=entry.reset,
            exposure=entry.exposure,
            pre_exposure=entry.pre_exposure,
            aov_names=raw.aov_names or self.info.aov_names or None,
        )

    def read_reference(self, index: int) -> Float32 | None:
        """Read a frame's reference, (H, W, 3) float32, linear RGB; None if it has none."""
        if self._reference is None or self._entries[index].reference is None:
            return None
        return self._reference(self._offset + index)

    def read_classes(self, index: int) -> ClassMaps | None:
        """Read the class maps of a frame's reference, (H, W) uint8 each; None if there are none."""
        file = self._reference_file(index)
        return None if file is None else shot_format.read_classes(file, self.display_size)

    def digest(self) -> str:
        """Return the SHA-256 of all files of the frames, and of their numbers and conventions."""
        stated = [self.conventions.to_json(), *map(msgspec.structs.asdict, self._entries)]
        digest = hashlib.sha256(msgspec.json.encode(stated))
        folder = self.source if self.source.is_dir() else self.source.parent
        for name in dict.fromkeys(name for entry in self._entries for name in shot_format.files_of(entry)):
            with os_errors_as_shot_error(folder / name), (folder / name).open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        return digest.hexdigest()

    def read_truth(self, index: int) -> dict[str, Array]:
        """Read further planes (H, W) of a frame's reference by name, such as coverage by kinds of objects.

        They are the channels `truth.NAME` of the reference's file.
        """
        file = self._reference_file(index)
        return {} if file is None else shot_format.read_truth(file, self.display_size)

    def read_metadata(self, index: int) -> Metadata:
        """Return the header entries of a frame's EXR file that describe its content; {} for other files."""
        path = self._complete_file(index)
        return read_header(path).metadata if path.suffix.lower() == ".exr" else {}

    def read_header(self, index: int) -> ImageHeader:
        """Read the header of a frame's EXR, PNG or TIFF file."""
        return read_header(self._complete_file(index))

    def _complete_file(self, index: int) -> Path:
        """Return the file of a frame, which may still be rendered when this is called."""
        self._wait(index + self._offset)
        return self.source / self._entries[index].file

    def read_channels(self, index: int, names: Collection[str]) -> dict[str, Channel]:
        """Read channels of a frame's EXR file unchanged, (h, w) each."""
        path = self._complete_file(index)
        channels = read_exr(path, only=names, outside={})
        shot_format.check_size(path, channels, self._entries[index].render_size or self.render_size)
        return channels

    def _reference_file(self, index: int) -> Path | None:
        """Return the file of a frame's reference if it can have class maps: in this package's format."""
        name = self._entries[index].reference
        return self.source / name if name is not None and self.own_format else None

    def _converted(
        self, index: int, raw: RawFrame, reference: Float32 | None, converter: Converter
    ) -> ShotFrame:
        try:
            frame = converter.to_frame(raw)
        except FrameError as error:
            folder = self.source if self.source.is_dir() else self.source.parent
            file = folder / self._entries[index].file
            raise ShotError(
                file, f"frame {self.first_number + index} breaks the contract: {error}"
            ) from error
        return ShotFrame(index=index, frame=frame, raw=raw, reference=reference)


def converter_at(info: ShotInfo, entries: Sequence[FrameEntry], index: int) -> Converter:
    """Return a converter in its state after all frames before `index`: it knows the previous jitter."""
    converter = info.conventions.converter(display_size=info.display_size)
    if index > 0 and info.conventions.motion_jittered:
        before = entries[index - 1]
        converter.pass_over(before.jitter, before.render_size or info.render_size)
    return converter
