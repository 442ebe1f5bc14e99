"""The first picture is timed where kernels are compiled, and where they are kept."""

from supersampler_bench.timing.startup import Started, markdown_table, measure_start, start_record


def test_kernels_are_compiled_in_the_fresh_process_and_kept_for_the_later() -> None:
    started: list[int] = []
    (result,) = measure_start(["taa"], (64, 36), fresh=1, later=2, on_start=lambda: started.append(1))
    assert result.method == "taa"
    assert len(started) == 3
    assert result.kept > 10_000
    assert 0.0 < result.later < result.fresh


def test_the_table_has_a_row_for_each_method() -> None:
    record = start_record([Started("taa", 2.04, 0.214, 4096)], (480, 270), 2.0)
    table = markdown_table({**record, "machine": {"cpu": "A", "cores": 2}})
    assert "| taa | 2.0 | 0.21 | 4 |" in table
    assert "480x270" in table
