"""A shot: frames in order, read lazily, one at a time, a few ahead."""

from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from supersampler.conventions import Conventions, Converter, RawFrame
from supersampler.errors import FrameError, ShotError
from supersampler.frame import Float32, Frame, Size
from supersampler.io.atomic import check_inside
from supersampler.io.shot.format import FILE_NAME, FrameEntry, ShotInfo, files_of, load_shot_json
from supersampler.io.shot.frame_files import ClassMaps, read_classes, read_frame, read_reference
from supersampler.io.shot.shipped import path_or_shipped

_AHEAD = 2  # frames held ready; more would cost memory and hide no more of the disk


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShotFrame:
    """One frame of a shot.

    Attributes:
        index: its place in the shot, from 0.
        frame: in this package's conventions, ready for `Upscaler.step`.
        raw: as stored, in the shot's conventions.
        reference: (H, W, 3) float32, display size, linear RGB: what a perfect upscaler would return. Or None.
    """

    index: int
    frame: Frame
    raw: RawFrame
    reference: Float32 | None


class Shot:
    """A sequence of rendered frames on disk.

    >>> shot = Shot.open("plaza")
    >>> for item in shot:  # read by one thread, two frames ahead
    ...     image = upscaler.step(item.frame)

    Frames are read when they are reached, so that memory does not grow with the shot. `Shot.open` reads this
    package's own folders; `open_source`, `import_blender`, `import_channels` and `import_arm` give Shots over
    other people's files, and `copy_shot` writes any Shot in the package's own format.
    """

    def __init__(
        self,
        path: Path,
        info: ShotInfo,
        entries: Sequence[FrameEntry],
        read_raw: Callable[[int, Collection[str] | None], RawFrame],
        read_reference: Callable[[int], Float32],
        read_classes: Callable[[int], ClassMaps | None] = lambda _: None,
    ) -> None:
        self.path, self.info = path, info
        self._entries, self._raw = tuple(entries), read_raw
        self._reference, self._classes = read_reference, read_classes

    @classmethod
    def open(cls, path: Path | str) -> "Shot":
        """Open a folder with a shot.json; images are read later, one by one.

        Args:
            path: the folder; or a JSON file in it, of the several that may share its images; or the name of
                a shot that ships with this package, "plaza", where nothing of that name lies here.

        Raises:
            ShotError: nothing lies there; or shot.json is missing or wrong, or names a file that is not there
                or that a link has outside of the folder. The folder itself may be a link.
        """
        path = path_or_shipped(path)
        description = path if path.suffix == ".json" else path / FILE_NAME
        folder = description.parent
        info, entries = load_shot_json(description)
        _check_files(description, entries)

        def raw_frame(index: int, gbuffers: Collection[str] | None) -> RawFrame:
            size = entries[index].render_size or info.render_size
            return read_frame(folder, entries[index], size, info.display_size, gbuffers)

        def reference(index: int) -> Float32:
            return read_reference(folder / str(entries[index].reference), info.display_size)

        def classes(index: int) -> ClassMaps | None:
            return read_classes(folder / str(entries[index].reference), info.display_size)

        return cls(path, info, entries, raw_frame, reference, classes)

    @property
    def name(self) -> str:
        """The shot's name."""
        return self.info.name

    @property
    def source(self) -> Path:
        """The folder or file that its frames are read from."""
        return self.path.parent if self.path.suffix == ".json" else self.path

    @property
    def render_size(self) -> Size:
        """(width, height) of the frames; a frame of another size says so itself."""
        return self.info.render_size

    @property
    def display_size(self) -> Size | None:
        """(width, height) of references and display-size buffers; None where the shot has none."""
        return self.info.display_size

    @property
    def frame_rate(self) -> float | None:
        """Frames a second; None where the source does not state it."""
        return self.info.frame_rate

    @property
    def conventions(self) -> Conventions:
        """How the stored frames are to be read."""
        return self.info.conventions

    @property
    def license(self) -> str:
        """Licence of the images; "" is unknown."""
        return self.info.license

    @property
    def attribution(self) -> list[str]:
        """Whom to name where the images are shown."""
        return list(self.info.attribution)

    @property
    def reference_indices(self) -> list[int]:
        """The frames that have a reference."""
        return [index for index, entry in enumerate(self._entries) if entry.reference is not None]

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[ShotFrame]:
        return self.frames()

    def frames(self, start: int = 0, *, gbuffers: Collection[str] | None = None) -> Iterator[ShotFrame]:
        """Iterate over the frames from `start` on, in order; one thread reads two frames ahead.

        An error of the thread is raised where its frame is reached. The thread ends when the iterator does:
        at the last frame, at an error, or when it is dropped.

        Args:
            start: index of the first one.
            gbuffers: names of the G-buffers to read, as `Model.info.gbuffers` has them, as others cost time
                for nothing; None reads all that are there.
        """
        converter = converter_at(self.info, self._entries, start)
        waiting: deque[Future[ShotFrame]] = deque()
        pool = ThreadPoolExecutor(1, thread_name_prefix="shot")
        try:
            for index in range(start, len(self)):
                waiting.append(pool.submit(self._load, index, converter, gbuffers))
                if len(waiting) > _AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)

    def read(self, index: int) -> ShotFrame:
        """Read one frame, wherever it is.

        Raises:
            IndexError: there is no frame of that index.
            ShotError: a file is missing, damaged, of another size, or lacks a channel.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return self._load(index, converter_at(self.info, self._entries, index))

    def read_raw(self, index: int, *, gbuffers: Collection[str] | None = None) -> RawFrame:
        """Read one frame as stored, without its reference; `gbuffers` as of `frames`."""
        return self._raw(index, gbuffers)

    def read_reference(self, index: int) -> Float32 | None:
        """Read a frame's reference, (H, W, 3) float32, linear RGB; None where it has none."""
        return None if self._entries[index].reference is None else self._reference(index)

    def read_classes(self, index: int) -> ClassMaps | None:
        """Read the class maps of a frame's reference, (H, W) uint8 each; None where there are none."""
        return None if self._entries[index].reference is None else self._classes(index)

    def _load(self, index: int, converter: Converter, gbuffers: Collection[str] | None = None) -> ShotFrame:
        raw, reference = self.read_raw(index, gbuffers=gbuffers), self.read_reference(index)
        try:
            frame = converter.to_frame(raw)
        except FrameError as error:
            folder = self.source if self.source.is_dir() else self.source.parent
            file = folder / self._entries[index].file
            raise ShotError(file, f"frame {index} breaks the contract: {error}") from error
        return ShotFrame(index=index, frame=frame, raw=raw, reference=reference)


def converter_at(info: ShotInfo, entries: Sequence[FrameEntry], index: int) -> Converter:
    """Return a converter that stands where it would after all frames before `index`.

    All that it remembers is the jitter of the frame before, which shot.json has.
    """
    converter = info.conventions.converter(display_size=info.display_size)
    if index > 0 and info.conventions.motion_jittered:
        before = entries[index - 1]
        converter.pass_over(before.jitter, before.render_size or info.render_size)
    return converter


def _check_files(description: Path, entries: Sequence[FrameEntry]) -> None:
    folder = description.parent
    for index, entry in enumerate(entries):
        for name in files_of(entry):
            if not _is_file(folder / name):
                hint = f"{description.name} lists it; copy or render it again."
                raise ShotError(folder / name, f"the file of frame {index} is missing", hint)
    check_inside(folder, (folder / name for entry in entries for name in files_of(entry)))


def _is_file(path: Path) -> bool:
    """Tell whether a file is there; False for a path that is too long for any to be."""
    try:
        return path.is_file()
    except OSError:
        return False
