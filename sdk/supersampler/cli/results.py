"""The output folder of a run: numbered images, a page, a video, and upscale.json.

upscale.json has the settings of a run and lists the files that it wrote: `"files": {"exr/####.exr": 12,
"compare.html": 1}` stands for exr/0000.exr to exr/0011.exr and a page; with `"first frame": 7`, for
exr/0007.exr to exr/0018.exr. A run of a range of frames writes upscale.0010-0050.json with `"frames":
"10-50"`, so that several runs can write into one folder at once. A file is listed before it is written. Files
that are not listed are never counted, replaced or removed. A list with a name that no run writes is refused.
"""

import json
import os
import re
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Generic, Self, TypeVar

import msgspec
import numpy as np

from supersampler.cli.arguments import FileOptions, size_text
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Float32
from supersampler.io import display_transforms, images
from supersampler.io.display import to_uint8, to_uint16
from supersampler.io.files import (
    FolderLock,
    is_own_folder,
    is_regular,
    is_there,
    remove_files,
    remove_partial_files,
    write_text,
)
from supersampler.io.images import Bytes, Channel, Metadata
from supersampler.io.json_files import read_json
from supersampler.io.shot import Shot
from supersampler.io.shot.format import COLOR, LARGEST_NUMBER, NAME, aov_channels, is_frame_range
from supersampler.io.shot.numbered import FrameRange
from supersampler.io.video import check_video_encoder

