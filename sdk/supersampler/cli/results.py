"""The folder that `supersampler upscale` writes: pictures, and upscale.json: how they were made."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from supersampler.display import display_transform, to_uint8
from supersampler.errors import ShotError
from supersampler.files import remove_partial_files, replacing
from supersampler.frame import Float32
from supersampler.image_io import write_exr, write_png

FILE_NAME = "upscale.json"
_PICTURE = re.compile(r"\d{4,}\.(exr|png)")
_LARGEST_HALF = 65504.0


class Results:
    """Numbered pictures in a folder; with several formats, each in a folder of its name.

    Args:
        folder: the folder.
        formats: "exr", "png" or both.
    """

    def __init__(self, folder: Path, formats: Sequence[str]) -> None:
        self.folder, self.formats = folder, tuple(formats)

    def begin(self, settings: Mapping[str, object], frame_count: int, *, overwrite: bool) -> int:
        """Make the folder ready, and return the index of the first frame that is not complete.

        Args:
            settings: all that the pictures follow from; JSON values.
            frame_count: how many there will be.
            overwrite: whether to remove what an earlier run wrote, instead of continuing it.

        Raises:
            ShotError: pictures of other settings, or of unknown ones, are there and `overwrite` is False.
        """
        path = self.folder / FILE_NAME
        if path.exists() and overwrite:
            self._remove_pictures()
        elif path.exists():
            self._check_same(_read(path), settings)
        elif not overwrite and (strangers := [name for name in self._pictures() if name.exists()]):
            hint = "Choose another folder, or --overwrite."
            raise ShotError(strangers[0], f"is there already, and no {FILE_NAME} says where from", hint)
        with replacing(path) as partial:
            partial.write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8", newline="\n")
        remove_partial_files(self.folder)
        return self.count_complete(frame_count)

    def count_complete(self, frame_count: int) -> int:
        """Return how many frames from the first on are complete."""
        for index in range(frame_count):
            if not all(path.exists() for path in self._paths(index)):
                return index
        return frame_count

    def write(self, index: int, image: Float32, exposure: float, carry: Float32 | None = None) -> None:
        """Write one frame: EXR as linear half floats, PNG as a screen shows it. Each file appears whole.

        Args:
            index: its place in the shot.
            image: (H, W, 3) linear RGB.
            exposure: > 0, for the PNG.
            carry: (H, W, k) of the EXR: A where it is one channel, else carry.0, carry.1 and so on.
        """
        for path in self._paths(index):
            if path.suffix == ".exr":
                write_exr(path, *_with_carry(image, carry))
            else:
                write_png(path, to_uint8(display_transform(image, exposure)))

    def is_newest(self, path: Path) -> bool:
        """Tell whether a file is there that was made when all pictures were."""
        times = [picture.stat().st_mtime_ns for picture in self._pictures()]
        return path.exists() and path.stat().st_mtime_ns >= max(times, default=0)

    def place(self, extension: str) -> Path:
        """Return the folder that files of a format are in."""
        return self.folder / extension if len(self.formats) > 1 else self.folder

    def _paths(self, index: int) -> list[Path]:
        return [self.place(extension) / f"{index:04d}.{extension}" for extension in self.formats]

    def _pictures(self) -> list[Path]:
        """Pictures that are there by such names, of this run's formats or others."""
        places = (self.folder, self.folder / "exr", self.folder / "png")
        return sorted(
            path
            for place in places
            if place.is_dir()
            for path in place.iterdir()
            if _PICTURE.fullmatch(path.name)
        )

    def _remove_pictures(self) -> None:
        (self.folder / FILE_NAME).unlink()
        for path in self._pictures():
            path.unlink()

    def _check_same(self, there: Mapping[str, object], wanted: Mapping[str, object]) -> None:
        changed = [key for key in wanted if there.get(key) != json.loads(json.dumps(wanted[key]))]
        if changed:
            key = changed[0]
            problem = f"pictures of another run are there: {key} was {there.get(key)}, is now {wanted[key]}"
            raise ShotError(self.folder, problem, "Choose another folder, or --overwrite to start over.")


def _with_carry(image: Float32, carry: Float32 | None) -> tuple[NDArray[np.float16], list[str]]:
    """Pixels and channel names of an EXR."""
    names, arrays = ["R", "G", "B"], [image]
    if carry is not None:
        count = carry.shape[2]
        names += ["A"] if count == 1 else [f"carry.{index}" for index in range(count)]
        arrays.append(carry)
    pixels = np.clip(np.concatenate(arrays, axis=-1), -_LARGEST_HALF, _LARGEST_HALF)
    return pixels.astype(np.float16), names


def _read(path: Path) -> Mapping[str, object]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ShotError(path, f"cannot be read ({error})", "--overwrite starts over.") from error
    return content if isinstance(content, dict) else {}
