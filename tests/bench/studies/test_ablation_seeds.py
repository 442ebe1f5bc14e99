"""The ablation from several seeds: its variants, and what its table calls chance."""

from dataclasses import asdict

import pytest

from studies.ablation_seeds import VARIANTS, markdown_table
from supersampler_bench.record import Record


def table_of(*differences: tuple[float, float, float]) -> list[list[str]]:
    """Rows of the table of variants whose PSNR over three seeds is 30 plus these; tPSNR is less by 2."""
    rows = [
        {"name": f"variant {i}", "psnr": [30.0 + d for d in own], "tpsnr": [28.0 + d for d in own]}
        for i, own in enumerate(differences)
    ]
    record: Record = {"seeds": 3, "plan": {"steps": 10, "batch": 2}, "rows": rows}
    return [
        [c.strip() for c in line.strip("|").split("|")] for line in markdown_table(record).splitlines()[2:]
    ]


def test_a_difference_within_the_spread_of_the_seeds_is_called_chance() -> None:
    first, second, *_ = table_of((0.0, 0.02, 0.04), (0.05, 0.06, 0.07))
    assert first[1:4] == ["30.02", "0.04", "–"]
    assert second[1:4] == ["30.06", "0.02", "chance"]


def test_a_difference_beyond_both_spreads_is_a_number() -> None:
    _, second, third, *_ = table_of((0.0, 0.02, 0.04), (-0.3, -0.2, -0.1), (0.3, 0.32, 0.34))
    assert second[3] == "-0.22"
    assert third[3] == "+0.30"


def test_the_spread_of_a_variant_of_wide_spread_counts_too() -> None:
    _, second, *_ = table_of((0.0, 0.02, 0.04), (-0.5, 0.0, 0.5))
    assert second[3] == "chance"


@pytest.mark.parametrize(("name", "field"), [(list(VARIANTS)[1], "losses"), (list(VARIANTS)[2], "config")])
def test_a_variant_differs_from_the_first_in_one_field(name: str, field: str) -> None:
    first, other = (VARIANTS[n]() for n in (next(iter(VARIANTS)), name))
    of_first, of_other = (asdict(t.losses) | t.config for t in (first, other))
    changed = {key for key in of_first if of_first[key] != of_other[key]}
    assert changed == ({"classes"} if field == "losses" else {"recurrent"})