FILE_NAME = "upscale.json"
FIRST, FRAMES, SOURCE, PREROLL = "first frame", "frames", "source", "preroll"
"""Settings: number of the first frame, 0 if missing; range of the frames, missing if the run has all from
FIRST on; options that opened the shot; frames before the range that build the history."""
AT_REST = "at rest"
"""Setting: see `Upscaler`."""
READ = "frames read"
"""Setting: `FramesRead` as JSON."""
REPLACED = "replaced from"
"""Setting: position of the first image that another run in the folder has replaced; missing if none has."""
DEMO: Mapping[str, str] = {"command": "demo"}
"""SOURCE of a run of `supersampler demo`. Another demo replaces its files."""
FORMATS = ("exr", "png", "tif")
_FRAME_FILES = re.compile(
    rf"(?:(?P<folder>{'|'.join(FORMATS)})/)?{NAME.pattern}\.(?P<format>{'|'.join(FORMATS)})"
)
_RECORDS = re.compile(r"upscale(\.-?\d+(?:--?\d+)?)?\.json")
_MAX_FILES = 10**9
_MIN_ALPHA = 0.5 / 65535.0  # less is written as 0
_OTHER_RANGE = "Choose another folder."
OTHER_RUN = "Choose another folder, or --overwrite to start over."
_START_OVER = f"Remove the files of that run and {FILE_NAME} yourself, or choose another folder."
_Written = TypeVar("_Written")


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputImage:
    """The image of one frame, with its AOVs and metadata.

    Attributes:
        image: (H, W, 3) linear RGB, multiplied by alpha.
        exposure: > 0, for PNG, TIFF and video.
        aovs: (H, W, k) AOVs, written to EXR. PNG and TIFF store only the one named A, alpha.
        aov_names: names of the AOVs' channels; None: A for k = 1, otherwise aovs.0, aovs.1 and so on.
        metadata: header entries, written to EXR. PNG and TIFF store only the pixel aspect ratio.
        copied: (H, W) channels by name that are written to EXR unchanged, such as ids.
    """

    image: Float32
    exposure: float
    aovs: Float32 | None = None
    aov_names: Sequence[str] | None = None
    metadata: Metadata | None = None
    copied: Mapping[str, Channel] = field(default_factory=dict)

    @property
    def aov_channels(self) -> list[str]:
        """Names of the AOVs' channels."""
        count = 0 if self.aovs is None else self.aovs.shape[2]
        return list(self.aov_names or (["A"] if count == 1 else aov_channels(count)))

    @property
    def alpha(self) -> Float32 | None:
        """(H, W, 1) alpha in [0, 1]; None if no AOV is named A."""
        if self.aovs is None or "A" not in self.aov_channels:
            return None
        at = self.aov_channels.index("A")
        alpha: Float32 = np.nan_to_num(self.aovs[..., at : at + 1]).clip(0.0, 1.0)
        return alpha


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageOptions:
    """Names, formats and encodings of the images of a run.

    Attributes:
        formats: "exr", "png", "tif", "mp4". Several image formats are written to subfolders of their names.
        name: name of the images without extension; a run of # stands for the frame's number.
        transform: display transform of PNG, TIFF and video.
        compression: compression of EXR: "zip", "dwaa", "piz" or "none".
        bits: bits of a PNG channel: 8 or 16. TIFF has 16.
        color_space: linear colour space that EXR files state. None: unknown; files keep the source's entries.
    """

    formats: Collection[str] = ("exr",)
    name: str = "####"
    transform: display_transforms.DisplayTransform = display_transforms.DEFAULT_TRANSFORM
    compression: str = "zip"
    bits: int = 8
    color_space: str | None = display_transforms.REC709

    @classmethod
    def of(cls, files: FileOptions, shot: Shot) -> Self:
        """Return the options of a shot's images; by default, sRGB-encoded frames keep their format and bits.

        Raises:
            ArgumentError: the name is invalid; or see `display_transform_from`.
            ShotError: the OpenColorIO configuration cannot be read.
        """
        stored, srgb, space = shot.stored_as, shot.conventions.srgb, shot.info.known_color_space
        same = srgb and stored.format in ("png", "tif")
        transform = display_transforms.display_transform_from(
            color_space=display_transforms.REC709 if space is None else space, srgb=srgb, ocio=files.ocio,
            display=files.display, view=files.view, look=files.look, exposure=files.exposure,
        )  # fmt: skip
        if space is not None and transform.ocio is not None:
            space = images.space_of_role(transform.ocio.config, space)
        return cls(
            formats=[str(item) for item in files.format or ()] or [stored.format if same else "exr"],
            name=shot.info.file_names if files.name is None else name_pattern(files.name),
            transform=transform,
            compression=files.compression,
            bits=16 if same and stored.type == "uint16" else 8,
            color_space=space,
        )

    @property
    def image_formats(self) -> list[str]:
        """Formats of image files."""
        return sorted({*self.formats} - {"mp4"})

    @property
    def video(self) -> bool:
        """Whether there is a video."""
        return "mp4" in self.formats

    @property
    def patterns(self) -> list[str]:
        """File patterns of the image formats, as upscale.json lists them."""
        formats = self.image_formats
        return [f"{name}/" * (len(formats) > 1) + f"{self.name}.{name}" for name in formats]

    def compression_with(self, copied: Collection[str]) -> str:
        """Return the compression of EXR files that have these channels, too: lossless if it changes them."""
        is_lossy = self.compression == "dwaa" and any(map(images.is_lossy_in_dwa, copied))
        return "zip" if is_lossy else self.compression

    def to_json(self) -> dict[str, object]:
        """Return the options that change the files' content, as JSON."""
        return {
            "formats": self.image_formats,
            "name": self.name,
            "compression": self.compression if "exr" in self.formats else None,
            "bits": self.bits if "png" in self.formats else None,
            "color space": self.color_space,
            "display transform": self.transform.to_json(),
        }

    def write(self, folder: Path, number: int, output: OutputImage) -> Bytes | None:
        """Write the files of one frame, each atomically; several threads may write different frames.

        Returns:
            (H, W, 3) uint8 for the video; None if there is no video.

        Raises:
            ShotError: the disk refused.
        """
        encoding, aspect = self.transform.encoding, images.pixel_aspect(output.metadata or {})
        display_image = self._display_image(output) if {"png", "tif"}.intersection(self.formats) else None
        for pattern in self.patterns:
            path = frame_path(folder, pattern, number)
            if display_image is not None and path.suffix == ".png":
                images.write_png(
                    path,
                    to_uint8(display_image) if self.bits == 8 else to_uint16(display_image),
                    encoding,
                    aspect,
                )
            elif display_image is not None and path.suffix == ".tif":
                images.write_tiff(path, to_uint16(display_image), encoding, aspect)
            else:
                arrays = [output.image] if output.aovs is None else [output.image, output.aovs]
                names = [*COLOR, *(output.aov_channels if output.aovs is not None else ())]
                image = images.half_pixels(arrays)
                channels = {name: image[..., at] for at, name in enumerate(names)} | dict(output.copied)
                images.write_exr(
                    path, channels if output.copied else image, names,
                    compression=self.compression_with(output.copied),
                    metadata=output.metadata, color_space=self.color_space,
                )  # fmt: skip
        if not self.video:
            return None
        if display_image is None or display_image.shape[2] == 4:  # a video shows it over black
            display_image = self.transform.show(output.image, output.exposure)
        return to_uint8(display_image)

    def _display_image(self, output: OutputImage) -> Float32:
        """Return the image after the display transform: (H, W, 3), or (H, W, 4) with straight alpha."""
        image, alpha = output.image, output.alpha
        if alpha is None:
            return self.transform.show(image, output.exposure)
        # colour without coverage, such as a glow, stays as it is
        image = np.divide(image, alpha, out=image.copy(), where=alpha > _MIN_ALPHA)
        return np.concatenate([self.transform.show(image, output.exposure), alpha], axis=2)


