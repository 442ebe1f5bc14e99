"""The output folder of `supersampler upscale`: numbered images, a page, a video, and upscale.json."""

import json
import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from supersampler import __version__
from supersampler.cli.image_options import ImageOptions
from supersampler.cli.run_record import (
    DEMO,
    FIRST,
    FRAMES,
    RECORDED,
    SOURCE,
    RunRecord,
    foreign,
    frame_number,
    frame_path,
    numbered,
    other_records,
    read_run_record,
)
from supersampler.errors import ShotError
from supersampler.io.files import is_regular, is_there, remove_files, remove_partial_files
from supersampler.io.video import check_encoder
from supersampler.model import Model

PREROLL = "preroll"
"""Setting in which runs into one folder may differ, as they may in FIRST and FRAMES."""


class Results:
    """Numbered images in a folder.

    Args:
        folder: the folder.
        options: names, formats and encodings.
    """

    def __init__(self, folder: Path, options: ImageOptions) -> None:
        self.folder, self.options = folder, options
        self._record, self._others = RunRecord({}), list[RunRecord]()

    @property
    def page(self) -> str:
        """Name of the page."""
        return self._record.single[0]

    @property
    def video(self) -> str:
        """Name of the video."""
        return self._record.single[1]

    def number(self, position: int) -> int:
        """Return the number of a frame, by its position among those of the run."""
        return self._record.numbers[position]

    def begin(
        self,
        settings: Mapping[str, object],
        frame_count: int | None,
        *,
        overwrite: bool,
        page: bool = False,
        recording: Path | None = None,
    ) -> int:
        """Prepare the folder, and return the position of the first incomplete frame.

        Args:
            settings: all that the images depend on; JSON values.
            frame_count: number of frames; None where it is not known.
            overwrite: whether to remove the files of an earlier run instead of continuing it. A demo does so
                with one of other settings.
            page: whether the page will be written.
            recording: the folder that the run will record to; if it exists, it must be an earlier run's.

        Raises:
            ShotError: files of another program are in the way; or images of other settings exist and
                `overwrite` is False; or no video can be encoded. Nothing has been changed.
            ModuleNotFoundError: PyAV is not installed, and a video is wanted.
        """
        wanted = RunRecord(settings)
        earlier = read_run_record(self.folder, wanted.file_name)
        self._others = other_records(self.folder, wanted.file_name)
        self._record = earlier or replace(wanted, settings=_numbers_of(settings))
        own = self._record.own_files(self.folder)
        if earlier is not None and not overwrite:
            overwrite = _is_demo(earlier.settings) and _is_demo(settings) and _differ(earlier, settings) != []
            if not overwrite:
                self._check_same(earlier, settings)
        for other in self._others:
            if other.numbers.overlaps(wanted.numbers):
                self._check_same(other, settings, but=(FIRST, FRAMES, PREROLL))
        names = [
            name
            for name, is_wanted in zip(wanted.single, (page, self.options.video), strict=True)
            if is_wanted
        ]
        self._check_free(wanted, frame_count, names)
        self._check_recording(recording)
        if self.options.video:
            check_encoder(self.folder / wanted.single[1])
        if overwrite:
            remove_files(own)
        kept = {} if overwrite else self._record.files
        recorded = self._record.recording if recording is None else os.path.realpath(recording)
        listed = [*self._record.files]
        self._save(RunRecord(settings, kept, recorded))
        below = {str(Path(pattern).parent) for pattern in listed}
        remove_partial_files(self.folder, lambda name: self._is_own_name(name, listed), below - {"."})
        return 0 if frame_count is None else self.count_complete(frame_count)

    def count_complete(self, frame_count: int) -> int:
        """Return the number of complete frames from the first on; only files of these runs count."""
        patterns = self.options.patterns
        if not patterns:  # a video alone is whole, or begins anew
            is_whole = self._record.files.get(self.video) == frame_count and self.is_newest(self.video)
            return frame_count if is_whole else 0
        count = min([frame_count, *(self._record.files.get(pattern, 0) for pattern in patterns)])
        for position in range(count):
            paths = [frame_path(self.folder, pattern, self.number(position)) for pattern in patterns]
            if not all(map(is_regular, paths)):
                return position
        return count

    def list_files(self, position: int, *, recorded: bool = False) -> None:
        """List the files of one frame as this run's, before they are written.

        Args:
            position: of the frame among those of the run.
            recorded: whether it is an image from a recording, which has a subfolder of its own.

        Raises:
            ShotError: the disk refused, or a file of another program has a name that is not listed yet.
        """
        listed = dict(self._record.files)
        for pattern in self.options.patterns:
            pattern = f"{RECORDED}/{pattern}" if recorded else pattern
            for place in range(listed.get(pattern, 0), position + 1):
                number = self.number(place)
                if is_there(path := frame_path(self.folder, pattern, number)):
                    self._check_listed_elsewhere(pattern, number, path)
            listed[pattern] = max(listed.get(pattern, 0), position + 1)
        if listed != self._record.files:
            self._save(replace(self._record, files=listed))

    def begin_file(self, name: str) -> Path:
        """List the page or the video and return its path; ShotError if the file is another program's."""
        if not self._record.files.get(name):
            self._check_free(self._record, 0, [name])
            self._save(replace(self._record, files={**self._record.files, name: 1}))
        return self.folder / name

    def end_file(self, name: str, frame_count: int) -> None:
        """State how many frames the video has."""
        self._save(replace(self._record, files={**self._record.files, name: frame_count}))

    def is_newest(self, name: str) -> bool:
        """Return whether the page or the video exists and no image is newer."""
        times = {path: path.stat().st_mtime_ns for path in self._record.own_files(self.folder)}
        images = [time for path, time in times.items() if path.name not in self._record.single]
        return self.folder / name in times and times[self.folder / name] >= max(images, default=0)

    def place(self, extension: str) -> Path:
        """Return the folder of the files of a format."""
        return self.folder / self.options.below(extension)

    def _save(self, record: RunRecord) -> None:
        record.write(self.folder)
        self._record = record

    def _is_own_name(self, name: str, listed: Iterable[str]) -> bool:
        """Return whether a file of this name is one of this run, and not of another that is running."""
        if name in (*self._record.single, self._record.file_name):
            return True
        numbers = [frame_number(Path(pattern).name, name) for pattern in listed]
        return any(number is not None and number in self._record.numbers for number in numbers)

    def _check_free(self, wanted: RunRecord, frame_count: int | None, single: Collection[str]) -> None:
        """Raise ShotError where an unlisted file has the name of one that will be written."""
        for name in single:
            if not self._record.files.get(name) and is_there(self.folder / name):
                raise foreign(self.folder / name)
        patterns, numbers = self.options.patterns, wanted.numbers
        if frame_count is None:
            patterns += [f"{RECORDED}/{pattern}" for pattern in patterns]
        for pattern in patterns:
            for number, path in sorted(numbered(self.folder, pattern)):
                is_wanted = number in numbers and (
                    frame_count is None or numbers.position(number) < frame_count
                )
                if is_wanted and not self._record.lists(pattern, number):
                    self._check_listed_elsewhere(pattern, number, path)

    def _check_listed_elsewhere(self, pattern: str, number: int, path: Path) -> None:
        if not any(other.lists(pattern, number) for other in self._others):
            raise foreign(path)

    def _check_recording(self, recording: Path | None) -> None:
        """Raise ShotError where the folder to record to exists and is not an earlier run's recording."""
        if recording is None or not is_there(recording):
            return
        from supersampler.recording.recorder import holds_only_a_recording

        own = self._record.recording == os.path.realpath(recording)
        if not (own and holds_only_a_recording(recording)):
            problem = f"is there already, and is no recording of an earlier run into {self.folder}"
            raise ShotError(recording, problem, "Choose another name, or move it away.")

    def _check_same(
        self, earlier: RunRecord, wanted: Mapping[str, object], *, but: Collection[str] = ()
    ) -> None:
        """Raise ShotError where the settings of an earlier run differ, except in those named by `but`."""
        for key in _differ(earlier, wanted, but):
            before = earlier.settings.get(key)
            problem = f"images of another run are there: {key} was {before}, is now {wanted[key]}"
            start_over = "" if but else ", or --overwrite to start over"
            raise ShotError(self.folder, problem, f"Choose another folder{start_over}.")


def _differ(earlier: RunRecord, wanted: Mapping[str, object], but: Collection[str] = ()) -> list[str]:
    """Return the names of the settings in which an earlier run differs, except those in `but`."""
    before = earlier.settings
    return [
        key
        for key, value in wanted.items()
        if key not in but and before.get(key) != json.loads(json.dumps(value))
    ]


def _is_demo(settings: Mapping[str, object]) -> bool:
    return settings.get(SOURCE) == DEMO


def _numbers_of(settings: Mapping[str, object]) -> dict[str, object]:
    return {name: settings[name] for name in (FIRST, FRAMES) if name in settings}


def model_settings(model: Model) -> dict[str, object]:
    """Return the settings of `Results.begin` that follow from a model."""
    return {
        "supersampler": __version__,
        "method": model.info.method,
        "model files": dict(model.info.files),
        "providers": list(model.providers),
        "executor": model.executor,
        "precision": model.precision,
    }
