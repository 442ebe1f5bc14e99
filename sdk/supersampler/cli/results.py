"""Write the output folder of `supersampler upscale`: numbered images, a page, and upscale.json."""

import json
import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from supersampler import __version__
from supersampler.cli.run_record import (
    FILE_NAME,
    RECORDED,
    SINGLE,
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
from supersampler.io.display_transforms import DisplayTransform
from supersampler.io.image_headers import Metadata
from supersampler.io.images import half_pixels, write_exr, write_png
from supersampler.io.shot.frame_files import COLOR, aov_channels
from supersampler.model import Model

_NAMES = re.compile(rf"\d{{4,}}\.(exr|png)|{'|'.join(map(re.escape, (FILE_NAME, *SINGLE)))}")


class Results:
    """Numbered images in a folder; with several formats, each in a subfolder of its name.

    Args:
        folder: the folder.
        formats: "exr", "png" or both.
        view: what PNG files show; by default exposure and the display transform.
    """

    def __init__(self, folder: Path, formats: Sequence[str], view: DisplayTransform | None = None) -> None:
        self.folder, self.formats, self._view = folder, tuple(formats), view
        self._record = RunRecord({})

    def begin(
        self,
        settings: Mapping[str, object],
        frame_count: int | None,
        *,
        overwrite: bool,
        single: Collection[str] = (),
        recording: Path | None = None,
    ) -> int:
        """Prepare the folder, and return the index of the first incomplete frame.

        Args:
            settings: all that the images depend on; JSON values.
            frame_count: number of frames; None where it is not known.
            overwrite: whether to remove the files of an earlier run instead of continuing it.
            single: names of SINGLE that will be written.
            recording: the folder that the run will record to; if it exists, it must be an earlier run's.

        Raises:
            ShotError: files of another program are in the way; or images of other settings exist and
                `overwrite` is False. Nothing has been changed.
        """
        earlier = read_run_record(self.folder)
        self._record = earlier or RunRecord({})
        own = self._record.own_files(self.folder)
        first = RunRecord(settings).first
        if earlier is not None and not overwrite:
            self._check_same(earlier.settings, settings)
        self._check_free(first, frame_count, single)
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
        """Return the number of complete frames from the first on; only files of these runs count."""
        count = min(frame_count, *(self._record.files.get(pattern, 0) for pattern in self._patterns()))
        for index in range(count):
            number = self._record.first + index
            paths = [frame_path(self.folder, pattern, number) for pattern in self._patterns()]
            if not all(map(is_regular, paths)):
                return index
        return count

    def write(
        self,
        index: int,
        image: Float32,
        exposure: float,
        aovs: Float32 | None = None,
        *,
        aov_names: Sequence[str] | None = None,
        metadata: Metadata | None = None,
        recorded: bool = False,
    ) -> None:
        """Write one frame atomically: EXR as linear half floats, PNG as it is shown.

        Args:
            index: its index in the shot; its file has the number of the shot's first frame + index.
            image: (H, W, 3) linear RGB.
            exposure: > 0, for the PNG.
            aovs: (H, W, k) AOVs for the EXR.
            aov_names: of their channels; by default A for k = 1, else aovs.0, aovs.1 and so on.
            metadata: entries of the EXR's header.
            recorded: whether it is an image from a recording, which has a separate subfolder.

        Raises:
            ShotError: the disk refused, or a file of another program has the name.
        """
        patterns = self._patterns(f"{RECORDED}/" if recorded else "")
        self._list(patterns, index + 1)
        for pattern in patterns:
            path = frame_path(self.folder, pattern, self._record.first + index)
            if path.suffix == ".exr":
                write_exr(path, *_with_aovs(image, aovs, aov_names), metadata=metadata)
            else:
                view = self._view
                write_png(path, to_uint8(view.show(image) if view else display_transform(image, exposure)))

    def begin_file(self, name: str) -> Path:
        """List a file of SINGLE in upscale.json and return its path; ShotError if it is another program's."""
        if not self._record.files.get(name):
            self._check_free(0, 0, [name])
            self._save(replace(self._record, files={**self._record.files, name: 1}))
        return self.folder / name

    def is_newest(self, name: str) -> bool:
        """Return whether a file of SINGLE exists and no image is newer."""
        times = {path: path.stat().st_mtime_ns for path in self._record.own_files(self.folder)}
        images = [time for path, time in times.items() if path.name not in SINGLE]
        return self.folder / name in times and times[self.folder / name] >= max(images, default=0)

    def images(self, extension: str, count: int) -> list[Path]:
        """Return the files of a format of the first `count` frames."""
        numbers = range(self._record.first, self._record.first + count)
        return [frame_path(self.place(extension), f"####.{extension}", number) for number in numbers]

    def place(self, extension: str) -> Path:
        """Return the folder of the files of a format."""
        return self.folder / extension if len(self.formats) > 1 else self.folder

    def _patterns(self, below: str = "") -> list[str]:
        """Return the patterns of this run's numbered files, as upscale.json lists them."""
        several = len(self.formats) > 1
        return [f"{below}{f'{name}/' if several else ''}####.{name}" for name in self.formats]

    def _list(self, patterns: list[str], count: int) -> None:
        """List the first `count` files of each pattern as this run's; unlisted ones must not exist yet."""
        listed = dict(self._record.files)
        for pattern in patterns:
            for index in range(listed.get(pattern, 0), count):
                if is_there(path := frame_path(self.folder, pattern, self._record.first + index)):
                    raise foreign(path)
            listed[pattern] = max(listed.get(pattern, 0), count)
        if listed != self._record.files:
            self._save(replace(self._record, files=listed))

    def _save(self, record: RunRecord) -> None:
        record.write(self.folder)
        self._record = record

    def _check_free(self, first: int, frame_count: int | None, single: Collection[str]) -> None:
        """Raise ShotError where an unlisted file has the name of one that will be written."""
        for name in single:
            if not self._record.files.get(name) and is_there(self.folder / name):
                raise foreign(self.folder / name)
        unknown = frame_count is None
        for pattern in self._patterns() + (self._patterns(f"{RECORDED}/") if unknown else []):
            for number, path in sorted(numbered(self.folder, pattern)):
                is_wanted = frame_count is None or 0 <= number - first < frame_count
                if is_wanted and not self._record.lists(pattern, number):
                    raise foreign(path)

    def _check_recording(self, recording: Path | None) -> None:
        """Raise ShotError where the folder to record to exists and is not an earlier run's recording."""
        if recording is None or not is_there(recording):
            return
        from supersampler.recording.folder import holds_only_a_recording

        own = self._record.recording == os.path.realpath(recording)
        if not (own and holds_only_a_recording(recording)):
            problem = f"is there already, and is no recording of an earlier run into {self.folder}"
            raise ShotError(recording, problem, "Choose another name, or move it away.")

    def _check_same(self, earlier: Mapping[str, object], wanted: Mapping[str, object]) -> None:
        changed = [key for key in wanted if earlier.get(key) != json.loads(json.dumps(wanted[key]))]
        if changed:
            key = changed[0]
            problem = f"images of another run are there: {key} was {earlier.get(key)}, is now {wanted[key]}"
            raise ShotError(self.folder, problem, "Choose another folder, or --overwrite to start over.")


def _with_aovs(
    image: Float32, aovs: Float32 | None, aov_names: Sequence[str] | None
) -> tuple[NDArray[np.float16], list[str]]:
    """Return the pixels and channel names of an EXR."""
    names, arrays = list(COLOR), [image]
    if aovs is not None:
        names += aov_names or (["A"] if aovs.shape[2] == 1 else aov_channels(aovs.shape[2]))
        arrays.append(aovs)
    return half_pixels(arrays), names


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