def name_pattern(name: str) -> str:
    """Return the value of --name, with %04d replaced by ####; ArgumentError if files cannot have the name."""
    pattern = re.sub(r"%0?(\d{0,2})d", lambda field: "#" * int(field[1] or 1), name)
    if NAME.fullmatch(pattern) is None or Path(pattern).suffix[1:] in FORMATS:
        want = "a file name without extension, with one run of # for the number, such as beauty.####"
        raise ArgumentError("--name", got=repr(name), want=want)
    return pattern


class OutputQueue(Generic[_Written]):
    """Runs functions on threads, and passes their results on in order, on the caller's thread.

    The number of waiting functions is limited, so that few images are in memory.

    Args:
        then: called with each result, in the order of `put`.
    """

    def __init__(self, then: Callable[[_Written], None]) -> None:
        threads = max(2, min(8, os.cpu_count() or 1))
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="write")
        self._then, self._max_waiting = then, threads + 1
        self._waiting: deque[Future[_Written]] = deque()

    def put(self, function: Callable[[], _Written]) -> None:
        """Run a function when a thread is free; raises the exception of an earlier function."""
        self._waiting.append(self._pool.submit(function))
        while self._waiting and (len(self._waiting) > self._max_waiting or self._waiting[0].done()):
            self._then(self._waiting.popleft().result())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Wait until all functions have run; after an error, drop their results."""
        try:
            while kind is None and self._waiting:
                self._then(self._waiting.popleft().result())
        finally:
            self._pool.shutdown()


class FramesRead(msgspec.Struct, frozen=True):
    """The frames that a run can read, as its record states them.

    Attributes:
        first: number of the first one.
        count: number of frames.
        hashes: `Shot.hashes` of them all.
    """

    first: int
    count: Annotated[int, msgspec.Meta(ge=1)]
    hashes: dict[str, str]


def settings_of(
    shot: Shot, numbers: FrameRange | None, source: Mapping[str, str], images: ImageOptions
) -> dict[str, object]:
    """Return the settings that the images of every method depend on: the frames and the file formats.

    `numbers` are those of the frames to write, or None; `source` are the options that opened the shot.
    """
    read = FramesRead(shot.first_number, len(shot), shot.hashes(len(shot)))
    return {
        "shot": str(shot.path.resolve()),
        "names": shot.info.file_names,
        "frame rate": shot.frame_rate,
        **({FIRST: shot.first_number} if numbers is None else {FRAMES: str(numbers)}),
        "render size": size_text(shot.render_size),
        "conventions": shot.conventions.to_json(),
        **images.to_json(),
        SOURCE: dict(source),
        READ: msgspec.structs.asdict(read),
    }


@dataclass(frozen=True)
class RunRecord:
    """Content of upscale.json.

    Attributes:
        settings: everything that the images depend on; JSON values.
        files: number of files by pattern, such as `exr/####.exr`, counted from the first frame; 1 for the
            page, the number of frames for the video.
    """

    settings: Mapping[str, Any]
    files: Mapping[str, int] = field(default_factory=dict)

    @property
    def numbers(self) -> FrameRange:
        """Numbers of the frames in the names of files; open-ended if the run has all frames."""
        if FRAMES in self.settings:
            return FrameRange.parse(self.settings[FRAMES], FRAMES)
        return FrameRange(int(self.settings.get(FIRST, 0)), LARGEST_NUMBER)

    @property
    def page(self) -> str:
        """Name of the page."""
        return f"compare{self._label}.html"

    @property
    def video(self) -> str:
        """Name of the video."""
        return f"video{self._label}.mp4"

    @property
    def file_name(self) -> str:
        """Name of the file that holds this record."""
        return f"upscale{self._label}.json"

    @property
    def _label(self) -> str:
        return f".{self.numbers.label}" if FRAMES in self.settings else ""

    def lists(self, pattern: str, number: int) -> bool:
        """Return whether the frame with this number is listed."""
        numbers = self.numbers
        return 0 <= number - numbers.first < min(len(numbers), self.files.get(pattern, 0))

    def own_files(self, folder: Path) -> list[Path]:
        """Return the listed files that exist; ShotError if a link or a folder has one of the names."""
        single = (self.page, self.video)
        found = [folder / name for name in single if self.files.get(name) and is_there(folder / name)]
        for pattern in self.files.keys() - single:
            found += sorted(path for n, path in _numbered(folder, pattern) if self.lists(pattern, n))
        for path in found:
            if not is_regular(path):
                raise _foreign(path, "is not a regular file")
        return sorted(found)

    def differences(self, settings: Mapping[str, object], ignored: Collection[str] = ()) -> list[str]:
        """Return the names of the settings whose values differ."""
        current = {name: value for name, value in settings.items() if name not in ignored}
        return [name for name, v in current.items() if self.settings.get(name) != json.loads(json.dumps(v))]


def read_run_record(folder: Path, name: str = FILE_NAME) -> RunRecord | None:
    """Read a record in a folder, None if it does not exist; ShotError if it is not of this command."""
    path = folder / name
    if not is_there(path):
        return None
    if not is_regular(path):
        raise _foreign(path, "is not a regular file")
    try:
        text = json.dumps(read_json(path), ensure_ascii=False)
        content = json.loads(os.fsdecode(text.encode()))  # text as in this locale's paths
    except RecursionError as error:
        raise ShotError(path, "is nested too deeply for a record", _START_OVER) from error
    files = content.pop("files", None) if isinstance(content, dict) else None
    if not isinstance(files, dict):
        problem = "does not list the files of its run: it is of an earlier version, or of something else"
        raise ShotError(path, problem, _START_OVER)
    record = RunRecord(content, files)
    _check_numbers(path, record)
    for pattern, count in files.items():
        match = _FRAME_FILES.fullmatch(pattern)
        is_written = pattern == record.video or (match and match["folder"] in (None, match["format"]))
        max_count = 1 if pattern == record.page else _MAX_FILES if is_written else -1
        if type(count) is not int or not 0 <= count <= max_count:
            raise ShotError(path, f"lists {pattern!r}: {count!r}, which no run writes", _START_OVER)
    return record


class Results:
    """Numbered images in a folder.

    Attributes:
        folder: the folder.
        options: names, formats and encodings.
        record: the run's record.
        has_outdated: whether `begin` has removed images of an earlier run that this run would not repeat.
    """

    def __init__(self, folder: Path, options: ImageOptions) -> None:
        self.folder, self.options = folder, options
        self.record, self._others, self.has_outdated = RunRecord({}), list[RunRecord](), False
        self._end = 0  # number after the last frame

    def begin(
        self,
        settings: Mapping[str, object],
        frame_count: int,
        kept: Callable[[FramesRead], int],
        lock: FolderLock,
        *,
        overwrite: bool,
        page: bool = False,
    ) -> int:
        """Prepare the folder, and return the position of the first incomplete frame.

        Args:
            settings: everything that the images depend on; JSON values.
            frame_count: number of frames.
            kept: returns the number of images, from the first on, that are valid if an earlier run has read
                these frames; later ones are removed.
            lock: the lock of the folder.
            overwrite: whether to remove the files of an earlier run instead of continuing it. A demo
                always removes the files of a demo with other settings.
            page: whether the page will be written.

        Raises:
            ShotError: files of another program are in the way; or images of other settings exist and
                `overwrite` is False; or no video can be encoded. Nothing was changed.
            ModuleNotFoundError: a video is requested, and PyAV is not installed.
        """
        record = RunRecord(settings)
        earlier = read_run_record(self.folder, record.file_name)
        names = [path.name for path in self.folder.iterdir()] if self.folder.is_dir() else []
        names = sorted(n for n in names if _RECORDS.fullmatch(n) and n != record.file_name)
        self._others = [other for name in names if (other := read_run_record(self.folder, name))]
        self.record = earlier or record
        own, valid = self.record.own_files(self.folder), frame_count
        if earlier is not None and not overwrite:
            both_demos = earlier.settings.get(SOURCE) == DEMO == settings.get(SOURCE)
            overwrite = both_demos and earlier.differences(settings) != []
            if not overwrite:
                self._check_same(earlier, settings, (READ,), OTHER_RUN)
                valid = min(valid, kept(_frames_read(self.folder / record.file_name, earlier)))
                valid = min(valid, earlier.settings.get(REPLACED, valid))
        for other in self._others:
            if other.numbers.overlaps(record.numbers):
                self._check_same(other, settings, (FIRST, FRAMES, PREROLL, READ), _OTHER_RANGE)
        single = [record.page] * page + [record.video] * self.options.video
        self._check_free(record, frame_count, single)
        if self.options.video:
            check_video_encoder(self.folder / record.video)
        if lock.take_new():
            return self.begin(settings, frame_count, kept, lock, overwrite=overwrite, page=page)
        listed, kept_files = [*self.record.files], {} if overwrite else self.record.files
        self.has_outdated = any(count > valid for name, count in kept_files.items() if name != record.page)
        if self.has_outdated:  # page and video show outdated images, too
            kept_files = {name: min(count, valid) for name, count in kept_files.items() if "#" in name}
        remaining = RunRecord(self.record.settings, kept_files)
        remove_files({*own} - {*remaining.own_files(self.folder)})
        self._save(kept_files, settings)
        subfolders = {str(Path(pattern).parent) for pattern in listed} - {"."}
        remove_partial_files(self.folder, lambda name: self._is_own_name(name, listed), subfolders)
        self._end = record.numbers.first + frame_count
        return self.count_complete(frame_count)

    def count_complete(self, frame_count: int) -> int:
        """Return the number of complete frames, counted from the first; only listed files count."""
        patterns, video = self.options.patterns, self.record.video
        if not patterns:  # a video alone is complete, or starts again
            return frame_count if self.record.files.get(video) == frame_count and self.is_newest(video) else 0
        count = min([frame_count, *(self.record.files.get(pattern, 0) for pattern in patterns)])
        for position in range(count):
            number = self.record.numbers.first + position
            if not all(is_regular(frame_path(self.folder, pattern, number)) for pattern in patterns):
                return position
        return count

    def written_at(self, position: int) -> list[int]:
        """Return the times at which the images at a position were written, in ns."""
        number = self.record.numbers.first + position
        paths = [frame_path(self.folder, pattern, number) for pattern in self.options.patterns]
        return [path.stat().st_mtime_ns for path in paths]

    def list_files(self, position: int) -> None:
        """List the files of the frame at a position of the run, before they are written.

        Raises:
            ShotError: the disk refused, or another program's file has one of the names.
        """
        self._mark_replaced(self.record.numbers.first + position)
        listed = dict(self.record.files)
        for pattern in self.options.patterns:
            for new in range(listed.get(pattern, 0), position + 1):
                number = self.record.numbers.first + new
                if is_there(path := frame_path(self.folder, pattern, number)):
                    self._check_listed_elsewhere(pattern, number, path)
            listed[pattern] = max(listed.get(pattern, 0), position + 1)
        if listed != self.record.files:
            self._save(listed)

    def begin_file(self, name: str) -> Path:
        """List the page or the video and return its path; ShotError if the file is another program's."""
        if not self.record.files.get(name):
            self._check_free(self.record, 0, [name])
            self.end_file(name, 1)
        return self.folder / name

    def end_file(self, name: str, frame_count: int) -> None:
        """State how many frames the video has."""
        if self.record.files.get(name) != frame_count:
            self._save({**self.record.files, name: frame_count})

    def end_without_files(self) -> None:
        """Remove the record if the run lists no file, so that a run with other settings may follow."""
        if not self.record.files:
            remove_files([self.folder / self.record.file_name])

    def is_newest(self, name: str) -> bool:
        """Return whether the page or the video exists and no image is newer."""
        times = {path.name: path.stat().st_mtime_ns for path in self.record.own_files(self.folder)}
        single = (self.record.page, self.record.video)
        image_times = [time for other, time in times.items() if other not in single]
        return name in times and times[name] >= max(image_times, default=0)

    def _save(self, files: Mapping[str, int], settings: Mapping[str, object] | None = None) -> None:
        """Write the record with these files; `settings` None keeps its settings."""
        self.record = RunRecord(self.record.settings if settings is None else settings, files)
        self._write(self.record)

    def _write(self, record: RunRecord) -> None:
        content = {**record.settings, "files": dict(record.files)}
        write_text(self.folder / record.file_name, json.dumps(content, indent=2, ensure_ascii=False) + "\n")

    def _mark_replaced(self, number: int) -> None:
        """Note in the records of other runs that this run replaces their images from a frame number on.

        A resumed run computes replaced images again, as they may depend on other frames.
        """
        for index, other in enumerate(self._others):
            first = other.numbers.first
            count = max((other.files.get(pattern, 0) for pattern in self.options.patterns), default=0)
            position = max(0, number - first)
            if position < min(count, self._end - first, other.settings.get(REPLACED, count)):
                now = read_run_record(self.folder, other.file_name) or other  # it may have changed
                self._others[index] = RunRecord({**now.settings, REPLACED: position}, now.files)
                self._write(self._others[index])

    def _is_own_name(self, name: str, listed: Collection[str]) -> bool:
        """Return whether this run writes files of this name, rather than another run in the folder."""
        if name in (self.record.page, self.record.video, self.record.file_name):
            return True
        numbers = [_frame_number(Path(pattern).name, name) for pattern in listed]
        return any(number is not None and number in self.record.numbers for number in numbers)

    def _check_free(self, record: RunRecord, frame_count: int, single: Collection[str]) -> None:
        """Raise ShotError if a file that is not listed has the name of a file to write."""
        for name in single:
            if not self.record.files.get(name) and is_there(self.folder / name):
                raise _foreign(self.folder / name)
        patterns, numbers = self.options.patterns, record.numbers
        for pattern in patterns:
            for number, path in sorted(_numbered(self.folder, pattern)):
                if 0 <= number - numbers.first < frame_count and not self.record.lists(pattern, number):
                    self._check_listed_elsewhere(pattern, number, path)

    def _check_listed_elsewhere(self, pattern: str, number: int, path: Path) -> None:
        if not any(other.lists(pattern, number) for other in self._others):
            raise _foreign(path)

    def _check_same(
        self, earlier: RunRecord, settings: Mapping[str, object], ignored: Collection[str], hint: str
    ) -> None:
        """Raise ShotError if a setting of an earlier run differs, except the ignored ones."""
        for key in earlier.differences(settings, ignored):
            before = earlier.settings.get(key)
            problem = f"images of another run are there: {key} was {before}, is now {settings[key]}"
            if key == AT_REST and settings.get(PREROLL) != earlier.settings.get(PREROLL):
                default = "It is off by default with --frames and --preroll."
                hint = f"{default} Choose another folder, or add --at-rest {before}."
            raise ShotError(self.folder, problem, hint)


