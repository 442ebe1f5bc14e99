"""Training sets on disk: dataset.json lists the sequences; a safetensors file holds each frame.

Frames are memory-mapped, so that only the pixels of a crop are read.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame, ShotError
from supersampler.io.files import FolderLock, is_there, write_text
from supersampler.io.json_files import FileSize, check_version, read_typed
from supersampler.io.safetensors import open_safetensors, write_safetensors
from supersampler_model.data.errors import DatasetError, check_number
from supersampler_model.data.rendered import UNIT_BUFFERS, render_size
from supersampler_model.data.specs import SHOT, SequenceSpec

_TYPES = {
    "color": np.float16, "depth": np.float32, "motion": np.float16, "reference": np.float16,
    "ghost": np.uint8, "alias": np.uint8,
}  # fmt: skip
_DISPLAY, _RENDER = "display.", "render."  # prefixes of G-buffers
GBuffers = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrainingFrame:
    """Inputs of a method in one frame, and the reference.

    Arrays that were read are read-only views into the file: slice them before converting them. G-buffers are
    by name: `normal` float16, `depth` float32, the others uint8 for [0, 1].
    """

    color: NDArray[np.float16]  # (h, w, 3) linear RGB, at pixel centre + jitter
    depth: NDArray[np.float32]  # (h, w) reversed
    motion: NDArray[np.float16]  # (h, w, 2) render pixels, previous minus current
    jitter: tuple[float, float]  # (x, y) render pixels
    reset: bool  # True on the first frame after a cut
    exposure: float  # > 0
    reference: NDArray[np.float16]  # (H, W, 3) linear RGB
    ghost: NDArray[np.uint8]  # (H, W) classes of `labels.Ghost`
    alias: NDArray[np.uint8]  # (H, W) classes of `labels.Alias`
    gbuffer_display: GBuffers | None = None  # of display size; None where the set has none
    gbuffer: GBuffers | None = None  # of render size, without depth; None unless rendered a second time

    def frame(self) -> Frame:
        """Return the input of an `Upscaler`."""
        return Frame(
            color=self.color, depth=self.depth, motion=self.motion, jitter=self.jitter, reset=self.reset,
            exposure=self.exposure, gbuffer=_in_unit_range(self.gbuffer),
            gbuffer_display=_in_unit_range(self.gbuffer_display),
        )  # fmt: skip


class Rerendered(NamedTuple):
    """The inputs of a frame rendered a second time at another ratio; see `TrainingFrame`."""

    color: NDArray[np.float16]
    depth: NDArray[np.float32]
    motion: NDArray[np.float16]
    jitter: tuple[float, float]
    gbuffer: GBuffers


def write_training_frame(path: Path, frame: TrainingFrame) -> None:
    """Write one frame atomically.

    Raises:
        OSError: writing failed.
    """
    tensors = {name: getattr(frame, name) for name in _TYPES}
    numbers = {"jitter": frame.jitter, "reset": frame.reset, "exposure": frame.exposure}
    _write(path, tensors, _DISPLAY, frame.gbuffer_display or {}, numbers)


def read_training_frame(path: Path) -> TrainingFrame:
    """Memory-map one frame.

    Raises:
        DatasetError: the file is missing, cut off, or lacks a tensor.
    """
    with _damage_named(path):
        fields, gbuffer = _read(path, _DISPLAY)
        frame = TrainingFrame(**fields, gbuffer_display=gbuffer or None)
        _check(frame)
    return frame


def write_rerendered(path: Path, rerendered: Rerendered) -> None:
    """Write a second rendering atomically.

    Raises:
        OSError: writing failed.
    """
    tensors = {name: getattr(rerendered, name) for name in ("color", "depth", "motion")}
    _write(path, tensors, _RENDER, rerendered.gbuffer, {"jitter": rerendered.jitter})


def _check(frame: TrainingFrame) -> None:
    """Raise a ValueError if arrays or numbers are not those of a frame."""
    render, display = frame.depth.shape, frame.ghost.shape
    shapes = {
        "color": (*render, 3), "motion": (*render, 2), "reference": (*display, 3), "alias": display,
        "depth": render[:2], "ghost": display[:2],
    }  # fmt: skip
    for name, shape in shapes.items():
        if getattr(frame, name).shape != shape or 0 in shape:
            raise ValueError(f"{name} is {getattr(frame, name).shape}")
    sizes = (_DISPLAY, frame.gbuffer_display, display), (_RENDER, frame.gbuffer, render)
    for prefix, buffers, size in sizes:
        for name, array in (buffers or {}).items():
            if array.shape[:2] != size:
                raise ValueError(f"{prefix}{name} is {array.shape}")
    if type(frame.reset) is not bool or type(frame.exposure) not in (int, float) or not frame.exposure > 0:
        raise ValueError(f"reset is {frame.reset!r}, exposure {frame.exposure!r}")


def _write(
    path: Path, tensors: GBuffers, prefix: str, gbuffer: Mapping[str, NDArray[Any]], numbers: dict[str, Any]
) -> None:
    stored = {name: array.astype(_TYPES[name], copy=False) for name, array in tensors.items()}
    for name, array in gbuffer.items():
        stored[prefix + name] = _to_bytes(array) if name in UNIT_BUFFERS else array
    write_safetensors(path, stored, {"frame": json.dumps(numbers)})


def _read(path: Path, prefix: str) -> tuple[dict[str, Any], GBuffers]:
    """Return the tensors and numbers by name, and the G-buffers with this prefix."""
    tensors, metadata = open_safetensors(path)
    numbers = json.loads(metadata["frame"])
    x, y = (float(value) for value in numbers.pop("jitter"))
    for name, array in tensors.items():
        if name in _TYPES and array.dtype != _TYPES[name]:
            raise TypeError(f"{name} is {array.dtype}")
    gbuffer = {n.removeprefix(prefix): tensors.pop(n) for n in list(tensors) if n.startswith(prefix)}
    return {**tensors, **numbers, "jitter": (x, y)}, gbuffer


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Convert errors of damaged content to a DatasetError that names the file."""
    hint = "Delete it and render again; complete frames are kept."
    try:
        yield
    except ShotError as error:
        raise DatasetError(path, f"not a whole training frame: {error.problem}", hint) from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        problem = f"not a whole training frame ({type(error).__name__}: {error})"
        raise DatasetError(path, problem, hint) from error


