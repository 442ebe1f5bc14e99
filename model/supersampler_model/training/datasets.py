"""Training data: sets made of shots, sets at other ratios with G-buffers, and frames as tensors."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.errors import ArgumentError, ShotError
from supersampler.io.display import MAX_HALF, auto_exposure, usable_exposure
from supersampler.io.shot import ClassMaps, Shot, ShotFrame
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_model.data.dataset import storage
from supersampler_model.data.specs import GLTF, SHOT, SequenceSpec

UNKNOWN = 255  # value of unknown classes


def dataset_of_shots(shots: Sequence[Shot], folder: Path, split: storage.Split) -> storage.Dataset:
    """Copy shots to a training set, for fast reads of crops; existing frames of the same shots are kept.

    Shots usually have no class labels. Frames without a reference serve as history; their references are NaN.

    Raises:
        ShotError: a shot has no reference, or another display size than the first.
        DatasetError: the folder holds a copy of other shots, or the shots have changed since.
        OSError: writing failed.
    """
    size = shots[0].display_size
    for shot in shots:
        if not shot.reference_indices or shot.display_size is None or size is None:
            hint = "Render some frames with many samples a pixel at display size and list them in shot.json."
            raise ShotError(shot.path, "no frame has a reference to learn from", hint)
        if shot.display_size != size:
            raise ShotError(shot.path, f"references are {shot.display_size}, the others are {size}")
    assert size is not None  # noqa: S101 - the loop has seen to it
    entries = []
    for index, shot in enumerate(shots):
        rate = shot.frame_rate or 30.0
        files = ((shot.name, shot.digest()),)
        spec = SequenceSpec(family=SHOT, seed=index, frames=len(shot), frame_rate=rate, files=files)
        entries.append(storage.SequenceEntry(spec=spec, ratio=size[0] / shot.render_size[0], split=split))
    description = storage.Description(
        display_size=size, samples=1, gbuffers=False, seed=0, sequences=tuple(entries)
    )
    dataset = storage.create_dataset(folder, description)
    for shot, entry in zip(shots, entries, strict=True):
        for item in shot.frames(dataset.complete(entry)):
            frame = _training_frame(shot, item, size[::-1])
            storage.write_training_frame(dataset.path(entry, item.index), frame)
    return dataset


def _training_frame(shot: Shot, item: ShotFrame, shape: tuple[int, int]) -> storage.TrainingFrame:
    frame = item.frame
    if frame.color is None:
        raise ShotError(shot.path, f"frame {item.index} has no colour to learn from")
    pre_exposure = np.float32(frame.pre_exposure)  # training sets have none
    color = np.minimum(frame.color / pre_exposure, MAX_HALF).astype(np.float16)
    unknown = np.full(shape, UNKNOWN, np.uint8)
    classes = shot.read_classes(item.index) or ClassMaps(unknown, unknown, None)
    truth = np.full((*shape, 3), np.nan) if item.reference is None else item.reference / pre_exposure
    truth = np.minimum(truth, MAX_HALF).astype(np.float16)
    return storage.TrainingFrame(
        color=color, depth=frame.depth, motion=frame.motion.astype(np.float16), jitter=frame.jitter,
        reset=frame.reset, exposure=usable_exposure(frame.exposure) or auto_exposure(color),
        reference=truth, ghost=classes.ghost, alias=classes.alias,
    )  # fmt: skip


def gbuffer_set(dataset: storage.Dataset, ratio: int) -> storage.Dataset:
    """Return a set with the sequences rendered at one ratio, with G-buffers of both sizes.

    Raises:
        ArgumentError: there are none, or a render pixel is not a whole number of display pixels.
    """
    at, size = dataset.at(ratio), dataset.description.display_size
    if size[0] % ratio or size[1] % ratio:
        want = f"a set whose display size is a multiple of {ratio}, the ratio of the method"
        raise ArgumentError("data", got=f"{dataset.folder}, of {size[0]}x{size[1]}", want=want)
    missing = "" if any(map(at.complete, at.entries())) else f"frames at ratio {ratio}"
    missing = missing if dataset.description.gbuffers else "G-buffers of display size"
    if missing:
        want = f"a set made by `supersampler render --gbuffers --also {ratio}`"
        raise ArgumentError("data", got=f"{dataset.folder}, without {missing}", want=want)
    return at


def unshaded_set(dataset: storage.Dataset, ratios: tuple[float, float]) -> storage.Dataset:
    """Return a set with the second renderings of the sequences, at each ratio within `ratios`.

    Raises:
        ArgumentError: there are none, so that no frame has G-buffers of render size.
    """
    own = dataset.entries()
    names = (path.name for entry in own for path in dataset.path(entry, 0).parent.glob("0000.*x.safetensors"))
    rendered = {float(name.removeprefix("0000.").removesuffix("x.safetensors")) for name in names}
    sequences = tuple(replace(entry, ratio=ratio) for ratio in sorted(rendered) for entry in own)
    sequences = tuple(entry for entry in sequences if entry.within(ratios))
    if not sequences:
        want = "a set made by `supersampler render --gbuffers --also 2`"
        got = f"{dataset.folder}, without G-buffers of render size at a ratio from {ratios[0]} to {ratios[1]}"
        raise ArgumentError("data", got=got, want=want)
    return storage.Dataset(dataset.folder, replace(dataset.description, sequences=sequences), own=dataset)


def sequences_of(
    datasets: Sequence[storage.Dataset], ratios: tuple[float, float], *, min_frames: int
) -> list[tuple[storage.Dataset, storage.SequenceEntry, int]]:
    """Return the training sequences with ratios in a range, and their numbers of consecutive frames.

    Raises:
        ArgumentError: no sequence has `min_frames` frames.
    """
    every = [(d, entry, d.complete(entry)) for d in datasets for entry in d.entries("train")]
    found = [each for each in every if each[1].within(ratios) and each[2] >= min_frames]
    if not found:
        kinds = sorted({(f"{entry.ratio:.3g}", count) for _, entry, count in every})
        got = ", ".join(f"{count} consecutive frames at ratio {ratio}" for ratio, count in kinds)
        want = f"{min_frames} or more consecutive frames at a ratio from {ratios[0]:g} to {ratios[1]:g}"
        raise ArgumentError("data", got=got or "empty", want=want)
    return found


def data_hash(datasets: Sequence[storage.Dataset]) -> str:
    """Return the sha256 of the descriptions of the data sets."""
    digest = hashlib.sha256()
    for dataset in datasets:
        digest.update(repr(dataset.description).encode())
    return digest.hexdigest()


def assets(datasets: Sequence[storage.Dataset]) -> list[str]:
    """Return the names of the asset files in the training sequences, for attribution."""
    entries = [entry for dataset in datasets for entry in dataset.entries("train")]
    return sorted({name for entry in entries if entry.spec.family == GLTF for name, _ in entry.spec.files})


def method_inputs(frame: storage.TrainingFrame, names: Sequence[str]) -> dict[str, Tensor]:
    """Return the inputs of a method from a training frame, by name, in the order of the names.

    Raises:
        ArgumentError: the frame lacks an input.
    """
    images = {**gbuffers(frame), "color": frame.color, "depth": frame.depth, "motion": frame.motion}
    numbers = {
        "jitter": torch.tensor([frame.jitter], dtype=torch.float32),
        "exposure": torch.tensor([frame.exposure], dtype=torch.float32),
        "pre_exposure": torch.ones(1),
        "adds_samples": torch.ones(1),
        "reactive": torch.zeros(1, 1, *frame.depth.shape),
        "display_size": torch.tensor(frame.reference.shape[1::-1]),
    }
    if missing := [name for name in names if name not in images and name not in numbers]:
        want = "frames with G-buffers of both sizes: `supersampler render --gbuffers --also 2,4`"
        raise ArgumentError("data", got=f"frames without {', '.join(missing)}", want=want)
    return {name: numbers[name] if name in numbers else planes(images[name]) for name in names}


def gbuffers(frame: storage.TrainingFrame) -> dict[str, NDArray[Any]]:
    """Return the G-buffers of both sizes by input name, as stored."""
    found = {name: (getattr(frame, place.group) or {}).get(place.key) for name, place in GBUFFERS.items()}
    return {name: image for name, image in found.items() if image is not None}


def planes(image: NDArray[Any]) -> Tensor:
    """Convert (h, w) or (h, w, c) to (1, c, h, w) float32; uint8 to [0, 1]."""
    channels = image[..., None] if image.ndim == 2 else image
    tensor = torch.from_numpy(np.array(channels.transpose(2, 0, 1), np.float32, order="C"))[None]
    return tensor / 255.0 if image.dtype == np.uint8 else tensor