def frame_path(folder: Path, pattern: str, number: int) -> Path:
    """Return the path of a frame's file: exr/0007.exr for `exr/####.exr` and 7."""
    sign = "-" if number < 0 else ""
    return folder / re.sub("#+", lambda digits: f"{sign}{abs(number):0{len(digits[0])}d}", pattern)


def _frame_number(pattern: str, name: str) -> int | None:
    """Return the number of the frame that `frame_path` gives this name; None if there is none."""
    if "#" not in pattern:
        return None
    before, _, after = re.split("(#+)", pattern)
    found = re.fullmatch(rf"{re.escape(before)}(-?\d{{1,10}}){re.escape(after)}", name)
    if found is None or frame_path(Path(), pattern, int(found[1])).name != name:
        return None
    return int(found[1])


def _numbered(folder: Path, pattern: str) -> Iterator[tuple[int, Path]]:
    """Yield number and path of the files of a pattern; ShotError if a subfolder is a link or a file."""
    place = folder / Path(pattern).parent
    if not is_there(place) or (place == folder and not place.is_dir()):
        return
    subfolders = [part for part in (place, *place.parents) if part != folder and part.is_relative_to(folder)]
    if not all(map(is_own_folder, subfolders)):
        raise _foreign(place, "is not a folder, or a link to one")
    for path in place.iterdir():
        number = _frame_number(Path(pattern).name, path.name)
        if number is not None:
            yield number, path


