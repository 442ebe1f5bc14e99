"""The plan of a training set: its families take turns; glTF files, ratios and seeds follow from one seed."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset.description import Description, SequenceEntry, Split
from supersampler_model.data.scenes.gltf.folder import Folder, read_folder
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES, TRAIN_FAMILIES, SequenceSpec

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
