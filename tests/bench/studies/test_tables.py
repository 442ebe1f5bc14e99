"""Tables that ablations wrote into the documentation equal their records."""

from pathlib import Path

import pytest

from studies.ablation import AblationRecord
from studies.taa_options import TaaOptionsRecord
from supersampler_bench.markdown import find_block
from supersampler_bench.record import BenchRecord, read_record

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("block", "record", "kind"),
    [
        *(
            (f"ablation {method}", f"ablation-{method}", AblationRecord)
            for method in ("classifier", "classifier-small", "gbuffer-small-4x")
        ),
        ("salvi-options test-shots", "salvi-options", TaaOptionsRecord),
    ],
)
def test_the_table_of_a_study_is_what_its_record_says(
    block: str, record: str, kind: type[BenchRecord]
) -> None:
    content, start, stop = find_block(ROOT / "docs" / "results" / "methods.md", f"study {block}")
    found = kind.from_json(read_record(ROOT / "bench" / "results" / "studies" / f"{record}.json"))
    assert content[start:stop].strip("\n") == found.table_text("")
