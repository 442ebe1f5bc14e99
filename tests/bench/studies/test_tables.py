"""Tables that ablations wrote into the documentation equal their records."""

from collections.abc import Callable
from pathlib import Path

import pytest

from studies import ablation, taa_options
from supersampler_bench.markdown_blocks import find_block
from supersampler_bench.record import Record, read_record

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("block", "record", "table"),
    [
        *(
            (f"ablation {method}", f"ablation-{method}", ablation.markdown_table)
            for method in ("classifier", "classifier-small", "gbuffer-small-4x")
        ),
        ("salvi-options test-shots", "salvi-options", taa_options.markdown_table),
    ],
)
def test_the_table_of_a_study_is_what_its_record_says(
    block: str, record: str, table: Callable[[Record], str]
) -> None:
    content, start, stop = find_block(ROOT / "docs" / "results" / "methods.md", f"study {block}")
    found = read_record(ROOT / "bench" / "results" / "studies" / f"{record}.json")
    assert content[start:stop].strip("\n") == table(found)
