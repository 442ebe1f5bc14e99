"""Scores of an ablation are those of the variant that they are given out for."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from supersampler import ArgumentError
from supersampler_bench.ablation import SUBJECTS, Ablation, Row, run_variant

METHOD = "gbuffer-small-4x"
FIRST, SECOND, *_ = SUBJECTS[METHOD]


@pytest.fixture(autouse=True)
def threads_and_seed() -> Iterator[None]:
    """A run sets both for its process."""
    threads, state = torch.get_num_threads(), torch.get_rng_state()
    yield
    torch.set_num_threads(threads)
    torch.set_rng_state(state)


def scored(folder: Path, **fields: object) -> Ablation:
    """One without data, so that what is not known fails; its second folder holds these scores."""
    (folder / "01").mkdir(parents=True)
    (folder / "01" / "scored-8.json").write_text(json.dumps(fields))
    return Ablation(METHOD, data=(), folder=folder, steps=8)


def test_a_variant_that_was_scored_is_not_trained_again(tmp_path: Path) -> None:
    ablation = scored(tmp_path, name=SECOND, psnr=31.0, tpsnr=30.0)
    assert run_variant(ablation, SECOND) == Row(SECOND, 31.0, 30.0)


@pytest.mark.parametrize("name", [{"name": FIRST}, {}])
def test_scores_of_another_variant_are_not_taken_for_its_own(tmp_path: Path, name: dict[str, str]) -> None:
    ablation = scored(tmp_path, **name, psnr=31.0, tpsnr=30.0)
    with pytest.raises(ArgumentError, match="data is nothing of use"):
        run_variant(ablation, SECOND)
