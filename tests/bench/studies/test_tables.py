"""Tables that ablations wrote into the documentation equal their records."""

from pathlib import Path

import pytest

from studies.ablation import AblationRecord
from supersampler_bench.markdown import find_block
from supersampler_bench.record import read_record

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("method", ["classifier", "classifier-small", "gbuffer-small-4x"])
def test_the_table_of_an_ablation_is_what_its_record_says(method: str) -> None:
    content, start, stop = find_block(ROOT / "docs" / "results" / "methods.md", f"study ablation {method}")
    record = read_record(ROOT / "bench" / "results" / "studies" / f"ablation-{method}.json")
    found = AblationRecord.from_json(record)
    assert content[start:stop].strip("\n") == found.table_text("")
