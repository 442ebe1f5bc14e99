"""The folder that `supersampler upscale` writes: numbered images, a page, and upscale.json."""

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from supersampler.cli.run_record import (
    FILE_NAME,
    PAGE,
    RECORDED,
    RunRecord,
    foreign,
    frame_path,
    numbered,
    read_run_record,
)
from supersampler.errors import ShotError
from supersampler.frame import Float32
from supersampler.io.atomic import is_regular, is_there, remove_files, remove_partial_files
from supersampler.io.display import display_transform, to_uint8
from supersampler.io.images import write_exr, write_png

_NAMES = re.compile(rf"\d{{4,}}\.(exr|png)|{re.escape(FILE_NAME)}|{re.escape(PAGE)}")
_LARGEST_HALF = 65504.0


class Results:
    """Numbered images in a folder; with several formats, each in a folder of its name.

    Args:
        folder: the folder.
        formats: "exr", "png" or both.
    """

    def __init__(self, folder: Path, formats: Sequence[str]) -> None:
        self.folder, self.formats = folder, tuple(formats)
        self._record = RunRecord({})

    def begin(
        self,
        settings: Mapping[str, object],
        frame_count: int | None,
        *,
        overwrite: bool,
        page: bool = False,
        recording: Path | None = None,
    ) -> int:
        """Make the folder ready, and return the index of the first frame that is not complete.

        Args:
            settings: all that the images follow from; JSON values.
            frame_count: how many there will be; None where it is not known.
            overwrite: whether to remove what an earlier run wrote, instead of continuing it.
            page: whether a page is to be written.
            recording: the folder that the run will record to; if it exists, it is an earlier run's.

        Raises:
            ShotError: files that no earlier run here wrote are in the way; or images of other settings are
                there and `overwrite` is False. Nothing has been changed.
        """
        there = read_run_record(self.folder)
        own = [] if there is None else there.own_files(self.folder)
        if there is not None and not overwrite:
            self._check_same(there.settings, settings)
        self._record = RunRecord({}) if there is None else there
        self._check_free(frame_count, page=page)
        self._check_recording(recording)
        if overwrite:
            remove_files(own)
        below = {str(Path(pattern).parent) for pattern in self._record.files}
        kept = {} if overwrite else self._record.files
        recorded = self._record.recording if recording is None else os.path.realpath(recording)
        self._save(RunRecord(settings, kept, recorded))
        remove_partial_files(self.folder, _NAMES, below - {"."})
        return 0 if frame_count is None else self.count_complete(frame_count)

    def count_complete(self, frame_count: int) -> int:
        """Return how many frames from the first on are complete; files that no run here wrote count not."""
        listed = min(self._record.files.get(pattern, 0) for pattern in self._patterns())
        for index in range(min(frame_count, listed)):
            paths = [frame_path(self.folder, pattern, index) for pattern in self._patterns()]
            if not all(map(is_regular, paths)):
                return index
        return min(frame_count, listed)

    def write(self, index: int, image: Float32, exposure: float, aovs: Float32 | None = None) -> None:
        """Write one frame: EXR as linear half floats, PNG as a screen shows it. Each file appears whole.

        Args:
            index: its place in the shot.
            image: (H, W, 3) linear RGB.
            exposure: > 0, for the PNG.
            aovs: (H, W, k) of the EXR: A where it is one channel, else aovs.0, aovs.1 and so on.

        Raises:
            ShotError: the disk refused, or a file that no run here wrote has the name.
        """
        self._write(self._patterns(), index, image, exposure, aovs)

    def write_recorded(self, index: int, image: Float32, exposure: float) -> None:
        """Write a frame as it was recorded, into a folder of its own; see `write`."""
        self._write(self._patterns(f"{RECORDED}/"), index, image, exposure, None)

    def begin_page(self) -> Path:
        """Return the page's path, once it is sure that no file of others is there.

        Raises:
            ShotError: one is.
        """
        if not self._record.files.get(PAGE):
            self._check_free(0, page=True)
            self._save(replace(self._record, files={**self._record.files, PAGE: 1}))
        return self.folder / PAGE

    def is_page_newest(self) -> bool:
        """Tell whether the page is there, and was made when all images were."""
        own = self._record.own_files(self.folder)
        times = {path: path.stat().st_mtime_ns for path in own}
        return self.folder / PAGE in times and times[self.folder / PAGE] == max(times.values())

    def place(self, extension: str) -> Path:
        """Return the folder that files of a format are in."""
        return self.folder / extension if len(self.formats) > 1 else self.folder

    def _patterns(self, below: str = "") -> list[str]:
        """Names of the numbered files of this run's formats, as upscale.json lists them."""
        several = len(self.formats) > 1
        return [f"{below}{f'{name}/' if several else ''}####.{name}" for name in self.formats]

    def _write(
        self, patterns: list[str], index: int, image: Float32, exposure: float, aovs: Float32 | None
    ) -> None:
        self._list(patterns, index + 1)
        for pattern in patterns:
            path = frame_path(self.folder, pattern, index)
            if path.suffix == ".exr":
                write_exr(path, *_with_aovs(image, aovs))
            else:
                write_png(path, to_uint8(display_transform(image, exposure)))

    def _list(self, patterns: list[str], count: int) -> None:
        """List the first `count` files of each pattern as this run's, once it is sure that no others are."""
        listed = dict(self._record.files)
        for pattern in patterns:
            for index in range(listed.get(pattern, 0), count):
                if is_there(path := frame_path(self.folder, pattern, index)):
                    raise foreign(path)
            listed[pattern] = max(listed.get(pattern, 0), count)
        if listed != self._record.files:
            self._save(replace(self._record, files=listed))

    def _save(self, record: RunRecord) -> None:
        record.write(self.folder)
        self._record = record

    def _check_free(self, frame_count: int | None, *, page: bool) -> None:
        """Raise where a file that is not listed has the name of one that is to be written."""
        listed = self._record.files
        if page and not listed.get(PAGE) and is_there(self.folder / PAGE):
            raise foreign(self.folder / PAGE)
        unknown = frame_count is None
        for pattern in self._patterns() + (self._patterns(f"{RECORDED}/") if unknown else []):
            for index, path in sorted(numbered(self.folder, pattern)):
                if index >= listed.get(pattern, 0) and (frame_count is None or index < frame_count):
                    raise foreign(path)

    def _check_recording(self, recording: Path | None) -> None:
        """Raise where the folder to record to exists, unless an earlier run of this folder recorded it."""
        if recording is None or not is_there(recording):
            return
        from supersampler.recording.folder import holds_only_a_recording

        own = self._record.recording == os.path.realpath(recording)
        if not (own and holds_only_a_recording(recording)):
            problem = f"is there already, and is no recording of an earlier run into {self.folder}"
            raise ShotError(recording, problem, "Choose another name, or move it away.")

    def _check_same(self, there: Mapping[str, object], wanted: Mapping[str, object]) -> None:
        changed = [key for key in wanted if there.get(key) != json.loads(json.dumps(wanted[key]))]
        if changed:
            key = changed[0]
            problem = f"images of another run are there: {key} was {there.get(key)}, is now {wanted[key]}"
            raise ShotError(self.folder, problem, "Choose another folder, or --overwrite to start over.")


def _with_aovs(image: Float32, aovs: Float32 | None) -> tuple[NDArray[np.float16], list[str]]:
    """Pixels and channel names of an EXR."""
    names, arrays = ["R", "G", "B"], [image]
    if aovs is not None:
        count = aovs.shape[2]
        names += ["A"] if count == 1 else [f"aovs.{index}" for index in range(count)]
        arrays.append(aovs)
    pixels = np.clip(np.concatenate(arrays, axis=-1), -_LARGEST_HALF, _LARGEST_HALF)
    return pixels.astype(np.float16), names
