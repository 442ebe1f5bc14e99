"""dataset.json: the sequences of a training set and their splits."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from supersampler.errors import ShotError
from supersampler.io.files import is_there, replacing
from supersampler.io.json_fields import read_json
from supersampler_model.data.dataset.frame_file import TrainingFrame, read_rerendered, read_training_frame
from supersampler_model.data.errors import DatasetError
from supersampler_model.data.sequences import SequenceSpec

FILE_NAME = "dataset.json"
VERSION = 1
Split = Literal["train", "validation", "test"]


@dataclass(frozen=True, kw_only=True)
class SequenceEntry:
    """One sequence of a training set.

    Attributes:
        spec: generates the sequence.
        ratio: display size over render size.
        split: its use.
    """

    spec: SequenceSpec
    ratio: float
    split: Split

    @property
    def folder(self) -> str:
        """Folder of its frames, relative to the data set."""
        return f"{self.split}/{self.spec.family}-{self.spec.seed}"

    def within(self, ratios: tuple[float, float]) -> bool:
        """Whether its ratio is in [minimum, maximum], as far as sizes of whole pixels can be."""
        return ratios[0] - 0.02 <= self.ratio <= ratios[1] + 0.02

    def render_size(self, display_size: tuple[int, int]) -> tuple[int, int]:
        """(width, height) of its frames."""
        return round(display_size[0] / self.ratio), round(display_size[1] / self.ratio)


@dataclass(frozen=True, kw_only=True)
class Description:
    """Content of a data set; two runs with the same description render the same images on one driver.

    Attributes:
        display_size: (width, height) of references and labels.
        samples: per pixel of the reference.
        gbuffers: whether display-size G-buffers are kept.
        seed: of the random plan.
        sequences: of all splits.
    """

    display_size: tuple[int, int]
    samples: int
    gbuffers: bool
    seed: int
    sequences: tuple[SequenceEntry, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {"version": VERSION, **asdict(self)}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Description":
        """Inverse of `to_json`; raises KeyError or TypeError on other data."""
        entries = (SequenceEntry(**{**e, "spec": SequenceSpec(**e["spec"])}) for e in content["sequences"])
        width, height = content["display_size"]
        others = {name: content[name] for name in ("samples", "gbuffers", "seed")}
        return cls(display_size=(width, height), sequences=tuple(entries), **others)


class Dataset:
    """A training set on disk, as far as it is rendered.

    Args:
        folder: of the set.
        description: its content.
        own: the set whose references and labels this one reuses, with the sequences rendered a second time at
            another ratio; None: its own.
    """

    def __init__(self, folder: Path, description: Description, *, own: "Dataset | None" = None) -> None:
        self.folder, self.description, self.own = folder, description, own

    def at(self, ratio: float) -> "Dataset":
        """Return the same set with all sequences at one ratio, and with G-buffers of render size."""
        sequences = tuple(replace(entry, ratio=ratio) for entry in self.description.sequences)
        return Dataset(self.folder, replace(self.description, sequences=sequences), own=self)

    def path(self, entry: SequenceEntry, index: int) -> Path:
        """File of one frame, which may not exist."""
        return self.folder / entry.folder / f"{index:04d}.safetensors"

    def rerendered_path(self, entry: SequenceEntry, index: int) -> Path:
        """File of a frame's second rendering, at the ratio of `entry`."""
        return self.path(entry, index).with_suffix(f".{entry.ratio:g}x.safetensors")

    def complete(self, entry: SequenceEntry) -> int:
        """Number of existing frames from the first on."""
        for index in range(entry.spec.frames):
            rerendered = self.own is None or self.rerendered_path(entry, index).exists()
            if not rerendered or not self.path(entry, index).exists():
                return index
        return entry.spec.frames

    def entries(self, split: Split | None = None) -> list[SequenceEntry]:
        """The sequences of a split, or all."""
        return [e for e in self.description.sequences if split in (None, e.split)]

    def read(self, entry: SequenceEntry, index: int) -> TrainingFrame:
        """Map one frame into memory.

        Raises:
            DatasetError: the frame is missing or damaged.
        """
        frame = read_training_frame(self.path(entry, index))
        if self.own is None:
            return frame
        return replace(frame, **read_rerendered(self.rerendered_path(entry, index))._asdict())

    def frames(self, entry: SequenceEntry) -> Iterator[TrainingFrame]:
        """Yield the existing frames of a sequence, in order."""
        for index in range(self.complete(entry)):
            yield self.read(entry, index)


def create_dataset(folder: Path, description: Description) -> Dataset:
    """Create a data set, or open one of the same description.

    Raises:
        DatasetError: the folder holds a set of another description or of changed files, or folders of no set.
    """
    path = folder / FILE_NAME
    if is_there(path):
        _check_same(path, open_dataset(folder).description, description)
    else:
        for entry in description.sequences:
            if is_there(folder / entry.folder):
                hint = "Move it away, or choose another folder."
                raise DatasetError(
                    folder / entry.folder, f"is there already, and no {FILE_NAME} lists it", hint
                )
        with replacing(path) as partial:
            partial.write_text(json.dumps(description.to_json(), indent=1) + "\n", encoding="utf-8")
    return Dataset(folder, description)


def open_dataset(folder: Path) -> Dataset:
    """Open a set; frames are read when asked for.

    Raises:
        DatasetError: there is none, or its description is damaged or of another version.
    """
    path = folder / FILE_NAME
    try:
        content = read_json(path)
        if content["version"] != VERSION:
            raise DatasetError(path, f"version {content['version']}, this code reads {VERSION}")
        return Dataset(folder, Description.from_json(content))
    except ShotError as error:
        problem = error.problem if is_there(path) else "is not there"
        raise DatasetError(path, problem, "`supersampler render` makes training sets.") from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise DatasetError(path, f"not a description ({type(error).__name__}: {error})") from error


def _check_same(path: Path, existing: Description, requested: Description) -> None:
    now, before = _digests(requested), _digests(existing)
    changed = sorted(name for name in now.keys() & before.keys() if now[name] != before[name])
    if changed:
        hint = "Put back the files that the set was begun with, or begin another set."
        raise DatasetError(path, f"these have changed since the set was begun: {', '.join(changed)}", hint)
    for name, value in asdict(requested).items():
        if asdict(existing)[name] != value:
            hint = "Give the options of the first run, and the same glTF files if any, or another folder."
            raise DatasetError(path, f"the set that is there has other {name.replace('_', ' ')}", hint)


def _digests(description: Description) -> dict[str, str]:
    """Return the SHA-256 of all asset files of a data set, by path."""
    specs = [entry.spec for entry in description.sequences]
    return {f"{spec.folder}/{name}": digest for spec in specs for name, digest in spec.files}
