"""Which sequences to render: families in turn, ratios and seeds drawn from one number."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset.description import Description, SequenceEntry, Split
from supersampler_model.data.sequences import TEST_FAMILIES, TRAIN_FAMILIES, SequenceSpec

RATIOS = (1.0, 1.5, 2.0, 3.0, 4.0)
_RATIO_SHARES = (0.1, 0.2, 0.4, 0.2, 0.1)
_VALIDATION_EVERY = 8  # one sequence in eight is kept for validation; of other seeds, so of other scenes


@dataclass(frozen=True, kw_only=True)
class RenderPlan:
    """What is asked for on the command line; sizes are (width, height)."""

    families: Sequence[str] = TRAIN_FAMILIES
    sequences: int = 60
    frames: int = 25
    frame_rate: float = 30.0
    display_size: tuple[int, int] = (640, 360)
    ratios: Sequence[float] = RATIOS
    samples: int = 64
    gbuffers: bool = False
    seed: int = 0


def plan_sequences(plan: RenderPlan) -> Description:
    """Draw the sequences of a set.

    Raises:
        ArgumentError: an unknown family, a ratio below 1, or nothing to render.
    """
    known = (*TRAIN_FAMILIES, *TEST_FAMILIES)
    for family in plan.families:
        if family not in known:
            raise ArgumentError("families", got=repr(family), want=f"some of {', '.join(known)}")
    for name, least in (("sequences", 1), ("frames", 1), ("samples", 1)):
        if getattr(plan, name) < least:
            raise ArgumentError(name, got=getattr(plan, name), want=f"at least {least}")
    if not plan.families or not plan.ratios or min(plan.ratios) < 1.0:
        raise ArgumentError("ratios", got=list(plan.ratios), want="some of at least 1.0")
    random = np.random.default_rng(plan.seed)
    weights = np.array([dict(zip(RATIOS, _RATIO_SHARES, strict=True)).get(r, 0.2) for r in plan.ratios])
    entries = tuple(_entry(plan, index, random, weights / weights.sum()) for index in range(plan.sequences))
    return Description(
        display_size=plan.display_size,
        samples=plan.samples,
        gbuffers=plan.gbuffers,
        seed=plan.seed,
        sequences=entries,
    )


def _entry(
    plan: RenderPlan,
    index: int,
    random: np.random.Generator,
    weights: "np.ndarray[tuple[int], np.dtype[np.float64]]",
) -> SequenceEntry:
    families = tuple(plan.families)
    family = families[index % len(families)]
    spec = SequenceSpec(
        family=family,
        seed=int(random.integers(1 << 31)),
        frames=plan.frames,
        frame_rate=plan.frame_rate,
    )
    ratio = float(random.choice(plan.ratios, p=weights))
    split: Split = "train"
    if family in TEST_FAMILIES:
        split = "test"
    elif index // len(families) % _VALIDATION_EVERY == _VALIDATION_EVERY - 1:
        split = "validation"
    return SequenceEntry(spec=spec, ratio=ratio, split=split)
