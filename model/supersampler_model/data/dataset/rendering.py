"""Plan and render a training set; a stopped run resumes after the last complete frame of each sequence."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from supersampler import halton_jitter
from supersampler.errors import ArgumentError
from supersampler.io.files import remove_partial_files
from supersampler_model.data.dataset.description import (
    Dataset,
    Description,
    SequenceEntry,
    Split,
    open_dataset,
)
from supersampler_model.data.dataset.frame_file import (
    Rerendered,
    TrainingFrame,
    write_rerendered,
    write_training_frame,
)
from supersampler_model.data.errors import DatasetError
from supersampler_model.data.labels import DEFAULTS, LabelThresholds
from supersampler_model.data.processes import OnFrame, run_parts
from supersampler_model.data.rendered import Rendered, labels_of
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.gltf.compose import Folder, read_folder
from supersampler_model.data.sequences import (
    APART_FAMILIES,
    TEST_FAMILIES,
    TRAIN_FAMILIES,
    SequenceSpec,
    make_sequence,
)
from supersampler_model.data.specs import Sequence as RenderedSequence

RATIOS = (1.0, 1.5, 2.0, 3.0, 4.0)
_RATIO_SHARES = (0.1, 0.2, 0.4, 0.2, 0.1)
_GOLDEN = (5.0**0.5 - 1.0) / 2.0  # its multiples fill [0, 1) evenly
_VALIDATION_EVERY = 8  # one sequence in eight is kept for validation; of other seeds, so of other scenes


@dataclass(frozen=True, kw_only=True)
class RenderPlan:
    """Options of the command line; sizes are (width, height).

    Attributes:
        gltf: folder of files to compose sequences of; None is procedural families alone.
        gltf_fraction: of the sequences that are composed of them, (0, 1]; the others are of `families`.
    """

    families: Sequence[str] = TRAIN_FAMILIES
    sequences: int = 60
    frames: int = 25
    display_size: tuple[int, int] = (640, 360)
    ratios: Sequence[float] = RATIOS
    samples: int = 64
    gbuffers: bool = False
    seed: int = 0
    gltf: Path | None = None
    gltf_fraction: float = 0.3


def plan_sequences(plan: RenderPlan) -> Description:
    """Draw the sequences of a set.

    Of procedural families, sequences for validation have other seeds than those to learn from; of glTF
    files, they also have other files, as far as there are two of a kind (stages, props, panoramas).

    Raises:
        ArgumentError: an unknown family, a ratio below 1, or nothing to render.
        SceneError: there is nothing to compose in the folder.
        GltfError: a file in it is broken or not supported.
    """
    _check(plan)
    random = np.random.default_rng(plan.seed)
    ratios = _RatioTurns(plan.ratios, random)
    folders = None if plan.gltf is None else read_folder(plan.gltf).split(plan.seed)
    entries = []
    for index in range(plan.sequences):
        seed = int(random.integers(1 << 31))
        composed, before = _composed(plan, index)
        spec, split = (
            _composition(plan, folders, before, seed)
            if folders is not None and composed
            else _staged(plan, index - before, seed)
        )
        entries.append(SequenceEntry(spec=spec, ratio=ratios.next(spec.family), split=split))
    return Description(
        display_size=plan.display_size,
        samples=plan.samples,
        gbuffers=plan.gbuffers,
        seed=plan.seed,
        sequences=tuple(entries),
    )


def _check(plan: RenderPlan) -> None:
    known = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)
    for family in plan.families:
        if family not in known:
            raise ArgumentError("families", got=repr(family), want=f"some of {', '.join(known)}")
    for name, least in (("sequences", 1), ("frames", 1), ("samples", 1)):
        if getattr(plan, name) < least:
            raise ArgumentError(name, got=getattr(plan, name), want=f"at least {least}")
    if not plan.families or not plan.ratios or min(plan.ratios) < 1.0:
        raise ArgumentError("ratios", got=list(plan.ratios), want="some of at least 1.0")
    if not 0.0 < plan.gltf_fraction <= 1.0:
        raise ArgumentError("gltf_fraction", got=plan.gltf_fraction, want="a fraction > 0 and <= 1")


class _RatioTurns:
    """Deals ratios to the sequences of each family: fixed frequencies, also over few sequences."""

    def __init__(self, ratios: Sequence[float], random: np.random.Generator) -> None:
        fractions = dict(zip(RATIOS, _RATIO_SHARES, strict=True))
        weights = np.array([fractions.get(ratio, 0.2) for ratio in ratios])
        self._ratios, self._ends = ratios, np.cumsum(weights / weights.sum())
        self._random = random
        self._turns: dict[str, float] = {}

    def next(self, family: str) -> float:
        turn = self._turns.get(family, self._random.random())
        self._turns[family] = (turn + _GOLDEN) % 1.0
        index = int(np.searchsorted(self._ends, turn, side="right"))
        return float(self._ratios[min(index, len(self._ends) - 1)])


def _composed(plan: RenderPlan, index: int) -> tuple[bool, int]:
    """Return whether sequence `index` is composed of files, and how many before it are: spread evenly."""
    fraction = 0.0 if plan.gltf is None else plan.gltf_fraction
    before, after = int(fraction * index + 0.5), int(fraction * (index + 1) + 0.5)
    return after > before, before


def _staged(plan: RenderPlan, index: int, seed: int) -> tuple[SequenceSpec, Split]:
    """Return procedural sequence `index`, and its split."""
    family = plan.families[index % len(plan.families)]
    spec = SequenceSpec(family=family, seed=seed, frames=plan.frames)
    if family in (*TEST_FAMILIES, *APART_FAMILIES):
        return spec, "test"
    return spec, _split(index // len(plan.families))


def _composition(
    plan: RenderPlan, folders: tuple[Folder, Folder | None], index: int, seed: int
) -> tuple[SequenceSpec, Split]:
    """Return glTF sequence `index`, and its split."""
    training, validation = folders
    if _split(index) == "validation" and validation is not None:
        return validation.spec(seed, plan.frames), "validation"
    return training.spec(seed, plan.frames), "train"


def _split(turn: int) -> Split:
    return "validation" if turn % _VALIDATION_EVERY == _VALIDATION_EVERY - 1 else "train"


MAX_DIFFERENCE = 0.01
"""Of the mean of two images of one frame by different drivers, relative."""


def render_sequence(
    dataset: Dataset,
    entry: SequenceEntry,
    renderer: Renderer,
    *,
    thresholds: LabelThresholds = DEFAULTS,
    on_frame: Callable[[], None] = lambda: None,
) -> None:
    """Render the missing frames of `entry`.

    For a set at one ratio (`Dataset.at`), write the second renderings beside the existing frames.

    Args:
        dataset: the data set.
        entry: the sequence.
        renderer: of the set's display size and samples.
        thresholds: of the labels.
        on_frame: called after each written frame.

    Raises:
        OSError: writing failed; all earlier frames are complete.
        DatasetError: the scenes have changed since the existing frames were rendered.
    """
    first = dataset.complete(entry)
    if first == entry.spec.frames:
        return
    if dataset.own is not None:
        _rerender(dataset, entry, renderer, on_frame)
        return
    sequence = make_sequence(entry.spec)
    before = _rendered(dataset, entry, sequence, renderer, max(first - 1, 0))
    for index in range(first, entry.spec.frames):
        rendered = before if index == 0 else _rendered(dataset, entry, sequence, renderer, index)
        labels = labels_of(rendered, before, thresholds)
        frame = TrainingFrame(
            color=rendered.color,
            depth=rendered.render.depth,
            motion=rendered.render.motion.astype(np.float16),
            jitter=rendered.jitter,
            reset=rendered.reset,
            exposure=rendered.exposure,
            reference=rendered.reference.color.astype(np.float16),
            ghost=labels.ghost,
            alias=labels.alias,
            gbuffer_display=rendered.display.gbuffer(depth=True) if dataset.description.gbuffers else None,
        )
        write_training_frame(dataset.path(entry, index), frame)
        before = rendered
        on_frame()


def _rerender(
    dataset: Dataset, entry: SequenceEntry, renderer: Renderer, on_frame: Callable[[], None]
) -> None:
    """Render the sequence a second time at the ratio of `entry`, from the first missing frame on."""
    sequence, size = make_sequence(entry.spec), entry.render_size(dataset.description.display_size)
    _check_same_images(dataset, entry, sequence, renderer)
    for index in range(dataset.complete(entry), entry.spec.frames):
        jitter = halton_jitter(index, entry.ratio)
        color, surfaces = renderer.frame(sequence.scene(index), size, jitter=jitter)
        motion = surfaces.motion.astype(np.float16)
        path = dataset.rerendered_path(entry, index)
        assert path is not None  # noqa: S101 - checked by the caller
        write_rerendered(path, Rerendered(color, surfaces.depth, motion, jitter, surfaces.gbuffer()))
        on_frame()


def _check_same_images(
    dataset: Dataset, entry: SequenceEntry, sequence: RenderedSequence, renderer: Renderer
) -> None:
    """Raise a DatasetError where the existing references show other images than are rendered now."""
    assert dataset.own is not None  # noqa: S101 - checked by the caller
    own = next(e for e in dataset.own.entries() if e.folder == entry.folder)
    size = own.render_size(dataset.description.display_size)
    there = dataset.own.read(own, 0).color.astype(np.float32)
    now, _ = renderer.frame(sequence.scene(0), size, jitter=halton_jitter(0, own.ratio))
    if float(np.abs(now - there).mean()) > MAX_DIFFERENCE * float(there.mean()):
        hint = "Render a new set: the scenes or the renderer have changed since this one was rendered."
        raise DatasetError(dataset.path(own, 0), "shows something else than is rendered now", hint)


def _rendered(
    dataset: Dataset, entry: SequenceEntry, sequence: RenderedSequence, renderer: Renderer, index: int
) -> Rendered:
    return renderer.render(
        sequence.scene(index),
        entry.render_size(dataset.description.display_size),
        jitter=halton_jitter(index, entry.ratio),
        reset=sequence.cut(index),
    )


_FRAMES = re.compile(r"\d{4,}(\.[\d.e+]+x)?\.safetensors")


def render_dataset(
    dataset: Dataset,
    *,
    ratio: float | None = None,
    workers: int = 1,
    on_frame: Callable[[], None] = lambda: None,
) -> None:
    """Render all missing frames.

    Args:
        dataset: the data set.
        ratio: of a second rendering of all sequences; None: the set itself.
        workers: processes; software OpenGL uses cores / workers threads in each.
        on_frame: called after each frame, in this process.

    Raises:
        DataError: a worker failed (a full disk, no OpenGL, a file that has changed); complete
            frames stay, and the next run resumes.
    """
    folders = [entry.folder for entry in dataset.entries()]
    remove_partial_files(dataset.folder, _FRAMES.fullmatch, folders)
    at = dataset if ratio is None else dataset.at(ratio)
    todo = [index for index, entry in enumerate(at.entries()) if at.complete(entry) < entry.spec.frames]
    indices = [todo[k::workers] for k in range(min(workers, len(todo)))]
    run_parts([partial(_render, dataset.folder, ratio, part) for part in indices], on_frame=on_frame)


def _render(folder: Path, ratio: float | None, indices: Sequence[int], on_frame: OnFrame) -> None:
    """Render some sequences in this process."""
    dataset = open_dataset(folder)
    dataset = dataset if ratio is None else dataset.at(ratio)
    description = dataset.description
    renderer = Renderer(description.display_size, samples=description.samples)
    for index in indices:
        render_sequence(dataset, description.sequences[index], renderer, on_frame=on_frame)
