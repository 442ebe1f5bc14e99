"""First-frame time with an empty and with a full kernel cache."""

import pytest

from gpu_steps import device_or_skip
from supersampler_bench.timing.against import FirstFrame, StartupRecord, measure_startup


@pytest.mark.long  # in new processes
def test_kernels_are_compiled_in_the_fresh_process_and_kept_for_the_later() -> None:
    started: list[int] = []
    (result,) = measure_startup(["taa"], (64, 36), cold=1, warm=2, on_process=lambda: started.append(1))
    assert result.method == "taa"
    assert len(started) == 3
    assert result.cache_bytes > 10_000
    assert 0.0 < result.warm_seconds < result.cold_seconds


@pytest.mark.long  # in new processes
def test_a_program_on_the_gpu_is_timed_from_its_start_too() -> None:
    device_or_skip()
    (result,) = measure_startup(["taa:gpu"], (64, 36), cold=1, warm=1)
    assert result.method == "taa:gpu"
    assert result.warm_seconds > 0.0


def test_the_table_has_a_row_for_each_method() -> None:
    record = StartupRecord((480, 270), 2.0, [FirstFrame("taa", 2.04, 0.214, 4096)])
    table = record.table()
    assert "| taa | 2.0 | 0.21 | 4 |" in table
    assert "480x270" in table
