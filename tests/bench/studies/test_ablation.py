"""Tests of the study that trains variants: which runs it makes, and what its table calls chance."""

from pathlib import Path

from studies.ablation import BATCH, Ablation, AblationRecord, Row, Scores


def ablation(seeds: int) -> Ablation:
    return Ablation("classifier-small", [], Path("nowhere"), steps=800, seeds=seeds)


def row(name: str, *psnr: float) -> Row:
    return Row(name, [Scores(value, value - 1.0) for value in psnr])


def test_the_first_variant_has_two_seeds_at_least_and_a_seed_is_complete_before_the_next() -> None:
    first, *others = ablation(1).variants
    assert ablation(1).runs == [(first, 0), *((name, 0) for name in others), (first, 1)]
    assert ablation(3).runs == [(name, seed) for seed in range(3) for name in (first, *others)]


def test_differences_within_the_range_of_the_seeds_are_in_brackets() -> None:
    rows = [row("all", 30.0, 30.2), row("less", 29.95), row("worse", 29.8), row("unsteady", 29.0, 30.3)]
    table = AblationRecord("classifier-small", 800, BATCH, 128, rows).table().splitlines()
    assert table[2:6] == [
        "| all | 30.10 ± 0.10 | +0.00 | 29.10 | 2 |",
        "| less | 29.95 | (-0.15) | 28.95 | 1 |",
        "| worse | 29.80 | -0.30 | 28.80 | 1 |",
        "| unsteady | 29.65 ± 0.65 | (-0.45) | 28.65 | 2 |",
    ]
    assert "128x128" in table[-1]
    assert "0.20 dB" in table[-1]