def _in_unit_range(buffers: GBuffers | None) -> GBuffers | None:
    """Convert uint8 buffers to [0, 1]."""
    if buffers is None:
        return None
    return {n: a.astype(np.float32) / 255.0 if n in UNIT_BUFFERS else a for n, a in buffers.items()}


def _to_bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    if values.dtype == np.uint8:
        return values
    return (np.clip(values.astype(np.float32), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


FILE_NAME = "dataset.json"
VERSION = 1
Split = Literal["train", "validation", "test"]


@dataclass(frozen=True, kw_only=True)
class SequenceEntry:
    """One sequence of a training set."""

    spec: SequenceSpec
    ratio: float  # display size over render size
    split: Split

    def __post_init__(self) -> None:
        check_number("ratio", self.ratio, 1.0, np.inf)

    @property
    def folder(self) -> str:
        """Folder of the frames, relative to the data set."""
        return f"{self.split}/{self.spec.family}-{self.spec.seed}"

    def within(self, ratios: tuple[float, float]) -> bool:
        """Return whether the ratio is in [minimum, maximum], up to the rounding of sizes to whole pixels."""
        return ratios[0] - 0.02 <= self.ratio <= ratios[1] + 0.02


@dataclass(frozen=True, kw_only=True)
class Description:
    """Content of a data set; on one driver, two runs with the same description render the same images."""

    display_size: FileSize  # (width, height) of references and labels
    samples: int  # per pixel of the reference
    gbuffers: bool  # whether display-size G-buffers are kept
    seed: int  # of the random plan
    sequences: tuple[SequenceEntry, ...]  # of all splits


class Dataset:
    """A training set on disk, which may be incomplete.

    If the sequences were rendered a second time, at another ratio, references and labels are those of `own`,
    the set of the first rendering.
    """

    def __init__(self, folder: Path, description: Description, *, own: "Dataset | None" = None) -> None:
        self.folder, self.description, self.own = folder, description, own

    def at(self, ratio: float) -> "Dataset":
        """Return this set with all sequences at one ratio, and with G-buffers of render size."""
        sequences = tuple(replace(entry, ratio=ratio) for entry in self.description.sequences)
        return Dataset(self.folder, replace(self.description, sequences=sequences), own=self)

    def path(self, entry: SequenceEntry, index: int) -> Path:
        """Return the file of one frame; it may not exist."""
        return self.folder / entry.folder / f"{index:04d}.safetensors"

    def rerendered_path(self, entry: SequenceEntry, index: int) -> Path:
        """Return the file of a frame's second rendering, at the ratio of `entry`."""
        return self.path(entry, index).with_suffix(f".{entry.ratio:g}x.safetensors")

    def complete(self, entry: SequenceEntry) -> int:
        """Return the number of existing frames from the first on."""
        for index in range(entry.spec.frames):
            rerendered = self.own is None or self.rerendered_path(entry, index).exists()
            if not rerendered or not self.path(entry, index).exists():
                return index
        return entry.spec.frames

    def entries(self, split: Split | None = None) -> list[SequenceEntry]:
        """Return the sequences of a split, or all."""
        return [e for e in self.description.sequences if split in (None, e.split)]

    def read(self, entry: SequenceEntry, index: int) -> TrainingFrame:
        """Map one frame into memory.

        Raises:
            DatasetError: the frame is missing or damaged.
        """
        path = self.path(entry, index)
        frame = read_training_frame(path)
        if self.own is not None:
            path = self.rerendered_path(entry, index)
            with _damage_named(path):
                fields, gbuffer = _read(path, _RENDER)
                frame = replace(frame, **Rerendered(**fields, gbuffer=gbuffer)._asdict())
                _check(frame)
        self._check_sizes(path, frame, entry)
        return frame

    def _check_sizes(self, path: Path, frame: TrainingFrame, entry: SequenceEntry) -> None:
        """Raise a DatasetError if sizes differ from the description; frames of shots may have any ratio."""
        display, render = frame.ghost.shape[::-1], frame.depth.shape[::-1]
        stated = self.description.display_size
        rendered = render if entry.spec.family == SHOT else render_size(stated, entry.ratio)
        if (render, display) != (rendered, stated):
            problem = f"is {render} to {display}; {FILE_NAME} says {rendered} to {stated}"
            raise DatasetError(path, problem, "Restore the frame, or its description.")

    def frames(self, entry: SequenceEntry) -> Iterator[TrainingFrame]:
        """Yield the existing frames of a sequence, in order."""
        for index in range(self.complete(entry)):
            yield self.read(entry, index)


def create_dataset(folder: Path, description: Description) -> Dataset:
    """Create a data set, or open one of the same description.

    Raises:
        DatasetError: the folder holds a set of another description or of changed files, or folders of no set.
        ShotError: another run writes to the folder, or the disk refuses.
    """
    path = folder / FILE_NAME
    with FolderLock(folder) as lock:
        lock.take_new()
        if is_there(path):
            _check_same(path, open_dataset(folder).description, description)
            return Dataset(folder, description)
        for entry in description.sequences:
            if is_there(folder / entry.folder):
                hint = "Move it away, or choose another folder."
                problem = f"already exists, and no {FILE_NAME} lists it"
                raise DatasetError(folder / entry.folder, problem, hint)
        write_text(path, json.dumps({"version": VERSION, **asdict(description)}, indent=1) + "\n")
    return Dataset(folder, description)


def open_dataset(folder: Path) -> Dataset:
    """Open a set; frames are read on demand.

    Raises:
        DatasetError: there is none, or its description is damaged or of another version.
    """
    path, hint = folder / FILE_NAME, "`supersampler render` makes training sets."
    try:
        check_version(path, VERSION, hint)
        return Dataset(folder, read_typed(path, Description, hint))
    except ShotError as error:
        problem = error.problem if is_there(path) else "is not there"
        raise DatasetError(path, problem, hint) from error


def _check_same(path: Path, existing: Description, requested: Description) -> None:
    now, before = _digests(requested), _digests(existing)
    changed = sorted(name for name in now.keys() & before.keys() if now[name] != before[name])
    if changed:
        hint = "Restore the files that the set was started with, or use another folder."
        raise DatasetError(path, f"these have changed since the set was started: {', '.join(changed)}", hint)
    for name, value in asdict(requested).items():
        if asdict(existing)[name] != value:
            hint = "Use the options of the first run, with the same glTF files or shots, or another folder."
            raise DatasetError(path, f"the existing set differs in its {name.replace('_', ' ')}", hint)


def _digests(description: Description) -> dict[str, str]:
    """Return the SHA-256 of all asset files and shots of a data set, by path or name."""
    specs = [entry.spec for entry in description.sequences]
    return {str(Path(spec.folder or "", name)): digest for spec in specs for name, digest in spec.files}