def _foreign(path: Path, problem: str = "already exists") -> ShotError:
    """Return the error for a file of another program."""
    hint = "Move it away, or choose another folder."
    return ShotError(path, f"{problem}, and {FILE_NAME} does not list it as written by this command", hint)


def _frames_read(path: Path, record: RunRecord) -> FramesRead:
    """Return the frames that an earlier run could read; ShotError if its record does not state them."""
    try:
        return msgspec.convert(record.settings.get(READ), FramesRead)
    except msgspec.ValidationError as error:
        problem = "does not state the frames of its run: it is of an earlier version, or of something else"
        raise ShotError(path, problem, OTHER_RUN) from error


def _check_numbers(path: Path, record: RunRecord) -> None:
    """Raise ShotError unless a record's numbers match its name."""
    first, frames = record.settings.get(FIRST, 0), record.settings.get(FRAMES, "0")
    if type(first) is not int or not is_frame_range(first, LARGEST_NUMBER):
        raise ShotError(path, f"says {FIRST!r}: {first!r}, which no run writes", _START_OVER)
    try:
        FrameRange.parse(frames if isinstance(frames, str) else "", FRAMES)
    except ArgumentError as error:
        raise ShotError(path, f"says {error}", _START_OVER) from error
    if type(replaced := record.settings.get(REPLACED, 0)) is not int or replaced < 0:
        raise ShotError(path, f"says {REPLACED!r}: {replaced!r}, which no run writes", _START_OVER)
    if record.file_name != path.name:
        raise ShotError(
            path, f"is named for other frames than it lists; want {record.file_name}", _START_OVER
        )
