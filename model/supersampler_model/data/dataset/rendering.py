"""Plan and render a training set; a stopped run resumes after the last complete frame of each sequence."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from supersampler import halton_jitter
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.files import SHOT_FRAMES, FolderLock, remove_partial_files
from supersampler_model.data.dataset import storage
from supersampler_model.data.dataset.storage import Dataset, Description, SequenceEntry, Split, open_dataset
from supersampler_model.data.errors import DatasetError
from supersampler_model.data.processes import OnFrame, run_parts
from supersampler_model.data.rendered import labels_of, render_size
from supersampler_model.data.renderer.renderer import Renderer, samples_side
from supersampler_model.data.scenes.gltf.compose import read_folder
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES, TRAIN_FAMILIES, make_sequence
from supersampler_model.data.shots import render_frame
from supersampler_model.data.specs import SequenceSpec

RATIOS = {1.0: 0.1, 1.5: 0.2, 2.0: 0.4, 3.0: 0.2, 4.0: 0.1}
"""Display over render size, and the fraction of the sequences that have it."""
_GOLDEN = (5.0**0.5 - 1.0) / 2.0  # its multiples fill [0, 1) evenly
_VALIDATION_EVERY = 8  # one sequence in eight is for validation, with another seed and thus another scene
_FRAME_FILE = re.compile(r"\d{4,}(\.[\d.e+]+x)?\.safetensors")
MAX_DIFFERENCE = 0.01  # tolerance for another driver: mean absolute difference of a frame over its mean


@dataclass(frozen=True, kw_only=True)
class RenderPlan:
    """Options of the command line; sizes are (width, height)."""

    families: Sequence[str] = TRAIN_FAMILIES
    sequences: int = 60
    frames: int = 25
    display_size: tuple[int, int] = (640, 360)
    ratios: Sequence[float] = tuple(RATIOS)
    samples: int = 64
    gbuffers: bool = False
    seed: int = 0
    gltf: Path | None = None  # folder of files to compose sequences of; None: procedural families only
    gltf_fraction: float = 0.3  # fraction of sequences composed of them, (0, 1]; the others are of `families`

    def check(self) -> None:
        """Raise an ArgumentError for an unknown family, a ratio below 1, or nothing to render."""
        known = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)
        for family in self.families:
            if family not in known:
                raise ArgumentError("families", got=repr(family), want=f"some of {', '.join(known)}")
        for name in ("sequences", "frames"):
            if not 1 <= getattr(self, name) <= SHOT_FRAMES:
                raise ArgumentError(name, got=getattr(self, name), want=f"1 to {SHOT_FRAMES}")
        samples_side(self.samples)
        if not self.families:
            raise ArgumentError("families", got="none", want=f"some of {', '.join(known)}")
        check_ratios("ratios", self.ratios, self.display_size)
        if not 0.0 < self.gltf_fraction <= 1.0:
            raise ArgumentError("gltf_fraction", got=self.gltf_fraction, want="a fraction > 0 and <= 1")


def check_ratios(name: str, ratios: Sequence[float], display_size: Size) -> None:
    """Raise an ArgumentError unless there are ratios, each from 1 to one pixel a frame."""
    most = 2 * min(display_size) - 1  # render sizes are rounded
    if not ratios or not all(1.0 <= ratio <= most for ratio in ratios):  # NaN fails, too
        raise ArgumentError(name, got=list(ratios), want=f"some from 1.0 to {most} at this display size")


def plan_sequences(plan: RenderPlan, on_left_out: Callable[[str], None] = lambda _: None) -> Description:
    """Draw the sequences of a set: families alternate; one seed determines files, ratios and seeds.

    Procedural sequences for validation have other seeds than those for training. Composed ones also have
    other files, if there are at least two of a kind (stages, props, panoramas). `on_left_out` is called with
    the reason why a file is not used.

    Raises:
        ArgumentError: an unknown family, a ratio below 1, or nothing to render.
        SceneError: there is nothing to compose in the folder.
        GltfError: a file in it is broken or not supported.
    """
    plan.check()
    random = np.random.default_rng(plan.seed)
    next_ratio = _ratio_turns(plan.ratios, random)
    training, validation = None, None
    if plan.gltf is not None:
        training, validation = read_folder(plan.gltf, on_left_out).split(plan.seed)
    fraction, entries = 0.0 if plan.gltf is None else plan.gltf_fraction, []
    for index in range(plan.sequences):
        seed = int(random.integers(1 << 31))
        composed, after = (int(fraction * number + 0.5) for number in (index, index + 1))  # spread evenly
        if training is not None and after > composed:
            split = "train" if validation is None else _split(composed)
            folder = training if validation is None or split == "train" else validation
            spec = folder.spec(seed, plan.frames)
        else:
            turn, place = divmod(index - composed, len(plan.families))
            spec = SequenceSpec(family=plan.families[place], seed=seed, frames=plan.frames)
            split = _split(turn) if spec.family in TRAIN_FAMILIES else "test"
        entries.append(SequenceEntry(spec=spec, ratio=next_ratio(spec.family), split=split))
    return Description(
        display_size=plan.display_size, samples=plan.samples, gbuffers=plan.gbuffers, seed=plan.seed,
        sequences=tuple(entries),
    )  # fmt: skip


def _split(turn: int) -> Split:
    return "validation" if turn % _VALIDATION_EVERY == _VALIDATION_EVERY - 1 else "train"


def _ratio_turns(ratios: Sequence[float], random: np.random.Generator) -> Callable[[str], float]:
    """Return a function that gives each family its next ratio, at fixed frequencies even in short runs."""
    weights = np.array([RATIOS.get(ratio, 0.2) for ratio in ratios])
    ends = np.cumsum(weights / weights.sum())
    turns: dict[str, float] = {}

    def next_ratio(family: str) -> float:
        turn = turns.get(family, random.random())
        turns[family] = (turn + _GOLDEN) % 1.0
        index = int(np.searchsorted(ends, turn, side="right"))
        return float(ratios[min(index, len(ends) - 1)])

    return next_ratio


def render_sequence(
    dataset: Dataset, entry: SequenceEntry, renderer: Renderer, *, on_frame: OnFrame = lambda: None
) -> None:
    """Render the missing frames of `entry`, with a renderer of the set's display size and samples.

    For a set at one ratio (`Dataset.at`), write the second renderings beside the existing frames.

    Raises:
        OSError: writing failed; all earlier frames are complete.
        DatasetError: the scenes have changed since the existing frames were rendered.
    """
    first = dataset.complete(entry)
    if first == entry.spec.frames:
        return
    if dataset.own is not None:
        _rerender(dataset, dataset.own, entry, renderer, on_frame)
        return
    sequence = make_sequence(entry.spec)
    before = render_frame(sequence, renderer, max(first - 1, 0), entry.ratio)
    for index in range(first, entry.spec.frames):
        now = before if index == 0 else render_frame(sequence, renderer, index, entry.ratio)
        labels = labels_of(now, before)
        frame = storage.TrainingFrame(
            color=now.color, depth=now.render.depth, motion=now.render.motion.astype(np.float16),
            jitter=now.jitter, reset=now.reset, exposure=now.exposure,
            reference=now.reference.color.astype(np.float16), ghost=labels.ghost, alias=labels.alias,
            gbuffer_display=now.display.gbuffer(depth=True) if dataset.description.gbuffers else None,
        )  # fmt: skip
        storage.write_training_frame(dataset.path(entry, index), frame)
        before = now
        on_frame()


def _rerender(
    dataset: Dataset, own: Dataset, entry: SequenceEntry, renderer: Renderer, on_frame: OnFrame
) -> None:
    """Render a sequence a second time at the ratio of `entry`, from the first missing frame on.

    Raises a DatasetError if the first existing frame is rendered differently now.
    """
    sequence, display_size = make_sequence(entry.spec), dataset.description.display_size
    first = next(e for e in own.entries() if e.folder == entry.folder)
    existing = own.read(first, 0).color.astype(np.float32)
    size, jitter = render_size(display_size, first.ratio), halton_jitter(0, first.ratio)
    now, _ = renderer.frame(sequence.scene(0), size, jitter=jitter)
    if float(np.abs(now - existing).mean()) > MAX_DIFFERENCE * float(existing.mean()):
        hint = "Render a new set: the scenes or the renderer have changed since this one was rendered."
        raise DatasetError(dataset.path(first, 0), "differs from its rendering now", hint)
    for index in range(dataset.complete(entry), entry.spec.frames):
        jitter, size = halton_jitter(index, entry.ratio), render_size(display_size, entry.ratio)
        color, surfaces = renderer.frame(sequence.scene(index), size, jitter=jitter)
        motion = surfaces.motion.astype(np.float16)
        frame = storage.Rerendered(color, surfaces.depth, motion, jitter, surfaces.gbuffer())
        storage.write_rerendered(dataset.rerendered_path(entry, index), frame)
        on_frame()


def render_dataset(
    dataset: Dataset, *, ratio: float | None = None, workers: int = 1, on_frame: OnFrame = lambda: None
) -> None:
    """Render all missing frames in `workers` processes; with a ratio, a second rendering of all sequences.

    Raises:
        DataError: a worker failed (a full disk, no OpenGL, a changed file); complete frames stay, and the
            next run resumes.
        ShotError: another run renders into the folder.
    """
    folders = [entry.folder for entry in dataset.entries()]
    with FolderLock(dataset.folder):
        remove_partial_files(dataset.folder, _FRAME_FILE.fullmatch, folders)
        at = dataset.at(ratio) if ratio else dataset
        todo = [index for index, entry in enumerate(at.entries()) if at.complete(entry) < entry.spec.frames]
        indices = [todo[k::workers] for k in range(min(workers, len(todo)))]
        run_parts([partial(_render, dataset.folder, ratio, part) for part in indices], on_frame=on_frame)


def _render(folder: Path, ratio: float | None, indices: Sequence[int], on_frame: OnFrame) -> None:
    """Render some sequences in this process."""
    dataset = open_dataset(folder).at(ratio) if ratio else open_dataset(folder)
    description = dataset.description
    renderer = Renderer(description.display_size, samples=description.samples)
    for index in indices:
        render_sequence(dataset, description.sequences[index], renderer, on_frame=on_frame)
